"""Effects on time itself, outside the equations of motion: a delayed command, a sensor clock that runs fast or slow."""

from __future__ import annotations

from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.effects.guesses import grid
from lostmotion.model.effects.words import Words
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
    amplitudes=("T",),
    guesses=lambda scales: grid(T=(1.5e-3, 4e-3, 8e-3)),
    delays_by="T",
    words=Words(
        "a delayed command",
        "The command reaches the motor late, by {T}.",
        "Look at the bus: baud rate, cycle time, an adapter that buffers (FTDI latency timer), a return delay set in "
        "the servo.",
    ),
)
CLOCK_SKEW = Effect(
    id="clock_skew",
    equation="accel stamped t was felt at start + (t - start)/(1 + s)",
    summary="the sensor's clock runs at rate 1 + s; it was set when the simulation starts",
    acts_on=ActsOn.SENSOR,
    bases=("play", "oscillator"),
    parameters={"s": Parameter(1e-4, "", -0.1, 0.1, False, "guess: a poor crystal", "skew", Domain.RATE)},
    clock_rate=lambda values: 1 + values["s"],
    amplitudes=("s",),
    guesses=lambda scales: grid(s=(-1e-3, 1e-3)),
    delays_by="s",
    words=Words(
        "a sensor clock that is off",
        "The accelerometer's clock runs fast, by {s.percent}.",
        "Take the time stamps from the host, or align the clocks at the start of each recording.",
        lambda values: values["s"] >= 0,
        "The accelerometer's clock runs slow, by {s.size.percent}.",
        read_as={"s": "percent"},
    ),
)
