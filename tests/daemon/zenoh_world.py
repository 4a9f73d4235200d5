"""Zenoh sessions of other programs, and a router in a process of its own that can be killed.

``python -m tests.daemon.zenoh_world FILE`` opens a session with this configuration, says "open", and stays.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import zenoh

ROOT = Path(__file__).parent.parent.parent


@contextmanager
def session(mode: str, **endpoints: list[str]) -> Iterator[zenoh.Session]:
    """Another program's session."""
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps(mode))
    config.insert_json5("scouting/multicast/enabled", "false")
    for key, value in endpoints.items():
        config.insert_json5(f"{key}/endpoints", json.dumps(value))
    with zenoh.open(config) as opened:
        yield opened


class Router:
    """A router that is killed and started again, as often as one likes."""

    def __init__(self, folder: Path, endpoint: str) -> None:
        self._file = folder / "router.json5"
        settings = {"mode": "router", "listen": {"endpoints": [endpoint]}}
        self._file.write_text(json.dumps(settings | {"scouting": {"multicast": {"enabled": False}}}))
        self.start()

    def start(self) -> None:
        """Runs when this returns."""
        command = [sys.executable, "-m", "tests.daemon.zenoh_world", str(self._file)]
        self._process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == "open\n"

    def kill(self) -> None:
        """kill -9."""
        self._process.kill()
        self._process.communicate()

    def hang(self) -> None:
        """It still takes connections, and says nothing any more."""
        self._process.send_signal(signal.SIGSTOP)

    def resume(self) -> None:
        """After ``hang``."""
        self._process.send_signal(signal.SIGCONT)

    close = kill


if __name__ == "__main__":
    with zenoh.open(zenoh.Config.from_file(sys.argv[1])):
        print("open", flush=True)
        threading.Event().wait()
