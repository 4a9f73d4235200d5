"""Effects tried in the inverse model, each from the initial values that explain most of what is left."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lostmotion.lab.candidates import others
from lostmotion.lab.inverse.regression import Problem, Regression, regressed
from lostmotion.lab.inverse.torques import is_static
from lostmotion.lab.seeds import AMPLITUDE, Sizes, seeds
from lostmotion.lab.simpler import SIMPLER, wider
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["candidates", "fitted_with", "sizes_of", "softened"]

STARTS = 3
"""Initial values of an effect from which it is fitted."""
UNSURE_SPEED = 0.02
"""Of the usual speed: below it the filtered speed does not tell the sign of the speed, whatever a model's omega_0."""
SLOW = 0.5
"""Of the usual speed: an effect near rest that reaches further cannot be told from one of all speeds."""
PERIODS = 2.0
"""A torque of N periods a turn is told from one that varies slowly when the motion covers so many of them."""


def softened(model: Model, data: Problem) -> Model:
    """The model with dry friction that changes sign no more steeply than the filtered speed tells."""
    least = UNSURE_SPEED * _rms([one.velocity for one in data.signals])
    widths = {
        name: least
        for name, parameter in model.parameters.items()
        if name.endswith(".omega_0") and parameter.fixed and parameter.value < least
    }
    return model.replace(widths)


def sizes_of(model: Model, data: Problem) -> Sizes:
    """Usual magnitudes in the motion."""
    signals = data.signals
    span = max(float(np.ptp(one.position)) for one in signals)
    return Sizes(
        torque=data.usual(model), speed=_rms([one.velocity for one in signals]), span=span,
        bend=0.0, swing=0.0, reading=0.0, peak=0.0, k=0.0, b=0.0, d=0.0, inertia=model.parameters["J"].value,
        length=max(float(one.time[-1]) for one in signals),
    )  # fmt: skip


def candidates(model: Model, added: tuple[str, ...], data: Problem) -> Iterator[tuple[str, Model]]:
    """Effects that the model may have beside its own, with the model that has them: static ones, and those of an angle
    only where the position is one.  Of nested laws the simple one comes first; once it was added, the wide one may take
    its place."""
    is_linear = any(one.experiment.is_linear for one in data.signals)
    nested = dict(found for part in added if (found := wider(model, part)))
    for name in others(model):
        if not is_static(get_effect(name)) or (is_linear and _needs_angle(name)):
            continue
        if name in nested:
            yield name, nested[name]
        elif SIMPLER.get(name, name) == name or SIMPLER[name] in model.effects:
            yield name, model.with_effect(name)


def fitted_with(name: str, wide: Model, now: Regression) -> Regression | None:
    """The best fit of a model with one more effect, from several initial values; None where nothing can be fitted or
    the effect would not be what its name says."""
    size = sizes_of(now.model, now.data)
    soft = _within_speeds(softened(wide, now.data), name, size)
    starts = [soft.replace(values) for values in seeds(soft, name, size)]
    ranked = sorted((entry for start in starts if (entry := _promise(name, start, now))), key=lambda pair: -pair[0])
    fits = [found for _, start in ranked[:STARTS] if (found := _tried(start, now.data))]
    possible = [one for one in fits if get_effect(name).is_apt(_own(one.model, name))]
    return min(possible, key=lambda one: one.rms, default=None)


def _within_speeds(model: Model, name: str, size: Sizes) -> Model:
    """The model with the speeds at which an effect changes among those of the motion."""
    speeds = {
        full: replace(
            p, value=min(p.value, SLOW * size.speed), low=min(p.low, SLOW * size.speed), high=SLOW * size.speed
        )
        for full, p in model.parameters.items()
        if full.startswith(f"{name}.") and p.unit == "rad/s" and not p.fixed
    }
    return model.replace(speeds)


def _promise(name: str, start: Model, now: Regression) -> tuple[float, Model] | None:
    """How much of the residual an effect explains, in the shape of this start and of the size that suits best, and the
    start with that size."""
    if not _covers(name, start, now.data):
        return None
    column = now.data.residual(start, now.data.nuisance) - now.residual
    if not (np.isfinite(column).all() and column.any()):
        return None
    own = _off(now.jacobian, column)
    power = float(own @ own)
    if power <= 1e-12 * float(column @ column):
        return None
    factor = -float(own @ now.residual) / power
    names = [f"{name}.{part}" for part in AMPLITUDE.get(name, ()) if f"{name}.{part}" in start.parameters]
    signed = all(start.parameters[full].low < 0 for full in names)
    if names and (factor > 0 or signed):
        sized = {full: start.parameters[full].value * factor for full in names}
        start = start.replace({full: _within(start, full, value) for full, value in sized.items()})
    elif names:
        factor = 0.0
    return factor**2 * power, start


def _covers(name: str, model: Model, data: Problem) -> bool:
    """Whether the motion covers some periods of an effect that repeats N times a turn; once a turn it has the shape of
    a weight, and is told as what cannot be told from one."""
    turns = model.parameters.get(f"{name}.N")
    span = max(float(np.ptp(one.position)) for one in data.signals)
    return turns is None or turns.value == 1 or turns.value * span > PERIODS * 2 * np.pi


def _tried(model: Model, data: Problem) -> Regression | None:
    try:
        found = regressed(model, data)
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return None
    return found if np.isfinite(found.residual).all() else None


def _own(model: Model, effect: str) -> dict[str, float]:
    prefix = f"{effect}."
    return {name.removeprefix(prefix): p.value for name, p in model.parameters.items() if name.startswith(prefix)}


def _needs_angle(name: str) -> bool:
    """Whether an effect has a phase."""
    return any(parameter.unit == "rad" for parameter in get_effect(name).parameters.values())


def _within(model: Model, name: str, value: float) -> float:
    parameter = model.parameters[name]
    return min(max(value, parameter.low), parameter.high)


def _off(jacobian: FloatArray, column: FloatArray) -> FloatArray:
    """What the fitted parameters cannot explain of a column."""
    q = np.linalg.qr(jacobian)[0]
    return np.asarray(column - q @ (q.T @ column))


def _rms(parts: list[FloatArray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
