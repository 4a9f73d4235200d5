"""The database's file: its lock, its version, the copy before a change, and the handling of a damaged one.

What is written into it is in ``store.py``, the versions themselves are in ``migrations.py``.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import re
import shutil
import sqlite3
import time
from contextlib import closing, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from lostmotion.daemon import inode_lock
from lostmotion.daemon.inode_lock import HeldError, InodeLock
from lostmotion.daemon.migrations import CURRENT, MIGRATIONS
from lostmotion.drivers.errors import LostmotionError

__all__ = [
    "DAMAGED",
    "UNREADABLE",
    "ReplacedError",
    "StoreBusyError",
    "StoreError",
    "StoreRefusedError",
    "explain",
    "file_identity",
    "is_damage",
    "is_full",
    "is_held",
    "is_lock_of",
    "leave",
    "lock",
    "lock_inode",
    "move_aside",
    "newer",
    "open_database",
    "refusal",
]

log = logging.getLogger(__name__)

GLANCE_S = 0.02
"""``is_held`` may have the lock for a moment"""
BUSY_S = 2.0
"""how long another program's lock is waited for [s]"""
WAL_BYTES = 16_000_000
"""the log does not stay larger than this, once a reader has let SQLite write it back"""
CACHE_KB = 400
"""SQLite's own 2 MB are no quicker, neither for a reader nor for the writer (266 instead of 295 µs for the rows of 0.2
s), and the service would fill them over its first half hour"""
FULL = (errno.ENOSPC, errno.EDQUOT)
DAMAGE = ("SQLITE_CORRUPT", "SQLITE_NOTADB")
UNREADABLE = (sqlite3.Error, UnicodeDecodeError)
"""what SQLite's module raises for a damaged file: it reads even the message of an error as UTF-8"""
DAMAGED = (*UNREADABLE, ValueError, TypeError, OverflowError)
"""what reading its rows raises: also of values that were never written, as an unknown state"""
PASSING = ("SQLITE_FULL", "SQLITE_BUSY", "SQLITE_IOERR")
CAUSES = {
    "SQLITE_FULL": "the disk is full; free some space",
    "SQLITE_BUSY": "another program holds the database locked; close it",
    "SQLITE_READONLY": "found read-only, expected to be writable; check the owner of the file and its folder",
    "SQLITE_CANTOPEN": "cannot be opened; check that the path is a file in a folder this user may write",
    "SQLITE_NOTADB": "is damaged, or no SQLite database at all",
    "SQLITE_CORRUPT": "is damaged",
    "SQLITE_IOERR": "the disk refuses to read or write (full, over quota, or failing)",
}


class StoreError(LostmotionError):
    """The database cannot be used; the one-line message has the cause and the remedy."""


class StoreBusyError(StoreError):
    """A service holds the database."""


class StoreRefusedError(StoreError):
    """The disk refuses at present (full, locked): worth another try later."""


class ReplacedError(StoreError):
    """The file that is open is not the one at its path any more."""


def file_identity(path: Path) -> tuple[int, int] | None:
    """The device and inode of a file, of which a link is followed; None for no file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def lock(path: Path) -> IO[bytes]:
    """Holds ``path``.lock, in a folder that is made if need be, as long as the file is open.  Raises StoreError."""
    if path.is_dir():
        raise StoreError(f"{path}: found a folder, expected a file; add its name to store.path")
    if path.exists() and not path.is_file():
        raise StoreError(f"{path}: found a device or a pipe, expected a file; choose another store.path")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise _denied(path, error, f"the folder cannot be made: {error.strerror}; choose another store.path") from error
    try:
        file = path.with_name(f"{path.name}.lock").open("ab")
    except OSError as error:
        raise _denied(
            path, error, f"its folder is found read-only, expected to be writable; check its owner ({error.strerror})"
        ) from error
    for pause_s in (GLANCE_S, 0.0):
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return file
        time.sleep(pause_s)
    file.close()
    raise StoreBusyError(
        f"{path}: another lostmotion service writes it, expected to be the only one; stop that one, or choose another "
        "store.path"
    )


def is_lock_of(file: IO[bytes], path: Path) -> bool:
    """Whether an open lock is that of this database: its folder may have gone, or a link may lead elsewhere."""
    found = os.fstat(file.fileno())
    return file_identity(path.with_name(f"{path.name}.lock")) == (found.st_dev, found.st_ino)


def lock_inode(path: Path) -> InodeLock | None:
    """Holds the file itself, by whatever name it is reached; one that is not there yet is made.

    The caller holds the lock beside it.  None where there is no file and none can be made.  Raises StoreBusyError.
    """
    _private(path)
    try:
        found = path.stat()
    except OSError:
        return None
    try:
        return InodeLock((found.st_dev, found.st_ino), found.st_uid)
    except HeldError as error:
        raise StoreBusyError(
            f"{path}: another lostmotion service writes the same file by another name (a hard link), expected to be "
            "the only one; stop that one, or choose another store.path"
        ) from error


def is_held(path: Path) -> bool | None:
    """Whether a service, or a command in its place, writes the database; None where that cannot be seen."""
    path = Path(os.path.realpath(path))
    with suppress(OSError):
        found = path.stat()
        if inode_lock.is_held((found.st_dev, found.st_ino), found.st_uid):
            return True
    try:
        file = path.with_name(f"{path.name}.lock").open("rb")
    except OSError:
        return None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return True
    return False


def open_database(path: Path) -> sqlite3.Connection:
    """Opens the database for writing, brings its schema up to date; a damaged one is moved aside for a new one.

    The caller holds the lock.  Raises StoreError.
    """
    try:
        return _open(path)
    except UNREADABLE as error:
        if not is_damage(error):
            raise refusal(path, error) from error
        move_aside(path, error)
    try:
        return _open(path)
    except UNREADABLE as error:
        raise refusal(path, error) from error


def refusal(path: Path, error: Exception) -> StoreError:
    """SQLite's error as one of ours."""
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith("SQLITE_CANTOPEN") and is_full(path.parent):  # SQLite does not report why
        return StoreRefusedError(f"{path}: {CAUSES['SQLITE_FULL']} ({error})")
    passes = name.startswith(PASSING)
    return (StoreRefusedError if passes else StoreError)(explain(path, error))


def _denied(path: Path, error: OSError, otherwise: str) -> StoreError:
    """The system's error as one of ours, in the words of ``otherwise`` unless the disk is full."""
    if error.errno in FULL:
        return StoreRefusedError(f"{path}: {CAUSES['SQLITE_FULL']} ({error.strerror})")
    return StoreError(f"{path}: {otherwise}")


def is_full(folder: Path) -> bool:
    """Whether no file can be made there for want of room; some filesystems do not count their files."""
    found = os.statvfs(folder)
    return found.f_bavail == 0 or (found.f_files > 0 and found.f_favail == 0)


def is_damage(error: Exception) -> bool:
    """Whether the file itself is bad, so that no waiting helps: pages, names in the schema, or values of no meaning."""
    if not isinstance(error, sqlite3.Error):
        return True
    return getattr(error, "sqlite_errorname", "").startswith(DAMAGE) or str(error).startswith("no such ")


def leave(path: Path, error: Exception, wal: tuple[int, int] | None) -> None:
    """Makes room for a new database in place of a closed one that was damaged or replaced; logs it as an error.

    wal: the identity of the write-ahead log of the one that was replaced: a log that stays behind would be read as part
    of the file that is there now.  Raises StoreError where that is not allowed.
    """
    if not isinstance(error, ReplacedError):
        move_aside(path, error)
        return
    if wal is not None and file_identity(path.with_name(f"{path.name}-wal")) == wal:
        for ending in ("-wal", "-shm"):
            path.with_name(path.name + ending).unlink(missing_ok=True)
    log.error("%s", error)  # now: from here on what is read there is that file, and no mixture of two


def move_aside(path: Path, error: Exception) -> None:
    """Gives a damaged database another name, with the files beside it that belong to it; logs it as an error.

    Raises StoreError where that is not allowed.
    """
    aside = path.with_name(f"{path.name}.damaged-{datetime.now(UTC):%Y%m%dT%H%M%S}")
    try:
        for ending in ("-wal", "-shm", ""):
            part = path.with_name(path.name + ending)
            if part.exists():
                part.rename(aside.with_name(aside.name + ending))
    except OSError as refused:
        raise StoreError(f"{explain(path, error)}; it cannot be moved aside: {refused.strerror}") from refused
    log.error(
        "%s; a new history begins, the old file is %s: sqlite3's .recover may save most of it",
        *(explain(path, error), aside.name),
    )


def explain(path: Path, error: Exception) -> str:
    """An error in using the file, most often SQLite's, as one line for a person."""
    if isinstance(error, StoreError):
        return str(error)
    name = getattr(error, "sqlite_errorname", "")
    cause = next((f"{cause} " for code, cause in CAUSES.items() if name.startswith(code)), "")
    return f"{path}: {cause}({error})" if cause else f"{path}: {error}"


def newer(path: Path, version: int) -> str:
    """The message about a database that a newer program has changed: with the copy made then, if it is there."""
    copies = {int(found[1]): copy for copy in path.parent.glob(f"{path.name}.version*")
              if (found := re.fullmatch(r".*\.version(\d+)", copy.name)) and int(found[1]) <= CURRENT}  # fmt: skip
    back = f", or go back to {copies[max(copies)].name} beside it, made before the change" if copies else ""
    return (
        f"{path}: found schema version {version}, expected at most {CURRENT}; a newer lostmotion wrote it: install "
        f"that one{back}"
    )


def _private(path: Path) -> None:
    """Makes the file, if it is not there, for its owner and group only, less what the umask removes: SQLite would let
    everybody read it.  One that is there is not opened: to close it again would end the locks that SQLite has on it."""
    with suppress(OSError):  # SQLite reports it better
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640))


def _open(path: Path) -> sqlite3.Connection:
    _private(path)
    db = sqlite3.connect(path, timeout=BUSY_S, check_same_thread=False)
    try:
        db.execute("PRAGMA journal_mode = WAL")
        db.execute("PRAGMA synchronous = NORMAL")
        db.execute(f"PRAGMA journal_size_limit = {WAL_BYTES}")
        _migrate(db, path)
        db.execute(f"PRAGMA cache_size = -{CACHE_KB}")
    except BaseException:
        db.close()
        raise
    return db


def _migrate(db: sqlite3.Connection, path: Path) -> None:
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version > CURRENT:
        raise StoreError(newer(path, version))
    if version == 0 and db.execute("SELECT count(*) FROM sqlite_schema").fetchone()[0]:
        raise StoreError(f"{path}: is the database of another program; choose another store.path")
    if 0 < version < CURRENT:
        with closing(sqlite3.connect(path, timeout=BUSY_S)) as blocker:
            blocker.execute(
                "BEGIN IMMEDIATE"
            )  # before the copy: where another program writes, there would be one a retry
            _copy(db, path, version)
    for number, script in enumerate(MIGRATIONS[version:], start=version + 1):
        db.executescript(f"BEGIN IMMEDIATE; {script} PRAGMA user_version = {number}; COMMIT;")


def _copy(db: sqlite3.Connection, path: Path, version: int) -> None:
    """The database as it was, under its version's name; that name appears only when the copy is whole."""
    copy = path.with_name(f"{path.name}.version{version}")
    size = path.stat().st_size
    if shutil.disk_usage(path.parent).free < 2 * size:
        raise StoreRefusedError(f"{path}: no room for a copy before its schema changes; free {size / 5e5:.0f} MB")
    unfinished = copy.with_name(f"{copy.name}.unfinished")
    _private(unfinished)
    with closing(sqlite3.connect(unfinished)) as target:
        db.backup(target)
    unfinished.rename(copy)
    log.warning("%s: schema version %d becomes %d; a copy stays in %s", path, version, CURRENT, copy.name)
