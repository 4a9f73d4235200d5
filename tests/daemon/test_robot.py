"""Devices of a robot and what is said of them: real drivers on pseudo-terminals."""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.robot import Robot
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine
from tests.daemon.test_service import hardware


def test_a_wrong_device_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A sensor where the servos should be says something else at each look: the joints' fault stays the same, and is
    their own only."""
    monkeypatch.setattr("lostmotion.daemon.poller.WRONG_RETRY_S", 0.05)
    motion = Motion()
    with Emulator(ServoLine.of("AX-12A", [1, 2], motion), CsvStream(motion)) as emulator:
        robot = Robot(config.load(hardware(tmp_path, *reversed(emulator.paths))))
        thread = threading.Thread(target=robot.pollers[0].run)
        thread.start()
        told: dict[str, set[str | None]] = {joint.name: set() for joint in robot.config.joints}
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            for joint in robot.config.joints:
                told[joint.name].add(robot.fault(joint))
            time.sleep(0.01)
        robot.stop.set()
        thread.join()
    for name, texts in told.items():
        (text,) = filter(None, texts)
        assert text.startswith(f"{name}: found no answer, but bytes unasked; likely cause: another device on the port")
    errors = [record.message for record in caplog.records if record.levelno == logging.ERROR]
    assert len(errors) == len(told)
