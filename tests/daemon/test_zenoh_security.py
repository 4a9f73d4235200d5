"""The example configuration with certificates and an access list: who is not on it reads and writes nothing."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from pathlib import Path

import pytest
import zenoh
from examples.zenoh import certificates
from zenoh.ext import HistoryConfig, RecoveryConfig, declare_advanced_subscriber

from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import Cause, Severity
from lostmotion.daemon.sinks.zenoh import ZenohSink
from tests.daemon.cli_world import call, fill
from tests.daemon.conftest import ROOT, wait_until

ALARM = raised("elbow", Cause.PLAY, Severity.WARNING, "much", datetime(2026, 1, 31, 12, tzinfo=UTC))
SETTLE_S = 0.5
"""long enough for what must not arrive"""


class World:
    """The example files with certificates in ``folder`` and a port of this test's own."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        self.folder, self._port = folder, endpoint.rpartition(":")[2]
        certificates.main([str(folder / "good"), "arm1", "office", "stranger"])
        certificates.main([str(folder / "wrong"), "arm1", "office"])

    def file(self, example: str, authority: str = "good", name: str = "") -> Path:
        """One of the examples, with certificates of an authority, if need be of somebody else."""
        text = (ROOT / "examples" / "zenoh" / example).read_text()
        text = text.replace("/etc/lostmotion/zenoh", str(self.folder / authority))
        text = re.sub(r"/(0\.0\.0\.0|localhost):7447", f"/localhost:{self._port}", text)
        path = self.folder / f"{authority}-{name}-{example}"
        path.write_text(re.sub(r"(arm1|office)\.(pem|key)", rf"{name}.\2", text) if name else text)
        return path

    def open(self, example: str, authority: str = "good", name: str = "") -> zenoh.Session:
        """A session with that file."""
        return zenoh.open(zenoh.Config.from_file(self.file(example, authority, name)))


@pytest.fixture
def world(tmp_path: Path, endpoint: str) -> Iterator[World]:
    """The router runs, and the robot arm1 with a database and an alarm."""
    world = World(tmp_path, endpoint)
    fill(tmp_path / "arm1.db", 20)
    with ExitStack() as stack:
        stack.enter_context(world.open("router.json5"))
        options = ZenohOptions(config=str(world.file("robot.json5")))
        sink = stack.enter_context(closing(ZenohSink("arm1", options, tmp_path / "arm1.db")))
        wait_until(lambda: sink.is_open)
        sink.alarm(ALARM)
        yield world


def test_who_is_on_the_list_hears_and_asks(world: World) -> None:
    """An operator gets the alarm that was raised before, and the fleet's status; nobody hears what he writes."""
    heard: list[str] = []
    with world.open("operator.json5") as office, world.open("robot.json5") as robot:
        declare_advanced_subscriber(
            office,
            "lostmotion/*/*/alarm",
            lambda sample: heard.append(json.loads(sample.payload.to_bytes())["id"]),
            history=HistoryConfig(detect_late_publishers=True),
            recovery=RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        wait_until(lambda: heard == [ALARM.id])
        forged: list[object] = []
        robot.declare_subscriber("lostmotion/**", forged.append)
        office.declare_publisher("lostmotion/arm1/elbow/alarm", allowed_destination=zenoh.Locality.REMOTE).put("forged")
        time.sleep(SETTLE_S)
    assert (heard, forged) == ([ALARM.id], [])
    result = call("fleet", "status", "--zenoh", world.file("operator.json5"), "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["robots"][0]["robot"] == "arm1"


def test_who_is_not_on_the_list_reads_and_writes_nothing(world: World) -> None:
    """A certificate of the right authority is not enough: nothing is heard, nothing is answered, nothing arrives."""
    heard: list[object] = []
    with world.open("operator.json5", name="stranger") as stranger, world.open("operator.json5") as office:
        for key in ("lostmotion/**", "lostmotion/**/@adv/**"):
            stranger.declare_subscriber(key, heard.append)
        forged: list[object] = []
        office.declare_subscriber("lostmotion/**", forged.append)
        time.sleep(SETTLE_S)
        publisher = stranger.declare_publisher("lostmotion/arm1/elbow/alarm", allowed_destination=zenoh.Locality.REMOTE)
        publisher.put("forged")
        assert [reply for reply in stranger.get("lostmotion/*/status", timeout=SETTLE_S) if reply.ok] == []
        assert list(stranger.liveliness().get("lostmotion/*/alive", timeout=SETTLE_S)) == []
    assert (heard, forged) == ([], [])


@pytest.mark.parametrize("who", ["wrong", "without"])
def test_who_has_no_good_certificate_gets_no_session(world: World, who: str) -> None:
    """Signed by another authority, or none of his own: the router does not talk to him."""
    file = world.file("operator.json5", "wrong" if who == "wrong" else "good")
    if who == "without":
        file.write_text("\n".join(line for line in file.read_text().splitlines() if "connect_" not in line))
    with pytest.raises(zenoh.ZError, match="Unable to connect"):
        zenoh.open(zenoh.Config.from_file(file))
    result = call("fleet", "status", "--zenoh", file)
    assert (result.exit_code, "nobody answers" in result.stderr) == (2, True)
    why = {"wrong": "TLS: the certificate is not accepted: ", "without": "TLS answers, but Zenoh opens no session"}
    assert why[who] in result.stderr
    assert "orchestrator" not in result.stderr
    assert "[Single(" not in result.stderr


def test_certificates_that_are_in_use_are_kept(tmp_path: Path) -> None:
    """A second call would make a new authority, of which the robots know nothing."""
    certificates.main([str(tmp_path), "arm1"])
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(SystemExit, match="2"):
        certificates.main([str(tmp_path), "arm2"])
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
