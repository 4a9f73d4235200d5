"""The metrics, asked for over real HTTP and read by Prometheus' own parser."""

from __future__ import annotations

import json
import logging
import math
import re
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from datetime import UTC, datetime
from pathlib import Path
from urllib.request import urlopen

import pytest
from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families

from lostmotion.daemon import config as configuration
from lostmotion.daemon import metrics, metrics_http
from lostmotion.daemon.config import ConfigError
from lostmotion.daemon.metrics import Exporter
from lostmotion.daemon.metrics_http import MOST_CONNECTIONS
from lostmotion.daemon.monitored_joint import Counts
from lostmotion.daemon.records import DeviceRow, Health, JointRow, ScoreRow, SinkRow, SinkRows
from lostmotion.daemon.store import Store
from tests.conftest import ROOT
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


def free_port() -> int:
    """A port of this computer that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def scrape(port: int) -> dict[str, Metric]:
    """What Prometheus would read, by metric."""
    with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=60) as answer:
        return {family.name: family for family in text_string_to_metric_families(answer.read().decode())}


def value(family: Metric, **labels: str) -> float:
    """The one sample with these labels."""
    (found,) = (sample.value for sample in family.samples if labels.items() <= sample.labels.items())
    return float(found)


def test_numbers_are_those_of_the_database(tmp_path: Path) -> None:
    """Score, level, play, time, health, counts and losses arrive as they were stored; unknown is NaN."""
    store, port = Store(tmp_path / "history.db", "arm1"), free_port()
    store.add(
        ScoreRow("elbow", NOON, 0.25, 17.5, 8.0, True, 1e-3, 9e-4, 1.1e-3, severity=2e-3, severity_high=4e-3),
        JointRow("elbow", Health.WARNING),
    )
    store.add(ScoreRow("wrist", NOON, 0.25, 2.5, 8.0, False), DeviceRow("tip", NOON, "reading", "", 200, 3, 0, 0, 0, 0))
    store.add(
        SinkRows((SinkRow("zenoh", True, NOON, ""), SinkRow("can", False, NOON, "?"), SinkRow("x", None, NOON, "")))
    )
    counts = Counts(triggered=9, scored=7)
    counts.lost["gap"] = 2
    exporter = Exporter(f"127.0.0.1:{port}", store, {"elbow": counts})
    wait_until(lambda: store.waiting() == 0)
    found = scrape(port)
    assert value(found["lostmotion_info"], robot="arm1") == 1
    assert value(found["lostmotion_joint_score"], joint="elbow") == 17.5
    assert value(found["lostmotion_joint_level"], joint="wrist") == 8.0
    assert value(found["lostmotion_joint_play_high_radians"], joint="elbow") == 1.1e-3
    assert value(found["lostmotion_joint_severity_radians"], joint="elbow") == 2e-3
    assert value(found["lostmotion_joint_severity_high_radians"], joint="elbow") == 4e-3
    assert math.isnan(value(found["lostmotion_joint_severity_low_radians"], joint="elbow"))
    assert found["lostmotion_joint_severity_radians"].documentation.startswith("Equivalent play")
    assert math.isnan(value(found["lostmotion_joint_play_radians"], joint="wrist"))
    assert value(found["lostmotion_joint_last_window_timestamp_seconds"], joint="elbow") == NOON.timestamp()
    healths = {sample.labels["health"]: sample.value for sample in found["lostmotion_joint_health"].samples[:4]}
    assert healths == {"OK": 0, "DEGRADED": 0, "WARNING": 1, "ERROR": 0}
    assert value(found["lostmotion_windows_lost"], joint="elbow", reason="gap") == 2
    assert value(found["lostmotion_device_samples"], device="tip") == 200
    assert value(found["lostmotion_device_losses"], device="tip", kind="lost") == 3
    sinks = {sample.labels["sink"]: sample.value for sample in found["lostmotion_sink_up"].samples}
    assert sinks == {"zenoh": 1, "can": 0}
    assert value(found["lostmotion_database_readable"]) == 1
    exporter.close()
    store.close()


def test_the_dashboard_asks_for_what_there_is(tmp_path: Path) -> None:
    """Every metric that the dashboard, the alert rules and the page of metrics name is exported."""
    store, port = Store(tmp_path / "history.db", "arm1"), free_port()
    exporter = Exporter(f"127.0.0.1:{port}", store, {})
    families = scrape(port).values()
    exported = {f"{family.name}_total" if family.type == "counter" else family.name for family in families}
    exporter.close()
    store.close()
    board = json.loads((ROOT / "examples/grafana/lostmotion.json").read_text())
    asked = " ".join(target["expr"] for panel in board["panels"] for target in panel["targets"])
    asked += (ROOT / "examples/grafana/alerts.yml").read_text()
    names = set(re.findall(r"\b(?:lostmotion|process)_[a-z_]+", asked))
    assert len(names) >= 12
    assert names <= exported


def test_a_database_that_cannot_be_read_is_a_metric(tmp_path: Path) -> None:
    """Without the file the scrape still succeeds and says so."""
    store, port = Store(tmp_path / "history.db", "arm1"), free_port()
    exporter = Exporter(f"127.0.0.1:{port}", store, {})
    (tmp_path / "history.db").unlink()
    found = scrape(port)
    exporter.close()
    store.close()
    assert value(found["lostmotion_database_readable"]) == 0
    assert "lostmotion_joint_score" not in found


@pytest.fixture
def served(tmp_path: Path) -> Iterator[int]:
    """The port of an exporter."""
    store, port = Store(tmp_path / "history.db", "arm1"), free_port()
    exporter = Exporter(f"127.0.0.1:{port}", store, {})
    yield port
    exporter.close()
    store.close()


def ended(connection: socket.socket) -> bool:
    """Whether the server has ended a connection; waits for it."""
    connection.settimeout(20)
    with suppress(ConnectionResetError):
        return connection.recv(1) == b""
    return True


def test_half_open_connections_keep_no_scrape_out(served: int) -> None:
    """Of 300 connections that send half a request all but the newest are ended, and with them their threads; a scrape
    is answered all the while."""
    threads = threading.active_count()
    with ExitStack() as stack:
        connections = []
        for number in range(300):
            connections.append(stack.enter_context(socket.create_connection(("127.0.0.1", served))))
            connections[-1].sendall(b"GET /metr")
            if number % 100 == 99:
                assert value(scrape(served)["lostmotion_database_readable"]) == 1
        assert all(ended(connection) for connection in connections[:-MOST_CONNECTIONS])
        wait_until(lambda: threading.active_count() <= threads + MOST_CONNECTIONS)
        assert value(scrape(served)["lostmotion_database_readable"]) == 1


def test_a_connection_that_says_nothing_is_ended(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """After its time, and without a word in the log."""
    monkeypatch.setattr(metrics_http, "TIMEOUT_S", 0.1)
    store, port = Store(tmp_path / "history.db", "arm1"), free_port()
    exporter = Exporter(f"127.0.0.1:{port}", store, {})
    with socket.create_connection(("127.0.0.1", port)) as silent, socket.create_connection(("127.0.0.1", port)) as half:
        half.sendall(b"GET /metr")
        assert ended(silent)
        assert ended(half)
    exporter.close()
    store.close()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("request_line", "status"),
    [
        (b"GET /metrics HTTP/1.1", b"200"),
        (b"GET /metrics?name[]=up HTTP/1.1", b"200"),
        (b"HEAD /metrics HTTP/1.0", b"200"),
        (b"POST /metrics HTTP/1.1", b"405"),
        (b"GET /favicon.ico HTTP/1.1", b"404"),
        (b"\x16\x03\x01 garbage", b"400"),
        (b"GET " + b"x" * 100_000, b"400"),
        (b"", b"400"),
    ],
)
def test_each_request_gets_its_answer(served: int, request_line: bytes, status: bytes) -> None:
    """A page, or what was wrong, and the end of the connection."""
    with socket.create_connection(("127.0.0.1", served), timeout=20) as connection:
        connection.sendall(request_line + b"\r\nHost: robot\r\n\r\n")
        answer = b""
        with suppress(ConnectionResetError):
            while more := connection.recv(65536):
                answer += more
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.0 " + status)
    assert (b"lostmotion_store_writable 1.0" in body) == request_line.startswith(b"GET /metrics")


def test_a_taken_address_is_told_and_had_once_it_is_free(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The log names the address; the service goes on without metrics until the other program gives it back."""
    caplog.set_level(logging.INFO)
    monkeypatch.setattr(metrics, "RETRY_S", 0.05)
    store = Store(tmp_path / "history.db", "arm1")
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        exporter = Exporter(f"127.0.0.1:{port}", store, {})
        Exporter(f"127.0.0.1:{port}", store, {}).close()  # also while it is taken
    wait_until(lambda: "metrics: http://" in caplog.text)
    assert value(scrape(port)["lostmotion_store_writable"]) == 1
    exporter.close()
    store.close()
    assert f"metrics: cannot listen at 127.0.0.1:{port} (" in caplog.text


@pytest.mark.parametrize("listen", ["9464", "robot:9464", "127.0.0.1:70000", "127.0.0.1", ""])
def test_a_wrong_address_is_refused(tmp_path: Path, listen: str) -> None:
    """The key is named, with an example of what is right."""
    text = (ROOT / "examples/arm.toml").read_text() + f'\n[metrics]\nlisten = "{listen}"\n'
    with pytest.raises(ConfigError, match=r"metrics.listen: found .*, expected ADDRESS:PORT such as 127.0.0.1:9464"):
        configuration.loads(text, "arm.toml")


def test_an_open_address_is_worth_a_note() -> None:
    """Who listens beyond this computer is told that there is no password; loopback is not worth a word."""
    text = (ROOT / "examples/arm.toml").read_text() + "\n[metrics]\n"
    assert not any("metrics" in note for note in configuration.loads(text, "arm.toml").notes)
    notes = configuration.loads(text + 'listen = "0.0.0.0:9464"\n', "arm.toml").notes
    assert any("metrics listens at 0.0.0.0:9464: open to everybody" in note for note in notes)


@pytest.mark.slow
def test_the_service_answers_and_gives_the_address_back(tmp_path: Path, start: Callable[..., Running]) -> None:
    """A running service counts its windows; a reload keeps the address, one without the table frees it."""
    port, path = free_port(), tmp_path / "fake.toml"
    plain = fake_config(tmp_path)
    path.write_text(plain + f'\n[metrics]\nlisten = "127.0.0.1:{port}"\n')
    service = start(path)
    service.wait_for("started")
    wait_until(lambda: any(sample.value for sample in scrape(port)["lostmotion_windows_scored"].samples))
    service.process.send_signal(signal.SIGHUP)
    service.wait_for("configuration taken")
    assert value(scrape(port)["lostmotion_database_readable"]) == 1
    path.write_text(plain)
    service.process.send_signal(signal.SIGHUP)
    service.wait_for("configuration taken", times=2)
    with pytest.raises(OSError, match="refused"):
        scrape(port)
    assert service.stop(signal.SIGTERM) == 0
