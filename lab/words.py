"""Effects, columns and variables in the words of a maintenance engineer.

Sentences about one effect, from its ``Words``; verdict.py joins them.  An effect without any, such as a user-defined
one, is described by its summary.
"""

from __future__ import annotations

from collections.abc import Mapping

from lostmotion.lab.quantity import Interval
from lostmotion.lab.results import Fit
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.registry import find
from lostmotion.model.effects.words import Words

__all__ = ["column", "intervals", "look", "name", "sentence", "size", "variable"]

Found = Mapping[str, Interval]

_VARIABLES = {
    "time": ("time", "s"),
    "command": ("the commanded angle", "rad"),
    "command_rate": ("the commanded speed", "rad/s"),
    "theta": ("the joint's angle", "rad"),
    "theta_1": ("the commanded angle", "rad"),
    "theta_2": ("the joint's angle", "rad"),
    "position": ("the joint's angle", "rad"),
    "omega": ("the joint's speed", "rad/s"),
    "omega_2": ("the joint's speed", "rad/s"),
    "velocity": ("the joint's speed", "rad/s"),
    "acceleration": ("the joint's acceleration", "rad/s^2"),
    "load": ("the load", "N"),
    "q": ("the bar's deflection", "m"),
    "q'": ("the bar's speed", "m/s"),
    "temperature": ("the temperature", "degC"),
    "torque": ("the torque", "N m"),
    "gap": ("the gap between the teeth", "m"),
    "force": ("the force", "N"),
    "accel": ("the measured acceleration", "m/s^2"),
    "displacement": ("the displacement", "m"),
}
"""By variable of a residual, its name and its SI unit."""
_COLUMNS = {
    "accel": ("acceleration", "m/s^2"),
    "position": ("angle", "rad"),
    "force": ("force", "N"),
    "displacement": ("displacement", "m"),
    "torque": ("torque", "N m"),
}
"""By column of a recording, its quantity and its SI unit."""
_DRIVES = {"A": "current", "V": "voltage", "%": "duty cycle"}
"""By unit of what was recorded instead of a torque, its name."""
_LINEAR = {"position": ("position", "m"), "torque": ("force", "N")}
"""The columns of an axis that moves along a line."""


def variable(name: str) -> tuple[str, str]:
    """The name of a variable that a residual depends on, and its SI unit."""
    return _VARIABLES.get(name, (name.replace("_", " "), ""))


def column(name: str, is_linear: bool = False, drive: str = "") -> tuple[str, str]:
    """The quantity in a column of a recording, and its SI unit; is_linear: of an axis that moves along a line; drive:
    the unit of what was recorded in place of its torque, "A" for a motor's current."""
    if name == "torque" and drive:
        return _DRIVES.get(drive, "input"), drive
    return (_LINEAR if is_linear and name in _LINEAR else _COLUMNS).get(name, (name, ""))


def name(effect: str) -> str:
    """The name of an effect: "Coulomb friction"."""
    words = _words(effect)
    return words.name if words else effect.replace("_", " ")


def sentence(effect: str, found: Found) -> str:
    """What the effect means for the robot, with its main parameters; found: these by their name within the effect.

    Raises ModelError for an effect that does not exist.
    """
    words = get_effect(effect).words
    if words:
        values = {parameter: interval.value for parameter, interval in found.items()}
        return (words.sentence if words.when(values) else words.otherwise).format_map(found)
    listed = "; ".join(f"{parameter} = {value}" for parameter, value in found.items())
    summary = get_effect(effect).summary.strip().rstrip(".") or name(effect)
    return f"{summary[0].upper()}{summary[1:]}{': ' if listed else ''}{listed}."


def look(effect: str) -> str:
    """What to look at on the robot; "" where it is not documented."""
    words = _words(effect)
    return words.look if words else ""


def _words(effect: str) -> Words | None:
    known = find(effect)
    return known.words if known else None


def size(effect: str, parameter: str, value: float, base: str) -> str:
    """A size of an effect by one of its parameters, without its sign, as its sentence has it: "30.0 µN m", "2.9°".

    Raises ModelError for an effect that does not exist or does not act on that base.
    """
    own = get_effect(effect)
    interval = Interval(value, unit=own.parameters_on(base)[parameter].unit).size
    read_as = own.words.read_as.get(parameter) if own.words else None
    read: Interval = getattr(interval, read_as) if read_as else interval
    return read.alone


def intervals(fit: Fit, effect: str) -> dict[str, Interval]:
    """The effect's parameters as fitted, by their name within the effect; fixed ones have no interval."""
    prefix = f"{effect}."
    found = {full: Interval(p.value, unit=p.unit) for full, p in fit.model.parameters.items()}
    found |= {e.name: Interval(e.value, e.low, e.high, e.unit) for e in fit.estimates}
    return {full.removeprefix(prefix): value for full, value in found.items() if full.startswith(prefix)}
