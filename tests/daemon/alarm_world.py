"""A robot whose alarms never rest, and what must hold of their transitions however often its service is killed.

Used by the tests of kills and by ``bench/alarms.py``.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from lostmotion.daemon.lifecycle import NEXT
from lostmotion.daemon.reader import ReaderError, open_readonly
from lostmotion.daemon.records import AlarmState, Cause, Transition
from tests.daemon.conftest import ROOT
from tests.daemon.fakes import fake_config

JOINTS = tuple(f"j{k}" for k in range(6))
RESTLESS = 'statistic = "band"\nlevel = 2.1\n[alarm]\nwindows = 3\noff_delay_s = 0\ndeadband = 0\n'
"""about half of the fake robot's windows lie above the level, and three of them decide"""


def restless_config(folder: Path, sinks: str) -> str:
    """The fake robot with alarms that come, ease, escalate and go a few times a second; sinks: their tables."""
    return fake_config(folder, RESTLESS + sinks, joints=JOINTS)


class Watcher:
    """examples/zenoh/watch_alarms.py in a process of its own; ``ids`` of what it has printed, in order."""

    def __init__(self, endpoint: str, log: Path) -> None:
        self._log = log
        with log.open("w") as sink:
            command = [sys.executable, "examples/zenoh/watch_alarms.py", "--connect", endpoint]
            self._process = subprocess.Popen(command, cwd=ROOT, stdout=sink)

    @property
    def ids(self) -> list[str]:
        return [json.loads(line)["id"] for line in self._log.read_text().splitlines()]

    def signal(self, number: int) -> None:
        """Stops it, or lets it go on."""
        self._process.send_signal(number)

    def close(self) -> None:
        self._process.kill()
        self._process.wait()


def stored(database: Path) -> list[Transition]:
    """All transitions in the database, oldest first; none while it is being made."""
    try:
        with open_readonly(database) as reader:
            return [transition for _, transition in reader.transitions()]
    except ReaderError:
        return []


def broken_links(transitions: Sequence[Transition]) -> list[str]:
    """The transitions that do not follow from the one before of the same alarm: one was lost or happened twice."""
    states: dict[tuple[str, Cause], AlarmState] = {}
    broken = []
    for transition in transitions:
        key = transition.alarm.joint, transition.alarm.cause
        if NEXT[states.get(key, AlarmState.NORMAL)].get(transition.event) is not transition.alarm.state:
            broken.append(transition.id)
        states[key] = transition.alarm.state
    return broken
