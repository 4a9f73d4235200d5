"""Angles whose unit nobody gives: in degrees where they cannot be in rad, and doubted where they may be anything, as
are large currents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.commands import unused
from lostmotion.drivers.formats.guess import Chosen, mapped
from lostmotion.drivers.formats.source import Part, Series, shown
from lostmotion.drivers.formats.swinging import SWINGS, crossings
from lostmotion.drivers.formats.words import is_angle
from lostmotion.drivers.units import MANY_TURNS, to_si

__all__ = ["ASSUMED", "DEGREE", "are_alike", "check_servo", "check_swing", "doubts", "in_degrees", "in_rad"]

ASSUMED = "; a swing"
"""the end of the reason for an angle that was read in degrees because nothing swings so far in rad"""
ANGLES = ("command", "position")
DEGREE = np.pi / 180
TURN = 360
COUNTED = f"*{np.pi / 2048:.8f}"
"""what makes rad of counts of 4096 a turn"""
MOTOR_CURRENT = 100.0
"""beyond that of a robot's motor [A]"""
COUNTS = 90
"""half the swing in whole numbers, beyond which they may be counts of an encoder"""
LEAST_BITS, EXACT = 8, 1e-6
"""bits of an encoder, and how far the logarithm of its counts a turn may be from a whole number: by chance one angle in
500,000 is as close"""
ALIKE = float(np.sqrt(1 / DEGREE))
"""Times as far as its angle a goal in the same unit may be, or the other way round: 7.6, half way to degrees beside
rad. Goals of 101 published recordings of servos and motors go 0.8 to 4.2 times as far as the angles, the latter of a
servo with a small gain that lifts a weight."""


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
    servo = _beyond_a_servo(chosen, [values for _, values in parts])
    if servo and max(float(np.abs(values).max()) for _, values in servo) <= TURN:
        most = max((values for _, values in servo), key=lambda values: np.abs(values).max())
        far = [one for one, values in servo if are_alike(values, most)]
        rad = " ".join(mapped(one.column, one.series, ":rad") for one in far)
        why = "as a servo with a goal does not turn so often"
        angles = {one.column for one in far}
        notes.append(f"{', '.join(sorted(angles))}: no unit is given; taken as deg, {why}; else use {rad}")
    kept, turned = list(chosen), list(parts)
    for at, (one, part) in enumerate(zip(chosen, parts, strict=True)):
        if one.column in angles:
            kept[at], turned[at] = in_rad(one, part, reason)
    return kept, turned, notes


def in_rad(one: Chosen, part: Part, reason: str) -> tuple[Chosen, Part]:
    """An angle that was found to be in degrees, with its values in rad; reason: what is added to why it was chosen."""
    times, values = part
    return replace(one, unit="deg", factor=DEGREE, why=one.why + reason), (times, DEGREE * values)


def doubts(chosen: Sequence[Chosen], parts: Sequence[Part]) -> list[str]:
    """A warning where the size of the numbers contradicts the assumed unit."""
    return [doubt for one, (_, values) in zip(chosen, parts, strict=True) for doubt in _doubts(one, values)]


def are_alike(goal: FloatArray, angle: FloatArray) -> bool:
    """Whether a goal (N,) and the angle (M,) that follows it may be in the same unit, as their sizes say."""
    asked, reached = float(np.abs(goal).max()), float(np.abs(angle).max())
    return asked < ALIKE * reached and reached < ALIKE * asked


def _is_swing_in_degrees(one: Chosen, values: FloatArray) -> bool:
    """Whether an angle without a unit goes to and fro so far that a pendulum in rad would turn over."""
    most = COUNTS if _are_whole(values) and not is_angle(one.series) else TURN
    return _swings_beyond(one, values, np.pi) and not _swings_beyond(one, values, most)


def _swings_beyond(one: Chosen, values: FloatArray, most: float) -> bool:
    """Whether an angle without a unit goes to and fro by more than this."""
    is_unknown = one.column == "position" and one.is_without_unit and values.size > 0
    return is_unknown and crossings(values) >= SWINGS and float(np.ptp(values)) / 2 > most


def check_servo(chosen: Sequence[Chosen], parts: Sequence[Part], name: str) -> None:
    """Refuses goal and angle in whole numbers beyond the turns of a servo in rad, which are degrees or counts of an
    encoder.  Raises RecordingError."""
    unknown = [replace(one, unit="") if to_si(one.unit) is None else one for one in chosen]  # as of increments: inc
    angles = _beyond_a_servo(unknown, [values for _, values in parts])
    numbers = np.concatenate([values for _, values in angles]) if angles else np.empty(0)
    if not angles or not _are_whole(numbers) or all(is_angle(one.series) for one, _ in angles):
        return
    counts, degrees = (
        " ".join(mapped(one.column, one.series, unit) for one, _ in angles) for unit in (COUNTED, ":deg")
    )
    raise RecordingError(
        f"{name}: found whole numbers without a known unit, {numbers.min():g} to {numbers.max():g}, in "
        f"{' and '.join(shown(one.series) for one, _ in angles)}, expected rad, in which a servo with a goal does not "
        f"turn so often; if they are counts of 4096 a turn, use {counts}, if degrees, {degrees}"
    )


def check_swing(chosen: Sequence[Chosen], parts: Sequence[Part], series: Sequence[Series], name: str) -> None:
    """Refuses an angle without a unit that nothing drives, and that goes to and fro beyond half a turn in rad and any
    angle in degrees, as counts of an encoder do.  Raises RecordingError."""
    one, (_, values) = chosen[0], parts[0]
    if len(chosen) > 1 or one.why == "given" or not _swings_beyond(one, values, np.pi) or unused(chosen, parts, series):
        return
    counts, degrees = (mapped(one.column, one.series, unit) for unit in (COUNTED, ":deg"))
    raise RecordingError(
        f"{name}: found a swing from {values.min():g} to {values.max():g} without a known unit in {shown(one.series)}, "
        f"expected rad, in which nothing swings so far; if these are counts of 4096 a turn, use {counts}, if degrees, "
        f"{degrees}"
    )


def _beyond_a_servo(columns: Sequence[Chosen], values: Sequence[FloatArray]) -> list[tuple[Chosen, FloatArray]]:
    """Goal and angle with their numbers, if they have no unit and are beyond the turns of a servo in rad; else none."""
    angles = [(one, numbers) for one, numbers in zip(columns, values, strict=True) if one.column in ANGLES]
    if {one.column for one, _ in angles} != {*ANGLES} or not all(one.is_without_unit for one, _ in angles):
        return []
    if any(_are_counts_in_rad(numbers) for _, numbers in angles):
        return []
    return angles if max(float(np.abs(numbers).max()) for _, numbers in angles) >= MANY_TURNS else []


def _are_counts_in_rad(values: FloatArray) -> bool:
    """Whether numbers are those of an encoder with a power of two counts a turn, in rad."""
    steps = np.diff(np.unique(values))
    if not steps.size:
        return False
    bits = float(np.log2(2 * np.pi / steps.min()))
    return bits >= LEAST_BITS and abs(bits - round(bits)) < EXACT


def _doubts(one: Chosen, values: FloatArray) -> list[str]:
    if one.column == "displacement" and one.is_without_unit:
        millimetres = mapped(one.column, one.series, ":mm")
        return [f"displacement: no unit is given, and m are taken; if its numbers are in mm, use {millimetres}"]
    if one.column == "current" and one.is_without_unit and values.size and np.abs(values).max() > MOTOR_CURRENT:
        said = f"{values.min():.4g} to {values.max():.4g} were taken as A"
        return [f"current: no unit is given, and {said}; if they are mA, use {mapped(one.column, one.series, ':mA')}"]
    if one.column not in ANGLES or one.unit or one.why == "given" or not values.size:
        return []
    is_whole = _are_whole(values) and float(np.ptp(values)) > 2 * np.pi
    if (np.abs(values).max() < MANY_TURNS and not is_whole) or _are_counts_in_rad(values):
        return []
    span = f"{values.min():.4g} to {values.max():.4g}"
    degrees, counts, turns = (mapped(one.column, one.series, each) for each in (":deg", COUNTED, ":rev"))
    what = "whole numbers, which rad hardly are, " if is_whole else ""
    said = f"{one.column}: no unit is given, and {what}{span} were taken as rad"
    other = f"if counts of 4096 a turn, {counts}" if is_whole else f"if turns, {turns}"
    return [f"{said}; if they are degrees, use {degrees}, {other}"]


def _are_whole(values: FloatArray) -> bool:
    return bool((values == np.rint(values)).all())
