"""What a motor was told, where a robot publishes that by itself: only when it changes, or beside the joints' states."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.guess import DRIVES, MOTIONS, POWERS, Chosen, mapped
from lostmotion.drivers.formats.rates import are_of_one_array, factor_of
from lostmotion.drivers.formats.source import Part, Series, shown
from lostmotion.drivers.formats.words import (
    column_of,
    is_asked_speed,
    is_input,
    is_sent,
    joint_of,
    says_nothing,
    without_joint,
)

__all__ = ["LEAST", "LEVELS", "held", "levels", "undriven", "unnamed", "unused"]

RARE = 0.1
"""messages of a command for each of the readings, below which the drive holds a value until the next one: of nine
recordings of a motor six have at most 0.0013, which changes a few times, and three, which follow a sine, 1.2"""
MOST = 8
"""of them are read"""
LEVELS, LEAST = 8, 100
"""values of such a series, among so many samples, up to which it looks like a switched input: those of three motors of
student laboratories have 2 or 3, a speed or an angle beside a swing has hundreds"""


def held(chosen: Sequence[Chosen], parts: Sequence[Part]) -> tuple[list[Part], list[str]]:
    """Times and values of each column, those of commands that have few messages at the times of the readings, each held
    until the next one, NaN before the first; and what a person should know.  Sensors are never held."""
    read = max((times for one, (times, _) in zip(chosen, parts, strict=True) if one.column in MOTIONS), key=len,
               default=np.empty(0))  # fmt: skip
    found, notes = list(parts), []
    for at, (one, (times, values)) in enumerate(zip(chosen, parts, strict=True)):
        if one.column in DRIVES and is_sent(one.series) and 0 < times.size < RARE * read.size:
            last = np.searchsorted(times, read, side="right") - 1
            found[at] = (read, np.where(last < 0, np.nan, values[np.maximum(last, 0)]))
            count = "1 message" if times.size == 1 else f"{times.size} messages"
            notes.append(f"{one.column}: {shown(one.series)} has {count}; each value is held until the next one")
    return found, notes


def unused(chosen: Sequence[Chosen], parts: Sequence[Part], series: Sequence[Series]) -> list[str]:
    """A warning where no drive is used, or one that is zero throughout, and another one of no other joint is there."""
    drives = [(one, values.any()) for one, (_, values) in zip(chosen, parts, strict=True) if one.column in POWERS]
    moved = [one.series for one in chosen if one.column in MOTIONS]
    if not moved or any(one.why == "given" or acts for one, acts in drives):
        return []
    taken = {one.series for one in chosen}
    others = [one.name for one in series if one.name not in taken]
    if drives:
        silent = drives[0][0]
        same = [name for name in others if column_of(name) == silent.column]
        told = [mapped(silent.column, name) for name in same if without_joint(name) != without_joint(silent.series)]
        told = told or [_drives(name) for name in _sent(others, moved[0])]
        said = f"{silent.column}: {shown(silent.series)} is zero throughout; if another one drives it, use"
        return [f"{said} {option}" for option in told[:1]]
    told = [
        f"{shown(name)} is not used, and the motion is taken as free; if that drives it, use {_drives(name)}"
        for name in _sent(others, moved[0])[:1]
    ]
    asked = [name for name in _of_joint(others, moved[0]) if is_asked_speed(name)]
    return told or [
        f"{shown(name)} is a speed that is asked for, so that a motor drives the motion, which is taken as free; its "
        f"torque, current or voltage is needed: {mapped('torque', 'SERIES')}"
        for name in asked[:1]
    ]


def unnamed(chosen: Sequence[Chosen], series: Sequence[Series], clocks: Collection[str]) -> list[str]:
    """The series whose names say nothing that may drive the motion, where no drive is used; clocks: the series that are
    the time, or count the rows."""
    columns, taken = {one.column for one in chosen}, {*clocks, *(one.series for one in chosen)}
    if not columns & MOTIONS or columns & DRIVES:
        return []
    moved = next(one.series for one in chosen if one.column in MOTIONS)
    left = [one.name for one in series if one.name not in taken]
    return [name for name in left if says_nothing(name) or are_of_one_array(moved, name)][:MOST]


def undriven(left: Mapping[str, Part], motion: Part) -> list[str]:
    """A note on each of these series, by name, that looks like a switched input; where none does, on those that change
    and are not how fast the motion changes."""
    many = {name: levels(values) for name, (_, values) in left.items() if values.size >= LEAST}
    changing = {name: count for name, count in many.items() if count > 1 and not _is_speed(left[name], motion)}
    few = {name: count for name, count in changing.items() if count <= LEVELS}
    said = {f"{shown(name)} has {count} values and is": name for name, count in few.items()}
    if changing and not few:
        said = {f"{', '.join(map(shown, changing))} {'is' if len(changing) == 1 else 'are'}": next(iter(changing))}
    return [
        f"{what} not used, and the motion is taken as free; if {shown(name)} drives it, use {mapped('torque', name)}, "
        f"or for a motor's voltage {mapped('voltage', name)}"
        for what, name in said.items()
    ]


def _is_speed(part: Part, motion: Part) -> bool:
    """Whether a series is how fast the motion changes, in any unit."""
    (times, values), (seen, position) = part, motion
    if min(times.size, seen.size) < 2:
        return False
    return factor_of(np.interp(times, seen, position), values * np.gradient(times)) is not None


def levels(values: FloatArray) -> int:
    """How many values a series (N,) has."""
    return int(np.unique(values[np.isfinite(values)]).size)


def _sent(names: Sequence[str], moved: str) -> list[str]:
    """Those that are commands of no other joint than that of the series that moves; those of a torque first, of goals
    last."""
    found = [name for name in _of_joint(names, moved) if is_sent(name) and _power_of(name)]
    return sorted(found, key=lambda name: column_of(name) == "command")


def _of_joint(names: Sequence[str], moved: str) -> list[str]:
    """Those of no other joint than that of the series that moves."""
    joints = {joint_of(name) for name in names if column_of(name) in MOTIONS} - {joint_of(moved)}
    return [name for name in names if joint_of(name) not in joints]


def _power_of(name: str) -> str:
    """The column that a command may be: that of its quantity, else a voltage, and what names no quantity a torque."""
    column = column_of(name) or ("voltage" if is_input(name) else "")
    return "torque" if column == "command" else column if column in POWERS else ""


def _drives(name: str) -> str:
    """What to type for a command that drives a joint."""
    goal = f", or for a goal {mapped('command', name)}" if column_of(name) == "command" else ""
    return f"{mapped(_power_of(name), name)}{goal}"
