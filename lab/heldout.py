"""How well a fit predicts an experiment that it has not seen.  Only start states are found there, no parameters."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.grow import merged, residuals, tiles
from lostmotion.lab.search import begun, passed
from lostmotion.lab.start import polished, repaired
from lostmotion.lab.stretch import Stretch
from lostmotion.lab.task import Task
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Judged", "judge"]

LONGER = 1.2
POLISHED = 6
LOST_SHARE = 0.4
LOST = 1.3


@dataclass(frozen=True, eq=False)
class Judged:
    """error: root mean square of r on unseen data, in units of the noise as it was estimated; count: samples;
    residual: r of each stretch that is not lost, best first."""

    error: float
    count: int
    residual: tuple[FloatArray, ...]

    def likelihood_gain_over(self, other: Judged) -> float:
        """Gain of the log-likelihood, each residual taken as white noise of its own size."""
        return self.count * math.log(max(other.error, 1e-9) / max(self.error, 1e-9))


def judge(model: Model, unseen: Experiment, task: Task, horizon_s: float, pool: Executor) -> Judged:
    """The model on the unseen experiment, in stretches of about this length with start states of their own.

    Up to two fifths of the stretches are left out, those that stand out as lost: chaos, or a start that was not found.
    """
    step, halvings = task.substep_s, task.halvings
    pieces = tiles(unseen, halvings)
    likely = passed(model, pieces, [unseen], task)
    stretches = repaired(model, begun(model, pieces, likely, task), step)
    while halvings > 0 and unseen.duration / 2 ** (halvings - 1) <= horizon_s * LONGER:
        halvings -= 1
        stretches = repaired(model, merged(stretches, [unseen], halvings), step)
        also = [likely.get((unseen.name, float(stretch.experiment.time[0]))) for stretch in stretches]
        stretches = tuple(pool.map(_polished, [model] * len(stretches), stretches, also, [step] * len(stretches)))
    parts = residuals(model, stretches, step)
    error = np.array([np.sqrt(np.mean(part**2)) for part in parts])
    usual = float(np.quantile(error, 1 - LOST_SHARE, method="lower"))
    r = [parts[i] for i in np.argsort(error) if error[i] <= LOST * usual]
    whole = np.concatenate(r)
    return Judged(float(np.sqrt(np.mean(whole**2))), whole.size, tuple(r))


def _polished(model: Model, stretch: Stretch, also: FloatArray | None, substep_s: float) -> Stretch:
    own = stretch.experiment.model(model)
    states = stretch.start[None] if also is None else np.vstack([stretch.start, also])
    return stretch.starting(polished(own, stretch, states, substep_s, POLISHED)[0])
