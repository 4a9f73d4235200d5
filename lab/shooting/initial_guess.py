"""Where the search for an effect begins: values of its parameters that would matter in this motion.  No fitting here.

An effect's size is guessed from the motion (a friction from the torques, a stiffness from the deflections); what makes
valleys (a phase, a number of teeth, a frequency, a time) is laid out as a grid.  An effect that is not listed here, a
user's own, begins at its defaults, smaller, larger, and with the other sign.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import usual_torque
from lostmotion.lab.shooting.segment import Segment, motions
from lostmotion.model import Domain, Model, Parameter
from lostmotion.model.motion import FloatArray

__all__ = ["AMPLITUDE", "Sizes", "faint", "initial_guesses", "sizes"]

Values = dict[str, float]


@dataclass(frozen=True)
class Sizes:
    """Usual (root mean square) and largest magnitudes in the motion, SI units; zero where a base has none.

    torque on the joint, its speed, the span of its angle; the bar's deflection and speed; the largest reading and
    speed; stiffness and damping of the bar; play; length of a record [s]; inertia.
    """

    torque: float
    speed: float
    span: float
    bend: float
    swing: float
    reading: float
    peak: float
    k: float
    b: float
    d: float
    inertia: float
    length: float


def sizes(model: Model, segments: Sequence[Segment], substep_s: float) -> Sizes:
    """From the modelled motion of some segments.  Raises ModelError where none can be run."""
    runs = motions(model, segments, substep_s)
    value = {name: parameter.value for name, parameter in model.parameters.items()}
    inertia = value.get("J2", value.get("J", 1.0))

    def all_of(signal: str) -> FloatArray:
        found = [run[signal] for run in runs if signal in run.signals]
        return np.concatenate(found) if found else np.zeros(1)

    def rms(signal: str) -> float:
        return float(np.sqrt(np.mean(all_of(signal) ** 2)))

    state = np.concatenate([run.states for run in runs])
    bar = {"play": (2, 3), "oscillator": (0, 1)}.get(model.base)
    bend, swing = (float(np.sqrt(np.mean(state[:, i] ** 2))) for i in bar) if bar else (0.0, 0.0)
    measured = np.concatenate([v[~np.isnan(v)] for s in segments for v in s.experiment.measured.values()])
    experiments: list[Experiment] = [s.experiment for s in segments]
    moving = inertia * rms("acceleration")
    driving = [usual_torque(model, e) for e in experiments] if model.base in ("joint", "servo") else []
    return Sizes(
        torque=max([moving, *driving]),
        speed=rms("velocity"),
        span=float(np.ptp(all_of("position"))),
        bend=bend,
        swing=swing,
        reading=rms("accel"),
        peak=float(np.max(np.abs(measured))),
        k=value.get("k", 0.0),
        b=value.get("b", 0.0),
        d=value.get("d", 0.0),
        inertia=inertia,
        length=max(float(e.time[-1]) for e in experiments),
    )


def initial_guesses(model: Model, effect: str, size: Sizes) -> list[Values]:
    """Values to begin from, by the names of the model's parameters; the model has the effect already."""
    own = {name: p for name, p in model.parameters.items() if name.startswith(effect + ".")}
    found = _TABLE[effect](size, own) if effect in _TABLE else _defaults(own)
    return [_within(model, {_full(effect, name, model): value for name, value in each.items()}) for each in found]


def faint(model: Model, effect: str, size: Sizes) -> list[Model]:
    """Models with hardly any of an effect, one for each shape that it may have.

    An effect without an amplitude (a spring, a filter, a limit) is made so stiff, fast or wide that it hardly acts.
    """
    own = model.with_effect(effect)
    if effect in _HARDLY:
        named = [{f"{effect}.{name}": value for name, value in each.items()} for each in _HARDLY[effect](size)]
        return [own.replace(_within(own, values)) for values in named]
    amplitudes = [f"{effect}.{name}" for name in AMPLITUDE.get(effect, ()) if f"{effect}.{name}" in own.parameters]
    if not amplitudes:
        return [own.replace(values) for values in initial_guesses(own, effect, size)]
    shapes: dict[tuple[tuple[str, float], ...], Values] = {}
    for values in initial_guesses(own, effect, size):
        shape = {name: value for name, value in values.items() if name.startswith(effect) and name not in amplitudes}
        shapes.setdefault(tuple(sorted(shape.items())), {n: v for n, v in values.items() if n.startswith(effect)})
    return [own.replace({**v, **{name: FAINT * v[name] for name in amplitudes}}) for v in shapes.values()]


def _full(effect: str, name: str, model: Model) -> str:
    return f"{effect}.{name}" if f"{effect}.{name}" in model.parameters else name


def _within(model: Model, values: Values) -> Values:
    """Values within the bounds, those of fixed parameters left out unless they are whole numbers."""
    kept = {}
    for name, value in values.items():
        p = model.parameters[name]
        if not p.fixed or p.domain is Domain.WHOLE:
            kept[name] = min(max(value, p.low), p.high)
    return kept


def _grid(**values: Sequence[float]) -> list[Values]:
    return [dict(zip(values, each, strict=True)) for each in itertools.product(*values.values())]


FAINT = 0.01
AMPLITUDE = {
    "viscous_friction": ("b_v",),
    "coulomb_friction": ("tau_c",),
    "stribeck_friction": ("tau_c", "tau_s"),
    "load_dependent_friction": ("mu",),
    "gravity_torque": ("tau_g",),
    "gear_eccentricity": ("e",),
    "torque_ripple": ("tau_r",),
    "actuator_lag": ("T",),
    "command_delay": ("T",),
    "sensor_lag": ("T",),
    "hardening_spring": ("k3",),
    "quadratic_damping": ("b2",),
    "second_mode": ("participation",),
    "gravity_leakage": ("c",),
    "centripetal_crosstalk": ("c",),
    "clock_skew": ("s",),
    "bias_drift": ("c",),
}
"""Parameters that make an effect vanish when they are zero."""
PHASES = (0.0, math.pi / 2, math.pi, -math.pi / 2)


def _defaults(own: Mapping[str, Parameter]) -> list[Values]:
    free = {name.split(".", 1)[1]: p for name, p in own.items() if not (p.fixed or p.domain.is_whole)}
    factors = (1.0, 0.25, 4.0) + ((-1.0,) if any(p.low < 0 < p.value for p in free.values()) else ())
    return [{name: p.value * f for name, p in free.items()} for f in factors]


def _friction(name: str, *shares: float) -> Callable[[Sizes, Mapping[str, Parameter]], list[Values]]:
    return lambda size, _: _grid(**{name: [size.torque * share for share in shares]})


_SMALL = (0.015, 0.05, 0.15)
_TABLE: dict[str, Callable[[Sizes, Mapping[str, Parameter]], list[Values]]] = {
    "viscous_friction": lambda size, _: _grid(b_v=[size.torque / size.speed * share for share in _SMALL]),
    "coulomb_friction": _friction("tau_c", *_SMALL),
    "stribeck_friction": lambda size, _: [
        {"tau_c": size.torque * share, "tau_s": size.torque * share * 2.5, "omega_s": size.speed * speed}
        for share, speed in ((0.02, 0.3), (0.06, 0.3), (0.15, 0.3), (0.06, 0.8))
    ],
    "load_dependent_friction": lambda size, _: _grid(mu=(0.01, 0.05, 0.15)),
    "gravity_torque": lambda size, _: _grid(tau_g=[size.torque * share for share in (0.02, 0.1)], phi=PHASES),
    "gear_eccentricity": lambda size, _: _grid(e=[0.1 * size.d, 0.03 * size.d], N=_turns(size), phi=PHASES[:2]),
    "shaft_compliance": lambda size, _: [
        {"share": share, "k_s": k, "c_s": 0.02 * math.sqrt(k * size.inertia / 2)}
        for share, frequencies in ((0.5, (35.0, 60.0, 100.0, 160.0)), (0.8, (160.0, 260.0, 420.0)))
        for f in frequencies
        for k in [size.inertia * share * (1 - share) * (2 * math.pi * f) ** 2]
    ],
    "finite_actuator": lambda size, _: _grid(
        f1=(10.0, 18.0, 28.0, 40.0, 60.0), zeta1=(0.7,), J1=(2 * size.inertia, 6 * size.inertia)
    ),
    "actuator_lag": lambda size, _: _grid(T=(1.5e-3, 4e-3, 8e-3)),
    "command_delay": lambda size, _: _grid(T=(1.5e-3, 4e-3, 8e-3)),
    "contact_asymmetry": lambda size, _: _grid(ratio=(0.4, 2.5, 6.0)),
    "torque_ripple": lambda size, _: _grid(tau_r=[0.05 * size.torque], N=_turns(size), phi=PHASES[:2]),
    "hardening_spring": lambda size, _: [
        {"k3": share * size.k / (3 * size.bend**2), "k": size.k * (1 - part)}
        for share, part in ((0.05, 0.04), (0.15, 0.12), (0.3, 0.22), (-0.05, -0.04), (-0.15, -0.12))
    ],
    "quadratic_damping": lambda size, _: (
        [{"b2": share * size.b / size.swing, "b": size.b * (1 - 0.6 * share)} for share in (0.3, 0.9)]
        if size.swing
        else _grid(b2=[size.torque / size.speed**2 * share for share in _SMALL])
    ),
    "second_mode": lambda size, _: _grid(
        f2=(100.0, 130.0, 160.0, 190.0, 220.0, 260.0, 310.0), zeta2=(0.02,), participation=(0.1,)
    ),
    "gravity_leakage": lambda size, _: _grid(c=(0.02, 0.1), phi=PHASES),
    "centripetal_crosstalk": lambda size, _: _grid(c=(0.3,)),
    "sensor_lag": lambda size, _: _grid(T=(2e-4, 1e-3, 3e-3)),
    "sensor_saturation": lambda size, _: _grid(a_max=(0.999 * size.peak,)),
    "clock_skew": lambda size, _: _grid(s=(-1e-3, 1e-3)),
    "bias_drift": lambda size, _: _grid(c=(size.reading / size.length * 0.01,)),
}


def _turns(size: Sizes) -> list[float]:
    """Numbers of teeth that differ over this span of angle by less than a third of a turn of the phase."""
    step = min(max(2.0 / max(size.span, 1e-3), 1.0), 12.0)
    return [float(n) for n in np.unique(np.round(np.arange(1.0, 60.5, step)))]


_HARDLY: dict[str, Callable[[Sizes], list[Values]]] = {
    # A lag faster than the solver's step would not run; a millisecond acts nearly linearly.
    "actuator_lag": lambda size: [{"T": 1e-3}],
    "sensor_lag": lambda size: [{"T": 1e-3}],
    "shaft_compliance": lambda size: [
        {"share": share, "k_s": k, "c_s": 0.05 * math.sqrt(k * size.inertia)}
        for share in (0.3, 0.7)
        for k in [size.inertia * share * (1 - share) * (2 * math.pi * 200.0) ** 2]
    ],
    "finite_actuator": lambda size: [{"f1": 40.0, "zeta1": 0.7, "J1": 5 * size.inertia}],
    "contact_asymmetry": lambda size: [{"ratio": 1.02}],
    "sensor_saturation": lambda size: [{"a_max": 0.98 * size.peak}],
}
