"""Which effects there are.

Their order is that of evaluation where two act on one signal: causal, however a model lists them.  Effects that others
register come last, by id, so that the order is the same in every process.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

from lostmotion.model.effects import bar, clock, friction, gears, gravity, hysteresis, lag, sensor, shaft, spring
from lostmotion.model.effects.base import Effect, EffectInfo
from lostmotion.model.errors import ModelError

__all__ = ["catalogue", "find", "get_effect", "own", "rank", "register", "registered", "unregister"]

_EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        clock.COMMAND_DELAY,
        lag.VELOCITY_LIMIT,
        lag.ACTUATOR_LAG,
        shaft.FINITE_ACTUATOR,
        gears.GEAR_ECCENTRICITY,
        gears.CONTACT_ASYMMETRY,
        shaft.SHAFT_COMPLIANCE,
        friction.VISCOUS,
        friction.COULOMB,
        friction.STRIBECK,
        friction.LOAD_DEPENDENT,
        hysteresis.PRESLIDING_FRICTION,
        hysteresis.FRICTION_BEHIND_PLAY,
        gravity.GRAVITY_TORQUE,
        gravity.CONSTANT_TORQUE,
        spring.SPRING_TORQUE,
        gears.TORQUE_RIPPLE,
        bar.HARDENING_SPRING,
        bar.QUADRATIC_DAMPING,
        bar.SECOND_MODE,
        sensor.GRAVITY_LEAKAGE,
        sensor.CENTRIPETAL_CROSSTALK,
        lag.SENSOR_LAG,
        sensor.BIAS_DRIFT,
        sensor.SENSOR_SATURATION,
        clock.CLOCK_SKEW,
    )
}
_PLACES = {name: place for place, name in enumerate(_EFFECTS)}


def catalogue() -> tuple[EffectInfo, ...]:
    """All effects, in the order of their evaluation."""
    return tuple(sorted(_EFFECTS.values(), key=lambda effect: rank(effect.id)))


def register(effect: Effect) -> None:
    """Adds an effect of one's own to this process; an id that is taken raises ModelError."""
    if effect.id in _EFFECTS and _EFFECTS[effect.id] is not effect:
        raise ModelError(f"there is already an effect called {effect.id!r}")
    _EFFECTS[effect.id] = effect


def unregister(name: str) -> None:
    """Takes a registered effect out again; lostmotion's own stay."""
    if name not in _PLACES:
        _EFFECTS.pop(name, None)


@contextmanager
def registered(effects: Sequence[Effect]) -> Iterator[None]:
    """Adds effects of one's own within a block."""
    for effect in effects:
        register(effect)
    try:
        yield
    finally:
        for effect in effects:
            unregister(effect.id)


def find(name: str) -> Effect | None:
    """The effect of that id, if there is one."""
    return _EFFECTS.get(name)


def get_effect(name: str) -> Effect:
    """The effect of that id.  Raises ModelError naming those that exist."""
    if name not in _EFFECTS:
        raise ModelError(f"no effect is called {name!r}; there are {', '.join(_EFFECTS)}")
    return _EFFECTS[name]


def own(names: Iterable[str]) -> tuple[Effect, ...]:
    """Those of the effects that are registered in this process only."""
    return tuple(get_effect(name) for name in names if name not in _PLACES)


def rank(name: str) -> tuple[int, str]:
    """Its place in the order of evaluation."""
    return _PLACES.get(name, len(_PLACES)), name
