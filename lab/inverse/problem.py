"""The residuals that a regression minimises: of the torque that a motion needs, or of its acceleration.

``Problem`` is the interface between a residual and the least squares of regression.py.  Its implementations are here
and in output_error.py.  Nothing is fitted here.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.data.experiment import axis_of
from lostmotion.lab.data.series import rms
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import accelerations, inertia_of
from lostmotion.model import Model
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray

__all__ = ["EquationError", "InverseModel", "Point", "Problem"]

MOST_ROUNDS, LOAD_CONVERGED = 40, 1e-3
"""Largest number of iterations for the transmitted torque, and the relative change at which they end."""
LARGEST_COLOUR = 0.99
"""The correlation of neighbouring samples is at most this, so that a constant keeps a tenth of its weight."""
HELD = 1e-9
"""Half range of a zero angle that is known [rad]."""


Point = tuple[Model, FloatArray]
"""A model and the nuisance parameters (E,)."""


@dataclass(frozen=True, eq=False)
class Problem(ABC):
    """A residual of R recordings with M samples in all, and E nuisance parameters: values of single recordings that are
    estimated beside the parameters of the model, such as initial states.

    is_anchored: whether the zero of the first recording is that of the model; prior_centre: the model near which a
    prior keeps parameters that are not identified, None for no prior.
    """

    signals: tuple[Signals, ...]
    is_anchored: bool = field(default=True, kw_only=True)
    prior_centre: Model | None = field(default=None, kw_only=True)

    @property
    @abstractmethod
    def column(self) -> str:
        """The quantity that is compared, as a column of a recording."""

    @property
    @abstractmethod
    def nuisance(self) -> FloatArray:
        """Initial values of the nuisance parameters (E,), recording by recording."""

    @property
    def nuisance_range(self) -> FloatArray:
        """The largest distances of the nuisance parameters from their initial values (E,)."""
        return np.full(self.nuisance.size, np.inf)

    @property
    @abstractmethod
    def counts(self) -> list[int]:
        """The number of samples of each recording; their sum is M."""

    @abstractmethod
    def misfits(self, points: Sequence[Point]) -> FloatArray:
        """Measured less modelled signal (K, M), all recordings one after the other, for each of several models with its
        nuisance parameters."""

    def misfit(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """The same of one model (M,)."""
        return np.asarray(self.misfits([(model, nuisance)])[0])

    @abstractmethod
    def signal_rms(self, model: Model) -> float:
        """Root mean square of the signal that is compared, in the unit of the residual."""

    @property
    def most_beside(self) -> int:
        """The largest number of models with other sizes of an effect whose residuals may be computed at once."""
        return LANES

    @property
    def is_driven(self) -> bool:
        """Whether an input drives one of the motions."""
        return any(one.experiment.is_driven for one in self.signals)

    @property
    def axis(self) -> tuple[bool, str]:
        """Whether the axis is linear, and the unit of what was recorded in place of its torque."""
        return axis_of([one.experiment for one in self.signals])

    def whitened(self, misfit: FloatArray) -> FloatArray:
        """A misfit (M,) without the correlation of neighbouring samples, where the problem has a noise model."""
        return misfit

    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """The whitened misfit (M,), the sum of whose squares is minimised."""
        return np.asarray(self.residuals([(model, nuisance)])[0])

    def residuals(self, points: Sequence[Point]) -> FloatArray:
        """The residuals (K, M) of several models, each with its nuisance parameters."""
        return np.array([self.whitened(misfit) for misfit in self.misfits(points)])

    def suited(self, models: Sequence[Model]) -> Self:
        """The same problem with an integration step that these models need, where motions are simulated."""
        return self

    @property
    def estimated_before(self) -> FloatArray:
        """Derivatives of the residual by what was estimated before the fit (M, B), for its intervals."""
        return np.empty((sum(self.counts), 0))

    def by_recording(self, values: NDArray[Any]) -> list[NDArray[Any]]:
        """Splits values of all samples (M, …) by recording."""
        return np.split(values, np.cumsum(self.counts)[:-1])


@dataclass(frozen=True, eq=False)
class InverseModel(Problem):
    """The error of the torque, with the motion given: tau - (J theta_2'' - torques of bias and effects) [N m].

    transmitted: for each recording the transmitted torque (N,) [N m], on which load-dependent friction depends.

    An incremental encoder that is zero at the start of a recording does not measure the absolute angle.  The angle of
    its zero is the nuisance parameter of each recording, but of the first only where that is not anchored.

    colour: correlation of the misfit of neighbouring samples.  This autoregression of order one is removed before
    squares are taken (generalised least squares: Aitken 1935, Cochrane and Orcutt 1949).
    """

    column = "torque"
    transmitted: tuple[FloatArray, ...]
    colour: float = 0.0

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model, zeros: FloatArray | None = None) -> InverseModel:
        """The problem with the transmitted torque that a model needs for the motion.

        The measured torque is not used for it, as it contains noise and the friction that depends on it.  With a
        friction mu |load| the transmitted torque is a fixed point; each iteration reduces its error by the factor mu.
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
        """The torque that each motion needs with this model: J theta_2'' less the torques of bias and effects, (N,)
        each [N m]."""
        nothing = np.zeros(len(self.signals))
        return [one[0] for one in self._needed_by([(model, nothing if zeros is None else zeros)])]

    def _needed_by(self, points: Sequence[Point]) -> list[FloatArray]:
        """The same of several models with their zero angles (K, N)."""
        found = []
        moved = zip(*[self.shifted(zeros) for _, zeros in points], strict=True)
        for signals, load in zip(moved, self.transmitted, strict=True):
            own = [one.experiment.model(model) for one, (model, _) in zip(signals, points, strict=True)]
            measured = np.array([one.acceleration for one in signals])
            inertia = np.array([inertia_of(model) for model in own])[:, None]
            found.append(inertia * (measured - accelerations(own, signals, load)) + load)
        return found

    def shifted(self, zeros: FloatArray) -> tuple[Signals, ...]:
        """The recordings with these zero angles (R,) [rad] added to their positions."""
        if not zeros.any():
            return self.signals
        return tuple(one.shifted(zero) for one, zero in zip(self.signals, zeros.tolist(), strict=True))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Initial values of the nuisance parameters: zero angles (R,) [rad], or none."""
        return np.zeros(len(self.signals) if all(one.counts_from_start for one in self.signals) else 0)

    @property
    def nuisance_range(self) -> FloatArray:
        """The largest distances of the zero angles from their initial values, (R,) or (0,) [rad]."""
        free = np.full(self.nuisance.size, math.tau)
        if self.is_anchored:
            free[:1] = HELD
        return free

    def misfits(self, points: Sequence[Point]) -> FloatArray:
        """Measured less modelled torque within the band, all recordings one after the other (K, M) [N m]."""
        pairs = zip(self.signals, self._needed_by(points), strict=True)
        return np.concatenate([one.filtered(one.torque - each) for one, each in pairs], axis=1)

    @property
    def estimated_before(self) -> FloatArray:
        """The derivative of the residual by the delay between torque and angle (M, 1), or nothing without one.

        A torque b omega that acts d later has the part b d of an inertia.  A delay that counts as known makes the
        interval of a motor's inertia too narrow.
        """
        if not any(one.is_delayed for one in self.signals):
            return super().estimated_before
        return self.whitened(np.concatenate([one.torque_by_delay for one in self.signals]))[:, None]

    def coloured(self, misfit: FloatArray) -> Self:
        """The problem with the colour of this misfit (M,): the correlation of its neighbouring samples."""
        parts = zip(self.by_recording(misfit), self.signals, strict=True)
        before, after = np.concatenate([np.stack([part[:-1], part[1:]])[:, one.is_next] for part, one in parts], axis=1)
        power = float(before @ before)
        colour = float(before @ after) / power if power else 0.0
        return replace(self, colour=min(max(colour, 0.0), LARGEST_COLOUR))

    def whitened(self, misfit: FloatArray) -> FloatArray:
        """The innovations of a misfit (M,), scaled to the variance of the misfit.  The first sample after a gap is
        unchanged, as it has no predecessor."""
        if not self.colour:
            return misfit
        scale, found = math.sqrt(1 - self.colour**2), misfit.copy()
        for new, old, one in zip(self.by_recording(found), self.by_recording(misfit), self.signals, strict=True):
            new[1:] = np.where(one.is_next, (old[1:] - self.colour * old[:-1]) / scale, old[1:])
        return found

    def signal_rms(self, model: Model) -> float:
        """Root mean square of the measured torque [N m]."""
        return rms(*(one.torque for one in self.signals))

    @cached_property
    def counts(self) -> list[int]:
        """The number of samples of each recording that are compared."""
        return [one.kept.size for one in self.signals]


@dataclass(frozen=True, eq=False)
class EquationError(InverseModel):
    """The equation error: the measured acceleration less that of the equation of motion at the measured position and
    speed [rad/s² or m/s²].

    transmitted: the input of each recording (N,), a command or a force.  Noise of the position biases the estimates,
    but the error has no local minima.  Its minimum is the start of a fit to the simulated motion.
    """

    column = "acceleration"

    @classmethod
    def driven(cls, signals: Sequence[Signals]) -> EquationError:
        """The problem with the inputs as they were recorded."""
        return cls(tuple(signals), tuple(one.driving for one in signals))

    @cached_property
    def nuisance(self) -> FloatArray:
        """Empty, as there are no nuisance parameters."""
        return np.empty(0)

    def misfits(self, points: Sequence[Point]) -> FloatArray:
        """Measured less modelled acceleration within the band, all recordings one after the other (K, M) [rad/s²]."""
        found = []
        for one, drive in zip(self.signals, self.transmitted, strict=True):
            own = [one.experiment.model(model) for model, _ in points]
            found.append(one.filtered(one.acceleration - accelerations(own, [one] * len(own), drive)))
        return np.concatenate(found, axis=1)

    def signal_rms(self, model: Model) -> float:
        """Root mean square of the acceleration [rad/s² or m/s²]."""
        return rms(*(one.acceleration for one in self.signals))
