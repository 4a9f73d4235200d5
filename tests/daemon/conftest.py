"""Fixtures of the service's tests: the fake driver, the service in a process of its own."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from lostmotion.drivers import registry

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture
def fake_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fake driver is in the table."""
    monkeypatch.setitem(registry.BUILT_IN, "fake", "tests.daemon.fakes:DRIVER")


@pytest.fixture
def endpoint() -> str:
    """A TCP port of this host that nobody uses, as Zenoh writes it."""
    return free_endpoint()


def free_endpoint() -> str:
    """Such a port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


class SmallDisk:
    """A filesystem of its own, at ``path``, that holds so many files and folders."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def hold(self, files: int) -> None:
        """From now on it holds so many; it already has one, the folder at ``path``."""
        subprocess.run(["mount", "-o", f"remount,nr_inodes={files}", self.path], check=True)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[SmallDisk]:
    """A disk with room for a thousand files, until the test's ``hold``."""
    disk = SmallDisk(tmp_path / "disk")
    disk.path.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "nr_inodes=1000", "none", disk.path], capture_output=True)
    if mounted.returncode:
        pytest.skip("this user may not mount a filesystem")
    yield disk
    subprocess.run(["umount", "--lazy", disk.path], check=True)


class Running:
    """A service in another process; ``log`` is a file that grows."""

    def __init__(self, config: Path, log: Path, environment: dict[str, str]) -> None:
        self.log = log
        with log.open("w") as sink:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "tests.daemon.fakes", str(config)],
                cwd=ROOT, stderr=sink, env=os.environ | environment,
            )  # fmt: skip

    def wait_for(self, text: str, times: int = 1, timeout_s: float = 60.0) -> str:
        """Waits until the log holds the text so often; the log."""
        wait_until(lambda: self.log.read_text().count(text) >= times, timeout_s, lambda: self.log.read_text())
        return self.log.read_text()

    def stop(self, number: int) -> int:
        """Sends a signal and waits for the end; the exit status."""
        self.process.send_signal(number)
        return self.process.wait(60)


def wait_until(condition: Callable[[], object], timeout_s: float = 60.0, state: Callable[[], str] = str) -> None:
    """Waits until the condition holds; fails with the state when it never does."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, f"not within {timeout_s} s; {state()}"
        time.sleep(0.01)


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Running]]:
    """Starts the service with a configuration file, in a process that ends with the test."""
    started: list[Running] = []

    def begin(config: Path, **environment: str) -> Running:
        started.append(Running(config, tmp_path / f"log{len(started)}", environment))
        return started[-1]

    yield begin
    for running in started:
        running.process.kill()
        running.process.wait()
