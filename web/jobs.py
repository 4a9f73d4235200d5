"""Jobs: commands that take long, each in a process of its own with limits, one at a time on a robot.

All that is known of a job lies in its folder, so that a page that is loaded again, and a server that was started again,
find it as it is.  ``lab.py`` defines jobs, ``runner.py`` runs them.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from lostmotion.drivers.errors import LostmotionError

__all__ = ["BusyError", "FullError", "Job", "JobError", "Jobs", "Limits"]

ID = re.compile(r"\d{8}T\d{6}-[0-9a-f]{6}")
MOST_KEPT = 40
"""jobs; the oldest go first"""
STOPPING_S = 5.0
"""how long a job may take to end by itself [s]"""
LINES = 40
"""of progress that are returned"""
LEAST_FREE = 300 * 10**6
"""bytes that have to be free on the disk: the database needs them"""
TAIL = 20_000
"""bytes of the log that are looked at"""


class JobError(LostmotionError):
    """There is no such job, or it cannot be begun; status: of HTTP."""

    status = 404


class BusyError(JobError):
    """Another job is under way."""

    status = 409


def _memory() -> int:
    """Half of the machine's, but 2 GB are plenty [bytes]."""
    return min(os.sysconf("SC_PAGESIZE") * os.sysconf("SC_PHYS_PAGES") // 2, 2 * 10**9)


class FullError(JobError):
    """There is no room for what a job leaves."""

    status = 507


class Limits(msgspec.Struct, frozen=True):
    """Of a job: its time, its memory, the size of a file that it writes, its niceness."""

    time_s: float = 900.0
    memory_bytes: int = msgspec.field(default_factory=_memory)
    file_bytes: int = 500 * 10**6
    nice: int = 10


class Wish(msgspec.Struct, frozen=True):
    """The commands of a job, one after the other; about: data of its creator."""

    about: dict[str, Any]
    steps: list[list[str]]
    cwd: str
    limits: Limits
    created: float


class State(msgspec.Struct, frozen=True):
    """running, done, failed, stopped or interrupted; text: a message for the user; times since 1970 [s]."""

    state: str
    text: str = ""
    began: float | None = None
    ended: float | None = None


class Job(msgspec.Struct, frozen=True):
    """A job as it is now; progress: its reports, oldest first, ``{"progress", "part"}``; files: what it left."""

    id: str
    about: dict[str, Any]
    created: float
    state: str
    text: str
    began: float | None
    ended: float | None
    progress: list[dict[str, Any]]
    files: list[str]


class Jobs:
    """The jobs of a folder."""

    def __init__(self, folder: Path, limits: Limits | None = None) -> None:
        self.folder = folder
        self.limits = limits or Limits()
        self._runner: subprocess.Popen[bytes] | None = None
        self._mutex = threading.Lock()

    def new(self) -> Path:
        """A folder for a job that is to be started; its name is the job's id.  Raises FullError."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if shutil.disk_usage(self.folder).free < LEAST_FREE:
            raise FullError("the robot's disk is nearly full: remove some recordings or runs first")
        folder = self.folder / f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{secrets.token_hex(3)}"
        folder.mkdir(mode=0o700)
        return folder

    def start(
        self, folder: Path, steps: Sequence[Sequence[str]], cwd: Path, about: Mapping[str, Any], nice: int | None = None
    ) -> str:
        """Begins a job in a folder of ``new``; its id.  Raises BusyError, the folder gone, where another runs."""
        limits = self.limits if nice is None else msgspec.structs.replace(self.limits, nice=nice)
        wish = Wish(dict(about), [list(step) for step in steps], str(cwd), limits, time.time())
        with self._mutex:
            try:
                with self._exclusive() as lock:
                    (folder / "wish.json").write_bytes(msgspec.json.encode(wish))
                    (folder / "state.json").write_bytes(msgspec.json.encode(State("running", began=time.time())))
                    self._begin(folder, lock)
            except BusyError:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        self._forget_oldest()
        return folder.name

    def _begin(self, folder: Path, lock: int) -> None:
        if self._runner:
            self._runner.poll()  # the one before has ended; nobody else would take its status
        os.ftruncate(lock, 0)  # before anybody could take the one before for this one
        command = [sys.executable, "-P", "-m", "lostmotion.web.runner", str(folder)]
        self._runner = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True, pass_fds=(lock,),
        )  # fmt: skip
        os.pwrite(lock, f"{folder.name} {self._runner.pid}".encode(), 0)

    @contextmanager
    def _exclusive(self) -> Iterator[int]:
        """The lock, to be handed on: it is free when all have closed it.  Raises BusyError."""
        lock = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            for pause_s in (0.05, 0.1, 0.2, 0.4, None):  # one who only looks, or ends, holds it for a moment
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if pause_s is None:
                        raise BusyError("another run is under way: wait until it ends, or stop it") from None
                    time.sleep(pause_s)
            yield lock
        finally:
            os.close(lock)

    def running(self) -> tuple[str, int] | None:
        """Id and process of the job that is under way."""
        try:
            with (self.folder / "lock").open("rb") as lock:
                try:
                    fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
                except BlockingIOError:
                    name, _, process = lock.read(100).decode("ascii", "replace").partition(" ")
                    return (name, int(process)) if process.isdecimal() else None
        except OSError:
            pass
        return None

    def stop(self, name: str) -> None:
        """Ends a job and all its processes; no error where it has ended already."""
        self._path(name)
        end = time.monotonic() + STOPPING_S
        number: int = signal.SIGTERM
        while (held := self.running()) and held[0] == name:
            with suppress(ProcessLookupError):
                os.killpg(held[1], number) if number == signal.SIGKILL else os.kill(held[1], number)
            if number == signal.SIGTERM and time.monotonic() > end:
                number = signal.SIGKILL
            time.sleep(0.05)
        if self._runner:
            self._runner.poll()

    def remove(self, name: str) -> None:
        """Forgets a job; one that is under way is stopped."""
        self.stop(name)
        shutil.rmtree(self._path(name))

    def find(self, name: str) -> Job:
        """A job as it is now.  Raises JobError."""
        return self._job(self._path(name), self.running())

    def all(self) -> list[Job]:
        """All of them, newest first."""
        held = self.running()
        return [job for path in self._paths() if (job := self._readable(path, held))]

    def path(self, name: str, file: str) -> Path:
        """A file that a job has left.  Raises JobError."""
        path = self._path(name) / file
        if not path.is_file():
            raise JobError(f"this run has left no {file}")
        return path

    def stamp(self, name: str) -> tuple[object, ...]:
        """Changes whenever there is something new of a job; costs nearly nothing."""
        folder, held = self.folder / name, self.running()
        times: list[object] = [held is not None and held[0] == name]
        for file in ("state.json", "log"):
            with suppress(OSError):
                found = (folder / file).stat()
                times.append((file, found.st_mtime_ns, found.st_size))
        return tuple(times)

    def _paths(self) -> list[Path]:
        if not self.folder.is_dir():
            return []
        return sorted((p for p in self.folder.iterdir() if ID.fullmatch(p.name)), reverse=True)

    def _path(self, name: str) -> Path:
        path = self.folder / name
        if not ID.fullmatch(name) or not path.is_dir():
            raise JobError(f"there is no run {name[:40]!r}; has it been removed?")
        return path

    def _readable(self, folder: Path, held: tuple[str, int] | None) -> Job | None:
        try:
            return self._job(folder, held)
        except JobError:
            return None  # being made, or damaged: the oldest go by themselves

    def _job(self, folder: Path, held: tuple[str, int] | None) -> Job:
        try:
            wish = msgspec.json.decode((folder / "wish.json").read_bytes(), type=Wish)
            state = msgspec.json.decode((folder / "state.json").read_bytes(), type=State)
        except (OSError, msgspec.DecodeError) as error:
            raise JobError(f"the run {folder.name} cannot be read: {error}") from error
        if state.state == "running" and not (held and held[0] == folder.name):
            state = State("interrupted", "It was interrupted: its process is gone.", state.began)
        files = sorted(path.name for path in folder.iterdir())
        return Job(
            folder.name, wish.about, wish.created, state.state, state.text, state.began, state.ended,
            _progress(folder / "log"), files,
        )  # fmt: skip

    def _forget_oldest(self) -> None:
        held = self.running()
        for path in self._paths()[MOST_KEPT:]:
            if not (held and held[0] == path.name):
                shutil.rmtree(path, ignore_errors=True)


def _progress(log: Path) -> list[dict[str, Any]]:
    """The progress reports of a command."""
    try:
        with log.open("rb") as file:
            file.seek(max(log.stat().st_size - TAIL, 0))
            lines = file.read(TAIL).splitlines()
    except OSError:
        return []
    entries = []
    for line in lines:
        with suppress(msgspec.DecodeError):
            found = msgspec.json.decode(line)
            if isinstance(found, dict) and "progress" in found:
                entries.append(found)
    return entries[-LINES:]
