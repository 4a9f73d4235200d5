"""The model as its users see it: built from names and values, changed by copies, simulated.  No equations here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.model import substep
from lostmotion.model.assemble import assemble, in_order, scope
from lostmotion.model.base import Base
from lostmotion.model.bases import get_base
from lostmotion.model.effects.base import Effect
from lostmotion.model.effects.registry import get_effect, own, register
from lostmotion.model.errors import ModelError
from lostmotion.model.motion import FloatArray, Motion
from lostmotion.model.observer import ObserverRun, observer_input
from lostmotion.model.parameter import Parameter
from lostmotion.model.pieces import Pieces, cut
from lostmotion.model.rk4 import Plan
from lostmotion.model.run import Run, from_first, records
from lostmotion.model.signals import READING
from lostmotion.model.solve import solve, start_signals
from lostmotion.model.trajectory import Trajectory

__all__ = ["Model", "build_model"]


def build_model(base: str, effects: Sequence[str] = (), values: Mapping[str, float | Parameter] | None = None) -> Model:
    """A model from the names of its base and effects; what values do not state takes its documented default.

    values: by name, those of an effect as "coulomb_friction.tau_c", in SI units.  Raises ModelError for an unknown
    base, effect or parameter, naming those that exist, and for a value that physics does not allow.
    """
    found = get_base(base)
    twice = {name for name in effects if list(effects).count(name) > 1}
    if twice:
        raise ModelError(f"an effect can act only once, but {', '.join(sorted(twice))} is listed twice")
    parameters = dict(found.parameters)
    for effect in map(get_effect, effects):
        parameters |= {f"{effect.id}.{name}": given for name, given in effect.parameters_on(base).items()}
    model = Model(base, tuple(effects), MappingProxyType(parameters))
    return model.replace(values) if values else model


@dataclass(frozen=True)
class Model:
    """A base, effects on it and their parameters.  Immutable; ``replace`` and ``with_effect`` give changed copies."""

    base: str
    effects: tuple[str, ...]
    parameters: Mapping[str, Parameter] = field(hash=False)

    def __repr__(self) -> str:
        """Base, effects, and the values of the parameters with their units."""
        values = ", ".join(f"{name} = {one.value:.6g} {one.unit}".rstrip() for name, one in self.parameters.items())
        return f"<Model: base {self.base}, effects: {', '.join(self.effects) or 'none'}; {values}>"

    def replace(self, values: Mapping[str, float | Parameter]) -> Model:
        """A copy with these values.  Raises ModelError as build_model does."""
        parameters = dict(self.parameters)
        for name, given in values.items():
            if name not in parameters:
                raise ModelError(f"no parameter is called {name!r}; this model has {', '.join(parameters)}")
            try:
                parameters[name] = parameters[name].updated(given)
            except ModelError as error:
                raise ModelError(f"parameter {name}: {error}") from error
        return Model(self.base, self.effects, MappingProxyType(parameters))

    def __reduce__(self) -> tuple[Any, ...]:
        """To another process goes what it is made of; addresses of compiled code mean nothing there."""
        return _remade, (self.base, self.effects, dict(self.parameters), own(self.effects))

    def with_effect(self, name: str) -> Model:
        """A copy with one more effect, at its defaults.  Raises ModelError if it is there, unknown or elsewhere."""
        return build_model(self.base, (*self.effects, name), self.parameters)

    def own(self, effect: str) -> dict[str, Parameter]:
        """The parameters of one of its effects, by their names within it."""
        prefix = f"{effect}."
        return {name.removeprefix(prefix): p for name, p in self.parameters.items() if name.startswith(prefix)}

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in the order of ``Trajectory.state``: "theta_2", "q'", "actuator_lag.0"."""
        own = (f"{effect.id}.{i}" for effect in self._in_order for i in range(len(effect.states)))
        return (*(state.name for state in self._base.states), *own)

    @cached_property
    def _base(self) -> Base:
        return get_base(self.base)

    @cached_property
    def _in_order(self) -> list[Effect]:
        return in_order([get_effect(name) for name in self.effects])

    @cached_property
    def _values(self) -> dict[str, float]:
        return {name: parameter.value for name, parameter in self.parameters.items()}

    def plan(self, is_driven: bool) -> Plan:
        """The solver's tables, without or with an input."""
        return self._plans[is_driven]

    @cached_property
    def _plans(self) -> tuple[Plan, Plan]:
        return assemble(self._base, self._in_order, self._values)

    def initial_state(self, drive: Motion | None = None, time: float = 0.0, **given: float) -> FloatArray:
        """The state (n,) that moves along with the drive at that time: bar bent by it, lags settled, gap centred.

        given: other values for some states by name, for instance ``initial_state(None, q=1e-3)``; the effects' own
        states begin where these put the signals.  Raises ModelError for a name that no state has.
        """
        unknown = set(given) - set(self.state_names)
        if unknown:
            raise ModelError(
                f"no state is called {', '.join(sorted(unknown))}; there are {', '.join(self.state_names)}"
            )
        pieces = cut(drive, float(time), 1e-3, self._delay)
        return self._start(self.plan(drive is not None), pieces, float(time), given)

    def simulate(
        self,
        drive: Motion | None,
        times: ArrayLike,
        state: ArrayLike | None = None,
        *,
        substep_s: float | None = None,
        shortest_s: float = 0.0,
    ) -> Trajectory:
        """The motion at the output times.

        drive: the input (play, servo: command [rad]; joint: torque [N m]; oscillator: force [N]), or None for a
        ring-down or free swing.  times: (N,) ascending [s], evenly spaced or not; the simulation starts at times[0]
        with state (n,), or moving along with the drive.  To go on from a trajectory, start at its last time with its
        ``state``.  substep_s: longest integration step [s]; chosen from the model's stiffness when left out, from the
        force that the motion really reaches, but no shorter than ``shortest_s``.  Give it where derivatives by finite
        differences are wanted of a motion whose errors add up.  Where dry friction changes its sign any step is halved
        as often as the friction needs.

        A joint *without* play is one with a very small d; 1 µm takes about five times as long as the default 80 µm.
        Raises ModelError for times, drives and states that cannot be used, and when the motion exceeds all numbers.
        """
        times = _checked_times(times)
        sensor_clock = self._clock_rate
        local = times - times[0]
        grid = local if sensor_clock == 1 else np.union1d(local, local / sensor_clock)
        pieces = cut(drive, float(times[0]), max(float(grid[-1]), 1e-3), self._delay)
        plan = self.plan(drive is not None)
        x0 = self._start(plan, pieces, float(times[0])) if state is None else self._checked_state(state)
        out, states, used = self._solve(plan, pieces, x0, grid, float(times[0]), substep_s, shortest_s)
        signals = dict(zip(self._base.outputs, out, strict=True))
        if sensor_clock != 1:
            here, felt = np.searchsorted(grid, local), np.searchsorted(grid, local / sensor_clock)
            outputs = self._base.outputs
            signals = {name: row[felt if outputs[name] == READING else here] for name, row in signals.items()}
            states = states[here]
        if drive is not None and self._delay:
            signals["command"] = np.asarray(drive.position(times), dtype=float)  # as sent
        return Trajectory(times, MappingProxyType(signals), states, states[-1].copy(), used)

    def prepare(self, drive: Motion | None, times: FloatArray, outputs: Sequence[str], clock_zero: float) -> Run:
        """What ``simulate`` would integrate, ready to be run from many start states; times and states unchecked.

        outputs: names of signals.  clock_zero: when sensor and host showed the same time [s]; a start state then
        belongs to the first time that either of them needs.  Raises ModelError for a motion that is not finite.
        """
        signals = tuple(self._base.outputs[name] for name in outputs)
        rate = self._clock_rate
        felt = times if rate == 1 else clock_zero + (times - clock_zero) / rate
        asked = [felt if signal == READING else times for signal in signals]
        every = asked[0] if all(one is asked[0] for one in asked) else np.union1d(times, felt)
        picks = None if every is asked[0] else np.array([np.searchsorted(every, one) for one in asked])
        origin, grid = from_first(every.tobytes())
        pieces = cut(drive, origin, max(float(grid[-1]), 1e-3), self._delay)
        return Run(self.plan(drive is not None), pieces, grid, origin, records(signals), (self._delay, rate), picks)

    def observer(self, drive: Motion | None, times: FloatArray, output: str, clock_zero: float) -> ObserverRun:
        """Ready to be run along a measurement of one output at these times, corrected by it; clock_zero as above."""
        signal, rate = self._base.outputs[output], self._clock_rate
        felt = times if rate == 1 or signal != READING else clock_zero + (times - clock_zero) / rate
        origin = float(felt[0])
        knots, coefficients, at = observer_input(drive, origin, felt - origin, self._delay)
        return ObserverRun(self.plan(drive is not None), knots, coefficients, at, origin, signal)

    @cached_property
    def _clock_rate(self) -> float:
        return math.prod(
            effect.clock_rate(scope(self._values, effect)) for effect in self._in_order if effect.clock_rate
        )

    @cached_property
    def _delay(self) -> float:
        return sum(effect.delay(scope(self._values, effect)) for effect in self._in_order if effect.delay)

    def _start(
        self, plan: Plan, pieces: Pieces, time: float, given: Mapping[str, float] = MappingProxyType({})
    ) -> FloatArray:
        """The base's states at rest against the drive; then each effect's own begin where the signals stand."""
        value, rate, half = map(float, pieces.coefficients[0, :3])
        base = self._base.start(scope(self._values), value, rate, 2 * half)
        wanted = [signal for effect in self._in_order for signal in effect.states]
        names = self.state_names
        state = np.array([given.get(name, x) for name, x in zip(names, (*base, *(0.0 for _ in wanted)), strict=True)])
        for _ in wanted:  # one state may begin at a signal that another one stands behind
            signals = start_signals(plan, state, time, value, rate)
            own = [0.0 if signal is None else signals[signal] for signal in wanted]
            state[len(base) :] = [given.get(name, x) for name, x in zip(names[len(base) :], own, strict=True)]
        return state

    def _checked_state(self, state: ArrayLike) -> FloatArray:
        x0 = np.array(state, dtype=np.float64)
        if x0.shape != (len(self.state_names),) or not np.all(np.isfinite(x0)):
            raise ModelError(
                f"a state needs {len(self.state_names)} finite numbers ({', '.join(self.state_names)}); found {x0}"
            )
        return x0

    def _solve(
        self, plan: Plan, pieces: Pieces, x0: FloatArray, grid: FloatArray, origin: float, substep_s: float | None,
        shortest_s: float,
    ) -> tuple[FloatArray, FloatArray, float]:  # fmt: skip
        """Outputs (outputs, N), states (N, n), sub-step; again where the motion is harder than guessed."""
        if substep_s is not None and not (math.isfinite(substep_s) and substep_s > 0):
            raise ModelError(f"a sub-step of {substep_s} s is not possible")
        records = np.array(list(self._base.outputs.values()), dtype=np.int64)
        chosen = self._steps(pieces, grid, shortest_s)
        step = substep_s or chosen(None)
        for _ in range(4):
            self._kernel_errors()  # of runs before
            (out,), (states,), peak = solve(
                [plan], [pieces], step, x0[None], grid, records, [origin], keeps_states=True
            )
            for error in self._kernel_errors():
                raise error
            finite = math.isfinite(peak) and bool(np.all(np.isfinite(states[-1])))
            if substep_s is not None:
                break
            needed = chosen(peak) if finite else max(step / 8, shortest_s)
            if needed >= step:
                break
            step = needed
        if not finite:
            raise ModelError(
                f"the motion exceeds all numbers with a sub-step of {step:.3g} s; "
                "the start state or a parameter is far outside of what the motion allows, or the sub-step is too long"
            )
        return out, states, step

    def _steps(self, pieces: Pieces, grid: FloatArray, shortest_s: float) -> Callable[[float | None], float]:
        """The choice of a sub-step [s] for the largest magnitude of the watched signal, None before a first run."""
        length = float(pieces.knots[-1])

        @cache
        def interval() -> float:
            return float(np.median(np.diff(grid))) if grid.size > 1 else 0.0

        def chosen(watched: float | None) -> float:
            before = substep.operating(self._base, self._values, pieces)
            return max(
                substep.pick(self._base, self._in_order, self._values, before, watched, length, interval()), shortest_s
            )

        return chosen

    def _kernel_errors(self) -> list[ModelError]:
        """What functions in plain Python raised in this thread since the last time; a Ctrl-C is raised again."""
        found = []
        for effect in own(self.effects):
            for term in effect.terms.get(self.base, ()):
                error = term.kernel.take_error()
                if isinstance(error, KeyboardInterrupt):
                    raise error
                if error is not None:
                    found.append(ModelError(f"effect {effect.id}: its function raised {error!r}"))
        return found


def _remade(
    base: str, effects: tuple[str, ...], parameters: Mapping[str, Parameter], own_effects: tuple[Effect, ...]
) -> Model:
    """The model, in a process where effects that are not lostmotion's may not be registered yet: registers them."""
    for effect in own_effects:
        register(effect)
    return Model(base, effects, MappingProxyType(dict(parameters)))


def _checked_times(times: ArrayLike) -> FloatArray:
    """Output times as an array of their own.  Raises ModelError unless they are finite, ascending, at least one."""
    array = np.array(times, dtype=np.float64)
    ascends = array.ndim == 1 and array.size > 0 and bool((array[1:] > array[:-1]).all())  # false beside a NaN
    if not (ascends and math.isfinite(array[0]) and math.isfinite(array[-1])):
        raise ModelError("output times must be at least one, finite and strictly ascending")
    return array
