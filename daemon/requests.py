"""Requests about alarms, through the database: made by any process, carried out by the one that writes alarms.

While a service runs it alone changes alarms, and carries out requests every second.  Without one, the asking program
opens the store itself, which keeps a service out meanwhile (docs/decisions/0006-alarms.md).
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic, sleep

from lostmotion.daemon.alarm import Change, JointMonitor
from lostmotion.daemon.database import StoreBusyError, explain
from lostmotion.daemon.migrations import CURRENT
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.reader import Reader, open_readonly
from lostmotion.daemon.records import AlarmState, Answer, JointRow, Request, ScoreRow, Transition, micros
from lostmotion.daemon.store import Store
from lostmotion.drivers.errors import LostmotionError

__all__ = ["ANSWER_S", "LONGEST_S", "RequestError", "ask", "do", "resume", "settle", "take", "wait"]

ANSWER_S = 10.0
"""how long the service may take for a request; it looks every second [s]"""
LONGEST_S = 366 * 86400.0
"""for how long an alarm may be shelved [s]; a joint to be silent for longer should leave the configuration"""
BUSY_S = 5.0
LOOK_S = 0.2
"""how often the answer of a service is looked for [s]"""


class RequestError(LostmotionError):
    """A request could not be left in the database."""


def ask(database: Path, request: Request, now: datetime) -> int:
    """Leaves a request for the service; its number.  Raises RequestError."""
    cause = request.cause and request.cause.value
    try:
        with closing(sqlite3.connect(database, timeout=BUSY_S)) as db, db:
            version = db.execute("PRAGMA user_version").fetchone()[0]
            if version != CURRENT:
                raise RequestError(
                    f"{database}: found schema version {version}, expected {CURRENT}; the service that writes it is of "
                    "another version of lostmotion: restart it"
                )
            cursor = db.execute(
                "INSERT INTO request (made_us, joint, verb, cause, for_s, person) VALUES (?, ?, ?, ?, ?, ?)",
                [micros(now), request.joint, request.verb.value, cause, request.for_s, request.by],
            )
    except sqlite3.Error as error:
        name = getattr(error, "sqlite_errorname", "")
        if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN", "SQLITE_PERM")):
            advice = f"{database}: cannot be written ({error}); the service's user may write it: try sudo"
        else:
            advice = f"{explain(database, error)}, and try again"
        raise RequestError(advice) from error
    return int(cursor.lastrowid or 0)


def settle(database: Path, request: Request) -> Answer:
    """Has the service do what is asked and waits for its answer, or does it here where no service runs.

    Raises RequestError or StoreError.
    """
    try:
        return do(database, request, datetime.now(UTC))
    except StoreBusyError:
        number = ask(database, request, datetime.now(UTC))
    late = (
        f"{request.joint}: the service has not answered within {ANSWER_S:g} s; it will take the request up when it can"
    )
    return wait(database, number, ANSWER_S) or Answer(number, False, late)


def wait(database: Path, number: int, wait_s: float) -> Answer | None:
    """The service's answer to a request, None when there is none within ``wait_s``.  Raises ReaderError."""
    end = monotonic() + wait_s
    with open_readonly(database) as reader:
        while monotonic() < end:
            if answer := reader.answer(number):
                return answer
            sleep(LOOK_S)
    return None


def resume(
    reader: Reader, joint: str, options: AlarmOptions, since: datetime, known: Sequence[Change | ScoreRow] = ()
) -> JointMonitor:
    """A joint's health and alarms where an earlier run left them; a new joint is OK ``since`` now.

    known: what was known of the joints before a reload, where the disk may not have taken all of it yet.
    """
    rows = [one for one in (*known, *reader.joints()) if isinstance(one, JointRow) and one.name == joint]
    recent = [one for one in known if isinstance(one, ScoreRow) and one.joint == joint]
    alarms = {alarm.cause: alarm for alarm in reader.alarms(joint, living=True)}
    alarms |= {one.alarm.cause: one.alarm for one in known if isinstance(one, Transition) and one.alarm.joint == joint}
    living = [alarm for alarm in alarms.values() if alarm.state is not AlarmState.NORMAL]
    origin = next((origin for origin in reader.origins() if joint in origin.probabilities), None)
    row = rows[0] if rows else JointRow(joint, since=since)
    return JointMonitor(row, options, recent or reader.scores(joint, limit=options.windows), living, origin)


def take(
    asked: Iterable[Request], monitors: Mapping[str, JointMonitor], reader: Reader, time: datetime
) -> list[Change | Answer]:
    """Carries out requests; the changes by each, followed by its answer.

    A joint without a monitor is no longer monitored, and may still have an alarm that is not acknowledged.
    """
    rows: list[Change | Answer] = []
    for request in asked:
        monitor = monitors.get(request.joint) or resume(reader, request.joint, AlarmOptions(), time)
        changes, answer = monitor.request(request, time)
        rows += [*changes, answer]
        time += timedelta(microseconds=1)  # two requests in one second are two transitions
    return rows


def do(database: Path, request: Request, now: datetime) -> Answer:
    """Does in this process what is asked; the answer.

    Raises StoreBusyError while a service runs, StoreError, or RequestError when the disk refuses.
    """
    with open_readonly(database) as reader:
        robot = reader.robot()
    store = Store(database, robot)
    try:
        with store.reader() as reader:
            changes, answer = resume(reader, request.joint, AlarmOptions(), now).request(request, now)
        store.add(*changes)
    finally:
        lost = store.close()
    if lost:
        raise RequestError(store.problem)
    return answer
