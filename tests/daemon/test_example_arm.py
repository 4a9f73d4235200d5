"""README's example, from its text to the size of the play: its hardware emulated byte by byte."""

from __future__ import annotations

import math
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import ScoreRow
from lostmotion.detector.pooling import pooled
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine
from lostmotion.drivers.emulator.motion import PLAY_RAD
from tests.conftest import ROOT
from tests.daemon.conftest import Running, wait_until

EXAMPLE = (ROOT / "examples" / "arm.toml").read_text()
LEVERS = (0.25, 0.10)


def test_readme_shows_the_example_which_can_tell_everything() -> None:
    """The file and what the README shows are the same; nothing is noted about it."""
    assert EXAMPLE in (ROOT / "README.md").read_text()
    arm = config.loads(EXAMPLE, "arm.toml")
    assert arm.notes == ()
    assert tuple(arm.levers(joint)["tip"] for joint in arm.joints) == LEVERS


@pytest.mark.slow
def test_the_example_tells_the_joint_and_its_play(tmp_path: Path, start: Callable[..., Running]) -> None:
    """The service says that the elbow has the play, with more than 95 %, and how large it is: all windows together
    within a third of the truth; of the shoulder it says none."""
    motion = Motion(levers=LEVERS)
    with Emulator(ServoLine.of("AX-12A", [2, 3], motion), CsvStream(motion), link=tmp_path / "ttyUSB") as robot:
        text = EXAMPLE.partition("[alarm.zenoh]")[0].replace("/var/lib/lostmotion", str(tmp_path))
        for name, path in zip(("/dev/ttyUSB0", "/dev/ttyUSB1"), robot.paths, strict=True):
            text = text.replace(name, path)
        (tmp_path / "arm.toml").write_text(text)
        service = start(tmp_path / "arm.toml")
        service.wait_for("alarm joint=elbow cause=play", timeout_s=60.0)
        # How many windows that takes depends on which of them a busy machine lets be whole.
        wait_until(lambda: is_right(tmp_path), 240.0, lambda: str((probabilities(tmp_path), pooled_play(tmp_path))))
        assert service.stop(signal.SIGTERM) == 0
    assert plays(tmp_path, "shoulder") == []


def is_right(folder: Path) -> bool:
    """Whether at least 24 windows have told a size, together within a third of the truth, and whose it is."""
    told, joints = pooled_play(folder), probabilities(folder)
    return (
        len(plays(folder, "elbow")) >= 24
        and told == pytest.approx(PLAY_RAD, rel=1 / 3)
        and joints["elbow"] > 0.95
        and joints["shoulder"] < 0.5
    )


def probabilities(folder: Path) -> dict[str, float]:
    """The probability of play of each joint."""
    with open_readonly(folder / "history.db") as reader:
        return dict(reader.origins()[0].probabilities) if reader.origins() else {"elbow": 0.5, "shoulder": 0.5}


def pooled_play(folder: Path) -> float:
    """The size that all windows of the elbow tell together [rad]."""
    told = plays(folder, "elbow")
    return pooled([row.play for row in told], [(row.play_high - row.play_low) / 2 for row in told]).value


def plays(folder: Path, joint: str) -> list[ScoreRow]:
    """The windows that told a size."""
    with open_readonly(folder / "history.db") as reader:
        return [row for row in reader.scores(joint) if math.isfinite(row.play)]
