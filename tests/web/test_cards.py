"""The texts of the first page, without a browser."""

from __future__ import annotations

from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import JointRow, Origin, Origins, ScoreRow
from lostmotion.daemon.store import Store
from lostmotion.web.cards import cards
from lostmotion.web.site import Site
from lostmotion.web.spark import spark
from tests.web.world import robot


@pytest.mark.parametrize(
    ("sure", "of_shoulder"),
    [(0.999, "impact at the last reversal, most probably of elbow (over 99%)"), (0.6, "impact at the last reversal")],
)
def test_an_impact_of_another_joint_is_told_as_its(tmp_path: Path, sure: float, of_shoulder: str) -> None:
    """A joint that is OK in spite of impacts far above the level says whose they are, once that is known."""
    database = tmp_path / "history.db"
    with closing(Store(database, "arm1")) as store:
        for joint in ("elbow", "shoulder"):
            store.add(JointRow(joint))
            store.add(ScoreRow(joint, datetime.now(UTC), 0.25, 215.0, 4.5, True))
        store.add(Origins((Origin({"elbow": sure, "shoulder": 1 - sure}, 88),)))
    with open_readonly(database) as reader:
        reasons = {card.joint: card.reason for card in cards(Site(robot(tmp_path), database), reader).joints}
    assert reasons == {"elbow": "impact at the last reversal", "shoulder": of_shoulder}


@pytest.mark.parametrize(
    ("span", "words"),
    [
        (timedelta(seconds=40), "40 s"),
        (timedelta(minutes=5), "5 min"),
        (timedelta(hours=5), "5 h"),
        (timedelta(days=40), "40 d"),
    ],
)
def test_a_curve_says_how_long_it_is(tmp_path: Path, span: timedelta, words: str) -> None:
    """The span of a curve is told as every length of time is, not as 0.1 hours."""
    database, now = tmp_path / "history.db", datetime.now(UTC)
    with closing(Store(database, "arm1")) as store:
        for k in range(5):
            store.add(ScoreRow("elbow", now - span * (4 - k) / 4, 0.25, 1.0 + k, 4.5, False))
    with open_readonly(database) as reader:
        assert spark(reader, "elbow", timedelta(days=90), 0.005).words == f"score over the last {words}"
