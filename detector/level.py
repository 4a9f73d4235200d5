"""The level between healthy and worn scores: by eq. 9, and by two better criteria.

All take scores and return a ``Level``; none uses a signal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.window import FloatArray

__all__ = ["Level", "from_healthy", "level", "windows_needed", "youden"]

CONFIDENCE = 0.99


@dataclass(frozen=True, slots=True)
class Level:
    """A level and its errors on the scores it was made from: a score is an impact when it is above ``value``.

    criterion: what was maximised; separable: whether the value lies in a gap between all healthy and all worn scores.
    """

    value: float
    criterion: float
    correct_accept: int
    correct_reject: int
    false_positive: int
    false_negative: int
    separable: bool


def level(scores: ArrayLike, labels: ArrayLike) -> Level:
    """The level of eq. 9: maximises correct_accept / false_positive + correct_reject / false_negative.

    scores [-] and labels (true: with play), shape (N,); NaN scores are left out.  The paper divides by zero wherever
    one kind of error does not occur: here every one of the four counts is one larger (Laplace's rule), so the criterion
    is always finite.  Separable scores give the middle of the gap; of equally good levels the one in the widest gap
    between scores wins, then the lowest.

    Raises DetectorError without scores of both classes.
    """
    return _best(*_sorted(scores, labels), _eq9)


def youden(scores: ArrayLike, labels: ArrayLike) -> Level:
    """The level that maximises Youden's J: true-positive rate minus false-positive rate.

    Eq. 9 rewards having none of one kind of error however many of the other, and depends on how many windows of each
    class were recorded; J does neither.  Arguments, ties and errors as for ``level``.
    """
    return _best(*_sorted(scores, labels), _youden_j)


def from_healthy(scores: ArrayLike, false_alarm: float = 0.01) -> Level:
    """The level that a new healthy window exceeds with a probability of at most ``false_alarm``.

    scores: of a joint known to be without play, shape (N,), exchangeable with those to come; NaN are left out.  The
    ceil((N + 1)(1 - false_alarm))-th smallest score (split conformal prediction, Vovk et al. 2005): no distribution is
    assumed.  Raises DetectorError when N is too small for the rate asked for.
    """
    values = np.asarray(scores, dtype=float)
    values = np.sort(values[np.isfinite(values)])
    if not 0 < false_alarm < 1:
        raise DetectorError(f"false_alarm is {false_alarm:g}; expected a rate between 0 and 1")
    rank = math.ceil((values.size + 1) * (1 - false_alarm) - 1e-9)
    if rank > values.size:
        raise DetectorError(
            f"{values.size} healthy windows cannot promise a false-alarm rate of {false_alarm:g}; "
            f"expected at least {math.ceil(1 / false_alarm - 1e-9) - 1}: record longer or allow more false alarms"
        )
    value = float(values[rank - 1])
    alarms = int(np.sum(values > value))
    return Level(value, false_alarm, 0, values.size - alarms, alarms, 0, separable=False)


def windows_needed(false_alarm: float) -> int:
    """How many healthy windows ``from_healthy`` needs for its level to hold on new windows: with 99 % confidence their
    rate of false alarms lies between half of ``false_alarm`` and twice of it.
    """
    high = math.ceil(1 / false_alarm)
    while _kept(high, false_alarm) < CONFIDENCE:
        high *= 2
    low = high // 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if _kept(middle, false_alarm) >= CONFIDENCE else (middle, high)
    return high


def _kept(count: int, false_alarm: float) -> float:
    """Probability that the rate is within a factor of two of the promised one.

    Of N windows a are at or above the level; whatever their distribution, the rate on fresh ones follows
    Beta(a, N + 1 - a), whose distribution function at p is the chance of at least a successes in N trials of p.
    """
    above = count + 1 - math.ceil((count + 1) * (1 - false_alarm) - 1e-9)
    return _fewer(above, count, 0.5 * false_alarm) - _fewer(above, count, min(2 * false_alarm, 1.0))


def _fewer(above: int, count: int, rate: float) -> float:
    """Probability of fewer than ``above`` successes in ``count`` trials."""
    if rate >= 1:
        return 0.0
    logs = (
        math.lgamma(count + 1) - math.lgamma(k + 1) - math.lgamma(count - k + 1)
        + k * math.log(rate) + (count - k) * math.log1p(-rate)
        for k in range(above)
    )  # fmt: skip
    return sum(math.exp(log) for log in logs)


Criterion = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray]
"""Of correct_accept, correct_reject, false_positive, false_negative, each of shape (number of levels,)."""


def _eq9(accept: FloatArray, reject: FloatArray, positive: FloatArray, negative: FloatArray) -> FloatArray:
    return (accept + 1) / (positive + 1) + (reject + 1) / (negative + 1)


def _youden_j(accept: FloatArray, reject: FloatArray, positive: FloatArray, negative: FloatArray) -> FloatArray:
    return accept / (accept + negative) - positive / (positive + reject)


def _best(scores: FloatArray, worn: NDArray[np.bool_], criterion: Criterion) -> Level:
    """The best of the levels half-way between neighbouring scores; scores ascending."""
    ends = np.flatnonzero(np.diff(scores) > 0)
    if ends.size == 0:
        raise DetectorError(
            f"all {scores.size} scores are {scores[0]:g}, with play and without; no level separates them"
        )
    below = np.cumsum(worn)[ends].astype(float)
    healthy_below = ends + 1 - below
    accept, positive = worn.sum() - below, (~worn).sum() - healthy_below
    values = criterion(accept, healthy_below, positive, below)
    gaps = scores[ends + 1] - scores[ends]
    at = int(np.lexsort((-np.arange(ends.size), gaps, values))[-1])
    return Level(
        value=float(scores[ends[at]] + gaps[at] / 2),
        criterion=float(values[at]),
        correct_accept=int(accept[at]),
        correct_reject=int(healthy_below[at]),
        false_positive=int(positive[at]),
        false_negative=int(below[at]),
        separable=bool(positive[at] == 0 and below[at] == 0),
    )


def _sorted(scores: ArrayLike, labels: ArrayLike) -> tuple[FloatArray, NDArray[np.bool_]]:
    values, worn = np.asarray(scores, dtype=float), np.asarray(labels, dtype=bool)
    if values.shape != worn.shape or values.ndim != 1:
        raise DetectorError(f"{values.size} scores and {worn.size} labels; expected one label for each score")
    there = np.isfinite(values)
    values, worn = values[there], worn[there]
    if not 0 < worn.sum() < worn.size:
        raise DetectorError(
            f"{int(worn.sum())} scores with play and {int((~worn).sum())} without; expected some of both "
            "(from_healthy makes a level without any with play)"
        )
    order = np.argsort(values, kind="stable")
    return values[order], worn[order]
