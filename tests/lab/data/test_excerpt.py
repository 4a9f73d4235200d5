"""Windows of long recordings."""

from __future__ import annotations

import numpy as np

from lostmotion.lab.data.excerpt import excerpts
from lostmotion.lab.data.experiment import Experiment

RATE_HZ = 100.0


def recording(number: int, length_s: float, lively_s: float = 0.0) -> Experiment:
    """An acceleration that is ten times as large for a second from ``lively_s`` on."""
    time = np.arange(0.0, length_s, 1 / RATE_HZ)
    accel = np.random.default_rng(number).standard_normal(time.size)
    accel[(time >= lively_s) & (time < lively_s + 1.0)] *= 10.0
    return Experiment(f"{number}.csv", None, time, {"accel": accel})


def test_short_recordings_are_used_whole() -> None:
    """Nothing is left out while all fit."""
    every = [recording(i, 2.0) for i in range(3)]
    assert excerpts(every, 6.0) == every


def test_the_window_is_where_the_signal_changes_most() -> None:
    """Of a minute the second is found in which the acceleration is large."""
    (window,) = excerpts([recording(1, 60.0, lively_s=40.0)], 4.0)
    assert window.duration <= 4.0
    assert window.time[0] <= 40.0
    assert window.time[-1] >= 40.9


def test_of_many_recordings_some_are_used_that_are_spread_over_all() -> None:
    """Thirty recordings of two seconds for eight seconds: four whole ones, not the first four."""
    found = excerpts([recording(i, 2.0) for i in range(30)], 8.0)
    numbers = [int(one.name.removesuffix(".csv")) for one in found]
    assert numbers == sorted(numbers)
    assert 4 <= len(found) <= 5
    assert max(np.diff(numbers)) <= 15
    assert sum(one.duration for one in found) <= 8.0
