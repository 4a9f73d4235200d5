"""Which series becomes which column: by the options, else by the names.  Pure functions."""

from __future__ import annotations

import difflib
import math
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import DATE, Choice, Series, Term, shown
from lostmotion.drivers.formats.words import (
    UNNAMED,
    column_of,
    is_angle,
    is_angular,
    is_commanded,
    is_error,
    is_estimated,
    is_input,
    is_other,
    is_reached,
    is_time,
    joint_of,
    puts_out,
    speed_of,
    unit_of,
)
from lostmotion.drivers.units import COLUMN_UNITS, MANY_TURNS, to_si

__all__ = [
    "DRIVES",
    "MOTIONS",
    "NOT_USED",
    "NO_MOTION",
    "POWERS",
    "Chosen",
    "Guess",
    "guessed",
    "listed",
    "mapped",
    "named",
    "not_used",
    "unknown",
]

OF_JOINTS = ("command", "position", "torque", "current", "voltage", "temperature")
LINEAR = ("displacement", "force")
MOTIONS = {"position", "displacement"}
POWERS = {"torque", "force", "current", "voltage"}
DRIVES = {"command", *POWERS}
FORCE = "F"
"""the symbol of a force, and of a temperature where nothing moves"""
GOAL = "r"
"""the symbol of a goal"""
MOTOR_SPEED = 1000.0
"""a speed beside a torque, beyond which it is taken in rpm: in rad/s it would be 9500 rpm"""
SHOWN = 12
MOVES_MOST = "it moves most"
NOT_USED = "not used: "
NO_MOTION = "position: none; "
"""how a note begins on what to type for the motion"""
NEAREST = "the goal that the position follows most closely"


class _Axis(NamedTuple):
    """What is said of a motion that is asked for: its column, that of what drives it, units, that of numbers beyond
    ``MANY_TURNS``, those of a speed, and what it is."""

    motion: str
    drive: str
    units: str
    beyond: str
    speeds: str
    kind: str

    def unit(self, span: tuple[float, float]) -> str:
        """The unit that is suggested from the least to the largest number: none where it may be in rad, or in m."""
        return self.beyond if max(map(abs, span)) > MANY_TURNS else ""


TURN = _Axis("position", "torque", "rad; else :deg, :mm", ":deg", ":rad/s, :rpm", "an angle")
FOLLOWED = TURN._replace(drive="command")
LINE = _Axis("displacement", "force", "m; else :mm", ":mm", ":m/s", "a place")

Spans = Callable[[Sequence[str]], Mapping[str, tuple[float, float]]]
"""The least and the largest number of series, by their names."""


def unknown(names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """The ``Spans`` of series of which no numbers are looked at."""
    return dict.fromkeys(names, (-math.inf, math.inf))


@dataclass(frozen=True, slots=True)
class Chosen:
    """One column of the recording: ``factor * series + offset``, in the unit ``si``; why: the reason, as text.

    unit: that of the series, "" where it is unknown.
    """

    column: str
    series: str
    unit: str
    si: str
    factor: float
    offset: float
    why: str

    @property
    def is_without_unit(self) -> bool:
        """Whether neither the file nor the options say what its numbers are in."""
        return not self.unit and self.why != "given" and self.factor == 1


@dataclass(frozen=True, slots=True)
class Guess:
    """joint: "" where the file names none; notes: what was not clear, and what else there was; goals: that names tell
    beside the command."""

    columns: Sequence[Chosen]
    joint: str
    notes: Sequence[str]
    goals: Sequence[Chosen] = ()


def guessed(
    series: Sequence[Series],
    choice: Choice,
    name: str,
    clock: str = "",
    moving: Mapping[str, str] | None = None,
    spans: Spans = unknown,
) -> Guess:
    """The columns of a recording, or RecordingError.  name: of the file, in errors; clock: the series that is the time
    although its name does not say so; moving: by column the axis that moves most; spans: for what is suggested."""
    candidates = _candidates([one for one in series if one.name != clock], choice)
    _check_topics(series, choice.topics, name)
    moved = _changing(series, spans)
    joint = _joint(candidates, [one.name for one in moved if speed_of(one.name) is not None], choice, name)
    chosen, notes = {}, []
    for column, term in choice.terms.items():
        if term.name and column != "time":
            chosen[column] = _chosen(column, *named(term, series, joint, name), "given")
    candidates = _beside_given(candidates, chosen)
    for column in COLUMN_UNITS:
        found = _of_joint(candidates.get(column, []), column, joint)
        if moving and column in moving and (column == "accel" or not MOTIONS & {*chosen}):
            term = Term(moving[column], moving.get("unit", ""))
            chosen[column] = _chosen(column, *named(term, series, joint, name), moving.get("why", MOVES_MOST))
        elif len(found) > 1 and column == "accel":
            notes.append(f"accel: not taken, found {listed(found)}; choose one with {mapped('accel', found[0].name)}")
        elif found:
            chosen[column] = _chosen(column, found[0], Term(found[0].name), "by its name")
            notes += [f"{column}: also found {listed(found[1:])}"] if found[1:] else []
    more, told = _inferred(moved, choice, joint, chosen, (moving or {}).get("speed", ""), spans)
    chosen, notes = chosen | more, notes + told
    chosen |= _eliminated(series, choice, clock, chosen, (moving or {}).get("rough", ""))
    if not chosen:
        advice = _advised(series, clock, moving or {}, spans, choice, notes)
        raise RecordingError(f"{name}: found {listed(series)}, and none that is clearly a column; {advice}")
    notes += _of_left([one for one in series if one.name != clock], chosen, notes, spans)
    goals = [_chosen("command", one, Term(one.name), NEAREST) for one in _others("command", candidates, joint, chosen)]
    return Guess([chosen[column] for column in COLUMN_UNITS if column in chosen], joint, notes, goals)


def _others(
    column: str, candidates: Mapping[str, Sequence[Series]], joint: str, chosen: Mapping[str, Chosen]
) -> list[Series]:
    """The series that may be a column by their names, beside the one that was chosen."""
    found = _of_joint(candidates.get(column, []), column, joint) if column in chosen else []
    return [one for one in found if one.name != chosen[column].series]


def _beside_given(candidates: Mapping[str, Sequence[Series]], given: Mapping[str, Chosen]) -> dict[str, list[Series]]:
    """The candidates without series that were given as another column, and without what drives, where that was given:
    a voltage that a person chose is not outranked by a current of which only the name is known."""
    taken = {one.series for one in given.values()}
    is_driven = bool(POWERS & {*given})
    return {
        column: [one for one in found if one.name not in taken]
        for column, found in candidates.items()
        if not (is_driven and column in POWERS)
    }


def _eliminated(
    series: Sequence[Series], choice: Choice, clock: str, chosen: Mapping[str, Chosen], rough: str
) -> dict[str, Chosen]:
    """The motion, where it is the only series beside the time, or beside the time and a command, unless its unit is
    that of another quantity, or it does not move as what has an inertia does (``rough``): an angle, or a place where
    the model moves along a line."""
    used = {one.series for one in chosen.values()}
    rest = [one for one in _unnamed(series, clock) if one.name not in used]
    rest = [one for one in rest if not is_error(one.name)] or rest
    if {*chosen} - {"command"} or len(rest) != 1 or MOTIONS & {*choice.terms}:
        return {}
    (one,) = rest
    if one.name == rough or not _may_be_position(one):
        return {}
    if not _is_alone(series) and (is_input(one.name) or (chosen and is_other(one.name))):
        return {}
    why = f"the only series beside the time{' and the command' * len(chosen)}"
    column = (LINE if choice.is_linear and not to_si(one.unit or unit_of(one.name, "position")) else TURN).motion
    return {column: _chosen(column, one, Term(one.name), why)}


def _is_alone(series: Sequence[Series]) -> bool:
    """Whether there is one series beside the time."""
    return sum(not is_time(one.name) for one in series) == 1


def _changing(series: Sequence[Series], spans: Spans) -> Sequence[Series]:
    """The series without speeds that never change, where another one does."""
    speeds = [one.name for one in series if speed_of(one.name) is not None]
    known = spans(speeds) if len(speeds) > 1 else {}
    still = [name for name, (low, high) in known.items() if low == high]
    return [one for one in series if one.name not in still] if len(still) < len(speeds) else series


def _of_left(series: Sequence[Series], chosen: Mapping[str, Chosen], notes: Sequence[str], spans: Spans) -> list[str]:
    """What is not used, and what to type for the motion where only what drives it was found, and nothing is said of a
    speed."""
    left, told = _left(series, chosen.values()), not_used(series, chosen.values())
    if {"accel", *MOTIONS} & {*chosen} or any(note.startswith(("position", "accel")) for note in notes):
        return told
    left = _unnamed(left, "")
    names = [one.name for one in left if _may_be_position(one) and not (is_other(one.name) or is_input(one.name))]
    moves = next(((name, span) for name, span in spans(names).items() if span[0] < span[1]), None)
    if moves is None:
        return told
    name, span = moves
    return [*told, f"{NO_MOTION}if {shown(name)} is it, use {mapped('position', name, TURN.unit(span))}"]


def not_used(series: Sequence[Series], chosen: Iterable[Chosen]) -> list[str]:
    """A note on the series that are no columns."""
    left = _left(series, chosen)
    return [f"{NOT_USED}{listed(left)}"] if left else []


def _left(series: Sequence[Series], chosen: Iterable[Chosen]) -> list[Series]:
    used = {one.series for one in chosen}
    return [one for one in series if one.name not in used and not is_time(one.name)]


def _advised(
    series: Sequence[Series], clock: str, moving: Mapping[str, str], spans: Spans, choice: Choice, notes: Sequence[str]
) -> str:
    """What to type where no column was found, also of several accelerometers: one is enough for what moves along a line
    only."""
    several = " ".join(note for note in notes if note.startswith("accel"))
    axis = LINE if choice.is_linear else FOLLOWED if choice.base == "servo" else TURN
    advice = "" if several and axis is LINE else _advice(series, clock, moving, spans, axis)
    return "; ".join(filter(None, (advice, several)))


def _inferred(
    series: Sequence[Series], choice: Choice, joint: str, chosen: Mapping[str, Chosen], gyroscope: str, spans: Spans
) -> tuple[dict[str, Chosen], list[str]]:
    """The motion, by the name of its goal or by its speed, and what drives it, where no names say them; and what a
    person should know.  gyroscope: the speed whose axis moves most; spans: see ``guessed``."""
    found = {} if "position" in {*chosen, *choice.terms} else _reached(series, chosen)
    notes: list[str] = []
    if not MOTIONS & {*chosen, *found, *choice.terms}:
        turning = [one for one in series if one.name == (gyroscope or one.name)]
        speed, note = _speed(turning, joint, spans if POWERS & {*chosen} else unknown)
        found, notes = found | speed, notes + note
    if MOTIONS & {*chosen, *found} and not DRIVES & {*chosen, *choice.terms}:
        driven, note = _input(series, joint)
        found |= driven
        notes += note
    return found | (_along_a_line({**chosen, **found}, series) if "force" in {*chosen, *found} else {}), notes


def _candidates(series: Sequence[Series], choice: Choice) -> dict[str, list[Series]]:
    """The series that may be each column that was not given, by their names."""
    found: dict[str, list[Series]] = {}
    for one in series:
        if (column := column_of(one.name)) and column not in choice.terms:
            found.setdefault(column, []).append(one)
    return {column: _of_topics(fits, choice.topics) for column, fits in found.items()}


def _unnamed(series: Sequence[Series], clock: str) -> list[Series]:
    """The series that may be a motion by their names, which say nothing."""
    others = [one for one in series if one.name != clock and not is_time(one.name) and one.unit != DATE]
    return [one for one in others if speed_of(one.name) is None]


def mapped(column: str, series: str, unit: str = "") -> str:
    """The option that assigns a series, as a shell takes it."""
    return f"--map {shlex.quote(f'{column}={shown(series)}{unit}')}"


def _advice(series: Sequence[Series], clock: str, moving: Mapping[str, str], spans: Spans, axis: _Axis) -> str:
    """What to type where no column was found."""
    if not series:
        return "it holds no series; was something recorded?"
    if all(is_time(one.name) or one.name == clock for one in series):
        ticks = "or if each is that of a tick of an encoder, write the numbers of the ticks beside them"
        return f"it holds times only; join it with the file of the motion: MOTION+FILE, {ticks}"
    known = spans([one.name for one in series if not is_time(one.name) and one.name != clock and one.unit != DATE])
    if known and all(low == high for low, high in known.values()):
        return "nothing in it changes; was something recorded?"
    if rows := moving.get("rows"):
        address = f"FILE#rate-hz={rows},{axis.motion}={shown(moving['perhaps'])}"
        others = [one.name for one in series if one.name not in (moving["perhaps"], moving["rate"])]
        if len(others) == 1:
            driven = shlex.quote(f"{address},{axis.drive}={shown(others[0])}")
            drives = f"{driven}, if {shown(others[0])} is the {axis.drive}"
        else:
            drives = f"{shlex.quote(address)}, and a {axis.drive} as {axis.drive}=SERIES"
        return f"{moving['why']}, if there are {rows} rows a second: {drives}"
    if why := moving.get("why"):
        motion, drive = mapped(axis.motion, moving["perhaps"]), mapped(axis.drive, "SERIES")
        goal = f", or a servo's goal, as in {mapped('command', 'SERIES')}" * (axis is TURN)
        return f"{why}: assign one of them, as in {motion}, and what drives it, as in {drive}{goal}"
    example = _example(series, clock, moving, spans, axis)
    units = f"({axis.units}, *FACTOR for counts; a speed: {axis.speeds})"
    if rough := moving.get("rough"):
        said = f"{shown(rough)} neither swings nor keeps its speed, as what has an inertia does"
        kind = axis.kind if speed_of(rough) is None else "the speed of one"
        return f"{said}; if it is {kind} all the same, use {example} {units}"
    return f"assign them, as in {example} {units}"


def _example(series: Sequence[Series], clock: str, moving: Mapping[str, str], spans: Spans, axis: _Axis) -> str:
    """How the first series that changes would be assigned, or the one that swings, and the next one as what drives it,
    or the one whose name says so; without times the one that ascends (``rising``) as these."""
    if swings := moving.get("perhaps", ""):
        return mapped(axis.motion, swings, axis.unit(spans([swings])[swings]))
    if turns := moving.get("gyroscope", "") if axis is not LINE else "":
        return mapped(axis.motion, turns, f"{axis.unit(spans([turns])[turns]) or ':rad'}/s")
    named_so = [one.name for one in series if not is_time(one.name) and one.name != clock and one.unit != DATE]
    known = spans(named_so)
    names = [one for one in named_so if known[one][0] < known[one][1]] or named_so
    names = [one for one in names if one != moving.get("counting")] or names
    names = sorted(names, key=lambda one: one != moving.get("slow", one))
    if not clock and len(named_so) == len(series) > 1:
        rising = moving.get("rising", "")
        others = [one for one in names if one != rising] or names
        moves = next((one for one in others if not is_input(one)), others[0])
        unit = axis.unit(known[moves])
        driven = "".join([f",voltage={shown(one)}" for one in others if one != moves and is_input(one)][:1])
        without = shlex.quote(f"FILE#rate-hz=100,{axis.motion}={shown(moves)}{unit}{driven}")
        if not rising:
            return f"{without}, if there are 100 rows a second"
        given = f"{mapped('time', rising, moving['steps'])} {mapped(axis.motion, moves, unit)}"
        return f"{given}, or without times, if there are 100 rows a second, {without}"
    return _pair(names, series, moving.get("input", ""), known, axis)


def _pair(
    names: Sequence[str], series: Sequence[Series], switched: str, known: Mapping[str, tuple[float, float]], axis: _Axis
) -> str:
    """How the first of these would be assigned as the motion, and another one as what drives it: an input by its name,
    or the one that is ``switched``; known: the least and the largest number of each."""
    has_input = any(is_input(one) for one in names)  # as in r, u, y: y is what u drives
    if axis is FOLLOWED and len(names) > 1 and all(map(UNNAMED.fullmatch, names)):
        goal, angle, *_ = (one.name for one in series if one.name in names)  # programs write the goal first
        names, switched = [angle, goal], ""
    ranked = sorted(names, key=lambda one: (one == switched, _may_drive(one), has_input and one != "y"))
    first, *others = ranked or ["SERIES"]
    if column := column_of(first):  # one of several, among which none was chosen
        return mapped({"position": axis.motion, "torque": axis.drive}.get(column, column), first)
    rest = [one for one in others if not is_other(one) and not _are_alike(one, first)]
    drives = [one for one in rest if _may_drive(one)] or [one for one in rest if one == switched] or rest
    is_forced = FORCE in drives[:1]
    is_speed = re.search("velo|speed", first, re.IGNORECASE) or (is_forced and first == "v")
    if not all(_may_be_position(one) for one in series if one.name == first):
        unit = "*FACTOR"
    elif is_speed:
        unit = ":m/s" if is_forced else axis.speeds.partition(",")[0]
    else:
        has_unit = unit_of(first, "position") or is_forced
        unit = "" if has_unit else axis.unit(known.get(first, (-math.inf, math.inf)))
    driven = "force" if is_forced else axis.drive
    has_goal = driven == FOLLOWED.drive
    goals = [one for one in rest if one == GOAL and one not in drives[:1]]
    return ", and ".join(
        [
            mapped(axis.motion, first, unit),
            *(
                f"{'its goal' if has_goal else f'a {driven}'} {mapped(driven, one, unit * has_goal)}"
                for one in drives[:1]
            ),
            *(f"for a servo its goal {mapped('command', one, unit)}" for one in goals if not has_goal),
        ]
    )


def _are_alike(name: str, other: str) -> bool:
    """Whether two names differ by their numbers only, as those of two joints do: ``joint1`` and ``joint2``."""
    return not UNNAMED.fullmatch(name) and "[" not in name and re.sub(r"\d", "", name) == re.sub(r"\d", "", other)


def _may_drive(name: str) -> bool:
    """Whether a name is that of a motor's input, or the symbol of a force."""
    return is_input(name) or name == FORCE


def _reached(series: Sequence[Series], chosen: Mapping[str, Chosen]) -> dict[str, Chosen]:
    """What the command asks for, by its name, as the position."""
    goal = chosen["command"].series if "command" in chosen else ""
    one = next((one for one in series if goal and is_reached(one.name, goal)), None)
    return {"position": _chosen("position", one, Term(one.name), f"what {goal} asks for")} if one else {}


def _speed(series: Sequence[Series], joint: str, spans: Spans) -> tuple[dict[str, Chosen], list[str]]:
    """The position as the integral of a speed, where a file has no other motion; and what a person should know.
    spans: see ``guessed``, of a motor."""
    found = [(one, unit) for one in series if (unit := speed_of(one.name)) is not None]
    own = [(one, unit) for one, unit in found if joint_of(one.name) in (joint, "") or len(found) == 1]
    one, unit = (own or found or [(Series(""), "")])[0]
    notes = []
    if not (one.unit or unit) and _is_alone(series) and is_angular(one.name):
        unit, degrees = "rad/s", mapped("position", one.name, ":deg/s")
        notes = [f"position: no unit is given, and {shown(one.name)} is taken in rad/s; else use {degrees}"]
    elif (
        len(own) == 1 and not (one.unit or unit) and MOTOR_SPEED < max(map(abs, spans([one.name])[one.name])) < math.inf
    ):
        unit, other = "rpm", mapped("position", one.name, ":rad/s")
        notes = [f"position: no unit is given, and {shown(one.name)} is taken in rpm; else use {other}"]
    if len(own) != 1 or not (one.unit or unit):
        told = f"{NO_MOTION}{mapped('position', one.name, ':rpm')} (or :rad/s) integrates a speed"
        return {}, [told] * bool(found)
    return {
        "position": _chosen("position", one, Term(one.name, one.unit or unit), "a speed, as there is no angle")
    }, notes


def _along_a_line(chosen: Mapping[str, Chosen], series: Sequence[Series]) -> dict[str, Chosen]:
    """A motion that a force drives: the only length by its unit, in place of an angle that only its name tells, if
    nothing else drives; or as a length if neither its unit nor its name says otherwise."""
    moved = [one for one in chosen.values() if one.column == "position" and one.why != "given"]
    lengths = [one for one in series if _is_length(one) and one.name not in {each.series for each in chosen.values()}]
    if moved and len(lengths) == 1 and moved[0].si == "rad" and moved[0].unit and {*chosen} & DRIVES == {"force"}:
        (length,) = lengths
        return {"position": _chosen("position", length, Term(length.name), "a length, which a force moves")}
    unknown = [one for one in moved if not (one.unit or column_of(one.series))]
    return {one.column: replace(one, unit="m", si="m") for one in unknown}


def _is_length(one: Series) -> bool:
    """Whether a series is a length by its unit."""
    unit = to_si(one.unit or unit_of(one.name, "displacement"))
    return unit is not None and unit[0] == COLUMN_UNITS["displacement"]


def _input(series: Sequence[Series], joint: str) -> tuple[dict[str, Chosen], list[str]]:
    """The input of a motor, of which no name says the quantity, as its voltage, or a force that has its symbol; and
    what a person should know."""
    if force := [one for one in series if one.name == FORCE]:
        return {"force": _chosen("force", force[0], Term(FORCE), "by its symbol")}, []
    found = [one for one in series if is_input(one.name) or puts_out(one.name)]
    own = [one for one in found if joint_of(one.name) in (joint, "")]
    own = [one for one in own if one.name.islower() and one.name.isalpha()] or own  # the plainest name
    if len(one := own or found) == 1:
        return {"voltage": _chosen("voltage", one[0], Term(one[0].name), "the motor's input, by its name")}, []
    return {}, [
        f"voltage: found several inputs, {listed(one)}; choose with {mapped('voltage', one[0].name)}"
    ] if one else []


def named(term: Term, series: Sequence[Series], joint: str, name: str) -> tuple[Series, Term]:
    """The series of a term: that of its name, or the one of the joint, or the only one that ends so.

    Raises RecordingError.
    """
    names = {one.name: one for one in series}
    for full in (term.name, f"{term.name}[{joint}]"):
        if full in names:
            return names[full], term
    spelt = [other for other in names if _plain(other) == _plain(term.name)]
    endings = spelt or [other for other in names if other.endswith((term.name, f"{term.name}[{joint}]"))]
    endings = endings or [other for other in names if _plain(other).endswith(_plain(term.name))]
    if len(endings) == 1:
        return names[endings[0]], replace(term, name=endings[0])
    close = endings or [other for other in names if other.startswith(term.name)]
    close = close or difflib.get_close_matches(term.name, names, 3, 0.4)
    hint = f", such as {_some(close)}" if close else f": {listed(series)}"
    raise RecordingError(f"{name}: found no series {shown(term.name)!r}, expected one of its {len(names)}{hint}")


def _plain(name: str) -> str:
    """A name in lower case, without the unit in brackets at its end; ``data.0`` is ``data[0]``."""
    less = re.sub(r"\s*[\[(][^\])\d]+[\])]\s*$", "", name)
    return re.sub(r"\.(\d+)\b", r"[\1]", less).strip().lower()


def listed(series: Sequence[Series]) -> str:
    """Names for a message, the first of many."""
    return _some([one.name for one in series]) if series else "no series of numbers"


def _chosen(column: str, series: Series, term: Term, why: str) -> Chosen:
    """With the unit of the options, or the format, or the name; else that of the column, or of a displacement or a
    force, which are those of an axis that moves along a line."""
    own = column_of(series.name)
    usual = COLUMN_UNITS[own] if own in LINEAR else ""
    if term.factor is not None:
        si, factor = to_si(term.unit) or (usual or COLUMN_UNITS[column], 1.0)
        return Chosen(column, series.name, "", si, term.factor * factor, term.offset * factor, why)
    unit = term.unit or series.unit or unit_of(series.name, column) or (usual if column != own else "")
    if not unit and column == "torque":  # a motor's current or voltage in its place
        unit = unit_of(series.name, "current") or unit_of(series.name, "voltage")
    known = to_si(unit)
    if known is None:  # none, or one that is kept and reported
        return Chosen(column, series.name, unit, unit or COLUMN_UNITS[column], 1.0, 0.0, why)
    return Chosen(column, series.name, unit, known[0], known[1], 0.0, why)


def _of_topics(found: list[Series], topics: Sequence[str]) -> list[Series]:
    """Those of the chosen topics, where there are any."""
    return [one for one in found if one.name.startswith(tuple(f"{topic}." for topic in topics))] or found


def _check_topics(series: Sequence[Series], topics: Sequence[str], name: str) -> None:
    for topic in topics:
        if not any(one.name.startswith(f"{topic}.") for one in series):
            there = sorted({one.name.partition(".")[0] for one in series})
            raise RecordingError(
                f"{name}: found no topic {shown(topic)!r} with numbers, expected one of {_some(there)}"
            )


def _joint(candidates: Mapping[str, Sequence[Series]], speeds: Sequence[str], choice: Choice, name: str) -> str:
    """The joint that is meant.  Raises RecordingError where that is not clear."""
    of = {column: {joint_of(one.name) for one in candidates.get(column, ())} - {""} for column in OF_JOINTS}
    turning = {joint_of(one.name) for column in ("command", "position") for one in candidates.get(column, ())}
    if not turning and speeds:  # several are asked about where one is needed
        turning = {*map(joint_of, speeds)} if len({*map(joint_of, speeds)}) == 1 else {""}
    moving = sorted((turning or of["torque"]) - {""})  # a kind of torque is no joint
    if choice.joint:
        everywhere = sorted(set().union(*of.values()))
        if choice.joint not in everywhere and everywhere:
            raise RecordingError(f"{name}: found no joint {shown(choice.joint)!r}, expected one of {_some(everywhere)}")
        return choice.joint
    if choice.hint in moving:
        return choice.hint
    named_joints = {
        joint_of(term.name) for column, term in choice.terms.items() if column in OF_JOINTS and term.name
    } - {""}
    if len(named_joints) == 1 and (named_joints <= set(moving) or not moving):
        return named_joints.pop()
    if len(moving) > 1 and not {"command", "position"} & set(choice.terms):
        raise RecordingError(
            f"{name}: found {len(moving)} joints, expected one; choose with --joint NAME (or FILE#joint=NAME) from "
            f"{_some(moving)}"
        )
    return moving[0] if len(moving) == 1 else ""


def _of_joint(found: Sequence[Series], column: str, joint: str) -> list[Series]:
    """Those of the joint, the plainest names first, of these those in a unit of the column: of ``Force (V)`` and
    ``Force (N)`` the second; then what is called an angle; a sensor's too, where none has the joint's name."""
    own = [one for one in found if joint_of(one.name) == joint]
    own.sort(key=lambda one: (not _has_unit(one, column), column == "position" and not is_angle(one.name)))
    plain = [one for one in own if one.name == column]
    plain = plain or sorted(own, key=lambda one: (is_commanded(one.name), is_estimated(one.name)))
    return plain or ([] if column in OF_JOINTS and joint and any(joint_of(one.name) for one in found) else list(found))


def _has_unit(one: Series, column: str) -> bool:
    """Whether the unit of a series, if it has one, may be that of the column; a place may be along a line."""
    unit = to_si(one.unit or unit_of(one.name, column))
    return unit is None or unit[0] == COLUMN_UNITS[column] or (column == "position" and unit[0] == "m")


def _may_be_position(one: Series) -> bool:
    """Whether the unit of a series, if it is known, is that of a place or of a speed; a share of something is none."""
    unit = to_si(one.unit or unit_of(one.name, "position"))
    is_share = one.unit == "%" or one.name.rstrip().endswith(("(%)", "[%]"))
    return not is_share if unit is None else unit[0] in ("rad", "m", "rad/s", "m/s")


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    return ", ".join(shown(name) for name in names[:SHOWN]) + more
