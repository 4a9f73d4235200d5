"""Which effects there are.

Their order is that of evaluation where two act on one signal: causal, however a model lists them.  Effects that others
register come last.
"""

from __future__ import annotations

from lostmotion.model.effects import bar, clock, friction, gears, gravity, lag, sensor, shaft
from lostmotion.model.effects.base import Effect, EffectInfo
from lostmotion.model.errors import ModelError

__all__ = ["catalogue", "get_effect", "rank", "register"]

_EFFECTS: dict[str, Effect] = {
    effect.id: effect
    for effect in (
        clock.COMMAND_DELAY,
        lag.ACTUATOR_LAG,
        shaft.FINITE_ACTUATOR,
        gears.GEAR_ECCENTRICITY,
        gears.CONTACT_ASYMMETRY,
        shaft.SHAFT_COMPLIANCE,
        friction.VISCOUS,
        friction.COULOMB,
        friction.STRIBECK,
        friction.LOAD_DEPENDENT,
        gravity.GRAVITY_TORQUE,
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


def catalogue() -> tuple[EffectInfo, ...]:
    """All effects, in the order of their evaluation."""
    return tuple(_EFFECTS.values())


def register(effect: Effect) -> None:
    """Adds an effect of one's own to this process; an id that is taken raises ModelError."""
    if effect.id in _EFFECTS and _EFFECTS[effect.id] is not effect:
        raise ModelError(f"there is already an effect called {effect.id!r}")
    _EFFECTS[effect.id] = effect


def get_effect(name: str) -> Effect:
    """The effect of that id.  Raises ModelError naming those that exist."""
    if name not in _EFFECTS:
        raise ModelError(f"no effect is called {name!r}; there are {', '.join(_EFFECTS)}")
    return _EFFECTS[name]


def rank(name: str) -> int:
    """Its place in the order of evaluation."""
    return list(_EFFECTS).index(name)
