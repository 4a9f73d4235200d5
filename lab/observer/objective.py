"""What observer runs follow, and how far off they are.  Searches for the models that come near are elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.observer.filter import SETTLED_S, STRONG, TIGHT, WEAK, Observer, sampled
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["OUTSIDE", "Follower", "settled"]

LENGTH_S, EXPERIMENTS = 2.0, 2
LEAST_HZ, PERIOD_SAMPLES = 800.0, 8.0
"""More samples a second, or a period of the bar, are not looked at."""
SHORTEST_STEP_S = 2.5e-4
"""What a longer step misses, the next sample corrects."""
ROUGH = 0.03
"""The part of its signal's standard deviation that ``roughly`` counts errors in, where the noise is fainter."""
OUTSIDE, FAR = 3.0, 1e6
"""Times what is expected, from which on an error counts by its logarithm; and where even that ends, squared."""


@dataclass(frozen=True, eq=False)
class Follower:
    """Segments that runs shall follow; noise [m/s²]; observers: by coupling."""

    rough: Model
    segments: tuple[Experiment, ...]
    noise: float
    substep_s: float
    observers: dict[float, Observer]

    @classmethod
    def of(cls, task: Task, rough: Model) -> Follower:
        """The liveliest parts of the first experiments."""
        value = {name: p.value for name, p in rough.parameters.items()}
        hz = max(LEAST_HZ, PERIOD_SAMPLES * math.sqrt(value["k"] / value["m"]) / (2 * math.pi))
        segments = tuple(_liveliest(e, hz) for e in task.experiments[:EXPERIMENTS])
        observers = {
            coupling: Observer.of(rough, 1 / segments[0].rate_hz, coupling) for coupling in (TIGHT, STRONG, WEAK)
        }
        return cls(rough, segments, task.noise[ACCEL], max(task.substep_s, SHORTEST_STEP_S), observers)

    def alone(self) -> Follower:
        """The first segment only."""
        return replace(self, segments=self.segments[:1])

    def roughly(self) -> Follower:
        """The first segment only, errors in units of a part of its signal at least: where the noise is faint, hardly a
        model is near enough for its error to say which way is better."""
        usual = float(np.std(self.segments[0].measured[ACCEL]))
        return replace(self.alone(), noise=max(self.noise, ROUGH * usual))

    def cost(self, model: Model, coupling: float) -> float:
        """Mean of log(1 + (e/c)²) over the samples after the first 0.2 s: one that is missed by far counts little more
        than one that is missed."""
        try:
            e = self.errors(model, coupling)
        except ModelError:
            return math.inf
        return float(np.mean(np.log1p(np.minimum((e / OUTSIDE) ** 2, FAR))))

    def errors(self, model: Model, coupling: float) -> FloatArray:
        """What runs did not expect at the samples after the first 0.2 s (N,), over what is expected of a model that is
        right.  Raises ModelError."""
        observer = self.observers[coupling]
        errors = [observer.run(s.model(model), s, self.substep_s)[0][settled(s)] for s in self.segments]
        return np.asarray(np.concatenate(errors) / (observer.expected * self.noise))


def _liveliest(experiment: Experiment, hz: float) -> Experiment:
    """The two seconds in which the sensor moves most, at no more than about ``hz`` samples a second."""
    bar = sampled(experiment)
    step = max(1, int(bar.rate_hz / hz))
    time, values = bar.time[::step], bar.measured[ACCEL][::step]
    power = np.concatenate(([0.0], np.cumsum((values - values.mean()) ** 2)))
    last = np.searchsorted(time, time + LENGTH_S)
    first = int(np.argmax(np.where(time + LENGTH_S <= time[-1] + 1e-9, power[last] - power[:-1], -1.0)))
    return replace(experiment, time=time[first : last[first]], measured={ACCEL: values[first : last[first]]})


def settled(segment: Experiment) -> slice:
    """The samples at which a observer run has forgotten its start."""
    return slice(int(np.searchsorted(segment.time, segment.time[0] + SETTLED_S)), None)
