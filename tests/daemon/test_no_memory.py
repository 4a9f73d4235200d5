"""Memory that comes to an end while the service runs; `bench.faults` sets real limits."""

from __future__ import annotations

from pathlib import Path

import pytest

from lostmotion.daemon import config, service
from lostmotion.daemon.poller import BusPoller
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.service import NO_MEMORY
from tests.daemon.conftest import wait_until
from tests.daemon.fakes import fake_config


@pytest.mark.usefixtures("fake_driver")
@pytest.mark.parametrize("stage", [(Robot, "step"), (BusPoller, "run")])
def test_no_memory_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], stage: tuple[type, str]
) -> None:
    """A stage, or a poller, that finds no memory says so in one line without a traceback, and is tried again."""
    calls = 0

    def starved(*_: object) -> None:
        nonlocal calls
        calls += 1
        raise MemoryError

    monkeypatch.setattr(*stage, starved)
    monkeypatch.setattr(service, "CRASH_PAUSE_S", 0.05)
    loaded = config.loads(fake_config(tmp_path), "fake")
    assert service.run(loaded, duration_s=1.0) == 0
    wait_until(lambda: calls >= 3)
    log = capfd.readouterr().err
    told = [line for line in log.splitlines() if " ERROR " in line and NO_MEMORY in line and "alarm joint" not in line]
    assert len(told) == 1
    assert "Traceback" not in log
