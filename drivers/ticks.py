"""Stamps of a clock with coarse ticks → the times at which evenly sampled values were really taken.  Pure functions of
numbers.

``millis()`` at 800 samples a second gives 0, 1, 2, 3, 5 ms …: each stamp is right to a tick, but neighbours are a tick
or two apart, which looks as if samples were missing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import pairwise

import numpy as np

from lostmotion.drivers.base import FloatArray

__all__ = ["COARSE", "Ticks", "coarser", "evened"]

Columns = Callable[[], Iterable[FloatArray]]
"""returns what was read at some times (N,), each (N,): few recordings need it"""

COARSE = 0.1
"""in periods: a clock of finer ticks is exact enough to be taken at its word"""
LEAST_ROWS = 50
REGULAR = 0.95
"""share of the longer steps that come as regularly as rounding makes them; of one in a hundred samples lost at random
some 2 % do"""
EXACT = 1e-3
"""in ticks: how far a step may be from a whole number of them"""
BURSTS, LEAST_BURSTS = 0.4, 10
"""Ratio of the median to the mean step below which samples came in bursts: 0.26 of an encoder's lines that a computer
stamped as it read them, 16 every 62 ms; 0.69 where they come at random.  Least number of bursts, as a pause is none."""
LEAST_ADVANCE = 0.01
"""in periods: times ascend at least so much from sample to sample"""


class Ticks:
    """Follows the stamps of a sensor with the period [s], whose clock ticks every ``tick`` [s].

    A sample was taken within the tick that its stamp begins; within it the time goes on evenly from the last sample's.
    A stamp that lies later than that by half a period or 0.6 ticks, whichever is more, follows samples that were lost.
    At a tick of 0.8 periods some single lost samples look like rounding and are not counted: 17 of 157.
    """

    def __init__(self, period: float, tick: float) -> None:
        self._period = period
        self._tick = tick
        self._most = max(0.5 * period, 0.6 * tick)
        self._last = math.nan

    def feed(self, stamps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The times [s] of stamps [s] that do not descend, shape (N,), and how many samples are missing before each."""
        times, missing, last, period, tick = [], [], self._last, self._period, self._tick
        for stamp in stamps.tolist():
            due = stamp + tick / 2 if math.isnan(last) else last + period
            lost = max(round((stamp - due) / period), 1) if stamp - due > self._most else 0
            time = min(max(due + lost * period, stamp), stamp + tick)
            last = time if not time < last + LEAST_ADVANCE * period else last + LEAST_ADVANCE * period
            times.append(last)
            missing.append(lost)
        self._last = last
        return np.array(times), np.array(missing, dtype=float)


def coarser(stamps: FloatArray, tick: float, period: float) -> float:
    """The step [s] of the clock of stamps [s], shape (N,), that are whole numbers of ``tick`` [s].

    It is coarser where all are multiples of more and some follow each other too soon for the period [s], as in
    ``millis() * 1000``.  An exact clock may have multiples of its period, and no shorter steps.
    """
    if not tick or len(stamps) < LEAST_ROWS:
        return tick
    steps = np.abs(np.diff(stamps)) / tick
    if not steps.max() < 2**53 or steps.min() * tick > 0.95 * period:
        return tick
    return max(float(np.gcd.reduce(np.rint(steps).astype(np.int64))) * tick, tick)


def evened(times: FloatArray, columns: Columns = tuple) -> FloatArray:
    """Times [s] that ascend, shape (N,), without the rounding to coarse ticks, where they show that they are rounded:
    all steps are whole numbers of a tick, and the longer ones come in a regular pattern.  Others as they are.
    columns: returns what was read then.

    Lost samples make longer steps, too, but not regularly.  Times with so many digits (10.63, 110.6) have a tick for
    each power of ten.
    """
    if len(times) < LEAST_ROWS or not np.diff(times).min() >= 0 or not times[-1] > times[0]:
        return times
    whole = _evened(times, columns)
    if whole is not times:
        return whole
    powers = 10.0 ** np.arange(math.floor(math.log10(times[-1] - times[0])) - 1, math.log10(np.abs(times).max()) + 1)
    ends = [0, *np.searchsorted(times, powers).tolist(), len(times)]
    spans = [slice(first, last) for first, last in pairwise(ends)]
    parts = [times[span] for span in spans]
    found = [_evened(part, _within(columns, span)) for part, span in zip(parts, spans, strict=True)]
    return times if all(new is old for new, old in zip(found, parts, strict=True)) else np.concatenate(found)


def _within(columns: Columns, span: slice) -> Columns:
    """What was read within a span of the rows."""
    return lambda: (each[span] for each in columns())


def _evened(times: FloatArray, columns: Columns) -> FloatArray:
    """Times of one tick."""
    steps = np.diff(times)
    if len(times) < LEAST_ROWS or not steps.any():
        return times
    if np.median(steps) < BURSTS * steps.mean():
        return _of_bursts(times, columns)
    tick = _tick(steps)
    counts = np.rint(steps / tick)
    usual = np.median(counts)
    near = np.abs(counts - usual) <= 1
    if not near.any():
        return times
    period = float(counts[near].mean()) * tick
    if tick < COARSE * period or np.abs(steps / tick - counts).max() > EXACT or not _is_regular(counts[near] != usual):
        return times
    even, _ = Ticks(period, tick).feed(times)
    return even - tick / 2


def _of_bursts(times: FloatArray, columns: Columns) -> FloatArray:
    """Times [s] of samples that mostly arrived several at once, and have the stamp of their arrival: even ones, where
    the stamps stay as close to these as bursts follow each other; not where nothing was read between bursts."""
    number, steps = np.arange(len(times)), np.sort(np.diff(times))
    even = np.polyval(np.polyfit(number, times, 1), number)
    apart = steps[np.searchsorted(np.cumsum(steps), steps.sum() / 2)]  # half of the time is in steps as long as this
    is_burst = np.sum(steps >= apart) >= LEAST_BURSTS and np.std(times - even) <= apart
    return np.asarray(even) if is_burst and not any(_pauses(times, each, apart) for each in columns()) else times


def _pauses(times: FloatArray, values: FloatArray, apart: float) -> bool:
    """Whether values (N,) change more over the steps that are at least so long [s] than over the others, as what moves
    does between two samples that are really so far apart: by more than the square root of the ratio of the steps, which
    is halfway between no difference and one in proportion to the time."""
    steps, ways = np.diff(times), np.diff(values) ** 2
    known = np.isfinite(ways)
    sets = [known & (steps >= apart), known & (steps < apart)]
    if not all(rows.any() for rows in sets):
        return False
    (far, far_s), (near, near_s) = ((float(ways[rows].mean()), float(steps[rows].mean())) for rows in sets)
    return far * near_s > near * far_s > 0


def _tick(steps: FloatArray) -> float:
    """The shortest step, or difference of two steps: 30 and 40 ms show a tick of 10."""
    lengths = np.unique(np.concatenate([[0.0], steps]))
    apart = np.diff(lengths)
    return float(apart[apart > EXACT * np.median(steps[steps > 0])].min())


def _is_regular(odd: FloatArray) -> bool:
    """Whether marks follow each other in distances that differ by one at most, as rounding makes them."""
    distances = np.diff(np.flatnonzero(odd))
    if len(distances) < 3:
        return False
    return float(np.mean(np.abs(distances - np.median(distances)) <= 1)) >= REGULAR
