"""A router that dies again and again: no transition is lost or doubled for a subscriber that recovers."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from examples.zenoh import watch_alarms

from lostmotion.daemon.lifecycle import happen, raised
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import AlarmEvent, Cause, Severity, Transition
from lostmotion.daemon.sinks import link_monitor
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.zenoh_session import connect_endpoints
from tests.daemon.alarm_world import Watcher
from tests.daemon.conftest import wait_until
from tests.daemon.zenoh_world import Router, session

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)
NOWHERE = Path("none.db")


def transitions(count: int, joint: str = "elbow", start: int = 0) -> Iterator[Transition]:
    """An alarm that comes and goes."""
    alarm = raised(joint, Cause.PLAY, Severity.WARNING, "much", NOON + timedelta(seconds=start))
    for k in range(count):
        yield alarm
        event = AlarmEvent.CLEARED if k % 2 == 0 else AlarmEvent.RAISED
        alarm = happen(alarm.alarm, event, alarm.time + timedelta(seconds=1))


@pytest.mark.slow
def test_a_router_killed_under_load(tmp_path: Path, endpoint: str) -> None:
    """Five kills while two joints have 25 transitions a second each: all arrive, each once, in order."""
    options = ZenohOptions(mode="client", connect=[endpoint])
    with (
        closing(Router(tmp_path, endpoint)) as router,
        closing(ZenohSink("arm1", options, NOWHERE)) as sink,
        closing(Watcher(endpoint, tmp_path / "watched")) as watcher,
    ):
        told: list[Transition] = []
        for number, both in enumerate(zip(transitions(250, "elbow"), transitions(250, "wrist"), strict=True)):
            if number % 50 == 20:
                router.kill()
            if number % 50 == 40:
                router.start()
            for transition in both:
                sink.alarm(transition)
                told.append(transition)
            time.sleep(0.04)
        wait_until(lambda: len(watcher.ids) >= len(told), 60, lambda: f"{len(watcher.ids)} of {len(told)}")
        for joint in ("elbow", "wrist"):
            heard = [name for name in watcher.ids if name.startswith(joint)]
            assert heard == [transition.id for transition in told if transition.alarm.joint == joint]


def test_a_service_that_tells_again_is_heard_once(tmp_path: Path, endpoint: str) -> None:
    """Another run of the service tells the newest transitions again: a subscriber that keeps ids prints none of them
    twice, and one that joins later gets all of them."""
    options = ZenohOptions(mode="client", connect=[endpoint])
    first, second = list(transitions(6)), list(transitions(2, start=60))
    with closing(Router(tmp_path, endpoint)), closing(Watcher(endpoint, tmp_path / "watched")) as watcher:
        with closing(ZenohSink("arm1", options, NOWHERE)) as sink:
            for transition in first:
                sink.alarm(transition)
            wait_until(lambda: len(watcher.ids) == 6)
        with closing(ZenohSink("arm1", options, NOWHERE)) as sink:
            for transition in first:
                sink.alarm(transition, again=True)
            for transition in second:
                sink.alarm(transition)
            wait_until(lambda: len(watcher.ids) >= 8)
            with closing(Watcher(endpoint, tmp_path / "late")) as late:
                wait_until(lambda: len(late.ids) >= 8)
            assert late.ids == watcher.ids == [transition.id for transition in first + second]


def test_a_router_that_dies_and_comes_back_is_told_once(
    tmp_path: Path, endpoint: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log says that nobody answers, once however long that lasts, and that somebody does again."""
    monkeypatch.setattr(link_monitor, "LOOK_S", 0.05)
    caplog.set_level("INFO", link_monitor.__name__)

    def told() -> list[str]:
        return [record.message for record in caplog.records if record.name == link_monitor.__name__]

    with (
        closing(Router(tmp_path, endpoint)) as router,
        closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), NOWHERE)) as sink,
    ):
        wait_until(lambda: sink.is_open)
        time.sleep(0.3)
        assert not told()
        assert sink.problem == ""
        router.kill()
        wait_until(told)
        assert sink.problem == f"nobody answers at {endpoint}: connection refused"
        time.sleep(0.3)
        router.start()
        wait_until(lambda: len(told()) >= 2)
        assert sink.problem == ""
    assert told() == [
        f"zenoh: nobody answers at {endpoint}: connection refused; connecting is tried again, alarms are sent then",
        f"zenoh: {endpoint} answers",
    ]


def test_a_session_that_has_lost_its_connection_for_ever_is_opened_again(
    tmp_path: Path, endpoint: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Zenoh that had no memory when its router died keeps the router and has no link to it: another session is opened,
    and who subscribes hears what was told meanwhile, once; what is told later is published, and asked for, again."""
    deaf = threading.Event()
    seen, give_up = link_monitor.LinkMonitor._seen, ZenohSink._give_up
    monkeypatch.setattr(link_monitor, "LOOK_S", 0.05)
    monkeypatch.setattr(link_monitor.LinkMonitor, "_seen", lambda self: (False, True) if deaf.is_set() else seen(self))
    monkeypatch.setattr(ZenohSink, "_give_up", lambda self, session: (give_up(self, session), deaf.clear()))
    caplog.set_level("INFO")
    told = list(transitions(6))
    with (
        closing(Router(tmp_path, endpoint)),
        closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), NOWHERE)) as sink,
        closing(Watcher(endpoint, tmp_path / "watched")) as watcher,
    ):
        for transition in told[:2]:
            sink.alarm(transition)
        wait_until(lambda: len(watcher.ids) == 2)
        deaf.set()
        for transition in told[2:4]:
            sink.alarm(transition)
        wait_until(lambda: not deaf.is_set() and sink.is_open)
        for transition in told[4:]:
            sink.alarm(transition)
        wait_until(lambda: len(watcher.ids) == 6)
        assert watcher.ids == [transition.id for transition in told]
        with session("client", connect=[endpoint]) as other:
            assert list(other.get("lostmotion/arm1/alarms")), "nobody answers, not even that there is no database"
    assert sum("a new one is opened" in record.message for record in caplog.records) == 1
    assert sum("session open as" in record.message for record in caplog.records) == 2


def test_where_a_session_connects_to() -> None:
    """A list, or one for each mode, as Zenoh's own file may have it; none is nowhere."""
    config = zenoh.Config()
    assert connect_endpoints(config) == []
    config.insert_json5("connect/endpoints", json.dumps({"peer": [], "client": ["tcp/a:1"], "router": ["tcp/b:2"]}))
    assert sorted(connect_endpoints(config)) == ["tcp/a:1", "tcp/b:2"]
    config.insert_json5("connect/endpoints", json.dumps(["tcp/c:3"]))
    assert connect_endpoints(config) == ["tcp/c:3"]


def test_a_session_that_does_not_open_has_its_cause(endpoint: str, caplog: pytest.LogCaptureFixture) -> None:
    """In one line, with the endpoint; Zenoh's own text, which names places in its source, is in the log for DEBUG."""
    caplog.set_level("DEBUG", "lostmotion")
    with closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), NOWHERE)) as sink:
        wait_until(
            lambda: sink.problem == f"session not open, trying again: nobody answers at {endpoint}: connection refused"
        )
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        where = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with closing(ZenohSink("arm1", ZenohOptions(listen=[where]), NOWHERE)) as sink:
            told = f"session not open, trying again: cannot listen at {where}: address already in use"
            wait_until(lambda: sink.problem == told)
    raw = [record.levelname for record in caplog.records if ".rs:" in record.message]
    assert raw
    assert {*raw} == {"DEBUG"}


def test_who_watches_where_nobody_is_gets_one_line(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The example names the address, and not the places in Zenoh's source; without an address it does not wait."""
    for arguments, told in (
        (["--connect", endpoint], f"nobody answers at {endpoint}; expected a router or a robot"),
        ([], "found no address, expected --connect or --zenoh"),
    ):
        with pytest.raises(SystemExit, match="2"):
            watch_alarms.main(arguments)
        assert told in capsys.readouterr().err


def test_endpoints_are_looked_at_once_each_time_that_the_link_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look connects to them, which a monitor that looks every two seconds must not do all day."""
    asked: list[zenoh.Config] = []
    monkeypatch.setattr(link_monitor, "unreached", lambda config: asked.append(config) or "x: refused")
    monitor = link_monitor.LinkMonitor(None, zenoh.Config(), lambda since: None)  # type: ignore[arg-type]
    for is_linked, looks in ((True, 0), (False, 1), (False, 1), (True, 1), (False, 2)):
        monitor._log_change(is_linked)
        assert len(asked) == looks
        assert monitor.problem == ("" if is_linked else "nobody answers at x: refused")
