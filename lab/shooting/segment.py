"""A segment of an experiment that is simulated from its own initial state, its residual and the derivatives of that.

Multiple shooting restarts a chaotic or drifting motion every second or so, which makes its parameters identifiable.
The fits of segments are in continuation.py and least_squares.py.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.series import rms
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model, ModelError, Trajectory
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.run import Run, run_each
from lostmotion.model.signals import COMMAND, COMMAND_RATE, OMEGA1, OMEGA2, THETA1, THETA2

__all__ = [
    "FINE_STEP",
    "STEP",
    "Linearised",
    "Segment",
    "in_motion",
    "motions",
    "residuals",
    "scales",
    "start_with",
    "state_scales",
]

STEP = 1e-5
"""Step of finite differences in z, and in scales of a state, for searches."""
FINE_STEP = 3e-8
"""Step of finite differences for confidence intervals.  With impacts the motion is nonlinear even over 1e-5: confounded
parameters then looked distinct, and intervals were up to ten times too narrow.  Steps of 1e-7 to 1e-8 give the same to
some percent: fixed integration steps leave hardly any rounding."""
LAG_SHARE, OWN_SHARE = 0.003, 0.1
"""Scale of a single state of an effect that follows from the motion (a lag of the command, a hysteresis), and of other
states of effects, as shares of the scale of the joint's state of the same kind.  A lag of the sensor follows readings,
which are not known before the first: with 0.003 the error of the right model was 1.5 % too large, and depended on the
units."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """A residual r (M,) in units of the noise, with its derivatives by the parameters z, A (M, P), and by the initial
    state in units of its scale, B (M, n)."""

    r: FloatArray
    A: FloatArray
    B: FloatArray

    @property
    def finite(self) -> bool:
        """Whether the motion could be simulated with all changes of parameters and states."""
        return bool(np.isfinite(self.r).all() and np.isfinite(self.A).all() and np.isfinite(self.B).all())


@dataclass(frozen=True, eq=False)
class Segment:
    """A segment with its initial state.

    experiment: the samples of the segment; noise: by column, the unit of residuals; scale: units of changes of the
    state (n,); start: the state at the first sample (n,).
    """

    experiment: Experiment
    noise: Mapping[str, float]
    scale: FloatArray
    start: FloatArray

    def starting(self, state: FloatArray) -> Segment:
        """The segment with another initial state (n,)."""
        return replace(self, start=state)

    def simulate(self, model: Model, start: FloatArray, substep_s: float | None) -> Trajectory:
        """The motion of a model over the segment from an initial state (n,); model: with the values of the
        recording."""
        return model.simulate(self.experiment.drive, self.experiment.time, start, substep_s=substep_s)

    def residual(self, model: Model, start: FloatArray, substep_s: float) -> FloatArray:
        """(measured - modelled)/noise of all columns one after the other (M,), from an initial state (n,); infinite
        where the motion cannot be simulated.  model: with the values of the recording."""
        return np.asarray(self.residuals(model, start[None], substep_s)[0])

    def residuals(self, model: Model, starts: FloatArray, substep_s: float) -> FloatArray:
        """The residuals (K, M) from several initial states (K, n); see ``residual``."""
        run = self.prepared(model)
        return self.residuals_of([None] * len(starts) if run is None else run(starts, substep_s))

    def prepared(self, model: Model) -> Run | None:
        """The run of a model over the segment; None where its motion is not finite."""
        e = self.experiment
        with suppress(ModelError):
            return model.prepare(e.drive, e.time, tuple(e.measured), e.clock_zero)
        return None

    def residuals_of(self, outputs: FloatArray | Sequence[FloatArray | None]) -> FloatArray:
        """The residuals (K, M) of the outputs (columns, N) of K runs, infinite where there are none; see
        ``residual``."""
        values, weights, seen = self._targets
        failed = np.full((len(self.experiment.measured), self.experiment.time.size), np.nan)
        every = np.array([failed if out is None else out for out in outputs]).reshape(len(outputs), -1)
        with np.errstate(over="ignore", invalid="ignore"):
            r = (values - (every if seen is None else every[:, seen])) * weights
            lost = ~np.isfinite(r.sum(axis=1))
        if lost.any():
            r[lost & ~np.isfinite(r).all(axis=1)] = np.inf
        return np.asarray(r)

    @cached_property
    def _targets(self) -> tuple[FloatArray, FloatArray, NDArray[np.bool_] | None]:
        """The measured values of all columns (M,), the reciprocals of their noise (M,), and which samples of the
        columns they are; None for all."""
        columns = self.experiment.measured
        values = np.concatenate(list(columns.values()))
        weights = np.repeat([1 / self.noise[name] for name in columns], self.experiment.time.size)
        seen = ~np.isnan(values)
        return (values, weights, None) if seen.all() else (values[seen], weights[seen], seen)

    def linearised(
        self, model: Model, unknowns: Unknowns, z: FloatArray, substep_s: float, by: float = STEP
    ) -> Linearised:
        """The residual and its derivatives at the parameters z (P,) and the segment's initial state, by finite
        differences with the step ``by``."""
        own = self.experiment.model
        at, around = unknowns.around(model, z, by)
        moved = self.start + np.vstack([np.zeros(self.start.size), np.diag(by * self.scale)])
        runs = [self.prepared(own(at))] * len(moved) + [self.prepared(own(there)) for there, _ in around]
        starts = np.vstack([moved, np.tile(self.start, (len(around), 1))])
        r, *others = self.residuals_of(run_each(runs, starts, substep_s))
        steps = [by] * self.start.size + [step for _, step in around]
        slopes = ((np.array(others) - r) / np.array(steps)[:, None]).T
        return Linearised(r, slopes[:, self.start.size :], slopes[:, : self.start.size])


def residuals(model: Model, segments: Sequence[Segment], substep_s: float) -> list[FloatArray]:
    """The residual of each segment (M_i,) from its initial state; see ``Segment.residual``."""
    runs = [one.prepared(one.experiment.model(model)) for one in segments]
    found = run_each(runs, np.array([one.start for one in segments]), substep_s)
    return [one.residuals_of([out])[0] for one, out in zip(segments, found, strict=True)]


def in_motion(model: Model, drive: Motion | None, time: float, **given: float) -> FloatArray:
    """The state (n,) of a model at a time [s] within a motion: given states have their values, the others are at rest
    relative to the input.

    An actuator with a lag T behind its command c is in its steady state, x = c - T c' + T² c''.
    """
    state = model.initial_state(drive, time, **given)
    if drive is not None and (name := "actuator_lag.0") in model.state_names and name not in given:
        values = {name: parameter.value for name, parameter in model.parameters.items()}
        T, at = values["actuator_lag.T"], np.array([time - values.get("command_delay.T", 0.0)])
        state[model.state_names.index(name)] += float(T**2 * drive.acceleration(at)[0] - T * drive.velocity(at)[0])
    return state


def start_with(model: Model, segment: Segment, states: Sequence[str]) -> FloatArray:
    """The initial state (n,) of a segment for a model with other effects, whose states begin in equilibrium; states:
    the names of the states of ``segment.start``."""
    given = {name: x for name, x in zip(states, segment.start.tolist(), strict=True) if name in model.state_names}
    return in_motion(model, segment.experiment.drive, float(segment.experiment.time[0]), **given)


def motions(model: Model, segments: Sequence[Segment], substep_s: float) -> list[Trajectory]:
    """The motions of a model over those segments on which it can be simulated.  Raises ModelError when there are
    none."""
    found, failed = [], ModelError("there is no segment to run the model on")
    for segment in segments:
        try:
            found.append(segment.simulate(segment.experiment.model(model), segment.start, substep_s))
        except ModelError as error:  # its initial state was not found, and is deep within the teeth
            failed = error
    if not found:
        raise failed
    return found


def scales(experiment: Experiment) -> tuple[float, float]:
    """Standard deviations of the measured acceleration [m/s²] and position or displacement; 0 if not measured."""

    def spread(*columns: str) -> float:
        found = [experiment.measured[name] for name in columns if name in experiment.measured]
        return float(np.nanstd(found[0])) if found else 0.0

    return spread("accel"), spread("position", "displacement")


def state_scales(model: Model, experiment: Experiment) -> FloatArray:
    """The scales of the states of a model (n,): for gears half the play and the speed that crosses it, for a bar its
    deflection at the usual acceleration, else the standard deviations of the measured signals."""
    values = {name: p.value for name, p in experiment.model(model).parameters.items()}
    accel, position = scales(experiment)
    if model.base == "play":
        turn = values["d"] / 2 / values["R2"]
        pull = _acceleration(experiment) * values["R1"]
        speed = math.sqrt(max(pull * values["d"], 1e-12)) / values["R2"]
        w = math.sqrt(values["k"] / values["m"])
        bend = max(accel, 1e-3) / w**2
        base = [turn, speed, bend, bend * w]
    elif model.base == "oscillator":
        w = math.sqrt(values["k"] / values["m"])
        bend = position or accel / w**2
        turn, speed, base = bend, bend * w, [bend, bend * w]
    else:
        turn, speed = position, position * 2 * math.pi
        base = [turn, speed]
    like: dict[int | None, float] = {
        **dict.fromkeys((COMMAND, THETA1, THETA2), turn),
        **dict.fromkeys((COMMAND_RATE, OMEGA1, OMEGA2), speed),
        None: base[-2] if len(base) > 2 else turn,
    }
    own = [
        (LAG_SHARE if len(states) == 1 and signal in like else OWN_SHARE) * like.get(signal, accel or turn)
        for states in (get_effect(name).states for name in _ordered(model))
        for signal in states
    ]
    return np.array([*base, *own])


def _ordered(model: Model) -> list[str]:
    """The names of the effects that have states, in the order of these states."""
    return list(dict.fromkeys(name.split(".")[0] for name in model.state_names if "." in name))


def _acceleration(experiment: Experiment) -> float:
    """Root mean square of the acceleration of the input [rad/s²]; 0 without an input."""
    if experiment.drive is None:
        return 0.0
    return rms(experiment.drive.acceleration(experiment.time))
