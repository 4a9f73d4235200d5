"""The residuals to minimise: of the torque that a motion needs, or of its acceleration.  Nothing is fitted here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration, inertia_of
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Data", "EquationError", "Problem", "by_recording"]

MOST_ROUNDS, LOAD_CONVERGED = 40, 1e-3
"""Rounds in which the transmitted torque is found, and the relative change that ends them."""
LARGEST_COLOUR = 0.99
"""The correlation of neighbouring samples is at most this, so that a constant keeps a tenth of its weight."""
HELD = 1e-9
"""Freedom of a zero angle that is known [rad]."""


class Problem(Protocol):
    """The interface of a residual that is minimised."""

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
    def misfit(self, model: Model, nuisance: FloatArray) -> FloatArray: ...
    def whitened(self, misfit: FloatArray) -> FloatArray: ...
    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray: ...
    def usual(self, model: Model) -> float: ...
    def suited(self, models: Sequence[Model]) -> Problem: ...


@dataclass(frozen=True, eq=False)
class Data:
    """Recordings and, for each, the transmitted torque [N m] (N,), on which load-dependent friction depends.

    An incremental encoder, zero at the start of a recording, does not measure the absolute angle: its zero angle is a
    nuisance parameter of each recording but the first, or with ``is_anchored`` false of all.  colour: correlation of
    the misfit of neighbouring samples, an autoregression of order one that is removed before squares are taken
    (generalised least squares: Aitken 1935, Cochrane and Orcutt 1949).
    """

    signals: tuple[Signals, ...]
    transmitted: tuple[FloatArray, ...]
    is_anchored: bool = True
    colour: float = 0.0

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model, zeros: FloatArray | None = None) -> Data:
        """With the transmitted torque that a model needs for the motion, a fixed point where friction depends on it.

        The measured torque is not used: it contains this friction, and noise.  With friction mu |load| each iteration
        reduces the error by the factor mu.
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
        """The torque that each motion needs of a model, J theta_2'' less that of bias and effects, (N,) each [N m]."""
        found = []
        for one, load in zip(self.signals if zeros is None else self.shifted(zeros), self.transmitted, strict=True):
            own = one.experiment.model(model)
            found.append(inertia_of(own) * (one.acceleration - acceleration(own, one, load)) + load)
        return found

    def shifted(self, zeros: FloatArray) -> tuple[Signals, ...]:
        """The recordings with angles relative to these zeros (R,) [rad]."""
        if not zeros.any():
            return self.signals
        return tuple(one.shifted(zero) for one, zero in zip(self.signals, zeros.tolist(), strict=True))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Initial values of the nuisance parameters: zero angles (R,) [rad], or none."""
        return np.zeros(len(self.signals) if all(one.counts_from_start for one in self.signals) else 0)

    @property
    def freedom(self) -> FloatArray:
        """How far a zero angle may be from its initial value, (R,) or (0,) [rad]."""
        free = np.full(self.nuisance.size, math.tau)
        if self.is_anchored:
            free[:1] = HELD
        return free

    @property
    def nuisances(self) -> int:
        """The number of nuisance parameters of one recording."""
        return int(self.nuisance.size > 0)

    @property
    def centre(self) -> None:
        """None: the torque identifies all parameters of a joint."""
        return None

    def misfit(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Measured less modelled torque within the band, all recordings one after the other (M,) [N m]."""
        pairs = zip(self.signals, self.needed(model, nuisance), strict=True)
        return np.concatenate([one.filtered(one.torque - torque) for one, torque in pairs])

    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """The whitened misfit (M,) [N m]."""
        return self.whitened(self.misfit(model, nuisance))

    def coloured(self, misfit: FloatArray) -> Self:
        """With the colour of this misfit (M,)."""
        parts = zip(by_recording(misfit, self), self.signals, strict=True)
        before, after = np.concatenate([np.stack([part[:-1], part[1:]])[:, one.is_next] for part, one in parts], axis=1)
        power = float(before @ before)
        colour = float(before @ after) / power if power else 0.0
        return replace(self, colour=min(max(colour, 0.0), LARGEST_COLOUR))

    def whitened(self, misfit: FloatArray) -> FloatArray:
        """Innovations of the misfit (M,), of the same size as a misfit of this colour; the first sample after a gap
        has no predecessor."""
        if not self.colour:
            return misfit
        scale, found = math.sqrt(1 - self.colour**2), misfit.copy()
        for new, old, one in zip(by_recording(found, self), by_recording(misfit, self), self.signals, strict=True):
            new[1:] = np.where(one.is_next, (old[1:] - self.colour * old[:-1]) / scale, old[1:])
        return found

    def suited(self, models: Sequence[Model]) -> Data:
        """Unchanged for other models: nothing is integrated."""
        return self

    def usual(self, model: Model) -> float:
        """Root mean square of the torque [N m], or of the inertia torque where the joint swings freely."""
        inertia = inertia_of(model)
        moving = [np.where(one.torque.any(), one.torque, inertia * one.acceleration) for one in self.signals]
        return float(np.sqrt(np.mean(np.concatenate(moving) ** 2)))

    @cached_property
    def counts(self) -> list[int]:
        """Samples of each recording that count."""
        return [one.kept.size for one in self.signals]


@dataclass(frozen=True, eq=False)
class EquationError(Data):
    """Recordings with a measured acceleration that is compared with that of the equation of motion at the measured
    position and speed; transmitted: the input of each (N,), a command or a force.

    Noise of the position biases it, but it has no local minima: it gives the initial values for a simulated motion.
    """

    @classmethod
    def driven(cls, signals: Sequence[Signals]) -> EquationError:
        """With the inputs as they were recorded."""
        return cls(tuple(signals), tuple(one.driving for one in signals))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Empty: there are no nuisance parameters."""
        return np.empty(0)

    def misfit(self, model: Model, nuisance: FloatArray) -> FloatArray:
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
    """Splits values of all samples (M, …) by recording."""
    return np.split(values, np.cumsum(data.counts)[:-1])
