"""The sockets of the service: those that the configuration asks for, those that config check prints, and no others."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.config import ConfigError
from tests.daemon.cli_world import call
from tests.daemon.conftest import Running, free_endpoint, wait_until
from tests.daemon.fakes import fake_config

LISTENING = {"tcp": "0A", "tcp6": "0A", "udp": "07", "udp6": "07"}
"""the state of a socket that waits for others, in /proc/net"""

Start = Callable[..., Running]


def listening(pid: int) -> set[str]:
    """Where a process listens: protocol/address:port, from the kernel's own tables."""
    inodes = set()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        target = str(link.readlink()) if link.is_symlink() else ""
        if target.startswith("socket:["):
            inodes.add(target[8:-1])
    found = set()
    for table, waiting in LISTENING.items():
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            cells = line.split()
            if cells[9] in inodes and cells[3] == waiting:
                found.add(f"{table.rstrip('6')}/{_readable(cells[1])}")
    return found


def _readable(text: str) -> str:
    address, _, port = text.partition(":")
    words = [int(address[i : i + 8], 16) for i in range(0, len(address), 8)]
    raw = b"".join(struct.pack("=I", word) for word in words)
    name = socket.inet_ntop(socket.AF_INET if len(raw) == 4 else socket.AF_INET6, raw)
    return f"{name if len(raw) == 4 else f'[{name}]'}:{int(port, 16)}"


def printed(path: Path) -> list[dict[str, object]]:
    """What config check --json says of the sockets."""
    result = call("config", "check", path, "--json")
    assert result.exit_code == 0, result.stderr
    sockets: list[dict[str, object]] = json.loads(result.stdout)["sockets"]
    return sockets


@pytest.mark.slow
def test_a_zenoh_file_in_peer_mode_opens_nothing_that_it_does_not_name(
    tmp_path: Path, start: Start, fake_driver: None
) -> None:
    """With a file that only connects, metrics on this computer, and a listening endpoint: the kernel's tables hold what
    config check has printed, and nothing else."""
    metrics, here, away = (free_endpoint() for _ in range(3))
    zenoh, path = tmp_path / "peer.json5", tmp_path / "fake.toml"
    tables = f'[metrics]\nlisten = "{metrics.removeprefix("tcp/")}"\n[alarm.zenoh]\nconfig = "{zenoh}"\n'
    path.write_text(fake_config(tmp_path, tables))
    for text, expected in (
        (f'{{ mode: "peer", connect: {{ endpoints: ["{away}"], exit_on_failure: false }} }}', {metrics}),
        (f'{{ listen: {{ endpoints: {{ peer: ["{here}"], router: ["tcp/[::]:0"] }} }} }}', {metrics, here}),
    ):
        zenoh.write_text(text)
        told = {str(one["address"]) for one in printed(path) if one["does"] == "listens"}
        assert {f"tcp/{address.removeprefix('tcp/')}" for address in told} == expected
        running = start(path)
        running.wait_for("session open as" if here in expected else "metrics: http")
        wait_until(lambda running=running, expected=expected: listening(running.process.pid) >= expected)  # type: ignore[misc]
        running.wait_for("session open as", timeout_s=30)
        assert listening(running.process.pid) == expected
        running.stop(15)


def test_config_check_lists_sockets_and_to_whom_they_are_open(tmp_path: Path, fake_driver: None) -> None:
    """Loopback, encrypted, plain, multicast, outgoing and CAN; none at all is said as well."""
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path))
    assert printed(path) == []
    assert "sockets: none; nothing listens" in call("config", "check", path).stdout
    tables = """
[metrics]
listen = "0.0.0.0:9464"
[alarm.zenoh]
listen = ["tcp/127.0.0.1:7447", "tls/0.0.0.0:7448", "tcp/[::]:7449"]
connect = ["tcp/10.0.0.1:7447"]
multicast_scouting = true
[alarm.can]
interface = "virtual"
channel = "can0"
node_id = 3
"""
    path.write_text(fake_config(tmp_path, tables))
    assert [(one["of"], one["does"], one["address"], one["plain"]) for one in printed(path)] == [
        ("zenoh", "listens", "tcp/127.0.0.1:7447", False),
        ("zenoh", "listens", "tls/0.0.0.0:7448", False),
        ("zenoh", "listens", "tcp/[::]:7449", True),
        ("zenoh", "listens", "udp/224.0.0.224:7446", True),
        ("metrics", "listens", "0.0.0.0:9464", True),
        ("zenoh", "connects", "tcp/10.0.0.1:7447", False),
        ("can", "sends", "virtual can0", False),
    ]
    notes = [note for note in config.load(path).notes if "no password" in note]
    assert [note.partition(":")[0] for note in notes] == ["zenoh listens at tcp/[", "zenoh listens at udp/224.0.0.224",
                                                          "metrics listens at 0.0.0.0"]  # fmt: skip


def test_a_zenoh_file_without_any_address_is_refused(tmp_path: Path, fake_driver: None) -> None:
    """It would have listened on all interfaces; now nobody can reach the robot, and that is said."""
    (tmp_path / "peer.json5").write_text('{ mode: "peer" }')
    text = fake_config(tmp_path, f'[alarm.zenoh]\nconfig = "{tmp_path / "peer.json5"}"\n')
    with pytest.raises(
        ConfigError, match=r"alarm\.zenoh\.connect: found none, nor in .*peer\.json5, so that no program"
    ):
        config.loads(text, "x")
