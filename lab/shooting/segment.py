"""A segment of an experiment that is simulated from its own initial state, and its residual.

Restarting a chaotic or drifting motion every second or so makes its parameters identifiable.  No fitting here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model, ModelError, Trajectory
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.signals import COMMAND, COMMAND_RATE, OMEGA1, OMEGA2, THETA1, THETA2

__all__ = [
    "FINE_STEP",
    "STEP",
    "Linearised",
    "Segment",
    "in_motion",
    "motions",
    "scales",
    "start_with",
    "state_scales",
]

STEP = 1e-5
"""Finite difference, in numbers of order one, for searches."""
FINE_STEP = 3e-8
"""The same for intervals.  With impacts the motion is nonlinear even over 1e-5: confounded parameters then looked
distinct, and intervals came out up to ten times too narrow.  Steps of 1e-7 to 1e-8 give the same to some percent: fixed
integration steps leave hardly any rounding."""
LAG_SHARE, OWN_SHARE = 0.003, 0.1
"""Share of such a scale for states of effects, which are known better than the joint's; that of a lag follows from the
input."""


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residual r (M,) in units of the noise, and its derivatives by parameters A (M, P) and start state B (M, n)."""

    r: FloatArray
    A: FloatArray
    B: FloatArray

    @property
    def finite(self) -> bool:
        """Whether the motion could be run with all of the changes."""
        return bool(np.isfinite(self.r).all() and np.isfinite(self.A).all() and np.isfinite(self.B).all())


@dataclass(frozen=True, eq=False)
class Segment:
    """experiment: the segment; noise: by column, the unit of residuals; scale: (n,) the units of state changes; start:
    (n,) the state at its first sample."""

    experiment: Experiment
    noise: Mapping[str, float]
    scale: FloatArray
    start: FloatArray

    def starting(self, state: FloatArray) -> Segment:
        """The same with another start state."""
        return replace(self, start=state)

    def simulate(self, model: Model, start: FloatArray, substep_s: float | None) -> Trajectory:
        """The model's motion over the segment.  ``model`` already has the recording's values."""
        return model.simulate(self.experiment.drive, self.experiment.time, start, substep_s=substep_s)

    def residual(self, model: Model, start: FloatArray, substep_s: float) -> FloatArray:
        """(measured - modelled) / noise of all columns one after the other (M,); infinite where it cannot be run."""
        return np.asarray(self.residuals(model, start[None], substep_s)[0])

    def residuals(self, model: Model, starts: FloatArray, substep_s: float) -> FloatArray:
        """The same from several start states (K, n): (K, M)."""
        values, weights, seen = self._targets
        try:
            e = self.experiment
            run = model.prepare(e.drive, e.time, tuple(e.measured), e.clock_zero)
        except ModelError:
            return np.full((len(starts), values.size), np.inf)
        modelled = run(starts, substep_s).reshape(len(starts), -1)
        with np.errstate(over="ignore", invalid="ignore"):
            r = (values - (modelled if seen is None else modelled[:, seen])) * weights
        r[~np.isfinite(r).all(axis=1)] = np.inf
        return r

    @cached_property
    def _targets(self) -> tuple[FloatArray, FloatArray, NDArray[np.bool_] | None]:
        """All measured values in a row, one over the noise of each, and which samples they are (None: all)."""
        columns = self.experiment.measured
        values = np.concatenate(list(columns.values()))
        weights = np.repeat([1 / self.noise[name] for name in columns], self.experiment.time.size)
        seen = ~np.isnan(values)
        return (values, weights, None) if seen.all() else (values[seen], weights[seen], seen)

    def linearised(
        self, model: Model, unknowns: Unknowns, z: FloatArray, substep_s: float, by: float = STEP
    ) -> Linearised:
        """Residual and derivatives by finite differences of this step, at the parameters z and this start state."""
        own = self.experiment.model
        at, around = unknowns.around(model, z, by)
        moved = self.start + np.vstack([np.zeros(self.start.size), np.diag(by * self.scale)])
        r, *by_state = self.residuals(own(at), moved, substep_s)
        by_parameter = [
            (self.residuals(own(there), self.start[None], substep_s)[0] - r) / step for there, step in around
        ]
        A = np.array(by_parameter).T if by_parameter else np.empty((r.size, 0))
        return Linearised(r, A, (np.array(by_state) - r).T / by)


def in_motion(model: Model, drive: Motion | None, time: float, **given: float) -> FloatArray:
    """The state (n,) at a time within a motion, as far as it is given; else at rest relative to the input.

    An actuator with lag T behind its command c is in its steady state: x = c - T c' + T² c''.
    """
    state = model.initial_state(drive, time, **given)
    if drive is not None and (name := "actuator_lag.0") in model.state_names and name not in given:
        values = {name: parameter.value for name, parameter in model.parameters.items()}
        T, at = values["actuator_lag.T"], np.array([time - values.get("command_delay.T", 0.0)])
        state[model.state_names.index(name)] += float(T**2 * drive.acceleration(at)[0] - T * drive.velocity(at)[0])
    return state


def start_with(model: Model, segment: Segment, states: Sequence[str]) -> FloatArray:
    """The segment's initial state for a model with other effects, which begin in equilibrium.

    states: the names of the states in the segment's start.
    """
    given = {name: x for name, x in zip(states, segment.start.tolist(), strict=True) if name in model.state_names}
    return in_motion(model, segment.experiment.drive, float(segment.experiment.time[0]), **given)


def motions(model: Model, segments: Sequence[Segment], substep_s: float) -> list[Trajectory]:
    """The model's motions over those segments that it can be run on.  Raises ModelError when there are none."""
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
    """Typical deviation of the measured signals: of accel [m/s²] and of position or displacement; 0 if not measured."""

    def spread(*columns: str) -> float:
        found = [experiment.measured[name] for name in columns if name in experiment.measured]
        return float(np.nanstd(found[0])) if found else 0.0

    return spread("accel"), spread("position", "displacement")


def state_scales(model: Model, experiment: Experiment) -> FloatArray:
    """The units of state changes (n,): half the play and the speed that crosses it, the bar's bending at the usual
    acceleration, the spread of the measured signals."""
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
        (LAG_SHARE if len(states) == 1 else OWN_SHARE) * like.get(signal, accel or turn)
        for states in (get_effect(name).states for name in _ordered(model))
        for signal in states
    ]
    return np.array([*base, *own])


def _ordered(model: Model) -> list[str]:
    """Effects that have states, in the order of their states."""
    return list(dict.fromkeys(name.split(".")[0] for name in model.state_names if "." in name))


def _acceleration(experiment: Experiment) -> float:
    """The input's usual acceleration (root mean square) [rad/s²]."""
    if experiment.drive is None:
        return 0.0
    return float(np.sqrt(np.mean(experiment.drive.acceleration(experiment.time) ** 2)))
