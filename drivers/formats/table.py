"""A table with a column of times, whatever file it comes from: times become seconds, empty cells are left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.guess import listed, mapped, named
from lostmotion.drivers.formats.source import DATE, Choice, Samples, Series, Term
from lostmotion.drivers.formats.words import (
    UNNAMED,
    column_of,
    ends_in_time,
    is_run,
    is_time,
    rate_of,
    time_rank,
    unit_of,
)
from lostmotion.drivers.units import to_si

__all__ = ["Table", "seconds"]

EPOCH_S = (1e9, 4e9)
"""2001 to 2096: times in this range count from 1970"""
LEAST_ROWS, LONGEST_STEP_S = 20, 0.5
"""of a time axis without a name; and the rows of the recordings that stand one after another in a file"""
COUNTED = 1.0
"""Times in such steps and larger are no seconds, but what a clock counts, in whole numbers or with fractions: of 15
published files with steps of 1 to 1.2 none has one row a second."""
MOST_STEPS = 0.5
"""Share of the rows, in which what may be a time ascends; a step of an input ascends once.  Of 520 published files 0.2
has three more with such a column, the x of a film, and 0.8 the same ones."""
SELDOM = 0.01
"""share of the rows in which a counter whose name says its rate may begin anew: once in 1100 to 1300 rows of twenty
recordings of a motor"""
TURN = 0.05
"""How far the range of an angle that begins anew may be from a turn, in turns: it is 0.95 turns and more with twenty
samples a turn, and 0.90 with ten, by two turns."""
ORDINALS = ("", "", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
"""of the rows from one value of a series to its next, where one column holds several in turn"""
SAME = 0.01
"""Variance of the steps of such series as a share of that from row to row: 1e-6 of the angles of an arm.  A swing of
eight samples a period and more has smaller steps."""
MOST_LOOKED_AT = 50
"""series among which a time without a name is looked for"""
LOOKS_LIKE = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
"""numbers beyond these count from 1970 in this unit"""

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Table:
    """A ``Source``.  load: reads columns by name, all of one length; numbers, or times as datetime64[ns]."""

    name: str
    kind: str
    series: Sequence[Series]
    load: Callable[[Sequence[str]], Mapping[str, Array]]
    notes: Sequence[str] = field(default=())
    metadata: Mapping[str, Any] = field(default_factory=dict)
    open_episode: Callable[[int], Table] | None = None
    """Reads one of the ``runs`` of the file, by its number from 0; None where it holds one.  Raises RecordingError."""
    runs: int = 1
    rate: tuple[str, float] = ("", 0.0)
    """What the file calls its rows a second, and how many it says; "" and 0.0 where it does not say it."""

    def of_rows(self, rows: slice) -> Table:
        """The table of these rows."""
        return replace(self, load=lambda names: {name: values[rows] for name, values in self.load(names).items()})

    def restarts(self, choice: Choice) -> list[slice]:
        """The parts in which the times ascend, of recordings that stand one after another; none of a single one."""
        try:
            clock = self._clock(choice)
            times = self._seconds(*clock, self.load([clock[0].name])[clock[0].name])[0] if clock else np.empty(0)
        except RecordingError:
            return []
        parts = _ascending(times)
        return parts if len(parts) > 1 else []

    def read(self, names: Sequence[str], choice: Choice) -> Samples:
        """The samples of these series.  Raises RecordingError."""
        clock = self._clock(choice)
        notes: list[str] = []
        if clock is None:
            rate_hz, why = (choice.rate_hz, "as given") if choice.rate_hz else (self.rate[1], f"by {self.rate[0]!r}")
            loaded = self.load(names)
            times, start = np.arange(max(map(len, loaded.values()))) / rate_hz, None
            clock_text = f"{rate_hz:g} rows a second, {why}"
        else:
            series, term = clock
            loaded = dict(self.load(list(dict.fromkeys([series.name, *names]))))
            times, start, clock_text = self._seconds(series, term, loaded[series.name])
            clock_text = series.name if series.name.endswith(f"[{clock_text}]") else f"{series.name} [{clock_text}]"
            part, notes = _in_order(times)
            times, loaded = times[part], {name: values[part] for name, values in loaded.items()}
            self._check(times, series.name)
            notes += _lost(times, [loaded[name] for name in names])
        values = {}
        for name in names:
            numbers = np.asarray(loaded[name], dtype=np.float64)
            there = ~np.isnan(numbers) & ~np.isnan(times)
            values[name] = (times, numbers) if there.all() else (times[there], numbers[there])
        return Samples(values, clock_text, start, notes, self.metadata)

    def _seconds(self, series: Series, term: Term, values: Array) -> tuple[FloatArray, datetime | None, str]:
        """See ``seconds``."""
        unit = term.unit or series.unit.replace(DATE, "") or unit_of(series.name, "time")
        return seconds(values, unit, term.factor, f"{self.name}: {series.name}")

    def spans(self, names: Sequence[str]) -> dict[str, tuple[float, float]]:
        """The least and the largest number of each of these series; zeros where it has none."""
        loaded = {name: np.asarray(values, dtype=np.float64) for name, values in self.load(names).items()}
        known = {name: values[np.isfinite(values)] for name, values in loaded.items()}
        return {
            name: (float(each.min()), float(each.max())) if each.size else (0.0, 0.0) for name, each in known.items()
        }

    def _clock(self, choice: Choice) -> tuple[Series, Term] | None:
        """The series with the times; None where a rate was given, or stands in the file.  Raises RecordingError."""
        if term := choice.terms.get("time"):
            return named(term, self.series, "", self.name)
        if choice.rate_hz is not None:
            if not 0 < choice.rate_hz <= 1e9:
                raise RecordingError(f"{self.name}: found a rate of {choice.rate_hz:g} Hz, expected 0 to 1e9 Hz")
            return None
        found = self.times
        if clock := self.clock:
            return next((one, Term(one.name)) for one in self.series if one.name == clock)
        if not found and self.rate[1]:
            return None
        if not found:
            raise RecordingError(
                f"{self.name}: found {listed(self.series)}, and no times; {self._in_turn()}{self._advised()}"
                "give the rows a second, if there are 100: FILE#rate-hz=100"
            )
        still = [one.name for one in found if len(found) > 1 and not np.any(self._steps.get(one.name, 1))]
        best = min(found, key=lambda one: (one.name in still, time_rank(one.name), is_run(one.name)))
        return best, Term(best.name)

    @property
    def times(self) -> list[Series]:
        """The series that are times by their names, else those of dates."""
        named_times = [one for one in self.series if is_time(one.name)]
        return named_times or [one for one in self.series if one.unit == DATE]

    @cached_property
    def clock(self) -> str:
        """The series that is the time although its name does not say so; "" for none: the first one, or the only one,
        that ascends in steps of one size, of less than half a second, or as a clock counts ms or µs, but not from 0 or
        1 on by one a row; of several the times of structures, if they are the same; without a header also the only one
        that ascends, or the first, if its steps are the most even: a place that moves steadily ascends, too."""
        if self.times:
            return ""
        names = [one.name for one in self.series if not one.unit and _may_be_time(one.name)]
        for name in names:  # the first that does not count the rows
            if not _only_counts(name, values := self.load([name])[name]):
                if _ascends(values):
                    return name
                break
        loaded = self.load(names) if len(names) <= MOST_LOOKED_AT else {}
        loaded = {name: values for name, values in loaded.items() if not _only_counts(name, values)}
        found = [name for name, values in loaded.items() if _ascends(values)]
        if not found:  # what says that it is one may stand still for a row
            found = [name for name in loaded if ends_in_time(name) and _ascends(loaded[name], may_repeat=True)]
        if not found and all(UNNAMED.fullmatch(name) for name in loaded):
            found = [name for name, values in loaded.items() if len(values) > LEAST_ROWS and _never_falls(values)] or [
                name for name, values in loaded.items() if _ascends(values, may_begin_anew=True)
            ]
        if len(found) > 1:
            told = [name for name in found if is_time(name.rpartition(".")[2])]
            first, *others = (_unevenness(loaded[name]) for name in found)
            found = told or found[: all(map(UNNAMED.fullmatch, found)) and all(first < other for other in others)]
        return found[0] if found and all(np.array_equal(loaded[found[0]], loaded[other]) for other in found) else ""

    def _in_turn(self) -> str:
        """What to do with one column that holds several series in turn; "" where it does not."""
        name = next(iter(self._steps), "")
        values = np.cumsum(self._steps[name]) if len(self.series) == 1 and name else np.empty(0)
        jumps = {k: float(np.var(values[k:] - values[:-k])) for k in range(1, len(ORDINALS)) if values.size > 4 * k}
        if not jumps or not min(jumps.values()) < SAME * jumps[1]:
            return ""
        many = next(k for k, each in jumps.items() if each < SAME * jumps[1])
        alike = f"every {ORDINALS[many]} number of {name} is close to the one before"
        return f"{alike}, as if {many} series stood there in turn: write these side by side, {many} in a row, and "

    def _advised(self) -> str:
        """What to type for the times; "" for none."""
        if not self.rising:
            return ""
        name, unit = self.rising
        rate, usual = rate_of(name), float(np.nanmedian(self._steps[name]))
        doubt = f"{1e3 * rate:g} Hz, as a row in {usual / rate:.3g} s would be slow" if rate else ""
        counted = f" (if it counts at {doubt})" if rate and _is_slow(usual, rate) else ""
        return f"choose their series, as in {mapped('time', name, unit)}{counted}, or "

    @cached_property
    def rising(self) -> tuple[str, str] | None:
        """The first series that only ascends, and does not count the rows unless its name says how often, which may be
        the times; and ``:unit``, or ``*factor`` by the rate in its name."""
        steps = {name: each[~np.isnan(each)] for name, each in self._steps.items()}
        rises = {name: each for name, each in steps.items() if np.sum(each > 0) > MOST_STEPS * each.size}
        found = [name for name, each in rises.items() if (each >= 0).all() and _may_be_time(name)]
        counts = (name for name, each in rises.items() if rate_of(name) and np.mean(each < 0) < SELDOM)
        if name := next(counts, ""):
            rate = rate_of(name)
            return name, f"*{1 / (1e3 * rate if _is_slow(float(np.median(steps[name])), rate) else rate):.6g}"
        name = next((name for name in found if name not in self.counting), "")
        return (name, f":{_counted(self.load([name])[name]) or 's'}") if name else None

    @cached_property
    def counting(self) -> Sequence[str]:
        """The series that count the rows, which are no motion."""
        return [name for name, each in self._steps.items() if np.ptp(each) == 0 and each[0] == 1]

    @cached_property
    def looked_at(self) -> Mapping[str, FloatArray]:
        """The numbers of each series but for very many, which are read once."""
        names = [one.name for one in self.series][:MOST_LOOKED_AT]
        return {name: np.asarray(values, dtype=np.float64) for name, values in self.load(names).items()}

    @cached_property
    def _steps(self) -> Mapping[str, FloatArray]:
        """From row to row, of each series but for very many."""
        return {name: np.diff(values) for name, values in self.looked_at.items() if values.size > LEAST_ROWS}

    def _check(self, times: FloatArray, clock: str) -> None:
        """Raises RecordingError for times that are none."""
        known = times[~np.isnan(times)]
        if known.size == 0:
            raise RecordingError(f"{self.name}: found no time in {clock!r}, expected numbers; is the table empty?")
        if not np.isfinite(known).all():
            raise RecordingError(f"{self.name}: found an infinite time in {clock!r}, expected numbers")
        if known.size > LEAST_ROWS and np.ptp(known) == 0:
            raise RecordingError(
                f"{self.name}: found the same time in {clock!r} in all {known.size} rows, expected times that ascend; "
                "give the rows a second, if there are 100: FILE#rate-hz=100"
            )
        back = np.flatnonzero(np.diff(known) < 0)
        if back.size:
            row = int(back[0]) + 2
            raise RecordingError(
                f"{self.name}: found the time {known[row - 1]:.9g} s after {known[row - 2]:.9g} s in row {row}, "
                "expected rows in time order; were two recordings joined, or did a clock step?"
            )


def _lost(times: FloatArray, columns: Sequence[Array]) -> list[str]:
    """A note on the rows that hold something, but no time (N,)."""
    rows = np.isnan(times)
    if not rows.any():
        return []
    lost = np.count_nonzero(
        np.any([~np.isnan(np.asarray(values, dtype=np.float64)[rows]) for values in columns], axis=0)
    )
    return [f"{lost} rows without a time were left out"] if lost else []


def _is_slow(steps: float, rate: float) -> bool:
    """Whether so many counts a row are too many for a rate [Hz], but not for one in kHz that was called Hz."""
    return steps / rate > LONGEST_STEP_S >= steps / (1e3 * rate)


def _may_be_time(name: str) -> bool:
    """Whether a name says nothing else: an angle that is turned evenly is none; the name of an array or a file says
    nothing of each of its columns (``pos1[0]``)."""
    return column_of(name) is None or ends_in_time(name) or name.endswith("]")


def _only_counts(name: str, values: Array) -> bool:
    """Whether numbers count the rows, and the name does not say that these are ms or the like: ``i_ms``."""
    return _counts_rows(values) and not unit_of(name, "time")


def _counts_rows(column: Array) -> bool:
    """Whether numbers count the rows, from 0 or 1 on."""
    values = np.asarray(column, dtype=np.float64)
    return values.size > LEAST_ROWS and values[0] in (0, 1) and bool((np.diff(values) == 1).all())


def _never_falls(column: Array) -> bool:
    """Whether numbers ascend, but for one that may stand twice, as times do that were rounded."""
    steps = np.diff(np.asarray(column, dtype=np.float64))
    return bool((steps >= 0).all() and (steps[1:] + steps[:-1] > 0).all())


def _spans_turn(values: Array) -> bool:
    """Whether the range of numbers is a turn, in degrees, rad or turns."""
    return any(abs(float(np.ptp(values)) / turn - 1) < TURN for turn in (360.0, 2 * np.pi, 1.0))


def _ascends(column: Array, may_repeat: bool = False, may_begin_anew: bool = False) -> bool:
    """Whether numbers ascend in steps of one size, which may be those of a time; may_repeat: some of them may stand
    twice; may_begin_anew: they may be seconds of several runs, and no angle that begins anew at each turn."""
    values = np.asarray(column, dtype=np.float64)
    if may_repeat:
        values = values[np.concatenate([[True], np.diff(values) != 0])]
    steps = np.diff(values)
    may_begin_anew = may_begin_anew and not _spans_turn(values)
    anew = np.count_nonzero(~(steps > 0)) if _counted(values) or may_begin_anew else 0
    if steps.size < LEAST_ROWS * (1 + anew) or not (anew or (steps > 0).all()):
        return False
    usual = float(np.median(steps))
    is_short = usual < LONGEST_STEP_S or _counted(values) != ""
    return is_short and float(np.quantile(steps, 0.9)) < 2 * usual


def _unevenness(column: Array) -> float:
    """The standard deviation of the steps of a column upwards, as a share of their mean."""
    steps = np.diff(np.asarray(column, dtype=np.float64))
    steps = steps[steps > 0]
    return float(np.std(steps) / np.mean(steps)) if steps.size else np.inf


def _ascending(times: FloatArray) -> list[slice]:
    """The parts in which time does not go back, where a file has a few such parts; all of it otherwise, as a clock that
    goes back more often is none."""
    back = np.flatnonzero(np.diff(times) < 0) + 1
    if times.size < LEAST_ROWS * (back.size + 1):
        return [slice(0, times.size)]
    ends = [0, *back.tolist(), times.size]
    return [slice(first, last) for first, last in pairwise(ends)]


def _in_order(times: FloatArray) -> tuple[slice, list[str]]:
    """The longest part in which time does not go back, and a note, where there are several."""
    parts = _ascending(times)
    if len(parts) == 1:
        return parts[0], []
    longest = max(range(len(parts)), key=lambda at: parts[at].stop - parts[at].start)
    part = parts[longest]
    used = (
        f"rows {part.start + 1} to {part.stop} are used, the longest part; for another FILE#episode={int(longest == 0)}"
    )
    return part, [f"time begins anew in row {parts[0].stop + 1}: {used}"]


def seconds(values: Array, unit: str, factor: float | None, name: str) -> tuple[FloatArray, datetime | None, str]:
    """Times [s]; UTC of time 0 where they count from 1970, they begin at 0 then; and how they were understood.

    Raises RecordingError.
    """
    if values.dtype.kind == "M":
        return _since_start(values.astype("datetime64[ns]").view(np.int64), 1e-9, "date and time")
    numbers = values if values.dtype.kind in "iu" else np.asarray(values, dtype=np.float64)
    known = numbers[np.isfinite(numbers)]
    if factor is not None:
        return np.asarray(numbers * factor, dtype=np.float64), None, f"times {factor:g}"
    largest = float(np.abs(known).max()) if known.size else 0.0
    clock_text = unit or "s"
    if not unit and (unit := _counted(known)):
        clock_text = f"{unit}, by the size of its steps"
    elif not unit and (unit := next((each for limit, each in LOOKS_LIKE if largest > limit), "")):
        clock_text = f"{unit} since 1970, by their size"
    si = to_si(unit or "s")
    if si is None or si[0] != "s":
        raise RecordingError(f"{name}: found times in {unit!r}, expected s, ms, us, ns, min or h")
    if EPOCH_S[0] < largest * si[1] < EPOCH_S[1]:
        return _since_start(numbers, si[1], clock_text)
    return np.asarray(numbers * si[1], dtype=np.float64), None, clock_text


def _counted(values: Array) -> str:
    """The unit in which a clock counts, as ``millis()`` and ``micros()`` do: the largest in which its steps are shorter
    than half a second.  "" for s, or where none can be told."""
    if values.size < LEAST_ROWS:
        return ""
    usual = float(np.median(np.diff(values)))
    smaller = (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if usual >= COUNTED else ()
    return next((unit for unit, size in smaller if usual * size < LONGEST_STEP_S), "")


def _since_start(stamps: Array, factor: float, clock_text: str) -> tuple[FloatArray, datetime | None, str]:
    """Exact also in ns: the first is subtracted before a float is made."""
    known = stamps[np.isfinite(stamps) if stamps.dtype.kind == "f" else stamps != np.iinfo(np.int64).min]
    if known.size == 0:
        return np.full(stamps.shape, np.nan), None, clock_text
    first = known[0]
    day = float(first) * factor
    start = datetime.fromtimestamp(round(day, 6), UTC) if day >= 86400 else None  # else a time of day
    times = np.asarray((stamps - first) * factor, dtype=np.float64)
    if stamps.dtype.kind != "f":
        times[stamps == np.iinfo(np.int64).min] = np.nan  # NaT
    return times, start, clock_text
