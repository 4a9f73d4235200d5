"""A model that follows its measurement: a cubature Kalman filter and smoother with one unknown input.

The model may be wrong in one equation; an unknown input u enters there as a torque, a force, an angle or an error of
the sensor, and may change by so much in so much time (Ornstein and Uhlenbeck's process).  The likelihood says how well
that explains the measurement; the smoother says what u must have been.  localise.py says which equations are tried.
After Kristensen, Madsen, Jorgensen 2004: "A method for systematic improvement of stochastic grey-box models".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from lostmotion.lab import words
from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment
from lostmotion.model import Model
from lostmotion.model.assemble import assemble, in_order, scope
from lostmotion.model.base import Term
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.kernel import Slots, compiled, kernel
from lostmotion.model.motion import FloatArray
from lostmotion.model.observer import at_samples
from lostmotion.model.parameter import Parameter
from lostmotion.model.pieces import cut
from lostmotion.model.signals import (
    ALPHA2,
    BAR_FORCE,
    COMMAND,
    COMMAND_RATE,
    DRIVEN,
    FORCE,
    OMEGA2,
    Q_RATE,
    QDD,
    THETA1,
    THETA2,
    TORQUE,
    Q,
)
from lostmotion.model.solve import Plan, integrate, start_signals

__all__ = ["TARGETS", "Track", "Tracker", "Wander"]

TARGETS = {
    "play": {"joint": TORQUE, "oscillator": BAR_FORCE, "command": THETA1},
    "oscillator": {"oscillator": BAR_FORCE},
    "joint": {"joint": TORQUE},
    "servo": {"joint": TORQUE, "command": THETA1},
}
"""The signal on which an unknown input of each equation acts; the sensor's is added to what it tells."""
SHOWN = {
    "play": {"theta_2": THETA2, "omega_2": OMEGA2, "acceleration": ALPHA2, "load": FORCE, "q": Q, "q'": Q_RATE,
             "command": COMMAND, "command_rate": COMMAND_RATE},
    "oscillator": {"q": Q, "q'": Q_RATE, "accel": QDD, "force": FORCE},
    "joint": {"theta_2": THETA2, "omega_2": OMEGA2, "torque": FORCE},
    "servo": {"theta_2": THETA2, "omega_2": OMEGA2, "torque": FORCE, "command": COMMAND, "command_rate": COMMAND_RATE},
}  # fmt: skip
"""Signals that what is found may depend on."""
ANY = Parameter(0.0, "", source="filled in by the filter")
LEAP, WIDEST = 6.0, 0.5
"""What a state may at most change by in one sample, and how uncertain it may become, as shares of its scale."""
UNSURE = 0.3
"""Standard deviation of the start state, as a share of its scale."""
WHITE_SHARE = 0.02
"""Of the variance of coloured noise that is taken to be white all the same: counts, rounding."""
FAR = 5.0
"""Standard deviations beyond which a sample is believed less."""
SETTLED_S = 0.1


@kernel
def injected(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """p: u."""
    return p[0]


@dataclass(frozen=True)
class Wander:
    """How an unknown input behaves: equation, standard deviation (its unit), and time in which it forgets itself [s].

    floor: what every state may do by itself from one sample to the next, as a share of its scale.  With too little of
    it the filter is too sure to find an impact again that it has missed, with too much it learns nothing.
    """

    equation: str
    deviation: float
    memory_s: float
    floor: float


@dataclass(frozen=True, eq=False)
class Track:
    """What the filter found.

    log_likelihood: of the innovations after the first 0.1 s; innovations: (N,) of the first column, in their standard
    deviations; and with smoothing: states (N, n), u (N,) and its standard deviation (N,).
    """

    log_likelihood: float
    innovations: FloatArray
    states: FloatArray
    u: FloatArray
    deviation: FloatArray


class Tracker:
    """An experiment prepared for tracking with different unknown inputs.

    noise: of each measured column, that of the first may be coloured; scale, start: (n,) of the states.
    """

    def __init__(
        self,
        model: Model,
        experiment: Experiment,
        noise: Mapping[str, NoiseModel],
        scale: FloatArray,
        start: FloatArray,
    ) -> None:
        own = experiment.model(model)
        base = get_base(own.base)
        self.columns = [name for name in experiment.measured if name in base.outputs]
        self._y = np.column_stack([experiment.measured[name] for name in self.columns])
        first = noise[self.columns[0]]
        gamma = first.autocovariance(1)
        self._alike = max(float(gamma[1] / gamma[0]), 0.0) if first.order else 0.0
        self._variance = np.array([noise[name].rms ** 2 for name in self.columns])
        self._coloured = first.rms * (1.0 if self._alike else 1e-3)
        if self._alike:
            self._variance[0] *= WHITE_SHARE
        self._records = np.array([base.outputs[name] for name in self.columns], dtype=np.uint64)
        self._scale, self._start, self.base = scale, start, own.base
        self._plan, self._at = _plan(own, experiment.drive is not None)
        effects = [get_effect(name) for name in own.effects]
        values = {name: p.value for name, p in own.parameters.items()}
        delay = sum(effect.delay(scope(values, effect)) for effect in effects if effect.delay)
        self._times = experiment.time - experiment.time[0]
        self._origin = float(experiment.time[0])
        whole = cut(experiment.drive, self._origin, float(self._times[-1]), delay)
        self._knots, self._coefficients = at_samples(whole, self._times)
        trial = own.simulate(experiment.drive, experiment.time, start)
        self._substep = trial.substep_s

    @property
    def time(self) -> FloatArray:
        """(N,) [s], as the experiment has it."""
        return np.asarray(self._times + self._origin)

    @property
    def unit(self) -> str:
        """Of the first column, which is the one an error of the sensor is added to."""
        return words.column(self.columns[0])[1]

    def signals(self, states: FloatArray) -> dict[str, FloatArray]:
        """What the model says at these states (N, n), each (N,): the states, and forces and speeds that follow."""
        at = np.searchsorted(self._knots, self._times - 1e-9)
        plan = self._plan
        rows = np.array([
            start_signals(plan, state, self._origin + time, c[0], c[1])
            for state, time, c in zip(states, self._times, self._coefficients[at], strict=True)
        ])  # fmt: skip
        return {"time": self.time, **{name: rows[:, number] for name, number in SHOWN[self.base].items()}}

    @property
    def equations(self) -> tuple[str, ...]:
        """Where an unknown input may enter."""
        return (*TARGETS[self.base], "sensor")

    def run(self, wander: Wander, *, smooth: bool = False) -> Track:
        """Filters, and smooths where that is asked for.  Safe in threads: the solver's tables are copied."""
        plan: Any = self._plan._replace(p=self._plan.p.copy())
        spacing = float(np.median(np.diff(self._times)))
        keeps = float(np.exp(-spacing / wander.memory_s))
        at = self._at.get(wander.equation, -1)
        result = _filter(
            plan, at, self._knots, self._coefficients, self._substep, self._records, self._times, self._origin,
            self._y, self._variance, np.append(self._scale, (wander.deviation, self._coloured)),
            np.append(self._start, (0.0, 0.0)), keeps, self._alike, wander.floor, smooth,
        )  # fmt: skip
        scores, innovations, means, deviations = result
        settled = self._times >= SETTLED_S
        return Track(float(scores[settled].sum()), innovations, means[:, :-2], means[:, -2], deviations)


def _plan(model: Model, is_driven: bool) -> tuple[Plan, dict[str, int]]:
    """The solver's tables with an injection on every equation, and where each stands among the parameters."""
    base = get_base(model.base)
    targets = TARGETS[model.base]
    effects = in_order([get_effect(name) for name in model.effects])
    values = {name: p.value for name, p in model.parameters.items()}
    for equation, target in targets.items():
        effects.append(_injection(model.base, equation, target))
        values[f"injected_{equation}.u"] = 0.0
    plan = assemble(base, effects, values)
    if is_driven:
        start = plan.start.copy()
        start[DRIVEN] = 1.0
        plan = plan._replace(start=start)
    mine = np.flatnonzero(plan.addresses == injected.address)
    at = {int(plan.targets[i]): int(plan.p_at[i]) for i in mine}
    return plan, {equation: at[target] for equation, target in targets.items()}


def _injection(base: str, equation: str, target: int) -> Effect:
    return Effect(
        id=f"injected_{equation}", equation="+ u", summary="an unknown input", acts_on=ActsOn.JOINT,
        parameters={"u": ANY}, bases=(base,), terms={base: (Term(target, injected, ("u",)),)},
    )  # fmt: skip


def _run_filter(
    plan: Any, at: int, knots: FloatArray, coefficients: FloatArray, substep: float, records: Any, times: FloatArray,
    origin: float, y: FloatArray, variance: FloatArray, scale: FloatArray, start: FloatArray, keeps: float,
    alike: float, floor: float, smooth: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """Scores and innovations (N,), means (N, m), deviation of u (N,).

    m numbers: n states, u, whose place among the parameters is ``at`` (the sensor where that is negative), and e, the
    coloured noise of the first column.  keeps, alike: what u and e keep from one sample to the next.  Works in units of
    ``scale`` (m,); cubature points, 2 m of them.
    """
    m, n, samples = scale.size, scale.size - 2, times.size
    reach = np.sqrt(m)
    mean, cov = start / scale, np.eye(m)
    for i in range(n):
        cov[i, i] = UNSURE**2
    noise = np.full(m, floor**2)
    noise[n], noise[n + 1] = 1.0 - keeps**2, 1.0 - alike**2
    scores, innovations = np.zeros(samples), np.full(samples, np.nan)
    means, covs = np.empty((samples, m)), np.empty((samples, m, m))
    before, spreads, crosses = np.empty((samples, m)), np.empty((samples, m, m)), np.empty((samples, m, m))
    points, moved = np.empty((2 * m, m)), np.empty((2 * m, m))
    out, states = np.empty((records.size, 1)), np.empty((1, n))
    told = np.empty((2 * m, records.size))
    k0 = 0
    for sample in range(samples):
        k1 = k0
        while k1 < knots.size - 1 and knots[k1] < times[sample] - 1e-9:
            k1 += 1
        if sample > 0:
            factor = np.linalg.cholesky(cov)
            for i in range(m):
                points[i] = mean + reach * factor[:, i]
                points[m + i] = mean - reach * factor[:, i]
            for i in range(2 * m):
                if at >= 0:
                    plan.p[at] = points[i, n] * scale[n]
                integrate(plan, knots[k0 : k1 + 1], coefficients[k0 : k1 + 1], substep, points[i, :n] * scale[:n],
                          knots[k1 : k1 + 1], records, out, states, origin)  # fmt: skip
                moved[i, :n] = states[0] / scale[:n]
                moved[i, n], moved[i, n + 1] = keeps * points[i, n], alike * points[i, n + 1]
                for j in range(n):  # deep in the contact's wall a point flies off, and would take all with it
                    if not abs(moved[i, j] - mean[j]) < LEAP:
                        moved[i, j] = mean[j] + (LEAP if moved[i, j] > mean[j] else -LEAP)
            new = np.ones(2 * m) @ moved / (2 * m)
            cross = (points - mean).T @ (moved - new) / (2 * m)
            spread = (moved - new).T @ (moved - new) / (2 * m)
            for i in range(m):
                spread[i, i] += noise[i]
            for i in range(n):
                if spread[i, i] > WIDEST**2:
                    share = WIDEST / np.sqrt(spread[i, i])
                    spread[i] *= share
                    spread[:, i] *= share
                    cross[:, i] *= share
            mean, cov = new, spread
            crosses[sample] = cross
        before[sample], spreads[sample] = mean, cov
        for column in range(records.size):
            if np.isnan(y[sample, column]):
                continue
            factor = np.linalg.cholesky(cov)
            for i in range(m):
                points[i] = mean + reach * factor[:, i]
                points[m + i] = mean - reach * factor[:, i]
            for i in range(2 * m):
                if at >= 0:
                    plan.p[at] = points[i, n] * scale[n]
                integrate(plan, knots[k1 : k1 + 1], coefficients[k1 : k1 + 1], substep, points[i, :n] * scale[:n],
                          knots[k1 : k1 + 1], records, out, states, origin)  # fmt: skip
                told[i, column] = out[column, 0]
                if column == 0:
                    told[i, column] += points[i, n + 1] * scale[n + 1]
                    if at < 0:
                        told[i, column] += points[i, n] * scale[n]
            expected = told[:, column].mean()
            off = told[:, column] - expected
            s = variance[column] + off @ off / (2 * m)
            gain = (points - mean).T @ off / (2 * m)
            error = y[sample, column] - expected
            square = error * error / s
            scores[sample] -= 0.5 * (np.log(s) + min(square, FAR * (2 * np.sqrt(square) - FAR)) if square > FAR * FAR
                                     else np.log(s) + square)  # fmt: skip
            if column == 0:
                innovations[sample] = error / np.sqrt(s)
            if square > FAR * FAR:
                s *= np.sqrt(square) / FAR
            mean = mean + gain * (error / s)
            cov = cov - np.outer(gain, gain) / s
            cov = 0.5 * (cov + cov.T)
        means[sample], covs[sample] = mean, cov
        k0 = k1
    if smooth:
        for sample in range(samples - 2, -1, -1):
            back = np.linalg.solve(spreads[sample + 1], crosses[sample + 1].T).T
            means[sample] += back @ (means[sample + 1] - before[sample + 1])
            covs[sample] += back @ (covs[sample + 1] - spreads[sample + 1]) @ back.T
    deviations = np.full(samples, np.nan)
    for sample in range(samples):
        deviations[sample] = np.sqrt(max(covs[sample, n, n], 0.0)) * scale[n]
        means[sample] *= scale
    return scores, innovations, means, deviations


_filter = compiled(lambda **options: njit(nogil=True, error_model="numpy", **options)(_run_filter))
