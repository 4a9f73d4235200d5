"""Whether the angle of a file, its speed and its goal agree: degrees in one column beside rad in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.angles import DEGREE, are_alike, in_rad
from lostmotion.drivers.formats.guess import Chosen, mapped
from lostmotion.drivers.formats.rates import factor_of
from lostmotion.drivers.formats.source import Part, Series, shown
from lostmotion.drivers.formats.words import joint_of, speed_of
from lostmotion.drivers.units import to_si

__all__ = ["BY_SPEED", "by_speed", "goal_beside", "own_doubts", "speeds_of"]

BY_SPEED = "; its speed"
"""the end of the reason for an angle that was read in degrees because of its speed"""
FOLLOWED, UNSURE = 0.9, 1.4
"""The least correlation of a goal with the angle that follows it, and how many times as far as the goal the angle may
swing, or less far: a first-order lag at its corner frequency has 1.4.  Gears may have such a ratio; this only warns.
Of 311 recordings of motors, servos and pendulums none is warned of."""
MOST = 20_000
"""Values of a goal and its angle that are compared: of 300 000 all take 0.37 s, and these 3 ms, with the same ratio to
1e-5."""


def speeds_of(chosen: Sequence[Chosen], series: Sequence[Series]) -> list[Series]:
    """The series that are the speed of the angle by their names."""
    angles = [one for one in chosen if one.column == "position" and one.si == "rad" and speed_of(one.series) is None]
    joints = {joint_of(one.series) for one in angles}
    taken = {one.series for one in chosen}
    found = [one for one in series if one.name not in taken and speed_of(one.name) is not None]
    return [one for one in found if joint_of(one.name) in joints]


def by_speed(
    chosen: Sequence[Chosen], parts: Sequence[Part], read: Mapping[str, Part], speeds: Sequence[Series]
) -> tuple[list[Chosen], list[Part], list[str]]:
    """The columns, times and values, with an angle without a unit, and its goal, turned from degrees into rad where its
    speed shows that; and what a person should know.  read: by the name of the series, those of the speeds, too."""
    kept, turned = list(chosen), list(parts)
    at = next((k for k, one in enumerate(chosen) if one.column == "position"), None)
    if at is None:
        return kept, turned, []
    units = {one.name: one.unit or speed_of(one.name) or "" for one in speeds}
    factors = {name: _times_as_fast(parts[at], read[name], unit) for name, unit in units.items()}
    name = next((name for name, factor in factors.items() if factor != 1), "")
    if not name:
        return kept, turned, []
    one, factor = chosen[at], factors[name]
    said = f"it changes {factor:.3g} times as fast as {shown(name)} says"
    if not one.is_without_unit or factor < 1:
        given = f"{one.unit or one.si} and {units[name] or 'rad/s'}"
        return kept, turned, [f"position: {said}: {shown(one.series)} and {shown(name)} are not in {given}"]
    for k, each in enumerate(chosen):
        is_goal = each.column == "command" and each.is_without_unit and are_alike(parts[k][1], parts[at][1])
        if k == at or is_goal:
            kept[k], turned[k] = in_rad(each, parts[k], BY_SPEED)
    columns = ", ".join(each.column for each, was in zip(kept, chosen, strict=True) if each is not was)
    rad = mapped("position", one.series, ":rad")
    return kept, turned, [f"{columns}: no unit is given; taken as deg, as {said}; else use {rad}"]


def goal_beside(chosen: Sequence[Chosen], parts: Sequence[Part]) -> list[str]:
    """A warning where the angle follows a goal that is as large as degrees beside rad."""
    known = {one.column: (one, part) for one, part in zip(chosen, parts, strict=True) if one.si == "rad"}
    if not {"command", "position"} <= {*known}:
        return []
    (goal, (_, asked)), (angle, (_, reached)) = known["command"], known["position"]
    if asked.size != reached.size:
        return []
    return _beside({"command": goal.series, "position": angle.series}, _times_as_far(asked, reached))


def own_doubts(time: FloatArray, columns: Mapping[str, FloatArray], extra: Mapping[str, Sequence[str]]) -> list[str]:
    """Warnings where a position of lostmotion's own format contradicts its command, or a speed, which the format does
    not know.  time: (N,) [s]; columns, extra: those of a Recording."""
    if "position" not in columns:
        return []
    position, found = columns["position"], []
    if "command" in columns and (both := ~np.isnan(position + columns["command"])).any():
        names = {"command": "command", "position": "position"}
        found += _beside(names, _times_as_far(columns["command"][both], position[both]))
    for name in (name for name in extra if speed_of(name) is not None):
        try:
            speed = np.array([float(cell) if cell.strip() else np.nan for cell in extra[name]])
        except ValueError:
            continue
        there = ~np.isnan(position + speed)
        factor = _times_as_fast((time[there], position[there]), (time[there], speed[there]), speed_of(name) or "")
        if factor > 1:
            said = f"it changes {factor:.3g} times as fast as {shown(name)} says, as degrees beside rad/s do"
            found.append(f"position: {said}; if so, use {mapped('position', 'position', ':deg')}")
    return found


def _beside(names: Mapping[str, str], ratio: float) -> list[str]:
    """A warning where one of two series is that of degrees beside rad.  names: of the series, by their columns, the
    goal first; ratio: how many times as far as its angle the goal moves, 0 where it is not followed."""
    goal, angle = names
    for one, other, far in ((goal, angle, ratio), (angle, goal, 1 / ratio if ratio else 0.0)):
        if 1 / UNSURE < far * DEGREE < UNSURE:
            said = f"{shown(names[one])} moves {far:.3g} times as far as {shown(names[other])}"
            return [f"{one}: {said}, as degrees beside rad do; if so, use {mapped(one, names[one], ':deg')}"]
    return []


def _times_as_fast(angle: Part, speed: Part, unit: str) -> float:
    """How many times as fast an angle [rad] changes as its speed says, if that is about the number of degrees in a
    radian, or the inverse of it; else 1.  unit: of the speed, "" where it is unknown: rad/s, or deg/s beside rad."""
    (seen, position), (times, values) = angle, speed
    si, factor = to_si(unit) or ("rad/s", 1.0)
    if si != "rad/s" or min(times.size, seen.size) < 2:
        return 1.0
    found = factor_of(np.interp(times, seen, position), factor * values * np.gradient(times))
    ratios = (1 / DEGREE, DEGREE) if unit else (1 / DEGREE,)
    return found.least if found and any(found.may_be(ratio) for ratio in ratios) else 1.0


def _times_as_far(goal: FloatArray, angle: FloatArray) -> float:
    """The ratio of the standard deviations of a goal (N,) and its angle (N,), 0 where the angle does not follow it."""
    every = max(goal.size // MOST, 1)
    asked, reached = (values[::every] - values[::every].mean() for values in (goal, angle))
    size = float(np.linalg.norm(asked) * np.linalg.norm(reached))
    if not size:
        return 0.0
    one, other = (np.fft.rfft(values, 2 * values.size) for values in (asked, reached))
    is_followed = np.fft.irfft(one.conj() * other).max() > FOLLOWED * size  # with any delay
    return float(np.std(asked) / np.std(reached)) if is_followed else 0.0
