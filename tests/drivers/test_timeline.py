"""Samples of a sensor in robot time: gaps, wraps, resets, late ones."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock
from lostmotion.drivers.timeline import Timeline

WRAP = 2**32 * 1e-6
PERIOD = 0.001


def stamped(timeline: Timeline, stamps: list[float], arrival: float, broken: int = 0) -> AccelBlock:
    """A block of samples whose value is their place in it."""
    return timeline.stamped(stamps, [float(i) for i in range(len(stamps))], arrival, broken)


def test_a_gap_in_the_stamps_is_filled_and_counted() -> None:
    """Samples at 1, 2, 5 ms: the two between are NaN at 3 and 4 ms, and count as lost."""
    block = stamped(Timeline(PERIOD, WRAP), [0.001, 0.002, 0.005], arrival=10.0)
    assert block.lost == 2
    assert np.isnan(block.accel[2:4]).all()
    assert block.accel[[0, 1, 4]].tolist() == [0.0, 1.0, 2.0]
    assert np.diff(block.time) == pytest.approx(PERIOD)


def test_a_gap_between_blocks_is_filled_too() -> None:
    """The first sample of a block is held against the last of the block before."""
    timeline = Timeline(PERIOD, WRAP)
    stamped(timeline, [0.001, 0.002], arrival=10.0)
    block = stamped(timeline, [0.004, 0.005], arrival=10.003)
    assert (block.lost, len(block.time)) == (1, 3)
    assert np.isnan(block.accel[0])


def test_a_broken_line_is_not_counted_as_lost_again() -> None:
    """A line thrown away leaves a gap: it is one broken, none lost."""
    block = stamped(Timeline(PERIOD, WRAP), [0.001, 0.003], arrival=10.0, broken=1)
    assert (block.lost, block.broken, len(block.time)) == (0, 1, 3)


def test_the_counter_of_microseconds_wraps() -> None:
    """micros() goes from 2³² - 1 to 0 after 71.6 minutes; the times go on, and nothing is lost."""
    timeline = Timeline(PERIOD, WRAP)
    first = stamped(timeline, [WRAP - 0.002, WRAP - 0.001], arrival=50.0)
    second = stamped(timeline, [0.0, 0.001], arrival=50.002)
    assert second.lost == 0
    assert np.diff(np.concatenate([first.time, second.time])) == pytest.approx(PERIOD, abs=1e-6)


def test_one_wild_stamp_is_thrown_away() -> None:
    """A digit lost in a stamp costs that one sample; the clock is not set anew."""
    timeline = Timeline(PERIOD, WRAP)
    stamped(timeline, [500.001, 500.002], arrival=10.0)
    block = stamped(timeline, [50.003, 500.004, 500.005], arrival=10.003)
    assert (block.broken, block.lost, len(block.time)) == (1, 0, 3)
    assert block.time[-1] == pytest.approx(10.003, abs=1e-4)


def test_a_wild_stamp_is_forgotten_when_good_ones_follow() -> None:
    """Two wild stamps alike with good ones between them are two mistakes, not a clock that was set anew."""
    timeline = Timeline(PERIOD, WRAP)
    stamped(timeline, [500.001, 500.002, 50.0], arrival=10.0)
    stamped(timeline, [500.003, 500.004], arrival=10.002)
    block = stamped(timeline, [50.1, 500.005, 500.006], arrival=10.004)
    assert (block.broken, block.lost) == (1, 0)
    assert block.accel.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("restart", [0.001, 2000.0])
def test_a_sensor_that_restarts_goes_on(restart: float) -> None:
    """Its clock begins anew anywhere: the second stamp of the new count is believed, and the times ascend."""
    timeline = Timeline(PERIOD, WRAP)
    first = stamped(timeline, [500.001, 500.002], arrival=10.0)
    second = stamped(timeline, [restart, restart + PERIOD, restart + 2 * PERIOD], arrival=12.0)
    assert second.broken == 1
    assert second.time[-1] == pytest.approx(12.0, abs=1e-4)
    assert np.diff(np.concatenate([first.time, second.time])).min() > 0


def test_samples_that_fit_nowhere_make_an_empty_block() -> None:
    """A lone stamp from nowhere gives no samples and is counted."""
    timeline = Timeline(PERIOD, WRAP)
    stamped(timeline, [5.0], arrival=10.0)
    block = stamped(timeline, [3.0], arrival=10.1)
    assert (len(block.time), block.broken) == (0, 1)


def test_late_samples_are_counted() -> None:
    """A block that arrives 0.3 s late counts its samples older than 250 ms as late."""
    timeline = Timeline(PERIOD, WRAP)
    stamps = np.arange(1, 101) * PERIOD
    for part in np.split(stamps, 10):
        stamped(timeline, list(part), arrival=10 + float(part[-1]))
    block = stamped(timeline, list(0.1 + stamps[:100]), arrival=10.5)
    assert block.late == 100
    assert stamped(timeline, [0.201], arrival=10.501).late == 1
    assert stamped(timeline, [0.202], arrival=10.203).late == 0


def test_a_sensor_without_a_clock_is_counted() -> None:
    """A WitMotion sensor sends no time: 200 Hz in bursts becomes an even grid that ends at the arrival."""
    timeline = Timeline(0.005)
    blocks = [timeline.counted([0.0] * 4, arrival=5 + 0.02 * i) for i in range(1, 200)]
    times = np.concatenate([block.time for block in blocks])
    assert np.diff(times) == pytest.approx(0.005, abs=1e-4)
    assert times[-1] == pytest.approx(5 + 0.02 * 199, abs=1e-4)


def test_samples_that_vanish_without_a_trace_are_found_by_the_clock() -> None:
    """When a sensor without a clock loses 3 samples, the counter falls behind by 15 ms; 2 s later they are counted."""
    timeline = Timeline(0.005)
    lost = sum(timeline.counted([0.0] * 4, arrival=5 + 0.02 * i + 0.015 * (i > 300)).lost for i in range(1, 420))
    assert lost == 3
