"""Memory that comes to an end while the service runs; `bench.faults` sets real limits."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from lostmotion.daemon import config, service, store
from lostmotion.daemon.poller import BusPoller
from lostmotion.daemon.records import ScoreRow
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.service import NO_MEMORY
from lostmotion.daemon.store import Store
from lostmotion.daemon.writer import Policy, Row, Writer
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
