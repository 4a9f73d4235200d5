"""What an angle follows: of several goals the one that the drive asks for at each instant; an input that no name tells,
``u``, may be the goal, or what drives a motor; a servo has a goal also where no column has a name, and a motor may be
switched by such a column."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.commands import LEAST as LEAST_SAMPLES
from lostmotion.drivers.formats.commands import LEVELS, levels
from lostmotion.drivers.formats.guess import MOTIONS, Chosen, Guess, mapped
from lostmotion.drivers.formats.source import Part, Series, shown
from lostmotion.drivers.formats.words import SPEED_LETTER, column_of, is_time
from lostmotion.drivers.units import COLUMN_UNITS

__all__ = ["followed", "follows", "goals", "nearest", "switched"]

NEAR, EXPLAINED = 0.1, 0.8
"""How far from 1 the gain of an angle that follows a goal may be, and the least share of the goal's variance that the
angle, its speed and its acceleration explain.  Of three sweeps of a motor with a bar gains are 0.99, of 0.82; of motors
that a voltage drives -0.4 and 0.0, of 0.96."""
SHARE, LEAST = 100, 5
"""The window is this part of the recording, and of so many samples at least.  With half and twice the window the three
sweeps are not explained, and of a sine at 5 Hz the gain is 0.86 and 0.87: the note misses goals, and has called no
voltage of a motor a goal."""
NEARER = 0.5
"""Share of the distance to another goal below which a goal is the nearer one.  Of twelve recordings of drives that make
a smooth motion of their goals 0.006 to 0.015 of it; of two names for one goal 1."""
DRIVES_BY = 0.85
"""Least partial correlation of the acceleration with what drives it: 0.87 to 1.00 of a cart on a belt, in three
recordings and with half and twice the window; of twelve simulated swings of 0.3 to 2.9 rad at most 0.74, beside marks
of the side, the direction and the reversals."""
MOST = 20_000
"""values that are looked at: means of more, as the time of a convolution grows with the square"""


def nearest(guess: Guess, values: Mapping[str, Part]) -> Guess:
    """With the goal that the position follows most closely as the command, where names tell several: a drive makes a
    smooth motion of the goal that it was sent, and asks for that.  What is the position itself is no goal."""
    goal = next((one for one in guess.columns if one.column == "command" and one.why == "by its name"), None)
    moved = next((one for one in guess.columns if one.column in MOTIONS), None)
    if not goal or not moved or len({values[one.series][1].size for one in (goal, moved, *guess.goals)}) != 1:
        return guess
    angle = values[moved.series][1] * moved.factor
    away = {one: float(np.std(values[one.series][1] * one.factor - angle)) for one in (goal, *guess.goals)}
    best = min((one for one in guess.goals if away[one] > 0), key=lambda one: away[one], default=goal)
    if not away[best] < NEARER * away[goal]:
        return guess
    columns = [best if one is goal else one for one in guess.columns]
    left = ("command: also found", "not used")
    notes = [
        note.replace(shown(best.series), shown(goal.series)) if note.startswith(left) else note for note in guess.notes
    ]
    return replace(guess, columns=columns, notes=notes)


def goals(
    chosen: Sequence[Chosen], parts: Sequence[Part], series: Sequence[Series]
) -> tuple[list[Chosen], list[Part], list[str]]:
    """The columns and their times and values, with an input that would count as the motor's voltage, and is the goal
    that the position follows, as the command; and what a person should know."""
    kept, moved = list(chosen), [at for at, one in enumerate(chosen) if one.column in MOTIONS]
    inputs = [
        at for at, one in enumerate(chosen) if one.column == "voltage" and one.why.startswith("the motor's input")
    ]
    if not inputs or not moved:
        return kept, list(parts), []
    (at, *_), (of, *_) = inputs, moved
    one, (times, values), motion, (_, angle) = kept[at], parts[at], kept[of], parts[of]
    if values.size != angle.size:
        return kept, list(parts), []
    gain = _gain(times, values, angle / motion.factor)
    if abs(gain - 1) > NEAR:
        return kept, list(parts), []
    taken = {each.series for each in chosen}
    others = [
        each.name for each in series if each.name not in taken and not (is_time(each.name) or column_of(each.name))
    ]
    drive = next((name for name in others if SPEED_LETTER.fullmatch(name)), "SERIES")
    why = f"{shown(motion.series)} follows it with a gain of {gain:.2f}"
    kept[at] = replace(motion, column="command", series=one.series, why=why)
    goal = (times, values / one.factor * motion.factor)
    said = (
        f"command: {shown(one.series)} is taken as the goal, as {why}; if it drives the motor, use "
        f"{mapped('voltage', one.series)}, or give what drives it: {mapped('voltage', drive)}"
    )
    return kept, [goal if place == at else part for place, part in enumerate(parts)], [said]


def followed(
    chosen: Sequence[Chosen], parts: Sequence[Part], left: Mapping[str, Part]
) -> tuple[list[Chosen], list[Part]]:
    """The columns of a servo and their times and values, with the first of the series without a name (``left``) that
    the position follows, and does not precede, as the command."""
    kept, own = list(chosen), list(parts)
    of = next(at for at, one in enumerate(kept) if one.column in MOTIONS)
    motion, angle = kept[of], own[of][1] / kept[of].factor
    for name, (times, values) in left.items():
        if values.size == angle.size and abs((gain := _gain(times, values, angle)) - 1) <= NEAR:
            why = f"{shown(motion.series)} follows it with a gain of {gain:.2f}"
            kept.append(replace(motion, column="command", series=name, why=why))
            own.append((times, values * motion.factor))
            break
    return kept, own


def switched(
    chosen: Sequence[Chosen], parts: Sequence[Part], left: Mapping[str, Part]
) -> tuple[list[Chosen], list[Part]]:
    """The columns of a joint and their times and values, with the only one of the series without a name (``left``) that
    has a few values, and that the acceleration follows, as the voltage of a motor."""
    kept, own = list(chosen), list(parts)
    of = next(at for at, one in enumerate(kept) if one.column in MOTIONS)
    times, angle = own[of]
    few = {
        name: values for name, (_, values) in left.items()
        if values.size == angle.size >= LEAST_SAMPLES and 1 < levels(values) <= LEVELS
    }  # fmt: skip
    found = [name for name, values in few.items() if abs(_drives(times, values, angle)) > DRIVES_BY]
    if len(found) == 1:
        why = f"it is switched, and the acceleration of {shown(kept[of].series)} follows it"
        kept.append(Chosen("voltage", found[0], "", COLUMN_UNITS["voltage"], 1.0, 0.0, why))
        own.append((times, few[found[0]]))
    return kept, own


def _drives(times: FloatArray, drive: FloatArray, angle: FloatArray) -> float:
    """The partial correlation of the acceleration with what may drive it (N,), given the angle (N,) and its cube, the
    speed, its direction and a constant: what moves freely has an acceleration that these explain."""
    times, drive, angle = (_thinned(values) for values in (times, drive, angle))
    angle = angle - angle.mean()
    place, speed, acceleration = _smoothed(times, angle)
    cube, way = (_smoothed(times, values)[0] for values in (angle**3, np.sign(np.gradient(angle))))
    known = np.stack([place, cube, speed, way, np.ones_like(speed)], axis=1)
    known = known / np.maximum(np.abs(known).max(axis=0), 1e-300)
    left = [each - known @ np.linalg.lstsq(known, each, rcond=None)[0]
            for each in (acceleration, _smoothed(times, drive)[0])]  # fmt: skip
    size = float(np.linalg.norm(left[0]) * np.linalg.norm(left[1]))
    return float(left[0] @ left[1]) / size if size > 0 else 0.0


def _smoothed(times: FloatArray, values: FloatArray) -> list[FloatArray]:
    """The values (N,), and their first and second derivatives, weighted by a smooth window (M,)."""
    width = max(values.size // SHARE, LEAST)
    window = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 4
    step = float(np.median(np.diff(times))) or 1.0
    windows = [window, first := np.gradient(window, step), np.gradient(first, step)]
    return [np.convolve(values, each / window.sum(), "valid") for each in windows]


def _gain(times: FloatArray, goal: FloatArray, angle: FloatArray) -> float:
    """The gain by which an angle (N,) follows a goal (N,), or settles at it, whichever is nearer to 1; 0 for neither,
    or where the angle is ahead."""
    gains = follows(times, goal, angle), _settles(goal, angle)
    return min(gains, key=lambda each: abs(each - 1))


def follows(times: FloatArray, goal: FloatArray, angle: FloatArray) -> float:
    """The gain by which an angle (N,) follows a goal (N,): c of goal = c angle + its speed and acceleration, each by a
    factor, + a constant, all weighted by the same smooth window, so that no noise is differentiated.  0 where this
    does not explain the goal."""
    times, goal, angle = (_thinned(values) for values in (times, goal, angle))
    width = max(goal.size // SHARE, LEAST)
    if goal.size < 4 * width or not (np.ptp(goal) > 0 and np.ptp(angle) > 0):
        return 0.0
    columns = np.stack(_smoothed(times, angle - angle.mean()), axis=1)
    columns = columns - columns.mean(axis=0)
    smooth = _smoothed(times, goal - goal.mean())[0]
    smooth = smooth - smooth.mean()
    size = np.abs(columns).max(axis=0)
    if not size.all() or not smooth.any():
        return 0.0
    factors = np.linalg.lstsq(columns / size, smooth, rcond=None)[0]
    left = smooth - columns / size @ factors
    return float(factors[0] / size[0]) if float(left @ left) < (1 - EXPLAINED) * float(smooth @ smooth) else 0.0


def _settles(goal: FloatArray, angle: FloatArray) -> float:
    """The gain by which an angle (N,) settles at a goal (N,) that steps from where it began; 0 where it does not."""
    last = max(goal.size // SHARE, LEAST)
    step = goal[-1] - goal[0]
    if goal.size < 4 * last or not step or np.ptp(goal[-last:]) > 0:
        return 0.0
    far = max(abs(angle[0] - goal[0]), float(np.abs(angle[-last:] - goal[-1]).max()))
    return float((angle[-last:].mean() - angle[0]) / step) if far < NEAR * abs(step) else 0.0


def _thinned(values: FloatArray) -> FloatArray:
    """The means of as many neighbours as make these (N,) few enough."""
    every = -(-values.size // MOST)
    return values[: values.size // every * every].reshape(-1, every).mean(axis=1) if every > 1 else values
