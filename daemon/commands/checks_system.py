"""The checks of the machine itself, for ``doctor``: clock, disk, database, adapters, versions."""

from __future__ import annotations

import os
import platform
import re
import shutil
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import msgspec

from lostmotion import __version__
from lostmotion.daemon.commands.checks import Check, within
from lostmotion.daemon.config import Config
from lostmotion.daemon.migrations import CURRENT, MIGRATIONS
from lostmotion.daemon.reader import open_readonly
from lostmotion.drivers.base import AccelerometerOptions, JointOptions
from lostmotion.drivers.clock import is_synchronised
from lostmotion.drivers.errors import LostmotionError

if TYPE_CHECKING:
    from sqlite_utils import Database

__all__ = [
    "check_adapters",
    "check_can",
    "check_clock",
    "check_disk",
    "check_history",
    "check_learnt",
    "check_versions",
    "clock_offset",
]

SYSTEM = "system"
USB_SERIAL = Path("/sys/bus/usb-serial/devices")
YEARS = (2025, 2100)
DRIFT_S = 0.05
SPARE_MB = 200.0
LASTS_DAYS = 90.0
ROW_BYTES = 100.0
"""A score in the database, measured 80 to 95."""
BUSY_S = 5.0
TRIED_BYTES = 1_000_000
OFF = 0.04
"""Share by which the resonance that windows show may differ from the file's: beyond, scores of new joints, the size of
the play and `score` suffer until it has been followed."""
WINDOWS_A_DAY = 86400.0
"""A joint that reverses once a second all day, where there is no history."""


def clock_offset() -> float:
    """How far the system's clock is ahead of the monotonic one [s]."""
    return time.time() - time.monotonic()


def check_clock(before: float, virtual: bool) -> Iterator[Check]:
    """The system's clock; before: ``clock_offset`` at the begin of the pass.  A virtual robot has its own time, so its
    host need not be synchronised."""
    year = datetime.now(UTC).year
    yield within(SYSTEM, "year", year, "", *YEARS, "the clock was never set: no network time, and no battery")
    cause = "the clock was stepped during the pass; scores stay right, their UTC jumps"
    step = round(abs(clock_offset() - before), 6)
    yield within(SYSTEM, "clock step during the pass", step, "s", None, DRIFT_S, cause)
    if not virtual:
        ok = is_synchronised()
        cause = "" if ok else "no network time: is systemd-timesyncd or chrony running, and the network up?"
        yield Check(SYSTEM, "clock", "synchronised" if ok else "not synchronised", "", "synchronised", ok, cause)


def check_disk(config: Config) -> Iterator[Check]:
    """The database, or the folder in which it would be made: tried by writing and reading; its room."""
    path = config.database
    folder = next(parent for parent in path.absolute().parents if os.path.isdir(parent))  # noqa: PTH112 - never raises
    windows_a_day, error = 0.0, ""
    try:
        _try_to_write(path, folder)
        windows_a_day = _windows_a_day(path) if path.exists() else 0.0
    except LostmotionError as found:
        error = str(found)
    except (sqlite3.Error, OSError) as found:
        reason = getattr(found, "strerror", found)
        error = f"{reason}: another user owns it, the disk is full, or it is damaged; then try sqlite3's .recover on it"
    windows_a_day = windows_a_day or WINDOWS_A_DAY * len(config.joints)
    value = "unusable" if error else "usable"
    yield Check(str(path), "database", value, "", "readable and writable", not error, error)
    free_mb = shutil.disk_usage(folder).free / 1e6
    needed_mb = SPARE_MB + config.store.keep_windows_mb
    yield within(str(folder), "free space", round(free_mb), "MB", needed_mb, None, "the disk is full")
    growth_mb = windows_a_day * ROW_BYTES / 1e6
    days = max(free_mb - config.store.keep_windows_mb, 0.0) / growth_mb
    cause = f"too small a disk: the database grows by {growth_mb:.1f} MB a day"
    yield within(str(folder), "room", round(days), "days", LASTS_DAYS, None, cause)


def _try_to_write(path: Path, folder: Path) -> None:
    """Writes a table that never is committed, in a database of its own where there is none yet.

    The small cache makes SQLite put its pages on the disk at once.  Raises sqlite3.Error or OSError.
    """
    with TemporaryDirectory(dir=folder) as scratch:
        target = path if path.exists() else Path(scratch) / "try.db"
        with closing(sqlite3.connect(target, timeout=BUSY_S)) as db:
            db.execute("PRAGMA cache_size = 1")
            db.execute("BEGIN IMMEDIATE")
            db.execute("CREATE TABLE doctor AS SELECT zeroblob(?) AS content", [TRIED_BYTES])
            db.rollback()


def _windows_a_day(path: Path) -> float:
    """Over the newest scores in the database, 0 for too few.  Raises ReaderError or sqlite3.Error."""
    with open_readonly(path) as reader:
        newest = [reader.scores(joint.name, limit=1000) for joint in reader.joints()]
    spans = [(len(scores), (scores[-1].time - scores[0].time).total_seconds()) for scores in newest if scores]
    return sum(86400 * count / span for count, span in spans if span > 0)


def check_history(config: Config) -> Iterator[Check]:
    """Pages, tables and views of the database, beside those of a new one of its version; none where there is none."""
    from sqlite_utils import Database

    path, subject = config.database, str(config.database)
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=BUSY_S)) as connection:
            (pages,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            there = _columns(Database(connection))
    except sqlite3.Error:
        return  # reported by the check of the disk
    cause = "" if pages == "ok" else f"{pages}; `lostmotion run` continues as long as possible: copy the database now"
    yield Check(subject, "pages", "sound" if pages == "ok" else "damaged", "", "sound", pages == "ok", cause)
    if not 0 < version <= CURRENT:
        return
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript("".join(MIGRATIONS[:version]))
        own = _columns(Database(connection))
    gone = sorted(own - there)
    cause = f"another program has changed it: {', '.join(gone)} is gone" if gone else ""
    yield Check(subject, "tables", "changed" if gone else "as written", "", "as written", not gone, cause)


def check_learnt(config: Config) -> Iterator[Check]:
    """What the service has learnt of each joint; none where there is no database."""
    if not config.database.is_file():
        return
    try:
        with open_readonly(config.database) as reader:
            noises, flanks = reader.noises(), reader.flanks()
    except (sqlite3.Error, LostmotionError, msgspec.MsgspecError):
        return  # reported by the checks of disk and pages
    for row in noises:
        if row.covariance:
            yield Check(row.joint, "noise learnt", row.deviation, "m/s²", "", ok=True)
        off = row.bar.used_hz / row.f_res_hz - 1 if row.bar else 0.0
        ok = abs(off) <= OFF
        cause = f"{off:+.1%} off: another bar, a loose one? `calibrate tap`, or correct f_res_hz in the file"
        allowed = f"within {OFF:.0%} of the file's"
        yield Check(row.joint, "bar", row.resonance, "", allowed, ok, "" if ok else cause)
    for flank in flanks:
        yield Check(flank.joint, "teeth and servo", str(flank), "", "", ok=True)


def _columns(db: Database) -> set[str]:
    """The columns of all tables and views, as table.column."""
    names = (*db.table_names(), *db.view_names())
    return {f"{name}.{column}" for name in names for column in db[name].columns_dict}


def check_adapters(config: Config, root: Path = USB_SERIAL) -> Iterator[Check]:
    """The latency timer of FTDI adapters: at its usual 16 ms a bus manages 10 cycles a second."""
    items: list[JointOptions | AccelerometerOptions] = [*config.joints, *config.accelerometers]
    for port in dict.fromkeys(item.port for item in items if item.port and not config.is_virtual):
        timer = root / Path(port).resolve().name / "latency_timer"
        if timer.exists():
            cause = f'its usual setting; a udev rule with ATTR{{latency_timer}}="1", or now: echo 1 > {timer}'
            yield within(port, "FTDI latency timer", float(timer.read_text()), "ms", None, 1, cause)


def check_can(config: Config) -> Iterator[Check]:
    """The CAN adapter, opened as the service would; nothing is sent."""
    options = config.can
    if options is None:
        return
    from lostmotion.daemon.sinks.can import open_bus
    from lostmotion.drivers.python_can import FAULTS

    value, cause = "opens", ""
    try:
        open_bus(options).shutdown()
    except FAULTS as error:
        value = "does not open"
        cause = (
            f"{error}; is the adapter plugged in, and the interface up (ip link set can0 up type can bitrate 500000)?"
        )
    yield Check(f"{options.interface} {options.channel}", "CAN bus", value, "", "opens", not cause, cause)


def check_versions() -> Iterator[Check]:
    """lostmotion, Python, and every library that lostmotion needs."""
    yield Check(SYSTEM, "lostmotion", __version__, "", "any", True)
    yield _version("Python", platform.python_version(), "3.11")
    for requirement in requires("lostmotion") or []:
        found = re.match(r"([\w.-]+)\s*>=\s*([\d.]+)(?!.*extra)", requirement)
        if found:
            try:
                yield _version(found[1], version(found[1]), found[2])
            except PackageNotFoundError:
                yield _version(found[1], "missing", found[2])


def _version(name: str, found: str, least: str) -> Check:
    numbers = [[int(n) for n in re.findall(r"\d+", text)[:3]] for text in (found, least)]
    ok = numbers[0] >= numbers[1]
    return Check(SYSTEM, name, found, "", f"at least {least}", ok, "" if ok else "install lostmotion anew")
