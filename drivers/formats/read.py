"""A recording out of a file of another program, and what was taken for what, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.codec.recording_csv import LARGEST
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.angles import ASSUMED, check_servo, check_swing, doubts, in_degrees
from lostmotion.drivers.formats.bag import Bag
from lostmotion.drivers.formats.commands import held, undriven, unnamed, unused
from lostmotion.drivers.formats.consistency import BY_SPEED, by_speed, goal_beside, speeds_of
from lostmotion.drivers.formats.differences import with_differences
from lostmotion.drivers.formats.goal import followed, goals, nearest, switched
from lostmotion.drivers.formats.guess import (
    DRIVES,
    MOTIONS,
    NO_MOTION,
    NOT_USED,
    POWERS,
    Chosen,
    Guess,
    guessed,
    not_used,
    unknown,
)
from lostmotion.drivers.formats.motion import (
    liveliest,
    with_angle,
    without_constant,
    without_inertia,
    without_still,
)
from lostmotion.drivers.formats.registry import Opener, open_source
from lostmotion.drivers.formats.runs import of_its_number, of_one_run
from lostmotion.drivers.formats.source import Choice, Part, Samples, Series, Source, shown
from lostmotion.drivers.formats.swinging import drift_of
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import is_gyroscope
from lostmotion.drivers.recording import Recording, merge
from lostmotion.drivers.units import COLUMN_UNITS, to_si

__all__ = ["Imported", "imported"]

INTEGRAL = {"rad/s": "rad", "m/s": "m"}
"""of a speed that is mapped to a position: encoders of motors often report nothing else"""


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """A recording, what each of its columns was, and what a person should know of it."""

    recording: Recording
    kind: str
    clock: str
    columns: Sequence[Chosen]
    notes: Sequence[str]

    def lines(self) -> list[str]:
        """What was taken for what, a line a column."""
        name = self.recording.name
        head = f"{name}: {self.kind}; time: {self.clock}"
        return [head, *(f"  {_column_line(one)}" for one in self.columns), *(f"  note: {note}" for note in self.notes)]


def imported(path: Path, choice: Choice, opened: Opener = open_source) -> Imported:
    """Reads a file of any known format.  Raises RecordingError, one line."""
    source, still = _chosen(opened(path), choice)
    name = str(path) if choice.episode is None else f"{path}#episode={choice.episode}"
    guess, samples, clock = _guessed(source, choice, path)
    if isinstance(source, Table) and (constant := _constant(guess, samples)):
        source = without_constant(source, choice, constant)
        guess, samples, clock = _guessed(source, choice, path)
    guess = nearest(guess, samples.values)
    kept, parts, told = _filled(guess.columns, samples, name)
    notes = [*source.notes, *samples.notes, *still, *guess.notes, *told]
    check_servo(kept, parts, name)
    kept = _of_axis(kept)
    left = _unnamed(kept, source, clock, choice)
    if left:
        kept, parts = (followed if choice.base == "servo" else switched)(kept, parts, left)
        notes = [note for note in notes if not note.startswith(NOT_USED)]
        notes += not_used([one for one in source.series if one.name != clock], [*guess.columns, *kept])
    kept, parts, of_speed = by_speed(kept, parts, samples.values, _speeds(guess, source))
    kept, parts, told = in_degrees(kept, parts, source.series)
    if choice.base == "joint":
        check_swing(kept, parts, source.series, name)
    kept, parts, of_goal = goals(kept, parts, source.series)
    left_drive = of_goal or unused(kept, parts, source.series) or _undriven(kept, parts, left)
    notes += [*of_speed, *told, *goal_beside(kept, parts), *doubts(kept, parts), *left_drive]
    metadata = _metadata(source.kind, guess, kept, samples)
    if left_drive and not POWERS & {*choice.terms}:
        metadata["imported"]["left_drive"] = left_drive[0]
        metadata["imported"] |= {"follows_goal": True} if of_goal else {}
    parts, told = held(kept, parts)
    time, columns = _merged(kept, parts)
    if time.size and not time[-1] <= LARGEST:
        raise RecordingError(f"{name}: found rows over {time[-1]:.3g} s, expected at most {LARGEST:g}")
    recording = Recording(time, columns, metadata, name=name)
    return Imported(recording, source.kind, samples.clock, kept, [*notes, *told])


def _chosen(source: Source, choice: Choice) -> tuple[Source, Sequence[str]]:
    """The run that was chosen, with what follows from other series of a table, and what was left out of it.  Raises
    RecordingError."""
    if isinstance(source, Bag):
        return of_its_number(source, choice), ()
    if not isinstance(source, Table):
        return source, ()
    return without_still(with_angle(with_differences(of_one_run(source, choice), choice), choice), choice)


def _guessed(source: Source, choice: Choice, path: Path) -> tuple[Guess, Samples, str]:
    """What becomes a column, its samples, and the series that is the time although its name does not say so.

    Raises RecordingError.
    """
    clock, moving, spans = "", {}, unknown
    if isinstance(source, Table):
        clock, spans = source.clock, source.spans
        moving = liveliest(source, choice) | without_inertia(source, choice)
    guess = guessed(source.series, choice, str(path), clock, moving, spans)
    names = [one.series for one in (*guess.columns, *guess.goals)] + [one.name for one in _speeds(guess, source)]
    return guess, source.read(names, choice), clock


def _unnamed(columns: Sequence[Chosen], source: Source, clock: str, choice: Choice) -> Mapping[str, Part]:
    """The samples of the series without a name that may drive the motion, where no drive is known."""
    counting = source.counting if isinstance(source, Table) else ()
    left = unnamed(columns, source.series, {clock, *counting})
    return source.read(left, choice).values if left else {}


def _undriven(chosen: Sequence[Chosen], parts: Sequence[Part], left: Mapping[str, Part]) -> list[str]:
    """Notes on the series without a name that may drive the motion, where nothing else does."""
    if not left or any(one.column in DRIVES for one in chosen):
        return []
    return undriven(left, next(part for one, part in zip(chosen, parts, strict=True) if one.column in MOTIONS))


def _speeds(guess: Guess, source: Source) -> Sequence[Series]:
    """The speeds of the angle in a table, which show its unit."""
    return speeds_of(guess.columns, source.series) if isinstance(source, Table) else ()


def _constant(guess: Guess, samples: Samples) -> list[str]:
    """The series of motions that never change, of those that were taken by their names."""
    named = [one.series for one in guess.columns if one.column in MOTIONS and one.why == "by its name"]
    return [name for name in named if (values := samples.values[name][1]).size and not np.ptp(values) > 0]


def _filled(columns: Sequence[Chosen], samples: Samples, name: str) -> tuple[list[Chosen], list[Part], list[str]]:
    """The columns that hold numbers, their times and values in SI units, and what a person should know of them.

    Raises RecordingError.
    """
    parts, kept, notes = list[Part](), list[Chosen](), list[str]()
    for one in columns:
        times, values = samples.values[one.series]
        if values.size == 0 and one.why != "given":
            notes.append(f"{one.column}: left out, {shown(one.series)} holds no numbers")
            continue
        values = _converted(one, values, name)
        if one.column in MOTIONS and one.si in INTEGRAL:
            values, note = _integrated(one, times, values, not any(each.column in DRIVES for each in columns))
            one, notes = replace(one, si=INTEGRAL[one.si]), [*notes, note]
        parts.append((times, values))
        kept.append(one)
    if not any(times.size for times, _ in parts):
        raise RecordingError(
            f"{name}: found no numbers in {', '.join(shown(one.series) for one in columns)}, expected samples; "
            "was the recording stopped at once?"
        )
    return kept, parts, notes


def _of_axis(chosen: Sequence[Chosen]) -> list[Chosen]:
    """The columns, with what drives an axis along a line in N, where it has no unit of its own."""
    is_linear = any(one.column in MOTIONS and one.si == "m" for one in chosen)
    return [
        replace(one, si="N") if is_linear and one.column == "torque" and not one.unit and one.si == "N m" else one
        for one in chosen
    ]


def _converted(one: Chosen, values: FloatArray, name: str) -> FloatArray:
    beyond = np.flatnonzero(~(np.abs(values) <= LARGEST))
    if beyond.size:
        raise RecordingError(
            f"{name}: found {values[beyond[0]]} in {shown(one.series)!r}, expected finite numbers up to {LARGEST:g}"
        )
    return values * one.factor + one.offset


def _integrated(one: Chosen, times: FloatArray, speed: FloatArray, is_free: bool) -> tuple[FloatArray, str]:
    """The position (N,) by the trapezoidal rule, zero at the first sample, and what a person should know of it;
    is_free: whether nothing is known to drive the motion."""
    position = np.concatenate([np.zeros_like(speed[:1]), np.cumsum(np.diff(times) * (speed[1:] + speed[:-1]) / 2)])
    drift = drift_of(times, position, speed) if is_free or is_gyroscope(one.series) else 0.0
    less = f" less {drift:.3g} {one.si}, by which its swings move on in both halves" if drift else ""
    return position - drift * (times - times[:1]), f"{one.column}: integrated from a speed{less}, from zero on"


def _merged(chosen: Sequence[Chosen], parts: Sequence[Part]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Rows in time order; columns that were sampled together stay together."""
    sources: dict[int, tuple[FloatArray, dict[str, FloatArray]]] = {}
    for one, (times, values) in zip(chosen, parts, strict=True):
        sources.setdefault(id(times), (times, {}))[1][one.column] = values
    if len(sources) == 1:
        return next(iter(sources.values()))
    time, columns = merge(*sources.values())
    return time, {one.column: columns[one.column] for one in chosen}


def _metadata(kind: str, guess: Guess, chosen: Sequence[Chosen], samples: Samples) -> dict[str, Any]:
    metadata = dict(samples.metadata)
    if guess.joint:
        metadata["joint"] = _plain(guess.joint)
    if samples.start is not None:
        metadata["start"] = samples.start
    metadata["imported"] = {"format": kind, **{one.column: _plain(one.series) for one in chosen}}
    metadata["imported"] |= {f"{one.column}_given": True for one in chosen if one.why == "given"}
    assumed = [one for one in chosen if one.why.endswith((ASSUMED, BY_SPEED))]
    metadata["imported"] |= {f"{one.column}_assumed": one.unit for one in assumed}
    if any(one.column == "position" and one.si == "rad" and one.is_without_unit for one in chosen):
        metadata["imported"]["position_without_unit"] = True
    if left_motion := [note for note in guess.notes if note.startswith(NO_MOTION)]:
        metadata["imported"]["left_motion"] = left_motion[0].removeprefix(NO_MOTION)
    return metadata | {f"{one.column}_unit": one.si for one in chosen if one.si != COLUMN_UNITS[one.column]}


def _plain(name: str) -> str:
    """A name that can be written to any file."""
    return name.encode("utf-8", errors="replace").decode()


def _column_line(one: Chosen) -> str:
    if one.unit:
        unit = one.unit if to_si(one.unit) in (None, (one.si, 1.0)) else f"{one.unit}, now {one.si}"
    elif one.factor != 1 or one.offset:
        unit = f"times {one.factor:g}{f' {one.offset:+g}' if one.offset else ''} [{one.si}]"
    else:
        unit = f"{one.si}, as no unit is given"
    return f"{one.column} = {shown(one.series)}  ({unit}; {one.why})"
