"""How well a fit predicts an experiment that it has not seen.  Only start states are found there, no parameters."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.grow import Level, errors, merged, residuals, tiles
from lostmotion.lab.search import Task
from lostmotion.lab.start import find_start, polished, repaired, stretch_of
from lostmotion.lab.stretch import Stretch
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Judged", "judge"]

LONGEST_S = 1.0
LOST_SHARE = 0.25
LOST = 1.5


@dataclass(frozen=True, eq=False)
class Judged:
    """error: root mean square of r on unseen data, in units of the noise as it was estimated; count: samples;
    residual: r of each stretch that is not lost."""

    error: float
    count: int
    residual: tuple[FloatArray, ...]

    def likelihood_gain_over(self, other: Judged) -> float:
        """Gain of the log-likelihood, each residual taken as white noise of its own size."""
        return self.count * math.log(max(other.error, 1e-9) / max(self.error, 1e-9))


def judge(level: Level, unseen: Experiment, task: Task, pool: Executor) -> Judged:
    """The level's parameters on the unseen experiment, in stretches of up to a second with start states of their own.

    Up to a quarter of the stretches are left out, those that stand out as lost: chaos, or a start that was not found.
    """
    pieces = tiles(unseen, task.halvings)
    model, step = level.model, task.substep_s
    found = list(pool.map(_begun, [model] * len(pieces), pieces, [task] * len(pieces)))
    stretches = repaired(model, found, step) if model.base == "play" else tuple(found)
    halvings = task.halvings
    while halvings > 0 and unseen.duration / 2 ** (halvings - 1) <= min(LONGEST_S, level.horizon_s) * 1.01:
        halvings -= 1
        stretches = repaired(model, merged(stretches, [unseen], halvings), step)
        stretches = tuple(pool.map(_polished, [model] * len(stretches), stretches, [step] * len(stretches)))
    error = errors(model, stretches, step)
    worst = float(np.quantile(error, 1 - LOST_SHARE, method="lower"))
    lost = error > max(LOST * float(np.median(error)), worst)
    r = [part for part, out in zip(residuals(model, stretches, step), lost, strict=True) if not out]
    whole = np.concatenate(r)
    return Judged(float(np.sqrt(np.mean(whole**2))), whole.size, tuple(r))


def _begun(model: Model, piece: Experiment, task: Task) -> Stretch:
    return find_start(model, stretch_of(model, piece, task.noise), task.substep_s)


def _polished(model: Model, stretch: Stretch, substep_s: float) -> Stretch:
    own = stretch.experiment.model(model)
    return stretch.starting(polished(own, stretch, stretch.start[None], substep_s, 5)[0])
