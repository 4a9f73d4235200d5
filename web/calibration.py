"""A calibration under way: what is being recorded, what has been found, and which change of the configuration follows.

Where a service runs it has the sensor, and records on request (``daemon/tasks.py``); else ``lostmotion record`` does,
in a process of its own.  Either way there is a recording that grows, and all that is shown is computed from it here,
while somebody looks.
"""

from __future__ import annotations

import json
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from lostmotion.daemon import requests
from lostmotion.daemon.database import is_held
from lostmotion.daemon.records import Request, Task
from lostmotion.daemon.tasks import recording_path
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.errors import LostmotionError
from lostmotion.web.config_file import Change, ConfigFile, edited
from lostmotion.web.lab import PROGRAM
from lostmotion.web.measuring import Motion, Taps, motion, taps
from lostmotion.web.site import Site

__all__ = ["Calibration", "CalibrationError", "State", "Step"]

Step = Literal["taps", "motion"]
LONGEST_S: dict[Step, float] = {"taps": 180.0, "motion": 1800.0}
"""what is recorded at most [s]"""
ANSWER_S = 20.0
"""how long the service may take: a new configuration waits for open windows and new ports [s]"""
REST = 3.0
"""after each look at the recording so many times as long is left to others"""
LEAST_REST_S = 0.5
QUIET_S = 6.0
"""a recording that does not grow for so long has no sensor behind it [s]"""
FIRST_ROWS_S = 3.0
"""a recording may be without any rows for so long [s]"""
JUDGING_S = 900.0
ENDING_S = 10.0


class CalibrationError(LostmotionError):
    """This cannot be done now."""


@dataclass(frozen=True, slots=True)
class State:
    """All that the page shows.  step: what is recorded now, "" for nothing; false_alarm: the rate that is to be
    promised; is_judging: whether settings and level are being computed; said: the last messages of a command or of the
    service; trouble: what went wrong last; change, back: of the configuration; bar: resonance [Hz] and damping in the
    file, by joint."""

    joint: str = ""
    step: Step | Literal[""] = ""
    false_alarm: float = 0.01
    taps: Taps | None = None
    history: tuple[Taps, ...] = ()
    motion: Motion | None = None
    is_judging: bool = False
    said: tuple[str, ...] = ()
    trouble: str = ""
    change: Change | None = None
    back: Change | None = None
    bar: Mapping[str, tuple[float, float]] = field(default_factory=dict)


class Calibration:
    """One for all pages: a robot has one sensor to tap.  Methods raise LostmotionError, and may wait."""

    def __init__(self, site: Site) -> None:
        self._site = site
        self._lock = threading.RLock()
        self._state = State()
        self._recorder: subprocess.Popen[bytes] | None = None
        self._path = Path()
        self._oscillator: dict[str, float] = {}
        self._detector: dict[str, Any] = {}
        self._began = self._rest_until = 0.0

    def look(self) -> State:
        """The state; measures what has come in, but not without pauses."""
        with self._lock:
            if self._state.step and time.monotonic() - self._began > LONGEST_S[self._state.step]:
                self.end()
            elif self._state.step and time.monotonic() >= self._rest_until:
                began = time.monotonic()
                dead = self._dead()
                self._measure()
                if dead:
                    self._update(trouble=dead)
                self._rest_until = time.monotonic() + max(LEAST_REST_S, REST * (time.monotonic() - began))
            return self._with_changes()

    def begin(self, joint: str, step: Step, false_alarm: float, by: str) -> None:
        """Records a joint and its accelerometer; what was found of another joint is forgotten."""
        with self._lock:
            self._expect_idle()
            self._site.config().joint(joint)
            if joint != self._state.joint:
                self._oscillator, self._detector, self._state = {}, {}, State(joint)
            self._path, self._recorder = self._start(joint, step, by)
            fresh: dict[str, Any] = {"taps": None, "history": ()} if step == "taps" else {"motion": None}
            self._update(step=step, false_alarm=false_alarm, said=(), trouble="", **fresh)
            self._began, self._rest_until = time.monotonic(), 0.0

    def end(self) -> None:
        """Ends the recording, and estimates the bar from it, or judges the motion."""
        with self._lock:
            step = self._state.step
            if not step:
                return
            self._stop()
            self._measure()
            self._update(step="")
            if step == "motion" and self._state.motion and not self._state.trouble:
                self._update(is_judging=True)
                threading.Thread(target=self._judge, name="judge", daemon=True).start()

    def forget(self) -> None:
        """Gives up what was found."""
        with self._lock:
            self._expect_idle()
            self._oscillator, self._detector, self._state = {}, {}, State(self._state.joint)

    def write(self, digest: str, by: str) -> None:
        """Writes the change that was shown; the service reloads the file."""
        with self._lock:
            self._expect_idle()
            file = self._file()
            file.write(self._new(file.text()), digest)
            self._oscillator, self._detector = {}, {}
            self._update(said=(f"{file.path.name} is written.", self._reload(by)), trouble="")

    def take_back(self, digest: str, by: str) -> None:
        """Restores the previous file; the service reloads it."""
        with self._lock:
            self._expect_idle()
            file = self._file()
            file.take_back(digest)
            self._update(said=(f"{file.path.name} is as it was.", self._reload(by)), trouble="")

    def close(self) -> None:
        """Ends a recording that runs."""
        with self._lock:
            if self._state.step:
                self._stop()

    # --- recording --------------------------------------------------------------------------------------------------

    def _start(self, joint: str, step: Step, by: str) -> tuple[Path, subprocess.Popen[bytes] | None]:
        """The recording that grows, and the process that writes it where the service does not."""
        database = self._site.database
        if is_held(database):
            path = recording_path(database, self._ask(Task.RECORD, joint, LONGEST_S[step], by)[0])
            return path, None
        config = self._file().path
        sensor = self._site.config().joint(joint).accelerometer
        path = recording_path(database, 0).with_name("page.csv")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.unlink(missing_ok=True)
            log = path.with_suffix(".log").open("wb")
        except OSError as error:
            raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from error
        whom = ["--joint", joint] if step == "motion" else ["--accelerometer", sensor]
        command = [*PROGRAM, "record", "--config", str(config), "--duration", f"{LONGEST_S[step]:g}", "-o", str(path)]
        with log:
            return path, subprocess.Popen([*command, *whom], stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def _stop(self) -> None:
        """The whole recording is there when this returns."""
        if self._recorder is None:
            try:
                self._ask(Task.RECORD, self._state.joint, 0.0, "")
            except LostmotionError as error:  # the service has gone; what it recorded is there
                self._update(said=(str(error),))
            size = -1
            while size != (size := self._path.stat().st_size if self._path.exists() else 0):
                time.sleep(0.5)
            return
        if self._recorder.poll() is None:
            self._recorder.send_signal(signal.SIGINT)
        try:
            self._recorder.wait(ENDING_S)
        except subprocess.TimeoutExpired:
            self._recorder.kill()
            self._recorder.wait()
        self._recorder = None

    def _measure(self) -> None:
        """Looks at what has been recorded so far."""
        if not self._path.exists():
            return
        try:
            if self._state.step == "taps":
                self._take_taps(taps(self._path))
            else:
                self._update(motion=self._motion())
            self._update(trouble="")
        except LostmotionError as error:
            if time.monotonic() - self._began > FIRST_ROWS_S:
                self._update(trouble=str(error))

    def _motion(self) -> Motion:
        return motion(self._path, self._settings(), self._state.false_alarm, self._state.motion)

    def _take_taps(self, found: Taps) -> None:
        before = self._state.taps
        self._update(taps=found)
        if found.f_res_hz is None or found.zeta is None:
            return
        if before is None or before.taps != found.taps:
            self._update(history=(*self._state.history, replace(found, frequency=[], amplitude=[])))
        self._oscillator = {"f_res_hz": round(found.f_res_hz.value, 3), "zeta": round(found.zeta.value, 5)}

    def _dead(self) -> str:
        """Why nothing more is recorded, "" where all is well."""
        if self._recorder is not None and (status := self._recorder.poll()):
            self._recorder = None
            self._update(step="")
            lines = self._path.with_suffix(".log").read_text("utf-8", "replace").strip().splitlines()
            return lines[-1].removeprefix("lostmotion: ") if lines else f"the recording ended with status {status}"
        since_s = time.time() - self._path.stat().st_mtime if self._path.exists() else time.monotonic() - self._began
        return "nothing comes from the sensor: is it plugged in?" if since_s > QUIET_S else ""

    def _settings(self) -> DetectorSettings:
        settings = self._site.config().settings(self._state.joint)
        bar = {"f_res_hz": settings.f_res_hz, "zeta": settings.zeta} | self._oscillator
        return replace(settings, f_res_hz=bar["f_res_hz"], zeta=bar["zeta"])

    # --- judging ----------------------------------------------------------------------------------------------------

    def _judge(self) -> None:
        """Settings and level from the recorded motion, by the commands that do so; in a thread of its own."""
        try:
            detector, messages = self._judged()
        except (LostmotionError, OSError, subprocess.SubprocessError, ValueError) as error:
            text = str(error).replace("promise less with --false-alarm", "allow more false alarms")
            with self._lock:
                self._update(is_judging=False, trouble=text)
            return
        with self._lock:
            self._detector = detector
            self._update(is_judging=False, said=messages)

    def _judged(self) -> tuple[dict[str, Any], tuple[str, ...]]:
        joint, text = self._state.joint, self._file().text()
        with tempfile.TemporaryDirectory(prefix="lostmotion-") as folder:
            config = Path(folder) / "trial.toml"
            config.write_text(edited(text, joint, self._oscillator, {}), "utf-8")
            healthy = self._run("healthy", config, joint)
            detector = healthy["settings"]
            config.write_text(edited(text, joint, self._oscillator, detector), "utf-8")
            level = self._run("level", config, joint, "--false-alarm", str(self._state.false_alarm))
        count, limit, found = level["healthy"], level["level"], max(healthy["found"].values())
        words = f"{count} healthy windows: the level is {limit:g}, and {found:.0%} of weak rings are found"
        messages = (f"{words} at false alarms below 10 %.", *healthy["warnings"], *level["warnings"])
        return detector | {"level": limit}, messages

    def _run(self, command: str, config: Path, joint: str, *more: str) -> Any:
        """The document that ``lostmotion calibrate`` prints: SciPy and its memory are another process's."""
        arguments = ["calibrate", command, str(self._path), "--config", str(config), "--joint", joint, "--json", *more]
        done = subprocess.run([*PROGRAM, *arguments], capture_output=True, text=True, timeout=JUDGING_S)
        if done.returncode:
            lines = done.stderr.strip().splitlines()
            raise CalibrationError(lines[-1].removeprefix("lostmotion: ") if lines else f"status {done.returncode}")
        return json.loads(done.stdout)

    # --- the configuration ------------------------------------------------------------------------------------------

    def _with_changes(self) -> State:
        """The state with what would change in the file, and what could be taken back."""
        if self._site.config_file is None:
            return self._state
        try:
            file = self._file()
            change = file.change(self._new(file.text())) if self._oscillator or self._detector else None
            return replace(self._state, change=change, back=file.change_back(), bar=self._bars())
        except LostmotionError as error:
            return replace(self._state, trouble=self._state.trouble or str(error))

    def _bars(self) -> dict[str, tuple[float, float]]:
        config = self._site.config()
        bars = {joint.name: config.accelerometer(joint.accelerometer).oscillator for joint in config.joints}
        return {name: (bar.f_res_hz, bar.zeta) for name, bar in bars.items()}

    def _new(self, text: str) -> str:
        return edited(text, self._state.joint, self._oscillator, self._detector)

    def _file(self) -> ConfigFile:
        if self._site.config_file is None:
            raise CalibrationError("the built-in robot has no file to write: start the page with --config FILE")
        return ConfigFile(self._site.config_file)

    def _reload(self, by: str) -> str:
        """Lets the service reload the file; the result as a message."""
        if not is_held(self._site.database):
            return "No service runs; it takes the file when it starts."
        try:
            return f"{self._ask(Task.RELOAD, '', 0.0, by)[1]}.".capitalize()
        except LostmotionError as error:
            return str(error)

    def _ask(self, task: Task, joint: str, for_s: float, by: str) -> tuple[int, str]:
        """Number and answer of a request.  Raises CalibrationError when the service refuses, or does not answer."""
        database = self._site.database
        number = requests.ask(database, Request(0, joint, task, None, for_s, by), datetime.now(UTC))
        answer = requests.wait(database, number, ANSWER_S)
        if answer is None:
            raise CalibrationError(f"the service has not answered within {ANSWER_S:g} s: is it of this version?")
        if not answer.done:
            raise CalibrationError(answer.text)
        return number, answer.text

    def _expect_idle(self) -> None:
        if self._state.step or self._state.is_judging:
            raise CalibrationError(f"joint {self._state.joint} is being calibrated: end that first")

    def _update(self, **values: Any) -> None:
        self._state = replace(self._state, **values)
