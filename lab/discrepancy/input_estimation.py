"""Estimation of one unknown input of a model by a cubature Kalman filter and smoother.

The model may be wrong in one equation; there an unknown input u enters as a torque, a force, an angle or an error of
the sensor, modelled as an Ornstein-Uhlenbeck process.  The likelihood shows how well it explains the measurement; the
smoother estimates u.  localise.py chooses the equations.  After Kristensen, Madsen, Jorgensen 2004: "A method for
systematic improvement of stochastic grey-box models".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.discrepancy.cubature import Path, run_filter
from lostmotion.model import Model
from lostmotion.model.assemble import assemble, in_order, scope
from lostmotion.model.base import Term
from lostmotion.model.bases import get_base
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.kernel import Slots, kernel
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
from lostmotion.model.solve import Plan, start_signals

__all__ = ["TARGETS", "InputProcess", "Track", "Tracker"]

TARGETS = {
    "play": {"joint": TORQUE, "oscillator": BAR_FORCE, "command": THETA1},
    "oscillator": {"oscillator": BAR_FORCE},
    "joint": {"joint": TORQUE},
    "servo": {"joint": TORQUE, "command": THETA1},
}
"""The signal on which an unknown input of each equation acts; the sensor's is added to its reading."""
SHOWN = {
    "play": {"theta_2": THETA2, "omega_2": OMEGA2, "acceleration": ALPHA2, "load": FORCE, "q": Q, "q'": Q_RATE,
             "command": COMMAND, "command_rate": COMMAND_RATE},
    "oscillator": {"q": Q, "q'": Q_RATE, "accel": QDD, "force": FORCE},
    "joint": {"theta_2": THETA2, "omega_2": OMEGA2, "torque": FORCE},
    "servo": {"theta_2": THETA2, "omega_2": OMEGA2, "torque": FORCE, "command": COMMAND, "command_rate": COMMAND_RATE},
}  # fmt: skip
"""Signals that the input may depend on."""
ANY = Parameter(0.0, "", source="filled in by the filter")
WHITE_SHARE = 0.02
"""Share of the variance of coloured noise that is modelled as white: counts, rounding."""
SETTLED_S = 0.1


@kernel
def injected(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """p: u."""
    return p[0]


@dataclass(frozen=True)
class InputProcess:
    """The Ornstein-Uhlenbeck process of an unknown input: equation, standard deviation (its unit), correlation time
    [s].

    floor: process noise of every state from one sample to the next, as a share of its scale.  With too little the
    filter cannot recover from a missed impact, with too much it does not filter.
    """

    equation: str
    deviation: float
    memory_s: float
    floor: float


@dataclass(frozen=True, eq=False)
class Track:
    """The result of the filter.

    log_likelihood: of the innovations after the first 0.1 s; and with smoothing: states (N, n), u (N,) and its standard
    deviation (N,).
    """

    log_likelihood: float
    states: FloatArray
    u: FloatArray
    deviation: FloatArray


class Tracker:
    """An experiment prepared for filtering with different unknown inputs.

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
        """Unit of the first column, to which an error of the sensor is added."""
        return words.column(self.columns[0])[1]

    def signals(self, states: FloatArray) -> dict[str, FloatArray]:
        """Signals of the model at these states (N, n), each (N,): the states, and forces and speeds that follow."""
        at = np.searchsorted(self._knots, self._times - 1e-9)
        plan = self._plan
        rows = np.array([
            start_signals(plan, state, self._origin + time, c[0], c[1])
            for state, time, c in zip(states, self._times, self._coefficients[at], strict=True)
        ])  # fmt: skip
        return {"time": self.time, **{name: rows[:, number] for name, number in SHOWN[self.base].items()}}

    @property
    def equations(self) -> tuple[str, ...]:
        """The equations that an unknown input may enter."""
        return (*TARGETS[self.base], "sensor")

    def run(self, process: InputProcess, *, smooth: bool = False) -> Track:
        """Runs the filter, and optionally the smoother.  Safe in threads: the solver's tables are copied."""
        plan: Any = self._plan._replace(p=self._plan.p.copy())
        spacing = float(np.median(np.diff(self._times)))
        keeps = float(np.exp(-spacing / process.memory_s))
        at = self._at.get(process.equation, -1)
        scale = np.append(self._scale, (process.deviation, self._coloured))
        noise = np.full(scale.size, process.floor**2)
        noise[-2:] = 1.0 - keeps**2, 1.0 - self._alike**2
        path = Path(plan, at, self._knots, self._coefficients, self._substep, self._records, self._origin, scale,
                     np.array([keeps, self._alike]), noise)  # fmt: skip
        start = np.append(self._start, (0.0, 0.0))
        scores, means, deviations = run_filter(path, self._times, self._y, self._variance, start, smooth)
        settled = self._times >= SETTLED_S
        return Track(float(scores[settled].sum()), means[:, :-2], means[:, -2], deviations)


def _plan(model: Model, is_driven: bool) -> tuple[Plan, dict[str, int]]:
    """The solver's tables with an injection on every equation, and the index of each among the parameters."""
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
