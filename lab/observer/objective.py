"""The objective of searches with observers: their prediction errors on some segments of the measurement.

The global search (global_search.py) and the local one (descent.py) minimise it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.excerpt import excerpts
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.observer.filter import SETTLED_S, STRONG, TIGHT, WEAK, Observer, Start, sampled
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray
from lostmotion.model.observer import Budget

__all__ = ["OUTSIDE", "Follower", "settled"]

LENGTH_S, EXPERIMENTS = 2.0, 2
"""Length of a segment [s], and the largest number of experiments of which one is taken."""
LEAST_HZ, PERIOD_SAMPLES = 800.0, 8.0
"""Samples a second, and samples in a period of the bar, above which segments are decimated."""
SHORTEST_STEP_S = 2.5e-4
"""Shortest integration step [s]: the next sample corrects the errors of a longer one."""
ROUGH = 0.03
"""Least noise in ``with_more_noise``, as a share of the standard deviation of the signal."""
OUTSIDE, FAR = 3.0, 1e6
"""Errors, in units of the expected one, above which the cost is logarithmic; and the square at which it is clipped."""
ROUNDING = 1e-9
"""Share by which a sum may differ from the same one in another order."""


@dataclass(frozen=True, eq=False)
class Follower:
    """The prediction errors of observers.

    rough: the model with whose bar the gains were computed; segments: what is predicted; noise: of the acceleration
    [m/s²]; substep_s: integration step [s]; observers: by coupling.
    """

    rough: Model
    segments: tuple[Experiment, ...]
    noise: float
    substep_s: float
    observers: dict[float, Observer]

    @classmethod
    def of(cls, task: Task, rough: Model) -> Follower:
        """The objective on those two seconds of each of the first experiments in which the reading changes most."""
        value = {name: p.value for name, p in rough.parameters.items()}
        hz = max(LEAST_HZ, PERIOD_SAMPLES * math.sqrt(value["k"] / value["m"]) / (2 * math.pi))
        segments = tuple(_window(e, hz) for e in task.experiments[:EXPERIMENTS])
        observers = {
            coupling: Observer.of(rough, 1 / segments[0].rate_hz, coupling) for coupling in (TIGHT, STRONG, WEAK)
        }
        return cls(rough, segments, task.noise[ACCEL], max(task.substep_s, SHORTEST_STEP_S), observers)

    def alone(self) -> Follower:
        """The objective on the first segment only."""
        return replace(self, segments=self.segments[:1])

    def with_more_noise(self) -> Follower:
        """The objective on the first segment with a noise of at least a share of the signal, as with little noise the
        cost of distant models is too flat to be minimised."""
        usual = float(np.std(self.segments[0].measured[ACCEL]))
        return replace(self.alone(), noise=max(self.noise, ROUGH * usual))

    def cost(self, model: Model, coupling: float) -> float:
        """The mean of log(1 + min((e/c)², FAR)) over the innovations e in units of their expected deviation, with c =
        OUTSIDE; the logarithm limits the weight of outliers.  Infinite where the model cannot be run."""
        return float(self.costs([model], coupling)[0])

    def costs(self, models: Sequence[Model], coupling: float, most: FloatArray | float = math.inf) -> FloatArray:
        """The cost of each of K models with the same effects (K,), run side by side.

        most: costs above these, (K,) or one of all, are not computed exactly; the runs end as soon as they are
        exceeded.
        """
        losses, largest = np.zeros(len(models)), np.broadcast_to(most, len(models)) * (1 + ROUNDING) * self._samples
        for one in self.segments:
            asked = np.flatnonzero((losses <= largest) & np.isfinite(losses))
            starts = {i: start for i in asked.tolist() if (start := self._start(models[i], one, coupling))}
            losses[[i for i in asked if i not in starts]] = math.inf
            if starts:
                budget = self._budget(one, coupling)._replace(most=(largest - losses)[[*starts]])
                found = Observer.follow([*starts.values()], one, self.substep_s, budget, keeps=False)
                losses[[*starts]] += found.loss
        return losses / self._samples

    def errors(self, models: Sequence[Model], coupling: float) -> FloatArray:
        """The innovations of all segments one after the other (K, N), in units of the standard deviation that they have
        for the right model, without those of the settling time; of K models with the same effects, run side by side.
        Infinite where a model cannot be run."""
        parts = []
        for one in self.segments:
            starts = {i: start for i, model in enumerate(models) if (start := self._start(model, one, coupling))}
            e = np.full((len(models), one.time.size), np.inf)
            if starts:
                e[[*starts]] = Observer.follow([*starts.values()], one, self.substep_s, self._budget(one, coupling)).e
            parts.append(e[:, settled(one)] / self._unit(coupling))
        return np.concatenate(parts, axis=1)

    @property
    def _samples(self) -> int:
        """N, the number of innovations that count."""
        return sum(one.time[settled(one)].size for one in self.segments)

    def _start(self, model: Model, segment: Experiment, coupling: float) -> Start | None:
        """The start of a run over a segment; None where the model cannot be run."""
        with suppress(ModelError):
            return self.observers[coupling].start(segment.model(model), segment)
        return None

    def _unit(self, coupling: float) -> float:
        """The expected standard deviation of an innovation [m/s²]."""
        return self.observers[coupling].expected * self.noise

    def _budget(self, segment: Experiment, coupling: float) -> Budget:
        return Budget(settled(segment).start, OUTSIDE * self._unit(coupling), FAR)


def _window(experiment: Experiment, hz: float) -> Experiment:
    """The two seconds in which the sensor's reading changes most, at no more than about ``hz`` samples a second."""
    (bar,) = excerpts([sampled(experiment)], LENGTH_S)
    step = max(1, int(bar.rate_hz / hz))
    return replace(bar, time=bar.time[::step], measured={ACCEL: bar.measured[ACCEL][::step]})


def settled(segment: Experiment) -> slice:
    """The samples of a segment after the settling time of an observer."""
    return slice(int(np.searchsorted(segment.time, segment.time[0] + SETTLED_S)), None)
