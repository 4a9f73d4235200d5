"""Rows on their way into the database: one thread writes them, in batches.

Callers hand in rows and never wait for the disk.  When the disk refuses (full, locked), also to open the file, rows
wait in a bounded backlog and ``problem`` has the reason; raw windows are given up first.  The SQL is in
``writer.py``, opening the file in ``database.py``, reading in ``reader.py``, the schema in ``migrations.py``, the
reasons in docs/decisions/0004-store.md.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import IO

from lostmotion.daemon import database
from lostmotion.daemon.database import ReplacedError, StoreError, StoreRefusedError, file_identity
from lostmotion.daemon.inode_lock import InodeLock
from lostmotion.daemon.no_memory import retry_without_memory
from lostmotion.daemon.reader import Reader, ReaderError, empty_reader, open_readonly
from lostmotion.daemon.records import Transition, WindowRow
from lostmotion.daemon.repeats import Condition
from lostmotion.daemon.rollup import DAY_US
from lostmotion.daemon.writer import Policy, Row, Writer

__all__ = ["Reader", "Store", "open_readonly"]

log = logging.getLogger(__name__)

FLUSH_S = 0.5
"""rows are written so often [s] where nobody calls ``flush``, and old ones made fewer; the service calls it in each of
its cycles, so that this decides nothing there.  A transition of an alarm does not wait"""
RETRY_S = 1.0
"""pause after the disk refused [s]"""
BATCH = 5000
"""rows in one transaction at most"""
ROLL_UP_S = 0.005
"""how long old scores are rolled up after each batch [s]"""
MOST_WAL_BYTES = 64_000_000
"""SQLite writes its log back from 4 MB on; a backlog of an hour makes 30"""
BACKLOG_ROWS = 200_000
BACKLOG_WINDOWS = 2_000


class Store:
    """The database of one robot, open for writing.  Raises StoreError when it cannot be opened; a ``patient`` one that
    the disk refuses to open (full, locked) is tried again with every batch of rows.

    ``problem`` is "" while rows reach the disk, else what keeps them from it; ``dropped`` counts rows given up because
    the backlog was full; ``damage`` is what is wrong with the file itself, or that it was deleted or replaced: closing
    makes room for a new one and writes there what waits.  While it is open no other process gets a Store of the same
    file, by whatever links: the scores of two robots would be mixed.  ``path`` is the file itself.
    """

    def __init__(
        self,
        path: Path,
        robot: str,
        keep_windows_mb: float = 100.0,
        keep_scores_days: float = 0.0,
        *,
        patient: bool = False,
    ) -> None:
        self.path = Path(os.path.realpath(path))
        self._link = path
        self._file: tuple[int, int] | None = None
        self._wal: tuple[int, int] | None = None
        self.problem = ""
        self.dropped = 0
        self.damage: Exception | None = None
        self.began_anew = ""
        """Why the file that was found was moved aside for a new one, "" for nothing."""
        self._condition, self._wal_condition = Condition(reported=""), Condition(reported="")
        self.configure(robot, keep_windows_mb, keep_scores_days)
        self._rows: deque[Row] = deque()
        self._windows: deque[Row] = deque()
        self._in_flight = 0
        self._unsettled: deque[Transition] = deque()
        self._settled: deque[Transition] = deque()
        self._wake = threading.Condition()
        self._closing = self._is_asked = False
        self._lock: IO[bytes] | None = None
        self._inode_lock: InodeLock | None = None
        self._writer: Writer | None = None
        try:
            self._open()
        except StoreError as error:
            if not (patient and isinstance(error, StoreRefusedError)):
                self._unlock()
                raise
            self._log_problem(str(error))
        self._written = self._policy
        self._thread = self._start_thread()

    def configure(self, robot: str, keep_windows_mb: float, keep_scores_days: float) -> None:
        """Sets what a new configuration may change.

        ``keep_windows_mb`` of raw windows stay [MB]; scores that are older than a joint's newest by
        ``keep_scores_days`` become one an hour, 0: never.
        """
        self._policy = Policy(robot, int(keep_windows_mb * 1e6), int(keep_scores_days * DAY_US))

    def add(self, *rows: Row) -> None:
        """Takes rows, which are committed together after ``flush``, or within ``FLUSH_S``.  Never blocks on the
        disk."""
        with self._wake:
            for row in rows:
                queue = self._windows if isinstance(row, WindowRow) else self._rows
                queue.append(row)
                if isinstance(row, Transition):
                    self._unsettled.append(row)
            self._trim()
            if self._unsettled:
                self._wake.notify_all()

    def flush(self) -> None:
        """Has the rows that wait committed now.  Does not wait for that."""
        with self._wake:
            if self._rows or self._windows:
                self._is_asked = True
                self._wake.notify_all()

    def settled(self, wait_s: float = 0.0) -> list[Transition]:
        """The transitions that are on the disk, or that it has refused, in order, each once: they may be published now.

        One published before it was stored would be lost by a kill, and published again with another id.  Waits at most
        ``wait_s`` for those that are on their way.
        """
        with self._wake:
            self._wake.wait_for(lambda: not self._unsettled, wait_s)
            return [self._settled.popleft() for _ in range(len(self._settled))]

    @property
    def is_settling(self) -> bool:
        """Whether a transition is on its way to the disk, or waits to be published."""
        return bool(self._unsettled or self._settled)

    @property
    def is_open(self) -> bool:
        """Whether the disk has let the database be opened."""
        return self._writer is not None

    def reader(self) -> Reader:
        """The same database for reading; until it ``is_open``, what can be read of it, which may be nothing.

        Nothing, too, where it has just been deleted: a service that reloads its configuration before it has noticed
        would end.  Raises ReaderError.
        """
        try:
            return open_readonly(self.path)
        except ReaderError:
            if self.is_open and self.path.exists():
                raise
            return empty_reader()

    def waiting(self) -> int:
        """How many rows are not on the disk yet."""
        with self._wake:
            return len(self._rows) + len(self._windows) + self._in_flight

    def close(self, timeout_s: float = 5.0) -> int:
        """Writes what is waiting, tries for at most ``timeout_s``, and closes the database.

        Returns how many rows were lost: not written now, or given up before.
        """
        if self._end_thread(timeout_s):
            if self.damage is not None:
                self._leave(self.damage)
            if self._writer is not None:
                self._writer.close()
        self._unlock()
        lost = self.waiting() + self.dropped
        if lost:
            log.error("%s: %d rows were lost: %s", self.path, lost, self.problem or "the disk was too slow")
        return lost

    def begin_anew(self, known: Sequence[Row], timeout_s: float = 5.0) -> None:
        """Goes on in a new file in place of one that has ``damage``: first with ``known``, then with what waits.

        No other store gets the lock meanwhile.  Raises StoreError where a damaged file cannot be moved aside.
        """
        if not self._end_thread(timeout_s):
            return  # the disk hangs: tried again
        self._rows.extendleft(reversed(known))
        if self.damage is not None:
            self._leave(self.damage)
        self._closing = False
        self._thread = self._start_thread()

    def _start_thread(self) -> threading.Thread:
        thread = threading.Thread(
            target=retry_without_memory, args=(self._run, str(self.path)), name="store", daemon=True
        )
        thread.start()
        return thread

    def _end_thread(self, timeout_s: float) -> bool:
        """Lets the writer's thread write what waits, and end; whether it has."""
        with self._wake:
            self._closing = True
            self._wake.notify()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def look(self) -> None:
        """Notes as ``damage`` that the file has been deleted or replaced while it was open."""
        if self._inode_lock is not None:
            self._inode_lock.answer()
        if self._file is None or self.damage is not None:
            return
        if file_identity(self._link) == self._file:
            self._look_at_log()
        else:
            what = "replaced by another file" if self._link.exists() else "deleted"
            self.damage = ReplacedError(
                f"{self._link}: was {what} while it was open; the service continues in a new one"
            )

    def _look_at_log(self) -> None:
        """Notes the write-ahead log's identity; logs when it cannot be written back, because a reader keeps a
        transaction open."""
        wal = self.path.with_name(f"{self.path.name}-wal")
        try:
            found = wal.stat()
        except OSError:
            self._wal, size = None, 0
        else:
            self._wal, size = (found.st_dev, found.st_ino), found.st_size
        grows = size > MOST_WAL_BYTES
        if self._wal_condition.is_news("grows" if grows else "", time.monotonic()):
            text = (
                f"has grown to {size / 1e6:.0f} MB: another program keeps a transaction open; end it, or the disk fills"
            )
            log.warning("%s: %s", wal, text if grows else "is small again")

    def _leave(self, damage: Exception) -> None:
        """Leaves the file for a new one at its path, and writes there what waits; the writer's thread has ended."""
        if self._writer is not None:
            self._writer.close()
        self._writer, self._file, self.damage = None, None, None
        database.leave(self.path, damage, self._wal)
        self._unlock_inode()
        while self.waiting() and self._flush_all():
            pass

    def _open(self) -> Writer:
        """Holds the locks and has the file open, the one to which a link leads at present; raises StoreError."""
        if self._writer is None:
            self.path = Path(os.path.realpath(self._link))
            if self._lock is not None and not database.is_lock_of(self._lock, self.path):
                self._unlock()
            self._lock = self._lock or database.lock(self.path)
            self._lock_inode()
            writer = Writer(self.path, self._policy)
            try:
                self._lock_inode()  # a damaged file has been moved aside for another
            except StoreError:
                writer.close()
                raise
            self._writer, self._file = writer, file_identity(self.path)
            self.began_anew = writer.damage
        return self._writer

    def _lock_inode(self) -> None:
        """Holds the file that is at the path now, and no other."""
        held = self._inode_lock
        if held is None or held.identity != file_identity(self.path):
            self._inode_lock = database.lock_inode(self.path)
            if held is not None:
                held.close()

    def _unlock_inode(self) -> None:
        if self._inode_lock is not None:
            self._inode_lock.close()
            self._inode_lock = None

    def _unlock(self) -> None:
        self._unlock_inode()
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._closing or self._unsettled or self._is_asked, FLUSH_S)
                closing, self._is_asked = self._closing, False
            if closing and not self.waiting():
                return
            if not self._flush_all():
                if closing:
                    return
                with self._wake:
                    self._wake.wait_for(lambda: self._closing, RETRY_S)
            elif not closing:
                self._roll_up()

    def _roll_up(self) -> None:
        """Makes old scores fewer, for a few milliseconds: alarms wait for this thread."""
        try:
            if self._writer is not None:
                self._writer.roll_up(self._policy, ROLL_UP_S)
        except (*database.UNREADABLE, MemoryError) as error:
            # A full disk refuses the next rows too, which are logged and retried; so does lack of memory.
            is_damage = not isinstance(error, MemoryError) and database.is_damage(error)
            self.damage = error if is_damage else None

    def _flush_all(self) -> bool:
        """Commits the oldest rows with the oldest raw windows, which cost a second transaction otherwise; after a disk
        has refused, rows first: one that is nearly full takes them still."""
        if not self.problem and self._windows:
            return self._flush(self._rows, self._windows)
        return self._flush(self._rows) and self._flush(self._windows)

    def _flush(self, *queues: deque[Row]) -> bool:
        """Commits the oldest rows of each queue in one transaction; on failure they go back to its head."""
        with self._wake:
            taken = [[queue.popleft() for _ in range(min(len(queue), BATCH))] for queue in queues]
            batch = list(chain.from_iterable(taken))
            self._in_flight = len(batch)
        if not batch and self._policy == self._written:
            return True
        problem = self._commit(batch)
        if problem or batch:
            self._log_problem(problem)  # before the rows stop waiting: who sees none waiting finds no problem either
        with self._wake:
            self._in_flight = 0
            if problem:
                for queue, rows in zip(queues, taken, strict=True):
                    queue.extendleft(reversed(rows))
                self._trim()
            self._settle(list(self._unsettled) if problem else batch)
        return not problem

    def _commit(self, batch: Sequence[Row]) -> str:
        """Writes a batch; what keeps the disk from taking it, or ""."""
        policy = self._policy
        try:
            if not isinstance(self.damage, ReplacedError):
                self._open().commit(batch, policy)
                self.look()
        except StoreError as error:
            return str(error)
        except database.UNREADABLE as error:
            self.damage = error if database.is_damage(error) else None
            return database.explain(self.path, error)
        except MemoryError:  # this thread must not end: nobody would write any more
            return f"{self.path}: no memory is left to write it"
        if isinstance(self.damage, ReplacedError):  # what was just written is lost with the file
            return str(self.damage)
        self._written = policy
        return ""

    def _settle(self, rows: Sequence[Row]) -> None:
        """Releases these transitions for publishing; also those the disk refused, so that no alarm is withheld."""
        for row in rows:
            if self._unsettled and self._unsettled[0] is row:
                self._settled.append(self._unsettled.popleft())
        self._wake.notify_all()

    def _trim(self) -> None:
        for queue, limit in ((self._rows, BACKLOG_ROWS), (self._windows, BACKLOG_WINDOWS)):
            while len(queue) > limit:
                self._settle([queue.popleft()])
                self.dropped += 1

    def _log_problem(self, problem: str) -> None:
        """Logs when the disk begins to refuse and when it takes rows again, not every time: a disk that is nearly full
        may take scores and refuse windows."""
        if self._condition.is_news(problem, time.monotonic()):
            if problem:
                log.error("%s; scoring continues, rows wait in memory", problem)
            else:
                log.warning("%s: written again; %d rows were dropped", self.path, self.dropped)
        self.problem = problem
