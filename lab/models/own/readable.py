"""The names of the signals in user-defined effects, and the signals that an effect may read.

An effect adds to one signal and may read those that precede it in the causal order (model/signals.py): a torque may
depend on the speed, but not on the acceleration that follows from it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lostmotion.model import BASES, signals
from lostmotion.model.effects import ActsOn

__all__ = ["ENTRIES", "READABLE", "Entry", "Readable", "bases_with", "before"]


@dataclass(frozen=True, slots=True)
class Readable:
    """A signal: its number, unit, a usual magnitude, and the signal that is its rate, if there is one."""

    number: int
    unit: str
    usual: float
    rate: int | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """The target of an effect: the signal it adds to, the one that gets its rate as well, unit and meaning."""

    target: int
    unit: str
    meaning: str
    rate: int | None = None


_ANGLE = Readable(signals.THETA2, "rad", 1.5, signals.OMEGA2)
_SPEED = Readable(signals.OMEGA2, "rad/s", 3.0)
READABLE: Mapping[str, Readable] = {
    "time": Readable(signals.TIME, "s", 10.0),
    "command": Readable(signals.COMMAND, "rad", 0.5, signals.COMMAND_RATE),
    "command_rate": Readable(signals.COMMAND_RATE, "rad/s", 3.0),
    "theta_1": Readable(signals.THETA1, "rad", 0.5, signals.OMEGA1),
    "omega_1": Readable(signals.OMEGA1, "rad/s", 3.0),
    "theta": _ANGLE,
    "theta_2": _ANGLE,
    "omega": _SPEED,
    "omega_2": _SPEED,
    "q": Readable(signals.Q, "m", 1e-3, signals.Q_RATE),
    "q_rate": Readable(signals.Q_RATE, "m/s", 0.5),
    "inertia": Readable(signals.INERTIA, "kg m^2", 2e-4),
    "gap": Readable(signals.GAP, "m", 1e-4),
    "gap_rate": Readable(signals.GAP_RATE, "m/s", 0.05),
    "load": Readable(signals.FORCE, "N; joint, servo: N m", 30.0),
    "torque": Readable(signals.TORQUE, "N m", 0.3),
    "acceleration": Readable(signals.ALPHA2, "rad/s^2", 200.0),
    "bar_force": Readable(signals.BAR_FORCE, "N", 1.0),
    "q_acceleration": Readable(signals.QDD, "m/s^2", 50.0),
    "tip": Readable(signals.TIP, "m/s^2", 50.0),
    "sensor": Readable(signals.SENSOR, "m/s^2", 50.0),
}
"""By name; theta and omega are short for those of the joint's output, load is F_cnt or the transmitted torque."""

ENTRIES: Mapping[ActsOn, Entry] = {
    ActsOn.JOINT: Entry(signals.TORQUE, "N m", "a torque on the joint"),
    ActsOn.OSCILLATOR: Entry(signals.BAR_FORCE, "N", "a force on the oscillator"),
    ActsOn.COMMAND: Entry(signals.THETA1, "rad", "an angle on top of theta_1", signals.OMEGA1),
    ActsOn.CONTACT: Entry(signals.GAP, "m", "a length on top of the gap", signals.GAP_RATE),
    ActsOn.SENSOR: Entry(signals.READING, "m/s^2", "an acceleration on top of the reading"),
}


def before(target: int) -> tuple[str, ...]:
    """The names of the signals that an effect on the signal ``target`` may read."""
    return tuple(name for name, signal in READABLE.items() if signal.number < target or _is_state(signal.number))


def bases_with(numbers: set[int]) -> tuple[str, ...]:
    """The bases that use all of these signals."""
    return tuple(name for name in BASES if numbers <= _used(name))


def _is_state(number: int) -> bool:
    """Whether a signal is a state of a base, which is known before any term is evaluated."""
    return any(state.signal == number for base in BASES.values() for state in base.states)


def _used(name: str) -> set[int]:
    """The numbers of the signals that a base uses."""
    base = BASES[name]
    fed = {signal for signal, _ in base.input_signals} | {state.signal for state in base.states}
    return {signals.TIME, *fed, *base.presets, *(term.target for term in base.terms)}
