"""Queries on Zenoh while some of the answers are held up, as a client that has stopped reading does."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path

import pytest
import zenoh

from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.sinks import queries
from lostmotion.daemon.sinks.answers import Answers
from lostmotion.daemon.sinks.zenoh import ZenohSink
from tests.daemon.cli_world import fill
from tests.daemon.conftest import wait_until
from tests.daemon.zenoh_world import session

HISTORY, STATUS = "lostmotion/arm1/elbow/history", "lostmotion/arm1/status"


class Gate:
    """Histories get to it and wait until it is opened."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reached = 0
        self._opened = threading.Event()
        answer = Answers.to

        def held_up(answers: Answers, key: str, parameters: Mapping[str, str]) -> Iterator[bytes]:
            if key.endswith("/history"):
                self.reached += 1
                self._opened.wait(60)
            yield from answer(answers, key, parameters)

        monkeypatch.setattr(Answers, "to", held_up)

    def open(self) -> None:
        self._opened.set()


@pytest.fixture
def robot(tmp_path: Path, endpoint: str) -> Iterator[str]:
    """The endpoint of a robot with a history."""
    fill(tmp_path / "history.db", 20)
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), tmp_path / "history.db")) as sink:
        wait_until(lambda: sink.is_open)
        yield endpoint


def answered(replies: zenoh.handlers.Handler[zenoh.Reply]) -> int:
    """How many documents have come."""
    return sum(reply.ok is not None for reply in replies)


def test_a_client_that_has_stopped_holds_nobody_up(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """While more histories wait than there are threads for them, others are told the status; the histories follow."""
    gate = Gate(monkeypatch)
    with session("client", connect=[robot]) as stopped, session("client", connect=[robot]) as other:
        held_up = [stopped.get(HISTORY, timeout=60.0) for _ in range(2 * queries.THREADS)]
        wait_until(lambda: gate.reached == queries.THREADS)
        assert answered(other.get(STATUS, timeout=20.0)) == 1
        gate.open()
        assert [answered(replies) for replies in held_up] == [1] * len(held_up)


def test_queries_that_wait_are_bounded(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 200 only as many are kept as there are places; the others see that nobody answers, and all goes on after."""
    gate = Gate(monkeypatch)
    with session("client", connect=[robot]) as other:
        flood = [other.get(HISTORY, timeout=60.0) for _ in range(200)]
        dropped = flood[queries.MOST_WAITING :]
        assert sum(answered(replies) for replies in dropped) == 0
        gate.open()
        assert sum(answered(replies) for replies in flood) == queries.MOST_WAITING
        wait_until(lambda: answered(other.get(HISTORY, timeout=20.0)) == 1)
