"""Observers of gears: simulations that are corrected by every sample of the bar's acceleration.

An innovation is attributed to a jump of the speed of the joint.  The gain on the bar is its stationary Kalman gain for
jumps of q' at every sample; a jump of q' by x is one of omega_2 by -x/l.  Such a jump means that the teeth struck
earlier than in the model, and the angle of the joint is corrected for the difference in time.  The prediction errors
are the objective of the global search (objective.py), and the states are initial states of segments.  No fitting here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.shooting.segment import in_motion
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray
from lostmotion.model.observer import UNLIMITED, Budget, Followed, ObserverRun, follow

__all__ = ["SETTLED_S", "STRONG", "TIGHT", "WEAK", "Observer", "Start", "can_follow", "sampled", "states_at"]

TIGHT, STRONG, WEAK = 1.0, 0.3, 0.1
"""High, medium and low gain: the standard deviation of the excitation of the bar at every sample, in units of the
noise."""
JOINT = (("theta_2", "omega_2"), ("shaft_compliance.0", "shaft_compliance.1"))
"""The states that an impact changes: angle and speed of the joint, and of its gear where a compliant shaft connects
them."""
EARLIER_S = 1.5e-3
"""Time by which impacts are assumed to be early or late in the model [s].  The errors of 39 right models with the gain
``STRONG`` are smallest at 1 to 2 ms, a tenth below those at 0."""
SETTLED_S = 0.2
"""Settling time of an observer from an unknown initial state [s]."""


class Start(NamedTuple):
    """What is run, from which state (n,), and with which gains (n,)."""

    run: ObserverRun
    state: FloatArray
    gain: FloatArray


@dataclass(frozen=True, eq=False)
class Observer:
    """gain: on q and q' (2,); expected: standard deviation of the innovations for the right model, in units of the
    noise."""

    gain: FloatArray
    expected: float

    @classmethod
    def of(cls, model: Model, spacing_s: float, coupling: float) -> Observer:
        """The observer from the Riccati equation of the bar for samples every ``spacing_s`` [s].  The jumps of q' have
        the standard deviation coupling/w, w being the bar's natural frequency [rad/s]."""
        from scipy.linalg import expm, solve_discrete_are

        k, b, m = (model.parameters[name].value for name in "kbm")
        w = math.sqrt(k / m)
        F, C = expm(np.array([[0.0, 1.0], [-(w**2), -b / m]]) * spacing_s), np.array([-(w**2), -b / m])
        P = solve_discrete_are(F.T, C[:, None], np.diag([0.0, (coupling / w) ** 2]), np.eye(1))
        s = float(C @ P @ C) + 1.0
        return cls(np.asarray(P @ C / s), math.sqrt(s))

    def run(self, model: Model, experiment: Experiment, substep_s: float) -> tuple[FloatArray, FloatArray]:
        """Innovations (N,) [m/s²] and corrected states (N, n) along an experiment without gaps in accel.

        model: with the experiment's values.  Raises ModelError for a motion that is not finite.
        """
        found = self.follow([self.start(model, experiment)], experiment, substep_s)
        return found.e[0], found.states[0]

    def start(self, model: Model, experiment: Experiment) -> Start:
        """The start of a run of a model, with the experiment's values.  Raises ModelError for a motion that is not
        finite."""
        value, first = model.parameters, experiment.measured[ACCEL][0]
        start = in_motion(model, experiment.drive, float(experiment.time[0]))
        start[2] = -value["m"].value / value["k"].value * first
        gain, names = np.zeros(start.size), model.state_names
        gain[2:4], jump = self.gain, -self.gain[1] / value["l"].value
        for angle, speed in JOINT:
            if angle in names:
                gain[names.index(angle)], gain[names.index(speed)] = -EARLIER_S * jump, jump
        return Start(model.observer(experiment.drive, experiment.time, ACCEL, experiment.clock_zero), start, gain)

    @staticmethod
    def follow(
        starts: Sequence[Start], experiment: Experiment, substep_s: float, budget: Budget = UNLIMITED,
        *, keeps: bool = True,
    ) -> Followed:  # fmt: skip
        """The runs along an experiment without gaps in accel, side by side; see ``model.observer.follow``."""
        runs, states, gains = zip(*starts, strict=True)
        return follow(runs, np.array(states), np.array(gains), experiment.measured[ACCEL], substep_s, budget,
                      keeps=keeps)  # fmt: skip


def can_follow(model: Model, *experiments: Experiment) -> bool:
    """Whether the model is one of gears, and the bar's acceleration was measured in all of these experiments."""
    return model.base == "play" and all(ACCEL in experiment.measured for experiment in experiments)


def sampled(experiment: Experiment) -> Experiment:
    """The experiment with the bar's acceleration only, at its samples; other columns are sampled at other times."""
    values = experiment.measured[ACCEL]
    rows = ~np.isnan(values)
    return replace(experiment, time=experiment.time[rows], measured={ACCEL: values[rows]})


def states_at(model: Model, experiment: Experiment, times: FloatArray, substep_s: float) -> Mapping[float, FloatArray]:
    """The states (2, n) of runs with medium and low gain at those of the times [s] at which the runs have settled, by
    time."""
    own, bar = experiment.model(model), sampled(experiment)
    try:
        runs = [Observer.of(own, 1 / bar.rate_hz, coupling).run(own, bar, substep_s)[1] for coupling in (STRONG, WEAK)]
    except ModelError:
        return {}
    found = {}
    for time in times[times >= bar.time[0] + SETTLED_S]:
        last = int(np.searchsorted(bar.time, time + 1e-9)) - 1
        states = np.array([_moved_on(own, bar, last, run[last], float(time)) for run in runs])
        if np.isfinite(states).all():
            found[float(time)] = states
    return found


def _moved_on(model: Model, bar: Experiment, last: int, state: FloatArray, time: float) -> FloatArray:
    """The state (n,) at a time [s] between two samples of the bar, by simulation from the state at the sample
    ``last``."""
    since = float(bar.time[last])
    if time - since < 1e-9 or not np.isfinite(state).all():
        return state
    try:
        return model.simulate(bar.drive, [since, time], state).state
    except ModelError:
        return np.full_like(state, np.inf)
