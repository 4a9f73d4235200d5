"""``lostmotion alarms``: lists alarms, watches them, acknowledges and shelves them."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from lostmotion.daemon import documents, requests, times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.where import find_database, open_joint, open_reader
from lostmotion.daemon.reader import ReaderError, open_readonly
from lostmotion.daemon.records import AlarmRow, Request, Severity, Transition
from lostmotion.drivers.terminal import printable

__all__ = ["change", "show", "watch"]

LOOK_S = 0.2
ANSWER_S = 10.0
"""how long the service may take for a request; it looks every second [s]"""
COLOURS = {Severity.DEGRADED: "yellow", Severity.WARNING: "dark_orange", Severity.ERROR: "red"}


def show(config: Path | None, database: Path | None, everything: bool, as_json: bool) -> None:
    """Prints the alarms that are not normal, or all that ever were."""
    with open_reader(config, database) as reader:
        robot, alarms = reader.robot(), reader.alarms(living=not everything)
    if as_json:
        output.print_json({"robot": robot, "alarms": [documents.alarm(alarm) for alarm in alarms]})
    elif not alarms:
        output.print_lines([f"robot {robot}: no alarm"])
    else:
        columns = ("joint", "cause", "severity", "state", "raised (UTC)", "cleared", "shelved until", "reason")
        output.print_table(columns, [_row(alarm) for alarm in alarms])


def watch(config: Path | None, database: Path | None, duration_s: float | None, as_json: bool) -> None:
    """Prints transitions of alarms as they come, a line each (JSON: a document each), until Ctrl-C."""
    end = time.monotonic() + duration_s if duration_s else math.inf
    for transition in _news(find_database(config, database), end):
        document = msgspec.json.encode(documents.transition(transition)).decode()
        sys.stdout.write((document if as_json else printable(_line(transition))) + "\n")
        sys.stdout.flush()


def _news(path: Path, end: float) -> Iterator[Transition]:
    """Transitions from now on until ``end`` [s], as they are stored; where a service has moved a damaged database
    aside, all that are in the new one."""
    file, reader = _file(path), open_readonly(path)
    last = max((number for number, _ in reader.transitions(newest=1)), default=0)
    while time.monotonic() < end:
        for number, transition in reader.transitions(after=last):
            last = number
            yield transition
        time.sleep(LOOK_S)
        if (now := _file(path)) not in (0, file):
            with suppress(ReaderError):  # it is not whole yet: at the next look
                fresh = open_readonly(path)
                reader.close()
                file, reader, last = now, fresh, 0
    reader.close()


def _file(path: Path) -> int:
    """Which file has this name; 0 for none."""
    try:
        return path.stat().st_ino
    except OSError:
        return 0


def change(config: Path | None, database: Path | None, request: Request, as_json: bool) -> int:
    """Lets the service carry out the request, or does it here where none runs; 1 when nothing changed.

    Raises UnknownJointError, RequestError or StoreError.
    """
    open_joint(request.joint, config, database).close()
    answer = requests.settle(find_database(config, database), request, ANSWER_S)
    if as_json:
        output.print_json({"joint": request.joint, "done": answer.done, "answer": answer.text})
    else:
        output.print_lines([answer.text])
    return int(not answer.done)


def _row(alarm: AlarmRow) -> list[str]:
    from rich.markup import escape

    colour = COLOURS[alarm.severity]
    moments = [times.local(moment) if moment else "-" for moment in (alarm.raised, alarm.cleared, alarm.shelved_until)]
    severity = f"[{colour}]{alarm.severity.value}[/{colour}]"
    return [escape(alarm.joint), alarm.cause.value, severity, alarm.state.value, *moments, escape(alarm.reason)]


def _line(change: Transition) -> str:
    alarm, who = change.alarm, f" by {change.by}" if change.by else ""
    what = f"{alarm.joint} {alarm.cause.value}: {change.event.value}{who}"
    return f"{times.local(change.time)} UTC  {what} ({alarm.severity.value}, {alarm.state.value}): {alarm.reason}"
