"""Parses the name of a series: which column it may be, which joint's, in which unit.  Pure functions of text."""

from __future__ import annotations

import re

from lostmotion.drivers.units import COLUMN_UNITS, to_si

__all__ = ["column_of", "is_time", "joint_of", "unit_of"]

COMMAND = {
    "goal", "goals", "target", "targets", "desired", "reference", "references", "ref", "command", "commands",
    "commanded", "cmd", "setpoint", "action",
}  # fmt: skip
POSITION = {"position", "positions", "pos", "angle", "angles", "qpos", "q", "theta"}
SYMBOLS = {"q", "theta"}
"""of the joint, where a name says another quantity, too: ``q3_tau`` is its torque"""
QUANTITIES = {
    "temperature": {"temperature", "temp"},
    "voltage": {"voltage", "volt", "volts"},
    "torque": {"torque", "torques", "effort", "efforts", "tau"},
    "force": {"force"},
    "displacement": {"displacement"},
    "accel": {"accel", "acceleration", "acc", "accelerometer"},
    "current": {"current", "amps"},
}
OTHER = {
    "velocity", "velocities", "vel", "speed", "qd", "qvel", "dq", "accelerations", "jerk", "error", "errors",
    "covariance", "orientation", "quaternion", "gyro", "angular", "status", "moving", "index", "stamp", "limit",
    "limits", "min", "max", "mean", "std", "id", "output", "tolerance", "delta",
}  # fmt: skip
"""words of series that are none of the columns"""
GENERAL = {
    "joint", "joints", "state", "states", "observation", "controller", "trajectory", "robot", "data", "feedback",
    "actual", "present", "measured", "linear", "interface", "values", "value", "motor", "motors", "servo", "sensor",
    "imu", "msg", "x", "y", "z",
}  # fmt: skip
UNITS = {"deg", "degrees", "rad", "s", "ms", "us", "ns", "mm", "m", "nm", "a", "ma", "v", "mv", "c", "g", "n", "arcmin"}
VOCABULARY = COMMAND | POSITION | set().union(*QUANTITIES.values()) | OTHER | GENERAL | UNITS
TIMES = (
    "__time", "time", "time_s", "timestamp", "timestamps", "t", "stamp", "times", "tout", "time_ms", "time_us",
    "time_ns", "timestamp_s", "timestamp_ms", "timestamp_us", "timestamp_ns", "secs", "seconds", "elapsed",
    "datetime", "date_time",
)  # fmt: skip
"""names of the time axis, those first that others come after"""
SPELT = {
    "degrees": "deg", "degree": "deg", "radians": "rad", "nm": "N m", "ma": "mA", "mv": "mV", "a": "A", "v": "V",
    "c": "degC", "n": "N", "sec": "s", "seconds": "s", "m/s2": "m/s^2",
}  # fmt: skip


def column_of(name: str) -> str | None:
    """The column that a series of this name may be, None for none."""
    if name in COLUMN_UNITS:
        return None if name == "time" else name
    words = set(_words(name))
    if words & OTHER:
        return None
    found = [column for column, known in QUANTITIES.items() if words & known]
    if words & (POSITION - SYMBOLS if found else POSITION) or {"observation", "state"} <= words:
        return "command" if words & COMMAND else "position"
    if found:
        return None if words & COMMAND else found[0]
    return "command" if words & COMMAND else None


def is_time(name: str) -> bool:
    """Whether a series of this name may be the time axis."""
    plain = re.sub(r"\s*[\[(][^\])]*[\])]$", "", name).strip().lower().replace(" ", "_")
    return plain in TIMES


def joint_of(name: str) -> str:
    """The joint in a name: the text in brackets, else what is left of the path without the usual words."""
    if name in COLUMN_UNITS or re.fullmatch(r"column\d+", name):
        return ""
    for bracket in re.findall(r"\[([^\]]+)\]", name):
        if bracket.isdigit():
            return str(bracket)
        if kept := _proper(bracket):
            return kept
    parts = [_proper(part) for part in re.split(r"[/.]", name) if set(_words(part)) - VOCABULARY]
    return "/".join(filter(None, parts))


def unit_of(name: str, column: str) -> str:
    """The unit at the end of a name, as in ``angle_deg``, ``angle (deg)`` or ``angle [deg]``; "" for none.

    Behind a ``_`` it must suit the column: the m of ``torque_m`` is a motor, and no metre.
    """
    if found := re.search(r"[\[(]([^\])]+)[\])]$", name):
        unit = SPELT.get(found[1].strip().lower(), found[1].strip())
        return unit if to_si(unit) is not None else ""
    found = re.search(r"_([A-Za-z]+)$", name)
    unit = SPELT.get(found[1].lower(), found[1]) if found else ""
    known = to_si(unit)
    return unit if known is not None and known[0] == COLUMN_UNITS[column] else ""


def _words(name: str) -> list[str]:
    """Words in lower case, split at signs, digits and capitals."""
    return [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]


def _proper(text: str) -> str:
    """The first words of a text that are not usual ones: of ``q3_tau_J_compensate`` the 3."""
    found: list[re.Match[str]] = []
    for word in re.finditer(r"[A-Za-z]+|\d+", text):
        if word[0].lower() not in VOCABULARY - {"joint", "motor", "servo"}:
            found.append(word)
        elif found:
            break
    return text[found[0].start() : found[-1].end()] if found else ""
