"""Word to systemd, heard on a real datagram socket."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lostmotion.daemon.notify import Notifier


@contextmanager
def manager(address: str) -> Iterator[socket.socket]:
    """What systemd's end of the socket is."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.settimeout(60.0)
        end.bind(address)
        yield end


@pytest.mark.parametrize("abstract", [False, True])
def test_every_state_arrives_in_systemds_words(tmp_path: Path, abstract: bool) -> None:
    """READY, STATUS, WATCHDOG, RELOADING with its time, STOPPING; on a path and on an abstract address."""
    name = f"@lostmotion-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with manager(name.replace("@", "\0") if abstract else name) as end:
        notifier = Notifier({"NOTIFY_SOCKET": name})
        notifier.ready()
        notifier.status("2 OK")
        notifier.watchdog()
        before = time.monotonic()
        notifier.reloading()
        after = time.monotonic()
        notifier.stopping()
        heard = [end.recv(1000).decode() for _ in range(5)]
        notifier.close()
    assert heard[:3] == ["READY=1", "STATUS=2 OK", "WATCHDOG=1"]
    reloading = re.fullmatch(r"RELOADING=1\nMONOTONIC_USEC=(\d+)", heard[3])
    assert reloading
    assert before - 1e-6 <= int(reloading[1]) / 1e6 <= after
    assert heard[4] == "STOPPING=1"


def test_without_a_manager_nothing_happens(tmp_path: Path) -> None:
    """No socket in the environment, or one where nobody listens: no error."""
    for environment in ({}, {"NOTIFY_SOCKET": str(tmp_path / "nobody")}):
        notifier = Notifier(environment)
        notifier.ready()
        notifier.close()


def test_the_watchdogs_period_is_for_the_named_process() -> None:
    """WATCHDOG_USEC counts when WATCHDOG_PID is this process or missing."""
    mine, other = str(os.getpid()), str(os.getpid() + 1)
    assert Notifier({"WATCHDOG_USEC": "3000000"}).watchdog_s == 3.0
    assert Notifier({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": mine}).watchdog_s == 3.0
    assert Notifier({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": other}).watchdog_s is None
    assert Notifier({}).watchdog_s is None
