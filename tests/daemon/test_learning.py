"""The noise that a service learns: kept in the database, gone on from, and told when it changes."""

from __future__ import annotations

import logging
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import msgspec
import pytest

from lostmotion.daemon import config as configuration
from lostmotion.daemon import documents
from lostmotion.daemon.learning import Learning
from lostmotion.daemon.learnt import BarRow, FlankRow, NoiseChange, NoiseRow
from lostmotion.daemon.pipeline import Learnt
from lostmotion.daemon.records import EPOCH
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.store import Store, open_readonly
from lostmotion.detector.learner import Change
from lostmotion.detector.servo import DELAYS
from tests.daemon.cli_world import SIMULATED

BAR = BarRow(61.0, 0.2, 0.011, 0.1, 90, 61.0, 0.012)
FIRST = NoiseChange(EPOCH, "noise learnt: 0.2 m/s²")
ROW = NoiseRow("elbow", 58.0, 1000.0, 250, (0.04, 0.01), 100.0, 0.5, 220, (FIRST,))


def robot(text: str = SIMULATED) -> Robot:
    """A simulated robot that nobody has started."""
    return Robot(configuration.loads(text, "robot.toml"))


def test_noises_are_kept(tmp_path: Path) -> None:
    """What is stored is read again, the newest of each joint, and stands in the document of status."""
    store = Store(tmp_path / "history.db", "arm")
    store.add(ROW, replace_seen(ROW, 500))
    assert store.close() == 0
    with open_readonly(tmp_path / "history.db") as reader:
        assert reader.noises() == [replace_seen(ROW, 500)]
        (told,) = documents.status(reader)["noise"]
    assert (told["joint"], told["windows"], told["noise_ms2"]) == ("elbow", 500, pytest.approx(0.2))
    assert told["changes"] == [{"time": "1970-01-01T00:00:00.000000Z", "text": "noise learnt: 0.2 m/s²"}]


def replace_seen(row: NoiseRow, seen: int) -> NoiseRow:
    """The same after so many windows."""
    return msgspec.structs.replace(row, seen=seen)


def test_bar_and_flanks_survive_a_restart(tmp_path: Path) -> None:
    """Resonance, damping, the law of the flanks and the servo's are those of the earlier run, from the first window on;
    with another zeta in the file the bar is the file's, and a law that the file gives stays."""
    servo = tuple(-abs(float(i) - 5) for i in range(DELAYS.size))
    flanks = FlankRow("elbow", tuple(-float(i) for i in range(8)), 60, (0.02, 0.0, 0.065), servo, (0.02, 0.004))
    store = Store(tmp_path / "history.db", "arm")
    store.add(msgspec.structs.replace(ROW, zeta=0.012, bar=BAR), flanks)
    assert store.close() == 0
    with open_readonly(tmp_path / "history.db") as reader:
        noises, kept = reader.noises(), reader.flanks()
        told = {"joint": "elbow", "softness": (0.02, 0.0, 0.065), "windows": 60, "servo_delay_s": (0.02, 0.004)}
        assert documents.status(reader)["flanks"] == [told]
        assert documents.status(reader)["noise"][0]["f_res_hz"] == 61.0
    found = robot()
    learning = Learning(found, noises, kept)
    learner = found.pipeline.learners["elbow"]
    assert (learner.settings.f_res_hz, learner.settings.zeta) == (61.0, 0.012)
    law, windows, follows = found.pipeline.laws["elbow"]
    assert follows.likelihood == servo
    assert str(kept[0]).endswith("from 60 windows; servo delay 20 ± 8 ms")
    assert (law.likelihood, windows) == (flanks.likelihood, 60)
    assert law.softness == (0.0, 0.0, 0.065)
    assert learning.rows() == []
    text = SIMULATED.replace("f_res_hz = 58.0", "f_res_hz = 58.0, zeta = 0.02")
    other = robot(text.replace("level = 5.5", "level = 5.5\nflank_exponent = 11"))
    Learning(other, noises, kept)
    assert other.pipeline.learners["elbow"].settings.f_res_hz == 58.0
    assert other.pipeline.laws == {}


def test_laws_of_flanks_are_written_now_and_then() -> None:
    """A row after every 20 windows that have told something, not before."""
    found = robot()
    learning, rows = Learning(found, []), []
    for windows in range(1, 46):
        found.pipeline.resume_law("elbow", (0.0,) * 8, windows)
        rows += learning.rows()
    assert [row.windows for row in rows if isinstance(row, FlankRow)] == [20, 40]


def test_what_is_told_of_a_bar() -> None:
    """What the scores are made with, what the file says, and what the windows show."""
    told = msgspec.structs.replace(ROW, zeta=0.012, bar=BAR).resonance
    assert told == (
        "resonance 61 Hz, damping 0.012, followed; in the file 58 Hz, 0.012; windows show 61 ± 0.4 Hz, 0.011"
    )
    assert msgspec.structs.replace(ROW, zeta=0.012).resonance == "resonance 58 Hz, damping 0.012, as in the file"


@pytest.mark.parametrize(("old", "new", "seen"), [("", "", 220), ("f_res_hz = 58.0", "f_res_hz = 50.0", 0)])
def test_a_restart_goes_on_and_another_bar_begins_anew(old: str, new: str, seen: int) -> None:
    """The learner of the same joint, bar and rate counts on with that noise; with another resonance it begins anew."""
    found = robot(SIMULATED.replace(old, new) if old else SIMULATED)
    Learning(found, [ROW])
    learner = found.pipeline.learners["elbow"]
    assert learner.seen == seen
    assert (learner.background is not None) == bool(seen)


def test_a_calibrated_noise_is_not_learnt_over() -> None:
    """With noise_ms2 in the file there is nothing that learns."""
    assert robot(SIMULATED.replace("level = 5.5", "level = 5.5\nnoise_ms2 = 0.1")).pipeline.learners == {}


def test_a_change_is_told_once_and_kept(caplog: pytest.LogCaptureFixture) -> None:
    """Another noise is a warning in the log and in the row, after what was told before."""
    found = robot()
    learning = Learning(found, [ROW])
    change = Change(0.2, 0.5, 50.0)
    learnt = Learnt("elbow", 10.0, found.pipeline.learners["elbow"], change)
    found.pipeline.learnt = lambda: [learnt, replace(learnt, change=None)]  # type: ignore[method-assign]
    with caplog.at_level(logging.INFO):
        first, second = learning.rows()
    text = "noise has changed from 0.2 to 0.5 m/s², most near 50 Hz"
    assert [record.getMessage() for record in caplog.records] == [f"elbow: {text}"]
    assert [told.text for told in first.changes] == ["noise learnt: 0.2 m/s²", text]
    assert second.changes == first.changes
    assert first.changes[-1].time - found.clock.utc(0.0) == timedelta(seconds=10)
    assert first.covariance == pytest.approx(ROW.covariance)
