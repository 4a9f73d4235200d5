"""Memory that comes to an end while the service runs; `bench.faults` sets real limits."""

from __future__ import annotations

import errno
import json
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import can
import pytest

from lostmotion.daemon import config, fault_barrier, metrics_http, no_memory, service, store
from lostmotion.daemon.database import ReplacedError
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.poller import BusPoller
from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.sinks import can as can_sink
from lostmotion.daemon.sinks import zenoh as zenoh_sink
from lostmotion.daemon.sinks.answers import Answers
from lostmotion.daemon.sinks.can import CanSink
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.store import Store
from lostmotion.daemon.writer import Policy, Row, Writer
from tests.daemon.canbus import JOINTS, frame_of
from tests.daemon.cli_world import fill
from tests.daemon.conftest import wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.test_can import FAULT, options
from tests.daemon.zenoh_world import session

NO_THREAD = RuntimeError("can't start new thread")


def chained() -> Exception:
    """What a library makes of no memory."""
    try:
        try:
            raise MemoryError
        except MemoryError:
            raise SystemError("returned a result with an exception set")  # noqa: B904 - as libraries do
    except SystemError as error:
        return error


@pytest.mark.parametrize(
    ("error", "is_so"),
    [
        (MemoryError(), True),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), True),
        (NO_THREAD, True),
        (ImportError("libx.so: failed to map segment from shared object"), True),
        (chained(), True),
        (OSError(errno.ENOSPC, "No space left on device"), False),
        (RuntimeError("dictionary changed size during iteration"), False),
        (ImportError("No module named 'zenoh'"), False),
    ],
)
def test_what_lack_of_memory_looks_like(error: Exception, is_so: bool) -> None:
    """Whatever the system, a thread, a library or Python itself calls it; no other error is taken for it."""
    assert is_no_memory(error) is is_so


@pytest.mark.usefixtures("fake_driver")
@pytest.mark.parametrize("stage", [(Robot, "step"), (BusPoller, "run")])
@pytest.mark.parametrize("error", [MemoryError(), OSError(errno.ENOMEM, "Cannot allocate memory")])
def test_no_memory_is_told_once(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    stage: tuple[type, str],
    error: Exception,
) -> None:
    """A stage, or a poller, that finds no memory says so in one line without a traceback, and is tried again."""
    calls = 0

    def starved(*_: object) -> None:
        nonlocal calls
        calls += 1
        raise error

    monkeypatch.setattr(*stage, starved)
    monkeypatch.setattr(fault_barrier, "CRASH_PAUSE_S", 0.05)
    loaded = config.loads(fake_config(tmp_path), "fake")
    assert service.run(loaded, duration_s=1.0) == 0
    wait_until(lambda: calls >= 3)
    log = capfd.readouterr().err
    told = [line for line in log.splitlines() if " ERROR " in line and NO_MEMORY in line and "alarm joint" not in line]
    assert len(told) == 1
    assert "Traceback" not in log


def test_rows_wait_until_there_is_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that writes lives on: what it had no memory for is written afterwards, once."""
    refusals = [MemoryError(), MemoryError()]
    commit = Writer.commit

    def starved(self: Writer, batch: Sequence[Row], policy: Policy) -> None:
        if batch and refusals:
            raise refusals.pop()
        commit(self, batch, policy)

    monkeypatch.setattr(Writer, "commit", starved)
    monkeypatch.setattr(store, "RETRY_S", 0.05)
    with closing(Store(tmp_path / "history.db", "arm")) as written:
        written.add(ScoreRow("elbow", datetime(2026, 1, 31, tzinfo=UTC), 0.25, 3.0, 8.0, False))
        wait_until(lambda: "no memory is left" in written.problem)
        wait_until(lambda: not written.waiting() and not written.problem)
        with written.reader() as reader:
            assert [row.score for row in reader.scores("elbow")] == [3.0]


@pytest.mark.usefixtures("fake_driver")
def test_a_service_that_cannot_go_on_ends_with_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """No thread can be started beside the new file in place of a deleted one: one line, exit status 1, no traceback."""
    is_starved = False

    class Thread(threading.Thread):
        def start(self) -> None:
            if is_starved:
                raise NO_THREAD
            super().start()

    def look(self: Store) -> None:
        nonlocal is_starved
        is_starved = True
        self.damage = ReplacedError("deleted")

    monkeypatch.setattr(service.threading, "Thread", Thread)
    monkeypatch.setattr(Store, "look", look)
    monkeypatch.setattr(Store, "begin_anew", lambda *_: None)
    assert service.run(config.loads(fake_config(tmp_path), "fake"), duration_s=20.0) == 1
    log = capfd.readouterr().err
    assert log.count(f"{NO_MEMORY}; the service cannot go on and ends, to be started again") == 1
    assert "stopped" in log
    assert "Traceback" not in log


def test_metrics_without_a_thread(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    """Connections for which no thread can be started are closed, with one line for all; the next one is answered."""
    with closing(metrics_http.MetricsServer("127.0.0.1", 0, lambda: "page\n")) as server:
        address, process = server.server_address, metrics_http.socketserver.ThreadingTCPServer.process_request

        def starved(*_: object) -> None:
            raise NO_THREAD

        monkeypatch.setattr(metrics_http.socketserver.ThreadingTCPServer, "process_request", starved)
        assert [ask(address) for _ in range(3)] == [b"", b"", b""]
        monkeypatch.setattr(metrics_http.socketserver.ThreadingTCPServer, "process_request", process)
        assert b"200 OK" in ask(address)
    assert caplog.text.count(NO_MEMORY) == 1
    assert "Traceback" not in caplog.text


def ask(address: object) -> bytes:
    """The answer to a scrape."""
    with socket.create_connection(address, timeout=10) as connection:  # type: ignore[arg-type]
        connection.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        answer = b""
        while data := connection.recv(4096):
            answer += data
        return answer


@pytest.mark.parametrize("name", ["_send", "open_bus"])
def test_can_goes_on_when_there_is_memory(
    name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The bus is opened again, what stands is told then, and the log says once what was missing."""
    refusals, function = [MemoryError()] * 3, getattr(can_sink, name)

    def starved(*arguments: object) -> object:
        if refusals:
            raise refusals.pop()
        return function(*arguments)

    monkeypatch.setattr(can_sink, name, starved)
    monkeypatch.setattr(can_sink, "FIRST_RETRY_S", 0.02)
    with (
        can.Bus(request.node.name, interface="virtual") as bus,
        closing(CanSink(JOINTS, options(request.node.name))) as sink,
    ):
        sink.alarm(FAULT)
        assert frame_of(bus, 0x721).data == b"\x00"
        while frame_of(bus, 0xA1).data[:2] != b"\x03\xff":
            pass
    assert not refusals
    assert caplog.text.count(NO_MEMORY) == 1


def test_a_thread_of_can_outlives_what_its_own_handling_meets(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is no memory to say so, either: the thread is there afterwards."""
    refusals, say = [MemoryError()] * 2, CanSink._log_problem

    def starved(self: CanSink, problem: str) -> None:
        if refusals:
            raise refusals.pop()
        say(self, problem)

    monkeypatch.setattr(CanSink, "_log_problem", starved)
    monkeypatch.setattr(no_memory, "AGAIN_S", 0.02)
    monkeypatch.setattr(can_sink, "FIRST_RETRY_S", 0.02)
    with (
        can.Bus(request.node.name, interface="virtual") as bus,
        closing(CanSink(JOINTS, options(request.node.name))) as sink,
    ):
        wait_until(lambda: not refusals)
        sink.alarm(FAULT)
        while frame_of(bus, 0xA1).data[:2] != b"\x03\xff":
            pass


def test_who_asks_over_zenoh_is_told(tmp_path: Path, endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer for which there is no memory is an error with these words; the next one is whole."""
    fill(tmp_path / "history.db", 20)
    refusals, answer = [MemoryError()], Answers.to

    def starved(answers: Answers, key: str, parameters: Mapping[str, str]) -> Iterator[bytes]:
        if refusals:
            raise refusals.pop()
        yield from answer(answers, key, parameters)

    monkeypatch.setattr(Answers, "to", starved)
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), tmp_path / "history.db")) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            (refused,) = other.get("lostmotion/arm1/status", timeout=20.0)
            assert refused.err is not None
            assert json.loads(refused.err.payload.to_bytes())["error"] == NO_MEMORY
            (told,) = other.get("lostmotion/arm1/status", timeout=20.0)
            assert told.ok is not None


@pytest.mark.parametrize("error", [MemoryError(), NO_THREAD])
def test_a_zenoh_session_is_opened_when_there_is_memory(
    tmp_path: Path, endpoint: str, error: Exception, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """What fails after the session is open is undone, told once, and tried again; queries are answered then."""
    fill(tmp_path / "history.db", 20)
    refusals, reach = [error] * 2, zenoh_sink.LinkMonitor

    def starved(*given: Any) -> zenoh_sink.LinkMonitor:
        if refusals:
            raise refusals.pop()
        return reach(*given)

    monkeypatch.setattr(zenoh_sink, "LinkMonitor", starved)
    monkeypatch.setattr(zenoh_sink, "FIRST_RETRY_S", 0.02)
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), tmp_path / "history.db")) as sink:
        wait_until(lambda: sink.is_open)
        with session("client", connect=[endpoint]) as other:
            (told,) = other.get("lostmotion/arm1/status", timeout=20.0)
            assert told.ok is not None
    assert not refusals
    assert caplog.text.count(NO_MEMORY) == 1
