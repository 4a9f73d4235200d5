"""Initial guesses for the parameters of an effect, from the scales of a motion.  No fitting here.

An effect owns its guesses (model/effects); this module computes the scales from which they follow, keeps them within
the bounds, and makes models of negligible amplitude for the score test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import usual_torque
from lostmotion.lab.data.series import rms
from lostmotion.lab.shooting.segment import Segment, motions
from lostmotion.model import Domain, Model, Parameter, build_model
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.guesses import MotionScales, Values
from lostmotion.model.motion import FloatArray

__all__ = ["faint", "initial_guesses", "natural_frequency", "restarts", "scales_of"]

FAINT = 0.01
"""Share of the guessed amplitude at which an effect counts as negligible."""


def scales_of(model: Model, segments: Sequence[Segment], substep_s: float) -> MotionScales:
    """The scales of the modelled motion over some segments.  Raises ModelError where none of them can be simulated."""
    runs = motions(model, segments, substep_s)
    value = {name: parameter.value for name, parameter in model.parameters.items()}
    inertia = value.get("J2", value.get("J", 1.0))

    def all_of(signal: str) -> FloatArray:
        found = [run[signal] for run in runs if signal in run.signals]
        return np.concatenate(found) if found else np.zeros(1)

    state = np.concatenate([run.states for run in runs])
    bar = {"play": (2, 3), "oscillator": (0, 1)}.get(model.base)
    bend, swing = (rms(state[:, i]) for i in bar) if bar else (0.0, 0.0)
    measured = np.concatenate([v[~np.isnan(v)] for s in segments for v in s.experiment.measured.values()])
    experiments: list[Experiment] = [s.experiment for s in segments]
    moving = inertia * rms(all_of("acceleration"))
    driving = [usual_torque(model, e) for e in experiments] if model.base in ("joint", "servo") else []
    return MotionScales(
        torque=max([moving, *driving]),
        speed=rms(all_of("velocity")),
        span=float(np.ptp(all_of("position"))),
        bend=bend,
        swing=swing,
        reading=rms(all_of("accel")),
        peak=float(np.max(np.abs(measured))),
        k=value.get("k", 0.0),
        b=value.get("b", 0.0),
        d=value.get("d", 0.0),
        inertia=inertia,
        length=max(float(e.time[-1]) for e in experiments),
        resonance=natural_frequency(model),
    )


def natural_frequency(model: Model) -> float:
    """The natural frequency of the bar, sqrt(k/m)/(2 pi) [Hz]; zero without a bar."""
    k, m = (model.parameters[name].value if name in model.parameters else 0.0 for name in ("k", "m"))
    return math.sqrt(k / m) / (2 * math.pi) if m > 0 else 0.0


def initial_guesses(model: Model, effect: str, size: MotionScales) -> list[Values]:
    """Initial values of an effect that the model already has, by the full names of the parameters.

    An effect without guesses of its own, such as a user-defined one, begins at its defaults, at a quarter and four
    times of these, and with the opposite sign.  Guesses that the bounds make equal are given once.
    """
    found = get_effect(effect).guesses(size) or _around_defaults(model.own(effect))
    return list({tuple(values.items()): values for values in _named(found, effect, model)}.values())


def restarts(model: Model, effect: str) -> list[Values]:
    """Values of an effect of a fitted model, by the full names of the parameters, from which a fit is begun again; see
    ``Effect.restarts``."""
    values = {name.removeprefix(f"{effect}."): p.value for name, p in model.parameters.items()}
    return _named(get_effect(effect).restarts(values), effect, model)


def faint(model: Model, effect: str, size: MotionScales) -> list[Model]:
    """Models with an effect of negligible amplitude, one for each shape that it may have (such as a number of teeth).

    An effect without an amplitude (a spring, a filter, a limit) is made so stiff, fast or wide that it hardly acts.
    """
    own, known = model.with_effect(effect), get_effect(effect)
    if barely := known.barely(size):
        named = [{f"{effect}.{name}": value for name, value in each.items()} for each in barely]
        return [own.replace(_within(own, values)) for values in named]
    if not (amplitudes := known.amplitude_names):
        return [own.replace(values) for values in initial_guesses(own, effect, size)]
    shapes: dict[tuple[tuple[str, float], ...], Values] = {}
    for values in initial_guesses(own, effect, size):
        shape = {name: value for name, value in values.items() if name.startswith(effect) and name not in amplitudes}
        shapes.setdefault(tuple(sorted(shape.items())), {n: v for n, v in values.items() if n.startswith(effect)})
    return [own.replace({**v, **{name: FAINT * v[name] for name in amplitudes}}) for v in shapes.values()]


def _named(found: Sequence[Values], effect: str, model: Model) -> list[Values]:
    """Values by the full names of the parameters, within the bounds."""
    return [_within(model, {_full(effect, name, model): value for name, value in each.items()}) for each in found]


def _full(effect: str, name: str, model: Model) -> str:
    """The full name of a parameter of an effect, or of the base where the effect has none of that name."""
    return f"{effect}.{name}" if f"{effect}.{name}" in model.parameters else name


def _within(model: Model, values: Values) -> Values:
    """The values within the bounds.  Those of fixed parameters are left out, except whole numbers and fixed zeros that
    no model file has stated."""
    kept = {}
    for name, value in values.items():
        p = model.parameters[name]
        if not p.fixed or p.domain is Domain.WHOLE or _is_default_zero(name, model):
            kept[name] = p.clipped(value)
    return kept


def _is_default_zero(name: str, model: Model) -> bool:
    """Whether a parameter is zero by default, as no model file has stated it."""
    p = model.parameters[name]
    return p.value == 0.0 and p == build_model(model.base, model.effects).parameters[name]


def _around_defaults(own: Mapping[str, Parameter]) -> list[Values]:
    """The defaults of the free parameters, and multiples of them."""
    free = {name: p for name, p in own.items() if not (p.fixed or p.domain.is_whole)}
    factors = (1.0, 0.25, 4.0) + ((-1.0,) if any(p.low < 0 < p.value for p in free.values()) else ())
    return [{name: p.value * f for name, p in free.items()} for f in factors]
