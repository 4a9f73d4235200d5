"""What the pipeline learns of a joint: noise, bar, flanks and servo; kept in the database, and logged when it changes.

``detector/learner.py`` and ``detector/flank.py`` do the learning.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

from lostmotion.daemon.learnt import BarRow, FlankRow, NoiseChange, NoiseRow
from lostmotion.daemon.pipeline import Learnt
from lostmotion.daemon.robot import Robot
from lostmotion.detector.background import Background
from lostmotion.detector.bar import Bar
from lostmotion.detector.learner import Learner

__all__ = ["Learning"]

log = logging.getLogger(__name__)

CHANGES = 10
"""the last changes of each joint's noise are kept"""
NO_NOISE = Background((), 0.0, 0, 0.0)
"""where the bar is known and the noise is not: rings are too loud in all windows"""
FLANK_WINDOWS = 20
"""after so many more windows a law of the flanks is written again"""


class Learning:
    """What is learnt of each joint of a robot."""

    def __init__(self, robot: Robot, earlier: Iterable[NoiseRow], flanks: Iterable[FlankRow] = ()) -> None:
        """Goes on from what an earlier run has learnt with the same bar, rate and length of the windows."""
        self._robot = robot
        self._changes: dict[str, tuple[NoiseChange, ...]] = {}
        self._written: dict[str, int] = {}
        for row in earlier:
            learner = robot.pipeline.learners.get(row.joint)
            if learner is None:
                continue
            self._changes[row.joint] = row.changes
            if (row.f_res_hz, row.rate_hz) == (learner.given.f_res_hz, learner.rate_hz):
                bar = row.bar if row.zeta == learner.given.zeta else None
                background = Background(row.covariance, row.told, row.length, row.ringing) if row.covariance else None
                learner.resume(background, row.seen, _bar(bar))
        for flank in flanks:
            robot.pipeline.resume_law(flank.joint, flank.likelihood, flank.windows, flank.servo)
            self._written[flank.joint] = flank.windows

    def rows(self) -> list[NoiseRow | FlankRow]:
        """What has been learnt since the last call; a change is logged."""
        return [*(self._row(learnt) for learnt in self._robot.pipeline.learnt()), *self._flanks()]

    def _flanks(self) -> Iterable[FlankRow]:
        for joint, (law, windows, servo) in self._robot.pipeline.laws.items():
            if windows - self._written.get(joint, 0) >= FLANK_WINDOWS:
                self._written[joint] = windows
                yield FlankRow(joint, law.likelihood, windows, law.softness, servo.likelihood, servo.delay)

    def _row(self, learnt: Learnt) -> NoiseRow:
        joint, learner = learnt.joint, learnt.learner
        background = learner.background or NO_NOISE
        if learnt.change is not None:
            log.log(logging.INFO if learnt.change.is_first else logging.WARNING, "%s: %s", joint, learnt.change)
            change = NoiseChange(self._robot.clock.utc(learnt.time), str(learnt.change))
            self._changes[joint] = (*self._changes.get(joint, ()), change)[-CHANGES:]
        return NoiseRow(
            joint, learner.given.f_res_hz, learner.rate_hz, background.length, background.covariance,
            background.windows, background.ringing, learner.seen, self._changes.get(joint, ()), learner.given.zeta,
            _bar_row(learner),
        )  # fmt: skip


def _bar_row(learner: Learner) -> BarRow | None:
    bar, settings = learner.bar, learner.settings
    if bar is None:
        return None
    return BarRow(
        bar.f_res_hz, bar.f_deviation, bar.zeta, bar.zeta_deviation, bar.windows, settings.f_res_hz, settings.zeta
    )


def _bar(row: BarRow | None) -> Bar | None:
    return Bar(row.f_res_hz, row.f_deviation, row.zeta, row.zeta_deviation, row.windows) if row else None
