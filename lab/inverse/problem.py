"""What a model is fitted to: the torque that a motion needs, or its acceleration.  Nothing is fitted here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration, inertia_of, needed
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["TURN", "Data", "EquationError", "Problem", "by_recording"]

MOST_ROUNDS, LOAD_CONVERGED = 40, 1e-3
"""Rounds in which the transmitted torque is found, and the relative change that ends them."""
TURN, HELD = 2 * math.pi, 1e-9
"""Freedom of an angle of zero that is not known, and of one that is [rad]."""


class Problem(Protocol):
    """What a model is fitted to."""

    @property
    def signals(self) -> tuple[Signals, ...]: ...
    @property
    def nuisance(self) -> FloatArray: ...
    @property
    def nuisances(self) -> int: ...
    @property
    def freedom(self) -> FloatArray: ...
    @property
    def counts(self) -> list[int]: ...
    @property
    def centre(self) -> Model | None: ...
    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray: ...
    def usual(self, model: Model) -> float: ...
    def suited(self, models: Sequence[Model]) -> Problem: ...


@dataclass(frozen=True, eq=False)
class Data:
    """Recordings and, for each, the torque [N m] (N,) on which friction that grows with load depends.

    An encoder that counts from where a recording begins does not tell the angle of the shaft: its zero is fitted beside
    the parameters, for each recording but the first, or with ``is_anchored`` false for all.
    """

    signals: tuple[Signals, ...]
    transmitted: tuple[FloatArray, ...]
    is_anchored: bool = True

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model, zeros: FloatArray | None = None) -> Data:
        """With the transmitted torque that a model needs for the motion: the one that comes out where it goes in, of
        friction that grows with load, too.

        The measured torque is no load: it holds the very friction, and noise.  Friction mu |load| makes each round a
        factor mu more exact.
        """
        data = cls(tuple(signals), tuple(np.zeros(one.time.size) for one in signals))
        for _ in range(MOST_ROUNDS):
            load = tuple(data.needed(model, zeros))
            change = max(float(np.abs(new - old).max()) for new, old in zip(load, data.transmitted, strict=True))
            data = replace(data, transmitted=load)
            if change <= LOAD_CONVERGED * max(float(np.abs(one).max()) for one in load):
                break
        return data

    def needed(self, model: Model, zeros: FloatArray | None = None) -> list[FloatArray]:
        """The torque that the motion of each recording needs of a model, (N,) each [N m]."""
        shifted = self.signals if zeros is None else self.shifted(zeros)
        pairs = zip(shifted, self.transmitted, strict=True)
        return [needed(one.experiment.model(model), one, torque) for one, torque in pairs]

    def shifted(self, zeros: FloatArray) -> tuple[Signals, ...]:
        """The recordings with angles from these zeros on (R,) [rad]."""
        if not zeros.any():
            return self.signals
        return tuple(one.shifted(zero) for one, zero in zip(self.signals, zeros.tolist(), strict=True))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Initial values of what is fitted beside the model's parameters: angles of zero (R,) [rad], or nothing."""
        return np.zeros(len(self.signals) if all(one.counts_from_start for one in self.signals) else 0)

    @property
    def freedom(self) -> FloatArray:
        """How far an angle of zero may be from its initial value, (R,) or (0,) [rad]."""
        free = np.full(self.nuisance.size, TURN)
        if self.is_anchored:
            free[:1] = HELD
        return free

    @property
    def nuisances(self) -> int:
        """Of one recording."""
        return int(self.nuisance.size > 0)

    @property
    def centre(self) -> None:
        """The torque tells all parameters of a joint."""
        return None

    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Measured less modelled torque within the band, all recordings one after the other (M,) [N m]."""
        pairs = zip(self.signals, self.needed(model, nuisance), strict=True)
        return np.concatenate([one.filtered(one.torque - torque) for one, torque in pairs])

    def suited(self, models: Sequence[Model]) -> Data:
        """For these models, too: nothing is integrated."""
        return self

    def usual(self, model: Model) -> float:
        """Root mean square of what moves the joint [N m]: the torque, or inertia where it swings freely."""
        inertia = inertia_of(model)
        moving = [np.where(one.torque.any(), one.torque, inertia * one.acceleration) for one in self.signals]
        return float(np.sqrt(np.mean(np.concatenate(moving) ** 2)))

    @cached_property
    def counts(self) -> list[int]:
        """Samples of each recording that count."""
        return [one.kept.size for one in self.signals]


@dataclass(frozen=True, eq=False)
class EquationError(Data):
    """Recordings whose acceleration is compared with what the equation of motion says for the measured position and
    speed; transmitted: the input of each (N,), a command or a force.

    Noise of the position biases it, but it has no valleys: it says where a simulated motion begins.
    """

    @classmethod
    def driven(cls, signals: Sequence[Signals]) -> EquationError:
        """With the inputs as they were recorded."""
        return cls(tuple(signals), tuple(one.driving for one in signals))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Nothing is fitted beside the parameters."""
        return np.empty(0)

    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Measured less modelled acceleration within the band, all recordings one after the other (M,) [rad/s²]."""
        pairs = zip(self.signals, self.transmitted, strict=True)
        return np.concatenate([
            one.filtered(one.acceleration - acceleration(one.experiment.model(model), one, drive))
            for one, drive in pairs
        ])  # fmt: skip

    def usual(self, model: Model) -> float:
        """Root mean square of the acceleration [rad/s² or m/s²]."""
        return float(np.sqrt(np.mean(np.concatenate([one.acceleration for one in self.signals]) ** 2)))


def by_recording(values: NDArray[Any], data: Problem) -> list[NDArray[Any]]:
    """Each recording's part of what all samples have (M, …)."""
    return np.split(values, np.cumsum(data.counts)[:-1])
