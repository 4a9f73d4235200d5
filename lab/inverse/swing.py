"""The angle of a joint that swings freely, simulated over each whole recording from an initial state of its own.

Without a torque there is no noisy input, and what a damping takes from one swing to the next is too little to be seen
in the acceleration; over all swings it adds up.  No selection here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.task import coarse_substep
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Swings"]

REST = 0.1
"""Of the largest speed: below, a recording has ended.  How a joint comes to rest depends on how its friction is
smoothed;
with 0.02 to 0.2 the same effects are found in drops of a servo, in another order."""
STEPS = 4.0
"""Integration steps of a fit, times the model's own choice."""


@dataclass(frozen=True, eq=False)
class Swings:
    """Recordings of free motion; substep_s: integration step of a fit [s]."""

    signals: tuple[Signals, ...]
    substep_s: float

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model) -> Swings:
        """With the step that this model needs; a joint that has come to rest tells no more."""
        moving = tuple(replace(one, experiment=_until_rest(one)) for one in signals)
        return cls(moving, coarse_substep(model, [one.experiment for one in moving], STEPS))

    def first(self, share: float) -> Swings:
        """The beginnings of the recordings."""
        parts = [
            replace(one, experiment=one.experiment.between(one.time[0], one.time[0] + share * one.experiment.duration))
            for one in self.signals
        ]
        return Swings(tuple(parts), self.substep_s)

    @property
    def nuisance(self) -> FloatArray:
        """Initial angle and speed of each recording as the filtered signals have them (2 R,)."""
        return np.concatenate([[one.position[0], one.velocity[0]] for one in self.signals])

    def residual(self, model: Model, states: FloatArray) -> FloatArray:
        """Measured less simulated angle, all recordings one after the other (M,) [rad]."""
        parts = []
        for one, state in zip(self.signals, np.split(states, len(self.signals)), strict=True):
            experiment = one.experiment
            own = experiment.model(model)
            try:
                motion = own.simulate(None, experiment.time, state, substep_s=self.substep_s)["position"]
            except ModelError:
                motion = np.full(experiment.time.size, np.inf)
            error = experiment.measured["position"] - motion
            parts.append(error[~np.isnan(experiment.measured["position"])])
        return np.concatenate(parts)

    def usual(self, model: Model) -> float:
        """Root mean square of the angle's deviation from its mean [rad]."""
        return float(
            np.sqrt(np.mean(np.concatenate([one.position - one.position.mean() for one in self.signals]) ** 2))
        )

    @property
    def counts(self) -> list[int]:
        """Samples of each recording that count."""
        return [int((~np.isnan(one.experiment.measured["position"])).sum()) for one in self.signals]


def _until_rest(signals: Signals) -> Experiment:
    """The recording without its end, in which the speed stays below a share of its largest."""
    speed = np.abs(signals.velocity)
    last = float(signals.time[np.flatnonzero(speed > REST * speed.max())[-1]])
    return signals.experiment.between(signals.experiment.time[0], last)
