"""What SysId of WPILib (2021 to 2023) has recorded of a mechanism of a robot: its four tests, rows of numbers in JSON.

Source: wpilibsuite/sysid, docs/data-collection.md: rows are ``timestamp, voltage, position, velocity``, those of a
drivetrain ``timestamp, l voltage, r voltage, l position, r position, l velocity, r velocity, angle, angular rate``,
positions in turns of the output and velocities in turns a second; ``unitsPerRotation`` makes ``units`` of these.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["tests_of"]

TESTS = ("slow-forward", "slow-backward", "fast-forward", "fast-backward")
UNITS = {"Meters": "m", "Feet": "ft", "Inches": "in", "Radians": "rad", "Degrees": "deg"}
"""with the unit that is known here; others are turns"""
SIDES = ("left", "right")
MOTION = ("position", "velocity")


def tests_of(held: Any) -> dict[str, dict[str, list[Any]]]:
    """The tests of a file by their names, each as lists by the name of the column, with its unit; none of another
    file, or of one that is not as the format says."""
    if not isinstance(held, Mapping) or held.get("sysid") is not True:
        return {}
    per_turn = held.get("unitsPerRotation")
    unit = UNITS.get(str(held.get("units")), "rev")
    scale = float(per_turn) if unit != "rev" and isinstance(per_turn, int | float) else 1.0
    found = {test: held[test] for test in TESTS if held.get(test)}
    names = {4: _mechanism(unit), 9: _drivetrain(unit)}
    widths = {len(row) if isinstance(row, list) else 0 for rows in found.values() for row in rows}
    if len(widths) != 1 or not (columns := names.get(widths.pop())):
        return {}
    return {test: _lists(rows, columns, scale) for test, rows in found.items()}


def _mechanism(unit: str) -> list[str]:
    """The names of the columns, each with its unit."""
    return ["time [s]", "voltage [V]", f"position [{unit}]", f"velocity [{unit}/s]"]


def _drivetrain(unit: str) -> list[str]:
    """The names of the columns, each with its unit; the gyroscope's angle is no joint's."""
    voltages = [f"{side} voltage [V]" for side in SIDES]
    motion = [f"{side} {what} [{unit}{'/s' if what == 'velocity' else ''}]" for what in MOTION for side in SIDES]
    return ["time [s]", *voltages, *motion, "gyro heading [rad]", "gyro rate [rad/s]"]


def _lists(rows: list[list[Any]], names: list[str], scale: float) -> dict[str, list[Any]]:
    """The columns by name, with positions and velocities in the unit of their names."""
    columns = zip(*rows, strict=True)
    return {
        name: [scale * each if isinstance(each, int | float) else each for each in column]
        if any(word in name for word in MOTION) else list(column)
        for name, column in zip(names, columns, strict=True)
    }  # fmt: skip
