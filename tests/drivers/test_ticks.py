"""Stamps in coarse ticks: evened times, no sample told lost that was not, recordings scored as exact ones are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.recording import Recording
from lostmotion.drivers.ticks import Ticks, coarser, evened
from lostmotion.drivers.timeline import Timeline

MILLIS = 1e-3


def taken(rate_hz: float, seconds: float = 10.0) -> FloatArray:
    """When a sensor took its samples [s]."""
    times: FloatArray = 0.1234 + np.arange(int(seconds * rate_hz)) / rate_hz
    return times


def stamped(times: FloatArray, tick: float = MILLIS) -> FloatArray:
    """What a microcontroller's clock says then [s]."""
    ticks: FloatArray = np.floor(times / tick + 1e-9) * tick
    return ticks


def told(rate_hz: float, times: FloatArray, tick: float = MILLIS) -> tuple[int, int, FloatArray, FloatArray]:
    """Lost and broken samples that a timeline tells of these, which arrive 2 ms late and by fours; its times, and those
    of them that have a value."""
    line = Timeline(1 / rate_hz, 2**32 * tick, tick)
    blocks = [
        line.stamped(stamped(part, tick), np.zeros(len(part)), float(part[-1]) + 2e-3)
        for part in np.array_split(times, len(times) // 4)
    ]
    every = np.concatenate([block.time for block in blocks])
    there = np.isfinite(np.concatenate([block.accel for block in blocks]))
    return sum(block.lost for block in blocks), sum(block.broken for block in blocks), every, every[there]


@pytest.mark.parametrize("rate_hz", [200.0, 500.0, 800.0, 1000.0, 1600.0])
def test_millis_tells_no_sample_lost_that_was_not(rate_hz: float) -> None:
    """At any rate nothing is missing or broken, and after a second the times are as even as the sensor's, to 20 µs."""
    lost, broken, every, _ = told(rate_hz, taken(rate_hz))
    assert (lost, broken) == (0, 0)
    assert np.diff(every[every > 1.2]) == pytest.approx(1 / rate_hz, abs=2e-5)


@pytest.mark.parametrize("off", [0.96, 0.999, 1.001, 1.04])
def test_a_sensor_that_is_a_little_fast_or_slow_loses_nothing(off: float) -> None:
    """Up to 4 % beside its nominal 800 Hz: every time lies within a tick of the true one, but for a constant."""
    times = taken(800.0 * off)
    lost, broken, _, there = told(800.0, times)
    assert (lost, broken) == (0, 0)
    late = (there - times)[times > 1.2]
    assert np.ptp(late) < MILLIS


def test_lost_samples_are_counted_all_the_same() -> None:
    """One in a hundred at random: nine of ten of them at 800 Hz, all where a tick is no more than a fifth of a period;
    a loss of ten in a row is counted to one."""
    rng = np.random.default_rng(1)
    for rate_hz, share in ((800.0, 0.8), (200.0, 1.0)):
        times = taken(rate_hz, 40)
        kept = rng.random(times.size) > 0.01
        kept[[0, -1]] = True
        lost, _, _, _ = told(rate_hz, times[kept])
        missing = np.count_nonzero(~kept)
        assert share * missing <= lost <= missing
    times = taken(800.0)
    assert told(800.0, np.delete(times, slice(4000, 4010)))[0] == pytest.approx(10, abs=1)


def test_a_counter_that_begins_again_at_0() -> None:
    """millis() wraps after 49.7 days: nothing is lost then."""
    line = Timeline(1 / 800, 2**32 * MILLIS, MILLIS)
    times = 2**32 * MILLIS - 0.5 + np.arange(800) / 800
    stamps = np.mod(stamped(times), 2**32 * MILLIS)
    blocks = [line.stamped(stamps[k : k + 4], np.zeros(4), k / 800) for k in range(0, 800, 4)]
    assert sum(block.lost + block.broken for block in blocks) == 0


def test_a_fine_clock_is_taken_at_its_word() -> None:
    """micros() at 800 Hz: the times keep the jitter of the samples, and one lost sample in 8000 is counted."""
    rng = np.random.default_rng(2)
    times = taken(800.0) + rng.normal(0, 5e-5, 8000)
    lost, _, _, there = told(800.0, np.delete(times, 4000), 1e-6)
    assert lost == 1
    assert np.std(np.diff(there)[2000:3900]) == pytest.approx(math.sqrt(2) * 5e-5, rel=0.1)


@pytest.mark.parametrize("rate_hz", [730.0, 800.0, 990.0, 1280.0])
@pytest.mark.parametrize("rounded", [np.floor, np.round])
def test_a_recording_with_rounded_times_is_evened(rate_hz: float, rounded: np.ufunc) -> None:
    """Times to a millisecond: all steps of the signal are the true period to 3 %, no time moves by more than 1 ms."""
    times = taken(rate_hz)
    written = rounded(times / MILLIS) * MILLIS
    found, _ = Recording(written, {"accel": np.ones_like(times)}).signal("accel")
    assert np.diff(found)[100:] == pytest.approx(1 / rate_hz, rel=0.03)
    assert np.abs(found - written).max() <= MILLIS


def test_samples_that_arrive_in_bursts_are_evened() -> None:
    """At 260 Hz through a buffer that is emptied every 62 ms, stamped on arrival: the times are even, and right to a
    constant; a second of samples that were lost stays lost."""
    times = np.arange(5000) / 260
    arrived = np.ceil(times / 0.062) * 0.062
    found = evened(arrived)
    assert np.diff(found) == pytest.approx(1 / 260, rel=1e-3)
    assert np.ptp(found - times) < 5e-3
    assert np.diff(evened(np.delete(arrived, slice(2000, 2260)))).max() == pytest.approx(1.0, abs=0.1)


def test_samples_with_pauses_between_them_keep_their_times() -> None:
    """A microcontroller that reads an encoder nine times at 200 Hz, then serves its page for 128 ms: the angle moves on
    meanwhile, as it does not between samples that only arrived together."""
    times = np.concatenate([0.168 * k + 0.005 * np.arange(9) for k in range(90)])
    angle = np.rint(np.cos(7 * times) * 1000) / 1000
    found, _ = Recording(times, {"position": angle}).signal("position")
    np.testing.assert_array_equal(found, times)
    arrived = Recording(times, {"position": np.cos(7 * np.linspace(0, times[-1], times.size))}).signal("position")[0]
    assert np.ptp(np.diff(arrived)) < 1e-9


def test_lines_that_are_stamped_as_they_are_read_from_a_buffer_are_evened() -> None:
    """The same, but each line has the millisecond in which it was read, and some bursts are late.  Times with a pause
    stay as they are."""
    rng = np.random.default_rng(1)
    times = np.arange(5000) / 260
    late = 0.1 * (rng.random(400) < 0.02)
    burst = np.ceil(times / 0.062).astype(int)
    arrived = burst * 0.062 + late[burst] + 5e-4 * (np.arange(5000) - np.searchsorted(burst, burst))
    arrived = np.round(np.maximum.accumulate(arrived), 3)
    found = evened(arrived)
    assert np.diff(found) == pytest.approx(1 / 260, rel=1e-3)
    assert np.ptp(found - times) < 5e-3
    paused = times + 5.0 * (times > 10)
    assert np.array_equal(evened(paused), paused)


def test_times_with_so_many_digits_are_evened() -> None:
    """Frames 1/30 s apart, written with four digits (9.967, 10.03, 110.6): the steps are even to 3 % above 10 s, where
    they were 30, 40, 0 and 100 ms; one frame that was lost stays lost."""
    times = np.delete(np.arange(3600) / 30, 1000)
    found = evened(np.array([float(f"{time:.4g}") for time in times]))
    steps = np.delete(np.diff(found)[330:], 1000 - 331)
    steps = steps[np.abs(found[331:-1] - 100.0) > 1]
    assert steps == pytest.approx(1 / 30, rel=0.03)
    assert np.abs(found - times).max() < 0.1


def test_times_that_are_not_rounded_stay_as_they_are() -> None:
    """An exact grid in milliseconds, with or without lost samples; another one; jitter; few rows; one instant."""
    rng = np.random.default_rng(3)
    grid = np.arange(5000) * MILLIS
    for times in (grid, grid[rng.random(5000) > 0.01], grid[rng.random(5000) > 0.3], grid * math.pi,
                  np.sort(grid + rng.normal(0, 2e-4, 5000)), grid[:20], np.zeros(100)):  # fmt: skip
        assert evened(times) is times


def test_times_ascend() -> None:
    """Whatever the stamps, also many equal ones: each time is later than the one before."""
    stamps = np.sort(np.random.default_rng(4).integers(0, 100, 2000)) * MILLIS
    times, missing = Ticks(1 / 800, MILLIS).feed(stamps)
    assert np.all(np.diff(times) > 0)
    assert missing.min() >= 0


def test_a_clock_may_be_coarser_than_its_unit() -> None:
    """Milliseconds in steps of 1000 µs are found; microseconds, an exact clock with samples lost, and few stamps are
    what they say."""
    period, count = 1.25e-3, np.arange(200)
    exact = count * period
    assert coarser(np.floor(exact * 1e3) / 1e3, 1e-6, period) == pytest.approx(1e-3)
    assert coarser(np.floor(exact / 5e-3) * 5e-3, 1e-6, period) == pytest.approx(5e-3)
    assert coarser(exact[count % 7 > 0], 1e-6, period) == pytest.approx(1e-6)
    assert coarser(np.round(exact * 1.0123, 6), 1e-6, period) == pytest.approx(1e-6)
    assert coarser(np.floor(exact[:20] * 1e3) / 1e3, 1e-6, period) == 1e-6
    assert coarser(exact, 0.0, period) == 0.0
