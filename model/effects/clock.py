"""Effects on time itself, outside the equations of motion: a delayed command, a sensor clock that runs fast or slow."""

from __future__ import annotations

from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.parameter import Domain, Parameter

__all__ = ["CLOCK_SKEW", "COMMAND_DELAY"]

COMMAND_DELAY = Effect(
    id="command_delay",
    equation="theta_1(t) = command(t - T)",
    summary="the command takes effect later: bus and firmware",
    acts_on=ActsOn.COMMAND,
    bases=("play", "servo"),
    parameters={"T": Parameter(0.01, "s", 0.0, 0.5, False, "guess: a 100 Hz bus", "delay", Domain.NOT_NEGATIVE)},
    delay=lambda values: values["T"],
)
CLOCK_SKEW = Effect(
    id="clock_skew",
    equation="accel stamped t was felt at start + (t - start)/(1 + s)",
    summary="the sensor's clock runs at rate 1 + s; it was set when the simulation starts",
    acts_on=ActsOn.SENSOR,
    bases=("play", "oscillator"),
    parameters={"s": Parameter(1e-4, "", -0.1, 0.1, False, "guess: a poor crystal", "skew", Domain.RATE)},
    clock_rate=lambda values: 1 + values["s"],
)
