"""The noise that the pipeline learns of each joint's windows: kept in the database, and told when it changes.

How it is learnt is ``detector/learner.py``'s.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable

from lostmotion.daemon.pipeline import Learnt
from lostmotion.daemon.records import NoiseChange, NoiseRow
from lostmotion.daemon.robot import Robot
from lostmotion.detector.background import Background

__all__ = ["Noises"]

log = logging.getLogger(__name__)

CHANGES = 10
"""the last changes of each joint's noise are kept"""


class Noises:
    """The noise of each joint of a robot whose noise is learnt."""

    def __init__(self, robot: Robot, earlier: Iterable[NoiseRow]) -> None:
        """Goes on from what an earlier run has learnt with the same bar, rate and length of the windows."""
        self._robot = robot
        self._changes: dict[str, tuple[NoiseChange, ...]] = {}
        for row in earlier:
            learner = robot.pipeline.learners.get(row.joint)
            if learner is None:
                continue
            self._changes[row.joint] = row.changes
            if (row.f_res_hz, row.rate_hz) == (learner.settings.f_res_hz, learner.rate_hz):
                learner.resume(Background(row.covariance, row.told, row.length, row.ringing), row.seen)

    def rows(self) -> list[NoiseRow]:
        """What has been learnt since this was last asked; a change goes to the log."""
        return [self._row(learnt) for learnt in self._robot.pipeline.learnt()]

    def _row(self, learnt: Learnt) -> NoiseRow:
        joint, learner = learnt.joint, learnt.learner
        background = learner.background
        assert background is not None
        if learnt.change is not None:
            log.log(logging.INFO if learnt.change.is_first else logging.WARNING, "%s: %s", joint, learnt.change)
            change = NoiseChange(self._robot.clock.utc(learnt.time), str(learnt.change))
            self._changes[joint] = (*self._changes.get(joint, ()), change)[-CHANGES:]
        return NoiseRow(
            joint, learner.settings.f_res_hz, learner.rate_hz, background.length, background.covariance,
            background.windows, background.ringing, learner.seen, self._changes.get(joint, ()),
        )  # fmt: skip
