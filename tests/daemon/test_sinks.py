"""The sinks: the log's lines, and Zenoh over a real session on loopback."""

from __future__ import annotations

import json
import logging
import math
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

import pytest
import zenoh
from msgspec import structs
from zenoh.ext import HistoryConfig, declare_advanced_subscriber

from lostmotion.daemon import zenoh_session
from lostmotion.daemon.lifecycle import happen, raised
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import AlarmEvent, Cause, Health, JointRow, ScoreRow, Severity
from lostmotion.daemon.sinks.log import LogSink
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.store import Store
from tests.daemon.conftest import wait_until
from tests.daemon.zenoh_world import session

NOWHERE = Path("none.db")
NOON = datetime(2026, 1, 31, 12, 0, 0, 123456, tzinfo=UTC)
SCORE = ScoreRow("elbow", NOON, 0.25, 17.5, 8.0, True, excitation=12.0)
ALARM = raised("elbow", Cause.PLAY, Severity.WARNING, "play: much", NOON)
CLEARED = happen(ALARM.alarm, AlarmEvent.CLEARED, NOON)
HEALTH = JointRow("elbow", Health.WARNING, "play: much", NOON)


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """Twenty scores of the elbow, a second apart, and its alarm."""
    with closing(Store(tmp_path / "history.db", "arm1")) as store:
        for k in range(20):
            store.add(structs.replace(SCORE, time=NOON + timedelta(seconds=k), score=float(k)))
        store.add(ALARM)
    return tmp_path / "history.db"


class Listener:
    """Everything that arrives under lostmotion/arm1, by key."""

    def __init__(self, other: zenoh.Session) -> None:
        self.heard: dict[str, list[dict[str, object]]] = {}
        self.encodings: set[str] = set()
        other.declare_subscriber("lostmotion/arm1/**", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.encodings.add(str(sample.encoding))
        self.heard.setdefault(str(sample.key_expr), []).append(json.loads(sample.payload.to_bytes()))


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_scores_alarms_and_health_arrive_under_their_keys(endpoint: str, mode: Literal["peer", "router"]) -> None:
    """JSON with schema 1, UTC with Z, null for unknown, encoding application/json; the token says the service lives."""
    options = ZenohOptions(mode=mode, listen=[endpoint])
    with closing(ZenohSink("arm1", options, NOWHERE)) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            listener = Listener(other)
            wait_until(lambda: sink.score(SCORE) or listener.heard)  # until the subscription has reached the sink
            sink.alarm(ALARM)
            sink.health(HEALTH)
            wait_until(lambda: len(listener.heard) == 3)
            tokens = [str(reply.ok.key_expr) for reply in other.liveliness().get("lostmotion/*/alive") if reply.ok]
    assert tokens == ["lostmotion/arm1/alive"]
    assert listener.encodings == {"application/json"}
    score = listener.heard["lostmotion/arm1/elbow/score"][0]
    assert score["schema"] == 1
    assert score["time"] == "2026-01-31T12:00:00.123456Z"
    assert (score["score"], score["level"], score["impact"], score["quality"]) == (17.5, 8.0, True, "ok")
    assert (score["play"], score["temperature"]) == (None, None)
    assert listener.heard["lostmotion/arm1/elbow/alarm"] == [
        {
            "schema": 1, "id": ALARM.id, "event": "raised", "time": "2026-01-31T12:00:00.123456Z", "by": "",
            "joint": "elbow", "cause": "play", "severity": "warning", "state": "active",
            "raised": "2026-01-31T12:00:00.123456Z", "acknowledged": None, "cleared": None, "shelved_until": None,
            "reason": "play: much",
        }
    ]  # fmt: skip
    assert listener.heard["lostmotion/arm1/elbow/health"] == [
        {
            "schema": 1, "joint": "elbow", "health": "WARNING", "since": "2026-01-31T12:00:00.123456Z",
            "reason": "play: much",
        }
    ]  # fmt: skip


def test_a_burst_reaches_a_plain_subscriber_whole(endpoint: str, tmp_path: Path) -> None:
    """All joints change at once, as they do when the accelerometer falls silent: none is dropped, even if Zenoh may
    drop as soon as its two batches are on their way."""
    hasty = tmp_path / "zenoh.json5"
    hasty.write_text("{transport: {link: {tx: {queue: {congestion_control: {drop: {wait_before_drop: 0}}}}}}}")
    joints = [f"j{k}" for k in range(100)]
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint], config=str(hasty)), NOWHERE)) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            listener = Listener(other)
            wait_until(lambda: sink.score(SCORE) or listener.heard)
            for joint in joints:
                sink.health(replace(HEALTH, name=joint))
                sink.alarm(raised(joint, Cause.PLAY, Severity.WARNING, "play: much", NOON))
            wanted = {f"lostmotion/arm1/{joint}/{kind}" for joint in joints for kind in ("alarm", "health")}
            wait_until(lambda: wanted <= set(listener.heard))


def test_who_joins_late_gets_the_last_alarm_and_health(endpoint: str, database: Path) -> None:
    """An advanced subscriber and a plain ``get``, both of a program that starts after the transitions, hear of them."""
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), database)) as sink:
        for row in (ALARM, CLEARED):
            sink.alarm(row)
        sink.health(HEALTH)
        wait_until(lambda: sink.is_open)
        with session("peer", connect=[endpoint]) as other:
            heard: list[tuple[str, object]] = []
            declare_advanced_subscriber(
                other,
                "lostmotion/arm1/*/*",
                lambda sample: heard.append((str(sample.key_expr), json.loads(sample.payload.to_bytes()))),
                history=HistoryConfig(detect_late_publishers=True, max_samples=1),
            )
            wait_until(lambda: len(heard) == 2)
            replies = [json.loads(r.ok.payload.to_bytes()) for r in other.get("lostmotion/arm1/*/alarm") if r.ok]
            (health,) = [json.loads(r.ok.payload.to_bytes()) for r in other.get("lostmotion/arm1/elbow/health") if r.ok]
    told = dict(heard)
    assert set(told) == {"lostmotion/arm1/elbow/alarm", "lostmotion/arm1/elbow/health"}
    assert replies == [told["lostmotion/arm1/elbow/alarm"]]
    assert (replies[0]["state"], health["health"]) == ("returned", "WARNING")


def test_a_clock_beyond_the_stamps_of_zenoh_is_a_problem(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """From 2106 on Zenoh panics, which ended the service: nothing is opened nor published then, the log says why, and
    alarms follow when the clock is right; they wait for the session, too, that is not opened before."""
    clock = [2.0**32]
    monkeypatch.setattr(zenoh_session, "time", lambda: clock[0])
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), NOWHERE)) as sink:
        sink.alarm(ALARM)
        wait_until(lambda: "beyond 2106" in sink.problem)
        assert not sink.is_open
        clock[0] = 1.8e9
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            listener = Listener(other)
            wait_until(lambda: sink.score(SCORE) or listener.heard)
            clock[0] = 2.0**32
            sink.score(SCORE)
            sink.alarm(ALARM)
            assert "beyond 2106" in sink.problem
            heard = len(listener.heard)
            clock[0] = 1.8e9
            sink.health(HEALTH)
            wait_until(lambda: {"lostmotion/arm1/elbow/alarm", "lostmotion/arm1/elbow/health"} <= set(listener.heard))
    assert heard == 1
    assert "beyond 2106" in caplog.text


def test_questions_are_answered_from_the_database(endpoint: str, database: Path) -> None:
    """`alarms` and `status` as the command line has them; `history` within its bounds, the newest when there are more,
    and never more than its limit; other keys of the joint bring no history along."""
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), database)) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            (alarms,) = ask(other, "lostmotion/*/alarms")
            (status,) = ask(other, "lostmotion/arm1/status")
            (newest,) = ask(other, "lostmotion/arm1/elbow/history?limit=3")
            bounds = "since=2026-01-31T12:00:05Z;until=2026-01-31T12:00:08Z"
            (between,) = ask(other, f"lostmotion/*/*/history?{bounds}")
            (everything,) = ask(other, "lostmotion/arm1/elbow/history?limit=999999999")
            assert ask(other, "lostmotion/arm1/elbow/*") == []
            assert ask(other, "lostmotion/arm1/knee/history") == []
    assert [(alarm["joint"], alarm["state"]) for alarm in alarms["alarms"]] == [("elbow", "active")]
    assert (status["robot"], status["joints"][0]["score"], status["schema"]) == ("arm1", 19.0, 1)
    assert ([score["score"] for score in newest["scores"]], newest["complete"]) == ([17.0, 18.0, 19.0], False)
    assert [score["score"] for score in between["scores"]] == [5.0, 6.0, 7.0]
    assert (len(everything["scores"]), everything["complete"]) == (20, True)


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("limit=0", "found limit=0, expected 1 to 10000"),
        ("limit=many", "found limit=many, expected 1 to 10000"),
        ("since=soon", "found the time 'soon', expected one such as"),
        ("since=1d;until=2d", "are they swapped?"),
    ],
)
def test_a_query_that_cannot_be_understood_is_told(endpoint: str, database: Path, query: str, words: str) -> None:
    """Wrong parameters bring an error that names what was found and expected, not silence."""
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), database)) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            (reply,) = other.get(f"lostmotion/arm1/elbow/history?{query}")
    assert reply.err is not None
    error = json.loads(reply.err.payload.to_bytes())["error"]
    assert error.startswith("elbow/history: ")
    assert words in error


def test_a_database_that_is_gone_is_told(endpoint: str) -> None:
    """The robot answers with an error while its database cannot be read."""
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), NOWHERE)) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            (reply,) = other.get("lostmotion/arm1/status")
    assert reply.err is not None
    assert "no database there" in reply.err.payload.to_string()


def ask(other: zenoh.Session, selector: str) -> list[Any]:
    """The documents that a query brings."""
    return [json.loads(reply.ok.payload.to_bytes()) for reply in other.get(selector) if reply.ok]


def test_a_router_that_comes_later_is_found(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    """Without its router the sink swallows scores and says so once; when the router comes it publishes every transition
    since, and the health."""
    with closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), NOWHERE)) as sink:
        for _ in range(100):
            sink.score(SCORE)
        sink.alarm(ALARM)
        sink.alarm(CLEARED)
        sink.health(HEALTH)
        wait_until(lambda: "trying again" in caplog.text)
        assert not sink.is_open
        with session("router", listen=[endpoint]) as router:
            listener = Listener(router)
            wait_until(lambda: "lostmotion/arm1/elbow/health" in listener.heard)
            assert [told["id"] for told in listener.heard["lostmotion/arm1/elbow/alarm"]] == [ALARM.id, CLEARED.id]
            wait_until(lambda: sink.score(SCORE) or "lostmotion/arm1/elbow/score" in listener.heard)
    assert caplog.text.count("trying again") == 1


def test_a_sink_whose_far_end_goes_away_keeps_quiet(endpoint: str) -> None:
    """The router dies and comes again: no error reaches the caller, and scores flow again."""
    with closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), NOWHERE)) as sink:
        for _ in range(2):
            with session("router", listen=[endpoint]) as router:
                listener = Listener(router)
                wait_until(lambda heard=listener.heard: sink.score(SCORE) or heard)
            for _ in range(20):
                sink.score(SCORE)


def test_the_interpreter_ends_with_a_sink_open_or_opening(endpoint: str) -> None:
    """A program that closes its sink ends at once, whether the session was open or still being tried."""
    code = f"""
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.store import Store
from pathlib import Path
import time
one = ZenohSink("a", ZenohOptions(listen=["{endpoint}"], ros2=True), Path("none.db"))
two = ZenohSink("b", ZenohOptions(mode="client", connect=["tcp/127.0.0.1:1"]), Path("none.db"))
while not one.is_open:
    time.sleep(0.01)
one.close()
two.close()
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


def test_the_log_tells_what_matters(caplog: pytest.LogCaptureFixture) -> None:
    """Alarms and bad health are warnings, their end is news, scores are for debugging."""
    caplog.set_level(logging.DEBUG)
    sink = LogSink()
    sink.score(ScoreRow("elbow", NOON, 0.25, math.nan, 8.0, False))
    sink.alarm(ALARM)
    sink.alarm(CLEARED)
    sink.alarm(ALARM, again=True)
    sink.health(HEALTH)
    sink.health(replace(HEALTH, reason="play: more"))
    sink.health(JointRow("elbow"))
    levels = [record.levelname for record in caplog.records]
    assert levels == ["DEBUG", "WARNING", "INFO", "WARNING", "INFO"]
    assert caplog.messages[1] == (
        "alarm joint=elbow cause=play severity=warning event=raised state=active reason='play: much'"
    )
