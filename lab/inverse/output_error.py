"""The output error: the measured motion of whole recordings less the motion simulated from an initial state of each.

Its estimates are unbiased where the input does not follow the disturbances: the command of a servo (the controller is a
part of the model), the force on an oscillator, and a joint that swings freely.  Over many swings it also shows a
damping that is too small to show in the acceleration of one.  No selection here.

References: L. Ljung, System Identification (1999), section 4.3; J. Schoukens and L. Ljung, "Nonlinear system
identification: a user-oriented road map", IEEE Control Systems 39 (2019).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import compress
from typing import Self

import numpy as np
from scipy.optimize import brentq

from lostmotion.lab.data.clipping import RANGE
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.series import rms
from lostmotion.lab.fitting.identifiability import free_states
from lostmotion.lab.inverse.problem import Point, Problem
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.shooting.task import fine_substep
from lostmotion.model import Model, ModelError
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray
from lostmotion.model.run import run_each

__all__ = ["OutputError", "initial_state", "offset_of"]

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
HORIZONS = (0.2, 0.5)
"""Shares of a free swing that are fitted before the whole; before these, shares with the same ratio down to
``IN_PHASE``."""
IN_PHASE = 10
"""Swings of the first horizon at most: a frequency error of 2 % is out of phase after ten, and a fit to more would end
in a local minimum.  Of a pendulum that was filmed for 140 swings the initial angle was 0.06 instead of 1.4 rad."""
STEPS = 4.0
"""Integration steps of a fit, times the model's own choice."""
RESOLVED, HALVINGS = 0.1, 5
"""Share of the residual that the motion changes by, when the integration step is halved, at which the step is short
enough; and how often it is halved at most."""


@dataclass(frozen=True, eq=False)
class OutputError(Problem):
    """The error of the simulated motion of R recordings, with K initial values of each as nuisance parameters: its
    position and speed, and the free states of effects.

    substep_s: integration step of a fit [s]; free: the names of the states of effects whose initial values are fitted.
    """

    substep_s: float
    free: tuple[str, ...]
    prior_centre: Model = field(kw_only=True)

    @classmethod
    def of(cls, signals: Sequence[Signals], model: Model, substep_s: float = 0.0) -> OutputError:
        """The problem with this integration step [s], by default the one that the model needs, without the time after a
        joint has come to rest."""
        parts = [_until_rest(one) for one in signals]
        surplus = sum(part.time.size for part in parts) // MOST_SAMPLES
        moving = tuple(
            replace(one, experiment=_thinned(part, min(surplus, int(part.rate_hz / one.band_hz / PER_PERIOD))))
            for one, part in zip(signals, parts, strict=True)
        )
        step = substep_s or _coarse_substep(model, moving)
        is_driven = any(one.experiment.is_driven for one in moving)
        return cls(moving, step, free_states(model, is_driven), prior_centre=model)

    @property
    def horizons(self) -> list[OutputError]:
        """The problem for growing parts of a free motion, from a few swings on, and for the whole of it."""
        if self.is_driven:
            return [self]
        shares, swings = list(HORIZONS), self.swings
        while shares[0] * swings > IN_PHASE:
            shares.insert(0, shares[0] * HORIZONS[0] / HORIZONS[1])
        return [*map(self._first, shares), self]

    @property
    def swings(self) -> float:
        """The largest number of swings of a recording, by the changes of the sign of its speed."""
        return max(float(np.count_nonzero(np.diff(np.signbit(one.velocity)))) / 2 for one in self.signals)

    def _first(self, share: float) -> OutputError:
        """The problem for the first part of each recording; share: of its duration."""
        parts = [
            replace(one, experiment=one.experiment.between(one.time[0], one.time[0] + share * one.experiment.duration))
            for one in self.signals
        ]
        return replace(self, signals=tuple(parts))

    @property
    def column(self) -> str:
        """The measured one."""
        return self.signals[0].column

    @cached_property
    def nuisance(self) -> FloatArray:
        """The initial position and speed of each recording in the filtered signals, and its free states in equilibrium
        with them (K R,).  A fit may move them anywhere, as near an end the transient of the filter is many times the
        noise."""
        settled = [self._settled(self.prior_centre, one) for one in self.signals]
        return np.hstack([self.measured.reshape(len(settled), -1), settled]).ravel()

    @property
    def begins(self) -> list[FloatArray]:
        """The nuisance parameters with which a fit of them alone begins; of an oscillator that a force drives also
        those at rest, as many begin there: the place near an end of a filtered and integrated acceleration is off by a
        fifth of the largest one, and a bar that stiffens was followed from there on another branch of its resonance,
        with 275 m/s² left instead of 0.2."""
        is_forced = self.is_driven and self.prior_centre.base == "oscillator"
        return [self.nuisance, *([np.zeros_like(self.nuisance)] if is_forced else [])]

    @property
    def measured(self) -> FloatArray:
        """The initial position and speed of each recording in the filtered signals (2 R,)."""
        return np.array([value for one in self.signals for value in (one.position[0], one.velocity[0])])

    def starts(self, nuisance: FloatArray) -> FloatArray:
        """The initial position, speed and free states of each recording (R, K)."""
        return nuisance.reshape(len(self.signals), -1)

    def _settled(self, model: Model, one: Signals) -> list[float]:
        """The free states in equilibrium with the start of a recording; zero for those that the model lacks."""
        if not self.free:
            return []
        own = one.experiment.model(model)
        state = initial_state(own, one.experiment, np.array([one.position[0], one.velocity[0]]))
        known = dict(zip(own.state_names, state.tolist(), strict=True))
        return [known.get(name, 0.0) for name in self.free]

    def trimmed(self, model: Model, nuisance: FloatArray) -> tuple[OutputError, FloatArray]:
        """The problem without the free states that the model lacks, and the nuisance parameters (K R,) without them."""
        has = [name in model.state_names for name in self.free]
        rows = self.starts(nuisance)[:, [True, True, *has]]
        return replace(self, free=tuple(compress(self.free, has))), np.asarray(rows.ravel())

    def begun(self, model: Model, nuisance: FloatArray) -> FloatArray:
        """Nuisance parameters (K R,) with initial values of additional free states that reduce the residual most, by
        linear least squares; nuisance: (K' R,), those without the additional states."""
        known, many = self.starts(nuisance), 2 + len(self.free)
        if known.shape[1] == many:
            return nuisance
        found = np.array([[0.0, 0.0, *self._settled(model, one)] for one in self.signals])
        found[:, : known.shape[1]] = known
        units = np.ptp(self.signals[0].position) * np.eye(many)[known.shape[1] :]
        here, *there = self.residuals([(model, found.ravel()), *((model, (found + one).ravel()) for one in units)])
        columns = [self.by_recording(moved - here) for moved in there]
        for row, column, left in zip(found, zip(*columns, strict=True), self.by_recording(here), strict=True):
            size = -np.linalg.lstsq(np.stack(column, axis=1), left)[0]
            row[known.shape[1] :] += size * np.ptp(self.signals[0].position)
        return np.asarray(found.ravel())

    def misfits(self, points: Sequence[Point]) -> FloatArray:
        """Measured less simulated motion, all recordings one after the other (K, M) [rad, m or m/s²]."""
        return np.concatenate([left for left, _ in self._compared(points)], axis=1)

    def zeros(self, model: Model, nuisance: FloatArray) -> list[float]:
        """What the sensor of each recording reads where the motion of the model is zero [rad, m or m/s²]."""
        return [zero for _, (zero,) in self._compared([(model, nuisance)])]

    def _compared(self, points: Sequence[Point]) -> Iterator[tuple[FloatArray, list[float]]]:
        """Measured less simulated motion (K, M_i), and the zeros of the sensor (K,), for each recording.

        The zero is that for which the residual's mean is zero (variable projection).  What a sensor cuts off is the
        motion with the zero.
        """
        limits = [model.own(RANGE)["a_max"].value if RANGE in model.effects else np.inf for model, _ in points]
        models = [without(model, RANGE) if RANGE in model.effects else model for model, _ in points]
        starts = [self.starts(nuisance) for _, nuisance in points]
        for at, one in enumerate(self.signals):
            measured = one.experiment.measured[one.column]
            seen = ~np.isnan(measured)
            motions, zeros = self._motions(models, one, [rows[at] for rows in starts])[:, seen], []
            for motion, limit in zip(motions, limits, strict=True):
                has_zero = self._has_zero(at) and np.isfinite(motion).all()
                zeros.append(offset_of(measured[seen], motion, limit) if has_zero else 0.0)
                motion[:] = measured[seen] - np.clip(motion + zeros[-1], -limit, limit)
            yield motions, zeros

    def _motions(self, models: Sequence[Model], one: Signals, starts: Sequence[FloatArray]) -> FloatArray:
        """The simulated readings (K, N) of a recording; starts: initial position, speed and free states for each model.
        Infinite where a motion exceeds all numbers.

        The integration step is constant within a fit, as its errors add up.  Those of a servo do not, as it follows its
        command.  Its stiffness changes by orders of magnitude within a fit, and its step follows that of the first
        model.
        """
        e, found, step = one.experiment, np.full((len(models), one.experiment.time.size), np.inf), self.substep_s
        own, first = [e.model(model) for model in models], 0
        with suppress(ModelError):
            states = np.array([initial_state(m, e, start, self.free) for m, start in zip(own, starts, strict=True)])
            if self.prior_centre.base == "servo":
                found[0], step = _simulated(own[0], e, one.column, states[0].tobytes(), FINEST * self.substep_s)
                first = 1
            runs = [model.prepare(e.drive, e.time, (one.column,), e.clock_zero) for model in own[first:]]
            for row, out in zip(found[first:], run_each(runs, states[first:], step), strict=True):
                row[:] = out if out is not None and np.isfinite(out).all() else np.inf
        return found

    def _has_zero(self, at: int) -> bool:
        """Whether the sensor of a recording has a zero of its own: an accelerometer, which feels gravity and has an
        offset, and an encoder or a film, whose zero is where the user puts it, but in the first recording.  The goal of
        a servo is counted from the zero of its angle."""
        is_placed = self.prior_centre.base != "servo" and (at > 0 or not self.is_anchored)
        return self.column == ACCEL or is_placed

    @property
    def most_beside(self) -> int:
        """One for a servo: its step follows its stiffness, and models side by side have the step of the first."""
        return 1 if self.prior_centre.base == "servo" else LANES

    def suited(self, models: Sequence[Model]) -> Self:
        """The problem with an integration step that these models need as well, but at least ``FINEST`` of the present
        one, and with their free states."""
        needed = math.inf
        for one in models:
            with suppress(ModelError):  # a guess that diverges is skipped
                needed = min(needed, _coarse_substep(one, self.signals))
        step = min(self.substep_s, max(needed, FINEST * self.substep_s))
        names = [name for one in models for name in free_states(one, self.is_driven)]
        return replace(self, substep_s=step, free=tuple(dict.fromkeys([*self.free, *names])))

    def resolved(self, model: Model, nuisance: FloatArray) -> OutputError:
        """The problem with the longest integration step (of repeated halvings) whose halving changes the residual of a
        free motion by less than the share ``RESOLVED``."""
        if self.is_driven:
            return self
        data, here = self, self.residual(model, nuisance)
        for _ in range(HALVINGS):
            finer = replace(data, substep_s=data.substep_s / 2)
            there = finer.residual(model, nuisance)
            if not np.linalg.norm(there - here) > RESOLVED * np.linalg.norm(there):
                break
            data, here = finer, there
        return data

    def signal_rms(self, model: Model) -> float:
        """Root mean square of the filtered motion's deviation from its mean over whole recordings, also at rest, in the
        unit of the readings [rad, m or m/s²]."""
        parts = [one.acceleration if one.column == ACCEL else one.position for one in self.signals]
        return rms(*(part - part.mean() for part in parts))

    @property
    def accuracy(self) -> float:
        """The error that may be one of integration [rad, m or m/s²]."""
        return ACCURACY * self.error_at_rest

    @property
    def error_at_rest(self) -> float:
        """The error of a model at rest: root mean square of the deviation of the compared readings from their mean
        [rad, m or m/s²]."""
        readings = [one.experiment.measured[one.column] for one in self.signals]
        return rms(*(each - np.nanmean(each) for each in readings))

    @cached_property
    def counts(self) -> list[int]:
        """The number of samples of each recording that are compared."""
        return [int((~np.isnan(one.experiment.measured[one.column])).sum()) for one in self.signals]


@lru_cache(maxsize=16)  # a point is judged, and simulated again beside those from which its derivatives come
def _simulated(
    model: Model, experiment: Experiment, column: str, state: bytes, shortest_s: float
) -> tuple[FloatArray, float]:
    """The simulated readings (N,) of a recording with a step that the model chooses, and the step [s]; state: the
    initial one (n,)."""
    run = model.simulate(experiment.drive, experiment.time, np.frombuffer(state), shortest_s=shortest_s)
    return run[column], run.substep_s


def _coarse_substep(model: Model, signals: Sequence[Signals]) -> float:
    """The integration step of a fit [s].  It is chosen from a motion that begins at rest, or from one that begins in
    the measured state: where the former diverges, as that of a bar that softens if its equilibrium is far from zero,
    and where friction changes over a distance, which takes the longest at rest.  Raises ModelError."""
    is_driven = any(one.experiment.is_driven for one in signals)
    if is_driven or not any(get_effect(name).along for name in model.effects):
        try:
            return STEPS * fine_substep(model, [one.experiment for one in signals])
        except ModelError:
            if is_driven:
                raise
    steps = []
    for one in signals:
        own = one.experiment.model(model)
        start = initial_state(own, one.experiment, np.array([one.position[0], one.velocity[0]]))
        steps.append(own.simulate(None, one.experiment.time, start).substep_s)
    return STEPS * min(steps)


def initial_state(model: Model, experiment: Experiment, start: FloatArray, free: Sequence[str] = ()) -> FloatArray:
    """The initial state (n,) of an experiment, from position, speed and the free states: start (K,), the names of the
    latter in ``free``.  Other states of effects begin in equilibrium with them."""
    names = [*(state.name for state in get_base(model.base).states), *free]
    given = {name: value for name, value in zip(names, start.tolist(), strict=True) if name in model.state_names}
    return model.initial_state(experiment.drive, float(experiment.time[0]), **given)


def offset_of(measured: FloatArray, motion: FloatArray, limit: float) -> float:
    """The offset of a sensor for which the readings (N,) and the motion (N,) plus the offset, cut off at a limit, have
    the same mean [m/s²]."""
    if limit == np.inf:
        return float(np.mean(measured - motion))

    def missing(offset: float) -> float:
        return float(np.mean(measured - np.clip(motion + offset, -limit, limit)))

    most = limit + float(np.abs(motion).max())  # beyond it all readings are cut off
    ends = missing(-most), missing(most)
    if not ends[0] > 0 > ends[1]:
        return 0.0
    return float(brentq(missing, -most, most, disp=False))  # of a motion that is far off, the value need not be exact


def _thinned(experiment: Experiment, every: int) -> Experiment:
    """The experiment with every n-th sample; every: n."""
    if every < 2:
        return experiment
    measured = {name: values[::every] for name, values in experiment.measured.items()}
    return replace(experiment, time=experiment.time[::every], measured=measured)


def _until_rest(signals: Signals) -> Experiment:
    """A free motion until it comes to rest; an experiment with an input is unchanged."""
    if signals.experiment.is_driven:
        return signals.experiment
    last = float(signals.time[np.flatnonzero(signals.moving)[-1]])
    return signals.experiment.between(signals.experiment.time[0], last)
