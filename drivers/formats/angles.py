"""Angles whose unit nobody gives: in degrees where they cannot be in rad, and doubted where they may be anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.commands import unused
from lostmotion.drivers.formats.guess import MOTIONS, Chosen, mapped, speeds_told
from lostmotion.drivers.formats.motion import SWINGS, crossings
from lostmotion.drivers.formats.source import Part, Series, shown
from lostmotion.drivers.formats.words import is_angle
from lostmotion.drivers.units import MANY_TURNS

__all__ = ["ASSUMED", "doubts", "in_degrees"]

ASSUMED = "; a swing"
"""the end of the reason for an angle that was read in degrees because nothing swings so far in rad"""
ANGLES = ("command", "position")
DEGREE = np.pi / 180
COUNTS = 90
"""half the swing in whole numbers, beyond which they may be counts of an encoder"""


def in_degrees(
    chosen: Sequence[Chosen], parts: Sequence[Part], series: Sequence[Series]
) -> tuple[list[Chosen], list[Part], list[str]]:
    """The columns and their times and values, with the angles that are in degrees turned into rad: one that swings by
    itself, or the goal and the angle of a servo; and what a person should know."""
    notes, angles = [], set()
    reason = ""
    if len(chosen) == 1 and _is_swing_in_degrees(chosen[0], parts[0][1]) and not unused(chosen, parts, series):
        half, rad = np.ptp(parts[0][1]) / 2, mapped("position", chosen[0].series, ":rad")
        notes.append(f"position: no unit is given; taken as deg, as nothing swings by {half:.4g} rad; else use {rad}")
        angles, reason = {"position"}, ASSUMED
    if _are_of_a_servo_in_degrees(chosen, [values for _, values in parts]):
        rad = " ".join(mapped(one.column, one.series, ":rad") for one in chosen if one.column in ANGLES)
        why = "as a servo with a goal does not turn so often"
        notes.append(f"command, position: no unit is given; taken as deg, {why}; else use {rad}")
        angles = {*ANGLES}
    kept, turned = list(chosen), list(parts)
    for at, (one, (times, values)) in enumerate(zip(chosen, parts, strict=True)):
        if one.column in angles:
            kept[at] = replace(one, unit="deg", factor=DEGREE, why=one.why + reason)
            turned[at] = times, DEGREE * values
    return kept, turned, notes


def doubts(chosen: Sequence[Chosen], parts: Sequence[Part], series: Sequence[Series]) -> list[str]:
    """A warning where the size of the numbers contradicts the assumed unit, or an angle does not change."""
    return [doubt for one, (_, values) in zip(chosen, parts, strict=True) for doubt in _doubts(one, values, series)]


def _is_swing_in_degrees(one: Chosen, values: FloatArray) -> bool:
    """Whether an angle without a unit goes to and fro so far that a pendulum in rad would turn over."""
    if one.column != "position" or one.unit or one.why == "given" or one.factor != 1 or not values.size:
        return False
    most = COUNTS if _are_whole(values) and not is_angle(one.series) else 360
    return bool(crossings(values) >= SWINGS and np.pi < np.ptp(values) / 2 <= most)


def _are_of_a_servo_in_degrees(columns: Sequence[Chosen], values: Sequence[FloatArray]) -> bool:
    """Whether goal and angle have no unit, and are beyond the turns of a servo in rad, but within one in degrees; whole
    numbers may be counts, unless both are called angles."""
    angles = [(one, numbers) for one, numbers in zip(columns, values, strict=True) if one.column in ANGLES]
    if {one.column for one, _ in angles} != {*ANGLES} or any(
        one.unit or one.why == "given" or one.factor != 1 for one, _ in angles
    ):
        return False
    numbers = np.concatenate([each for _, each in angles])
    may_be_counts = _are_whole(numbers) and not all(is_angle(one.series) for one, _ in angles)
    return MANY_TURNS <= float(np.abs(numbers).max()) <= 360 and not may_be_counts


def _doubts(one: Chosen, values: FloatArray, series: Sequence[Series]) -> list[str]:
    if one.column in MOTIONS and one.why == "by its name" and values.size and not np.ptp(values) > 0:
        return [f"{one.column}: {shown(one.series)} does not change; {hint}" for hint in speeds_told(series)]
    if one.column not in ANGLES or one.unit or one.why == "given" or not values.size:
        return []
    is_whole = _are_whole(values) and float(np.ptp(values)) > 2 * np.pi
    if np.abs(values).max() < MANY_TURNS and not is_whole:
        return []
    span = f"{values.min():.4g} to {values.max():.4g}"
    degrees, counts = (mapped(one.column, one.series, each) for each in (":deg", f"*{pi / 2048:.8f}"))
    what = "whole numbers, which rad hardly are, " if is_whole else ""
    said = f"{one.column}: no unit is given, and {what}{span} were taken as rad"
    return [f"{said}; if they are degrees, use {degrees}{f', if counts of 4096 a turn, {counts}' * is_whole}"]


def _are_whole(values: FloatArray) -> bool:
    return bool((values == np.rint(values)).all())
