"""The measured motion of whole recordings, simulated from an initial state of each: the output-error method.

It is unbiased where the input does not follow the disturbances: the command of a servo (the controller is a part of the
model), the force on an oscillator, and a joint that swings freely.  The effect of a damping on one swing is too small
to show in the acceleration; over all swings it adds up.  No selection here.

References: L. Ljung, System Identification (1999), section 4.3; J. Schoukens and L. Ljung, "Nonlinear system
identification: a user-oriented road map", IEEE Control Systems 39 (2019).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.fitting.identifiability import free_states, is_driven
from lostmotion.lab.inverse.problem import by_recording
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.task import coarse_substep
from lostmotion.model import Model, ModelError
from lostmotion.model.bases import get_base
from lostmotion.model.motion import FloatArray

__all__ = ["OutputError"]

FINEST = 1 / 8
"""Share of the step of the present model: the shortest step of a model with one more effect, which leaves room for dry
friction.  A guess that needs a shorter one is far off; with one for a dropped servo a search of nine seconds took
minutes."""
MOST_SAMPLES, PER_PERIOD = 20_000, 20
"""Largest number of samples of all recordings, beyond which they are thinned, but not below so many in a period of the
end of the band: a search of 113 000 readings of a pendulum over two minutes did not finish in a minute."""
ACCURACY = 1e-6
"""Share of the motion that counts as an error of its integration: to a mass whose motion was itself computed, and that
was followed to 1e-8, a clock that is off by 28 ppm was named."""
STEPS = 4.0
"""Integration steps of a fit, times the model's own choice."""
RESOLVED, HALVINGS = 0.1, 5
"""Share of the residual that the motion changes by, when the integration step is halved, at which the step is short
enough; and how often it is halved at most."""


@dataclass(frozen=True, eq=False)
class OutputError:
    """Recordings with a simulated motion.

    substep_s: integration step of a fit [s]; centre: the model near which unidentified parameters stay.
    """

    signals: tuple[Signals, ...]
    substep_s: float
    centre: Model
    free: tuple[str, ...] = ()
    """States of effects with fitted initial values."""

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model) -> OutputError:
        """With the step that this model needs, without the time after a joint has come to rest."""
        parts = [_until_rest(one) for one in signals]
        surplus = sum(part.time.size for part in parts) // MOST_SAMPLES
        moving = tuple(
            replace(one, experiment=_thinned(part, min(surplus, int(part.rate_hz / one.band_hz / PER_PERIOD))))
            for one, part in zip(signals, parts, strict=True)
        )
        experiments = [one.experiment for one in moving]
        step = _coarse_substep(model, moving)
        return cls(moving, step, model, free_states(model, any(map(is_driven, experiments))))

    def first(self, share: float) -> OutputError:
        """The beginnings of the recordings."""
        parts = [
            replace(one, experiment=one.experiment.between(one.time[0], one.time[0] + share * one.experiment.duration))
            for one in self.signals
        ]
        return replace(self, signals=tuple(parts))

    @property
    def nuisance(self) -> FloatArray:
        """Initial angle and speed of each recording as the filtered signals have them, other states in equilibrium with
        them (K R,)."""
        return np.concatenate(
            [[one.position[0], one.velocity[0], *self._settled(self.centre, one)] for one in self.signals]
        )

    def _settled(self, model: Model, one: Signals) -> list[float]:
        """The free states in equilibrium with a motion; zero for those that the model lacks."""
        if not self.free:
            return []
        own = one.experiment.model(model)
        state = initial_state(own, one.experiment, np.array([one.position[0], one.velocity[0]]))
        known = dict(zip(own.state_names, state.tolist(), strict=True))
        return [known.get(name, 0.0) for name in self.free]

    @property
    def freedom(self) -> FloatArray:
        """How far the initial values may be from these (K R,): anywhere.  The readings determine them; filtered signals
        do not near an end, where the transient of the filter is many times their noise.  A bar that a force sets into
        motion from rest had 14 times the noise left where its initial speed was bounded by their scatter."""
        return np.full(self.nuisance.size, np.inf)

    @property
    def nuisances(self) -> int:
        """K, the initial values of one recording."""
        return 2 + len(self.free)

    def trimmed(self, model: Model, nuisance: FloatArray) -> tuple[OutputError, FloatArray]:
        """Without the free states that the model lacks, and the initial values without theirs."""
        has = [name in model.state_names for name in self.free]
        rows = nuisance.reshape(len(self.signals), self.nuisances)[:, [True, True, *has]]
        return replace(self, free=tuple(compress(self.free, has))), np.asarray(rows.ravel())

    def begun(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Initial values (K R,) of the model's free states that reduce the residual most; nuisance: (K' R,), of fewer
        states."""
        recordings = len(self.signals)
        known = nuisance.reshape(recordings, -1)
        if known.shape[1] == self.nuisances:
            return nuisance
        found = np.array([[0.0, 0.0, *self._settled(model, one)] for one in self.signals])
        found[:, : known.shape[1]] = known
        here, columns = self.residual(model, found.ravel()), []
        for at in range(known.shape[1], self.nuisances):
            unit = np.ptp(self.signals[0].position) * (np.arange(self.nuisances) == at)
            columns.append(by_recording(self.residual(model, (found + unit).ravel()) - here, self))
        for row, column, left in zip(found, zip(*columns, strict=True), by_recording(here, self), strict=True):
            size = -np.linalg.lstsq(np.stack(column, axis=1), left)[0]
            row[known.shape[1] :] += size * np.ptp(self.signals[0].position)
        return np.asarray(found.ravel())

    def misfit(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """The residual, which is not whitened: errors of a simulated motion add up."""
        return self.residual(model, nuisance)

    def whitened(self, misfit: FloatArray) -> FloatArray:
        """Unchanged."""
        return misfit

    def residual(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Measured less simulated motion, all recordings one after the other (M,) [rad, m or m/s²].

        An accelerometer has an offset, from gravity and its own: the least-squares one, the residual's mean, is removed
        (variable projection).
        """
        parts = []
        for one, start in zip(self.signals, nuisance.reshape(len(self.signals), -1), strict=True):
            experiment = one.experiment
            own, measured = experiment.model(model), experiment.measured[one.column]
            state = initial_state(own, experiment, start, self.free)
            try:
                run = own.simulate(experiment.drive, experiment.time, state, **self._step)
                motion = run[one.column]
            except ModelError:
                motion = np.full(experiment.time.size, np.inf)
            left = (measured - motion)[~np.isnan(measured)]
            has_offset = one.column == "accel" and np.isfinite(left).all()
            parts.append(left - left.mean() if has_offset else left)
        return np.concatenate(parts)

    @property
    def _step(self) -> dict[str, float]:
        """The step of a simulation: the same in all of a fit where its errors add up.  A servo follows its command, so
        that they do not; its stiffness changes by orders of magnitude in a fit, and its step follows."""
        if self.centre.base == "servo":
            return {"shortest_s": FINEST * self.substep_s}
        return {"substep_s": self.substep_s}

    def suited(self, models: Sequence[Model]) -> OutputError:
        """With the integration step that these models need, too, within ``FINEST``."""
        experiments, needed = [one.experiment for one in self.signals], math.inf
        for one in models:
            with suppress(ModelError):  # a guess that diverges is skipped
                needed = min(needed, _coarse_substep(one, self.signals))
        step = min(self.substep_s, max(needed, FINEST * self.substep_s))
        is_moved = any(map(is_driven, experiments))
        names = [name for one in models for name in free_states(one, is_moved)]
        return replace(self, substep_s=step, free=tuple(dict.fromkeys([*self.free, *names])))

    def resolved(self, model: Model, nuisance: FloatArray) -> OutputError:
        """With an integration step that changes the residual of a free motion by less than ``RESOLVED`` of it: with the
        step of a search a mass that dry friction stops had 1.4 times the noise left, and a second mode was named."""
        if any(is_driven(one.experiment) for one in self.signals):
            return self
        data, here = self, self.residual(model, nuisance)
        for _ in range(HALVINGS):
            finer = replace(data, substep_s=data.substep_s / 2)
            there = finer.residual(model, nuisance)
            if not np.linalg.norm(there - here) > RESOLVED * np.linalg.norm(there):
                break
            data, here = finer, there
        return data

    def no_finer(self, other: OutputError) -> OutputError:
        """With an integration step within ``FINEST`` of that of other recordings of the same model: with a model that
        is far off, a pendulum that a fit made spin, a single simulation took minutes."""
        return replace(self, substep_s=max(self.substep_s, FINEST * other.substep_s))

    def usual(self, model: Model) -> float:
        """Root mean square of the motion's deviation from its mean [rad or m]."""
        return float(
            np.sqrt(np.mean(np.concatenate([one.position - one.position.mean() for one in self.signals]) ** 2))
        )

    @property
    def accuracy(self) -> float:
        """The error that may be one of integration [rad, m or m/s²]."""
        return ACCURACY * self.error_at_rest

    @property
    def error_at_rest(self) -> float:
        """Root mean square of the readings' deviation from their mean [rad, m or m/s²]."""
        readings = [one.experiment.measured[one.column] for one in self.signals]
        return float(np.sqrt(np.nanmean(np.concatenate([each - np.nanmean(each) for each in readings]) ** 2)))

    @property
    def counts(self) -> list[int]:
        """Samples of each recording that count."""
        return [int((~np.isnan(one.experiment.measured[one.column])).sum()) for one in self.signals]


def _coarse_substep(model: Model, signals: Sequence[Signals]) -> float:
    """The integration step of a fit [s], of a motion from rest; where it runs away from there, as a bar that softens
    does whose place of rest is far from zero, of the measured one.  Raises ModelError."""
    try:
        return coarse_substep(model, [one.experiment for one in signals], STEPS)
    except ModelError:
        if any(is_driven(one.experiment) for one in signals):
            raise
    steps = []
    for one in signals:
        own = one.experiment.model(model)
        start = initial_state(own, one.experiment, np.array([one.position[0], one.velocity[0]]))
        steps.append(own.simulate(None, one.experiment.time, start).substep_s)
    return STEPS * min(steps)


def initial_state(model: Model, experiment: Experiment, start: FloatArray, free: Sequence[str] = ()) -> FloatArray:
    """The state with this position and speed, and these values of the model's free states; other states of effects
    begin in equilibrium with them."""
    names = [*(state.name for state in get_base(model.base).states), *free]
    given = {name: value for name, value in zip(names, start.tolist(), strict=True) if name in model.state_names}
    return model.initial_state(experiment.drive, float(experiment.time[0]), **given)


def _thinned(experiment: Experiment, every: int) -> Experiment:
    """One sample of so many."""
    if every < 2:
        return experiment
    measured = {name: values[::every] for name, values in experiment.measured.items()}
    return replace(experiment, time=experiment.time[::every], measured=measured)


def _until_rest(signals: Signals) -> Experiment:
    """A free recording without its end, in which the part rests."""
    if is_driven(signals.experiment):
        return signals.experiment
    last = float(signals.time[np.flatnonzero(signals.moving)[-1]])
    return signals.experiment.between(signals.experiment.time[0], last)
