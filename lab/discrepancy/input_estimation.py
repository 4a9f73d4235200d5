"""A model that follows its measurement: a cubature Kalman filter and smoother with one unknown input.

The model may be wrong in one equation; an unknown input u enters there as a torque, a force, an angle or an error of
the sensor, and may change by so much in so much time (Ornstein and Uhlenbeck's process).  The likelihood says how well
that explains the measurement; the smoother says what u must have been.  localise.py says which equations are tried.
After Kristensen, Madsen, Jorgensen 2004: "A method for systematic improvement of stochastic grey-box models".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

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
F = TypeVar("F", bound=Callable[..., Any])
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

    log_likelihood: of the innovations after the first 0.1 s; and with smoothing: states (N, n), u (N,) and its standard
    deviation (N,).
    """

    log_likelihood: float
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
        scale = np.append(self._scale, (wander.deviation, self._coloured))
        noise = np.full(scale.size, wander.floor**2)
        noise[-2:] = 1.0 - keeps**2, 1.0 - self._alike**2
        path = _Path(plan, at, self._knots, self._coefficients, self._substep, self._records, self._origin, scale,
                     np.array([keeps, self._alike]), noise)  # fmt: skip
        start = np.append(self._start, (0.0, 0.0))
        scores, means, deviations = _filter(path, self._times, self._y, self._variance, start, smooth)
        settled = self._times >= SETTLED_S
        return Track(float(scores[settled].sum()), means[:, :-2], means[:, -2], deviations)


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


def _part(function: F) -> F:
    """Decorator: a function that the filter calls; inlined by force, it would take twice as long to compile."""
    return cast(F, njit(error_model="numpy")(function))


class _Path(NamedTuple):
    """What the filter runs along: the solver's tables and input from the first sample on (see ``solve.integrate``).

    at: the place of u among the parameters, negative where it acts on the sensor; scale: (m,) what each of m numbers
    counts in, n states, u, and e, the coloured noise of the first column; keeps: (2,) what u and e keep from one sample
    to the next; noise: (m,) variance of what is new of each there.
    """

    plan: Any
    at: int
    knots: FloatArray
    coefficients: FloatArray
    substep: float
    records: Any
    origin: float
    scale: FloatArray
    keeps: FloatArray
    noise: FloatArray


@_part
def _points(mean: FloatArray, cov: FloatArray) -> FloatArray:
    """The cubature points (2 m, m) of a normal distribution."""
    m = mean.size
    factor = np.sqrt(m) * np.linalg.cholesky(cov)
    points = np.empty((2 * m, m))
    for i in range(m):
        points[i] = mean + factor[:, i]
        points[m + i] = mean - factor[:, i]
    return points


@_part
def _run(path: _Path, points: FloatArray, k0: int, k1: int) -> tuple[FloatArray, FloatArray]:
    """The model's states (2 m, n) and outputs (2 m, columns) at one knot, from these points at another one."""
    n = path.scale.size - 2
    ends, told = np.empty((len(points), n)), np.empty((len(points), path.records.size))
    out, states = np.empty((path.records.size, 1)), np.empty((1, n))
    for i in range(len(points)):
        if path.at >= 0:
            path.plan.p[path.at] = points[i, n] * path.scale[n]
        integrate(path.plan, path.knots[k0 : k1 + 1], path.coefficients[k0 : k1 + 1], path.substep,
                  points[i, :n] * path.scale[:n], path.knots[k1 : k1 + 1], path.records, out, states,
                  path.origin)  # fmt: skip
        ends[i], told[i] = states[0] / path.scale[:n], out[:, 0]
    return ends, told


@_part
def _predicted(
    path: _Path, mean: FloatArray, cov: FloatArray, k0: int, k1: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean (m,) and covariance (m, m) one sample later, and the covariance of then and now."""
    m, n = mean.size, mean.size - 2
    points, moved = _points(mean, cov), np.empty((2 * mean.size, mean.size))
    moved[:, :n] = _run(path, points, k0, k1)[0]
    moved[:, n], moved[:, n + 1] = path.keeps[0] * points[:, n], path.keeps[1] * points[:, n + 1]
    for i in range(2 * m):
        for j in range(n):  # deep in the contact's wall a point flies off, and would take all with it
            if not abs(moved[i, j] - mean[j]) < LEAP:
                moved[i, j] = mean[j] + (LEAP if moved[i, j] > mean[j] else -LEAP)
    new = np.ones(2 * m) @ moved / (2 * m)
    cross = (points - mean).T @ (moved - new) / (2 * m)
    spread = (moved - new).T @ (moved - new) / (2 * m)
    for i in range(m):
        spread[i, i] += path.noise[i]
    for i in range(n):
        if spread[i, i] > WIDEST**2:
            share = WIDEST / np.sqrt(spread[i, i])
            spread[i] *= share
            spread[:, i] *= share
            cross[:, i] *= share
    return new, spread, cross


@_part
def _corrected(
    path: _Path, mean: FloatArray, cov: FloatArray, k: int, column: int, value: float, variance: float
) -> tuple[FloatArray, FloatArray, float]:
    """Mean and covariance given a value of a column at this knot, and its log-likelihood."""
    m, n = mean.size, mean.size - 2
    points = _points(mean, cov)
    told = _run(path, points, k, k)[1][:, column].copy()
    if column == 0:
        told += points[:, n + 1] * path.scale[n + 1]
        if path.at < 0:
            told += points[:, n] * path.scale[n]
    expected = told.mean()
    off = told - expected
    s = variance + off @ off / (2 * m)
    gain = (points - mean).T @ off / (2 * m)
    error = value - expected
    square = error * error / s
    score = -0.5 * (np.log(s) + square)
    if square > FAR * FAR:  # Huber's cost, and his weight
        score = -0.5 * (np.log(s) + FAR * (2 * np.sqrt(square) - FAR))
        s *= np.sqrt(square) / FAR
    cov = cov - np.outer(gain, gain) / s
    return mean + gain * (error / s), 0.5 * (cov + cov.T), score


def _run_filter(
    path: _Path, times: FloatArray, y: FloatArray, variance: FloatArray, start: FloatArray, smooth: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-likelihoods (N,), means (N, m), deviations of u (N,); y: (N, columns), NaN where not sampled; variance:
    (columns,) of their white noise; start: (m,).  Works in units of ``path.scale``.
    """
    m, n, samples = path.scale.size, path.scale.size - 2, times.size
    mean, cov = start / path.scale, np.eye(m)
    for i in range(n):
        cov[i, i] = UNSURE**2
    scores, means, covs = np.zeros(samples), np.empty((samples, m)), np.empty((samples, m, m))
    before, spreads, crosses = np.empty((samples, m)), np.empty((samples, m, m)), np.empty((samples, m, m))
    k0 = 0
    for sample in range(samples):
        k1 = k0
        while k1 < path.knots.size - 1 and path.knots[k1] < times[sample] - 1e-9:
            k1 += 1
        if sample > 0:
            mean, cov, crosses[sample] = _predicted(path, mean, cov, k0, k1)
        before[sample], spreads[sample] = mean, cov
        for column in range(path.records.size):
            if not np.isnan(y[sample, column]):
                mean, cov, score = _corrected(path, mean, cov, k1, column, y[sample, column], variance[column])
                scores[sample] += score
        means[sample], covs[sample] = mean, cov
        k0 = k1
    for sample in range(samples - 2, -1 if smooth else samples, -1):  # Rauch, Tung and Striebel's smoother
        back = np.linalg.solve(spreads[sample + 1], crosses[sample + 1].T).T
        means[sample] += back @ (means[sample + 1] - before[sample + 1])
        covs[sample] += back @ (covs[sample + 1] - spreads[sample + 1]) @ back.T
    return scores, means * path.scale, np.sqrt(np.maximum(covs[:, n, n], 0.0)) * path.scale[n]


_filter = compiled(lambda **options: njit(nogil=True, error_model="numpy", **options)(_run_filter))
