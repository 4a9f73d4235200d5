"""The faults that a campaign chooses from: how each begins and ends, and how the service must tell it."""

from __future__ import annotations

import os
import re
import resource
import shutil
import signal
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.request import urlopen

from bench.faults.world import CAN, SENSOR, SERVOS, World

__all__ = ["ATTACKS", "LOSS", "Attack"]

Undo = Callable[[], None]
DEVICE = r"cause=device severity=error event=(raised|changed)"
LOSS = r"event=(raised|changed).*(samples were lost|loses samples|has no samples|no data for|broken)"
YEAR_S = 365.25 * 86400
HALF_OPEN, SCRAPE_S = 300, 10.0
"""connections to the metrics that send half a request, and how long a scrape beside them may take [s]"""
SPARE_BYTES = 4 << 20
"""what the service may still take of memory under a limit"""
BAD_LINES = ("x = ", "[[[", "\0", "path = 1e999", "rate_hz = -1", "=" * 5000)


@dataclass(frozen=True, slots=True)
class Attack:
    """begin: does it, and returns what ends it; told: a pattern that the log must hold soon after, "" where nothing has
    to be told."""

    name: str
    begin: Callable[[World], Undo]
    told: str = ""


def _lossy(world: World) -> Undo:
    world.stream.lossy = 0.3
    return lambda: setattr(world.stream, "lossy", 0.0)


def _held(world: World) -> Undo:
    world.stream.held = True
    return lambda: setattr(world.stream, "held", False)


def _garbage(world: World) -> Undo:
    world.stream.insert(world.dice.randbytes(world.dice.choice((1, 200, 5000))))
    world.line.garbage = world.dice.randbytes(world.dice.choice((1, 30)))
    return lambda: setattr(world.line, "garbage", b"")


def _corrupt(world: World) -> Undo:
    world.line.corrupt.add(3)
    return world.line.corrupt.clear


def _unplugged(port: int) -> Callable[[World], Undo]:
    def begin(world: World) -> Undo:
        world.emulator.unplug(port)
        return lambda: world.emulator.plug(port)

    return begin


def _clock(world: World) -> Undo:
    world.ahead.write_text(str(world.dice.choice((64 * YEAR_S, -56 * YEAR_S, 90 * 86400.0, -7200.0))))

    def end() -> None:
        world.ahead.write_text("0")

    return end


def _full(world: World) -> Undo:
    pid, (_, hard) = world.pid, resource.prlimit(world.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (1_000, hard))

    def end() -> None:
        with suppress(ProcessLookupError):  # killed meanwhile
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (hard, hard))

    return end


def _killed(world: World) -> Undo:
    world.kill()
    return world.revive


def _deleted(world: World) -> Undo:
    world.settle()
    world.put(None)
    return lambda: None


def _replaced(world: World) -> Undo:
    world.settle()
    copy = world.folder / "copy.db"
    with closing(sqlite3.connect(world.database)) as source, closing(sqlite3.connect(copy)) as target:
        source.backup(target)
    world.put(copy)
    return lambda: None


def _copied(world: World) -> Undo:
    """What a backup by `cp` while it is written holds, put back: the file and its log, perhaps of two moments."""
    world.settle()
    copy = world.folder / "copy.db"
    for suffix in ("", "-wal"):
        with suppress(FileNotFoundError):
            shutil.copyfile(f"{world.database}{suffix}", f"{copy}{suffix}")
    with suppress(FileNotFoundError):
        Path(f"{copy}-wal").rename(f"{world.database}-wal")
    world.put(copy)
    return lambda: None


def _locked(world: World) -> Undo:
    world.settle()
    other = sqlite3.connect(world.database, timeout=5.0, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    return other.close


def _reader(world: World) -> Undo:
    world.settle()
    other = sqlite3.connect(world.database, check_same_thread=False)
    other.execute("BEGIN")
    other.execute("SELECT count(*) FROM scores").fetchone()
    return other.close


def _reloaded(world: World) -> Undo:
    lines = world.text.splitlines()
    lines[world.dice.randrange(len(lines))] = world.dice.choice(BAD_LINES)
    world.config.write_text("\n".join(lines))
    os.kill(world.pid, signal.SIGHUP)

    def end() -> None:
        world.config.write_text(world.text)
        if world.process is not None and world.process.poll() is None:
            os.kill(world.pid, signal.SIGHUP)

    return end


def _second(world: World) -> Undo:
    """Another service on the same database by a link, and on the same ports."""
    link, config = world.folder / "link.db", world.folder / "second.toml"
    link.unlink(missing_ok=True)
    link.symlink_to(world.database)
    config.write_text(world.text.replace(str(world.database), str(link)))
    command = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()", "run", "--config", str(config)]
    command += ["--duration", "3"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    world.exits.append(done.returncode)
    world.said += f"second service: {done.stderr}"
    return lambda: None


def _stopped(world: World) -> Undo:
    pid = world.pid
    os.kill(pid, signal.SIGSTOP)

    def end() -> None:
        with suppress(ProcessLookupError):  # killed meanwhile
            os.kill(pid, signal.SIGCONT)

    return end


def _starved(world: World) -> Undo:
    """No more memory than it has; where that ends it, it is begun again, as systemd does."""
    status = Path(f"/proc/{world.pid}/status").read_text()
    now = int(re.findall(r"VmSize:\s+(\d+)", status)[0]) * 1024
    pid, (_, hard) = world.pid, resource.prlimit(world.pid, resource.RLIMIT_AS)
    world.starve()
    resource.prlimit(pid, resource.RLIMIT_AS, (now + SPARE_BYTES, hard))

    def end() -> None:
        with suppress(ProcessLookupError):
            resource.prlimit(pid, resource.RLIMIT_AS, (hard, hard))
        world.revive()

    return end


def _router_killed(world: World) -> Undo:
    world.router.kill()
    return world.router.start


def _router_hung(world: World) -> Undo:
    world.router.hang()
    return world.router.resume


def _subscriber_stopped(world: World) -> Undo:
    world.watcher.signal(signal.SIGSTOP)
    return lambda: world.watcher.signal(signal.SIGCONT)


def _half_open(world: World) -> Undo:
    """Connections to the metrics that send half a request: a scrape is answered all the same."""
    stack = ExitStack()
    with suppress(OSError):  # the service is not there at the moment
        for _ in range(HALF_OPEN):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", world.metrics), timeout=SCRAPE_S))
            connection.sendall(b"GET /metr")
        try:
            with urlopen(f"http://127.0.0.1:{world.metrics}/metrics", timeout=SCRAPE_S) as answer:
                answer.read()
        except OSError as error:
            if not world.is_starved:
                world.wrong.append(f"no scrape beside {HALF_OPEN} half-open connections: {error}")
    return stack.close


ATTACKS = (
    Attack("three bytes of ten of the sensor lost", _lossy, LOSS),
    Attack("sensor's value held", _held, "shows the same value all the time"),
    Attack("foreign bytes on both lines", _garbage),
    Attack("servo's checksums wrong", _corrupt, DEVICE),
    Attack("servos unplugged", _unplugged(SERVOS), DEVICE),
    Attack("sensor unplugged", _unplugged(SENSOR), DEVICE),
    Attack("CAN adapter unplugged", _unplugged(CAN), "trying again, active alarms are sent then"),
    Attack("clock wrong by hours to decades", _clock, "the system's clock has stepped"),
    Attack("disk full", _full, "scoring continues, rows wait in memory"),
    Attack("service killed", _killed),
    Attack("database deleted", _deleted, "was deleted while it was open"),
    Attack("database replaced by a copy", _replaced, "was replaced by another file while it was open"),
    Attack("database locked", _locked, "another program holds the database locked"),
    Attack("reader that never ends", _reader),
    Attack("bad configuration and SIGHUP", _reloaded, "the old configuration stays|configuration taken"),
    Attack("second service by a link", _second, "another lostmotion service writes it"),
    Attack("service stopped (SIGSTOP)", _stopped),
    Attack("database replaced by a copy mid-write", _copied, "was replaced by another file while it was open"),
    Attack("no more memory", _starved),
    Attack("Zenoh router killed", _router_killed, "nobody answers at|session not open"),
    Attack("Zenoh router hangs", _router_hung),
    Attack("Zenoh subscriber stopped", _subscriber_stopped),
    Attack("300 half-open connections to the metrics", _half_open),
)
