"""Selects the parts of long recordings that a search of gears uses: the windows in which the motion changes most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.model.motion import FloatArray

__all__ = ["excerpts"]

WINDOW_SHARE = 0.25
"""Shortest window, as a share of the usable time: fewer recordings are better than windows that are too short."""


def excerpts(experiments: Sequence[Experiment], most_s: float) -> list[Experiment]:
    """The experiments, or windows of them with a total length of at most ``most_s`` [s].

    Experiments are chosen evenly over the list.  One that is longer than its share is cut to the window in which its
    measured signals change most.
    """
    if sum(one.duration for one in experiments) <= most_s:
        return list(experiments)
    window = max(most_s / len(experiments), WINDOW_SHARE * most_s)
    chosen: dict[int, Experiment] = {}
    left = most_s
    for at in _spread(len(experiments)):
        if left < window / 2:
            break
        chosen[at] = _most_varying(experiments[at], min(window, left))
        left -= chosen[at].duration
    return [chosen[at] for at in sorted(chosen)]


def _spread(count: int) -> list[int]:
    """The numbers 0 … count - 1 in bit-reversed order, so that the first of them are spread evenly."""
    bits = max(count - 1, 1).bit_length()
    every = (int(f"{at:0{bits}b}"[::-1], 2) for at in range(2**bits))
    return [at for at in every if at < count]


def _most_varying(experiment: Experiment, length_s: float) -> Experiment:
    """The window of this length [s] in which the measured signals change most."""
    if experiment.duration <= length_s:
        return experiment
    count = max(int(length_s * experiment.rate_hz), 2)
    changes = np.sum([_changes(values) for values in experiment.measured.values()], axis=0)
    before = np.concatenate([[0.0], np.cumsum(changes)])
    first = int(np.argmax(before[count:] - before[:-count])) if before.size > count else 0
    start = float(experiment.time[first])
    return experiment.between(start, start + length_s)


def _changes(values: FloatArray) -> FloatArray:
    """Squared differences of neighbouring samples (N,), in units of their standard deviation."""
    seen = np.flatnonzero(~np.isnan(values))
    found = np.zeros(values.size)
    found[seen[1:]] = np.diff(values[seen]) ** 2
    return np.asarray(found / max(float(found.sum()), 1e-300))
