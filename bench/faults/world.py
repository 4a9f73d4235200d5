"""One robot under attack: emulated devices, a service in a process of its own, a Zenoh router and a subscriber in
theirs, and a witness of its database."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from types import TracebackType

from tests.daemon.alarm_world import Watcher
from tests.daemon.canbus import SlcanAdapter
from tests.daemon.zenoh_world import Router

from bench.sinks import CAN_TABLE, free_port
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine

__all__ = ["NODE", "Witness", "World"]

NODE = 0x21
SERVOS, SENSOR, CAN = range(3)
ROBOT = """
[robot]
name = "arm"
[store]
path = "{folder}/state/history.db"
[[accelerometer]]
name = "tip"
driver = "csv_serial"
port = "{folder}/port.1"
rate_hz = 1000
time_column = 0
column = 1
oscillator = {{ f_res_hz = 58.0 }}
[[joint]]
name = "elbow"
driver = "dynamixel"
port = "{folder}/port.0"
model = "AX-12A"
id = 3
accelerometer = "tip"
[alarm]
off_delay_s = 0
[metrics]
listen = "127.0.0.1:{metrics}"
[alarm.zenoh]
mode = "client"
connect = ["{endpoint}"]
"""
LOOK_S, START_S, LEFT_S = 0.25, 60.0, 5.0


class World:
    """Devices and service; ``said`` is all that every service of this world has logged, ``wrong`` what an attack has
    found broken."""

    router: Router
    watcher: Watcher

    def __init__(self, folder: Path, dice: random.Random) -> None:
        self.folder, self.dice = folder, dice
        self.config, self.ahead = folder / "robot.toml", folder / "ahead"
        self.database = folder / "state" / "history.db"
        motion = Motion(play=dice.choice((0.0, 1.0)))
        self.line, self.stream, self.adapter = ServoLine.of("AX-12A", [3], motion), CsvStream(motion), SlcanAdapter()
        self.emulator = Emulator(self.line, self.stream, self.adapter, link=folder / "port")
        self.metrics, self.endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
        robot = ROBOT.format(folder=folder, metrics=self.metrics, endpoint=self.endpoint)
        self.text = robot + CAN_TABLE.format(port=f"{folder}/port.2")
        self.said = ""
        self.wrong: list[str] = []
        self.exits: list[int] = []
        self._starting, self._ended = threading.Lock(), threading.Event()
        self._starved: set[int] = set()
        self._put: int | None = None  # how often a file had been left when another one was put in its place
        self.process: subprocess.Popen[str] | None = None

    def __enter__(self) -> World:
        self.config.write_text(self.text)
        self.ahead.write_text("0")
        self.emulator.__enter__()
        self.router = Router(self.folder, self.endpoint)
        self.watcher = Watcher(self.endpoint, self.folder / "watched")
        self.start()
        threading.Thread(target=self._supervise, daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        with self._starting:
            self.kill()
        self.watcher.close()
        self.router.close()
        self.emulator.__exit__(kind, error, trace)

    @property
    def pid(self) -> int:
        """Of the service that runs."""
        assert self.process is not None
        return self.process.pid

    def left(self) -> int:
        """How often a service has left a file; that it will is said up to a second before."""
        return self.said.count("while it was open; the service continues in a new one\n")

    def put(self, database: Path | None) -> None:
        """Puts another file in the place of the database, or none."""
        self._put = self.left()
        if database is None:
            self.database.unlink()
        else:
            database.rename(self.database)

    @property
    def is_starved(self) -> bool:
        """Whether the service that runs has no memory left, so that nobody need be answered."""
        return self.pid in self._starved

    def is_mixed(self) -> bool:
        """Whether a file was put there that the service has not noticed: beside the log of the old one a reader sees a
        mixture of both, of which nothing is promised."""
        return self._put is not None and self.left() <= self._put

    def settle(self) -> None:
        """Waits until the service has left a file that was replaced or deleted: before that it does not notice what
        happens to the new one, and takes away its log."""
        end = time.monotonic() + LEFT_S
        while (self.is_mixed() or not self._is_begun()) and time.monotonic() < end:
            time.sleep(0.05)

    def _is_begun(self) -> bool:
        """Whether the service has made its tables."""
        with suppress(sqlite3.Error), closing(sqlite3.connect(f"{self.database.as_uri()}?mode=ro", uri=True)) as db:
            return bool(db.execute("SELECT count(*) FROM sqlite_master WHERE name = 'scores'").fetchone()[0])
        return False

    def start(self) -> None:
        """Starts the service, with a clock that ``ahead`` sets, and waits until it has started: before that SIGHUP ends
        it as it ends any program."""
        length, self._put = len(self.said), None
        command = [sys.executable, "-m", "tests.daemon.fakes", str(self.config)]
        environment = os.environ | {"FAKE_CLOCK": str(self.ahead), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
        threading.Thread(target=self._listen, args=(self.process,), daemon=True).start()
        end = time.monotonic() + START_S
        while "started: robot" not in self.said[length:] and self.process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)

    def revive(self) -> None:
        """Starts the service where it has ended, as systemd does; once, whoever notices."""
        with self._starting:
            if self.process is not None and self.process.poll() is not None:
                self.start()

    def starve(self) -> None:
        """From now on lack of memory may end this process, at any time: it is begun again."""
        self._starved.add(self.pid)

    def _supervise(self) -> None:
        while not self._ended.wait(0.2):
            if self.process is not None and self.process.pid in self._starved:
                self.revive()

    def kill(self) -> None:
        """Ends it at once."""
        assert self.process is not None
        self._starved.discard(self.process.pid)
        self.process.kill()
        self.process.wait()

    def stop(self) -> int:
        """Ends it as systemd does; its exit status."""
        assert self.process is not None
        self._ended.set()
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(30)

    def _listen(self, process: subprocess.Popen[str]) -> None:
        assert process.stderr is not None
        for line in process.stderr:
            self.said += line


class Witness:
    """Reads the database all the while: ``seen`` are the scores committed to each file; ``wrong`` what must not be.

    file: a number that changes with each file that the service begins: a filesystem gives inodes anew; is_mixed:
    whether what is read at present is no file of the service's.
    """

    def __init__(
        self, database: Path, file: Callable[[], int] = lambda: 0, is_mixed: Callable[[], bool] = lambda: False
    ) -> None:
        self._database = database
        self._file, self._is_mixed = file, is_mixed
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self.seen: dict[tuple[int, int], set[float]] = {}
        self.wrong: set[str] = set()
        self._thread.start()

    def close(self) -> None:
        """Looks no more."""
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._done.wait(LOOK_S):
            with suppress(sqlite3.Error, OSError):
                self.look()

    def look(self) -> None:
        """One look, in one transaction."""
        is_mixed, inode = self._is_mixed(), (self._file(), self._database.stat().st_ino)
        with closing(sqlite3.connect(f"{self._database.as_uri()}?mode=ro", uri=True, timeout=1.0)) as db:
            db.execute("BEGIN")
            scores = {row[0] for row in db.execute("SELECT score FROM scores WHERE score IS NOT NULL")}
            sound = db.execute("SELECT count(*) FROM scores WHERE quality = 'ok' OR quality = 'clock'").fetchone()[0]
            healths = [row[0] for row in db.execute("SELECT health FROM joints")]
            faults = db.execute(
                "SELECT count(*) FROM alarms WHERE cause = 'device' AND state IN ('active', 'acknowledged')"
            ).fetchone()[0]
        if is_mixed or self._is_mixed() or (self._file(), self._database.stat().st_ino) != inode:
            return  # which file was read is not known
        if "OK" in healths and (sound < 5 or faults):
            self.wrong.add(f"OK with {sound} sound windows and {faults} device alarms")
        before = self.seen.get(inode, set())
        if lost := before - scores:
            self.wrong.add(f"{len(lost)} committed scores are gone")
        self.seen[inode] = before | scores
