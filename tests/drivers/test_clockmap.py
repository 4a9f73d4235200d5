"""How near the clock map comes to the truth, on simulated sensors whose true times are known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.clockmap import ClockMap


@dataclass(frozen=True)
class Line:
    """A sensor and its way to the host: rate [Hz], clock error [ppm], period of the bursts [s], mean of the random
    delay [s], share of bursts that a busy host takes up to 0.1 s later."""

    rate: float = 200.0
    ppm: float = 0.0
    burst: float = 0.016
    jitter: float = 0.001
    stalls: float = 0.01

    def bursts(self, seconds: float, seed: int = 0) -> Iterator[tuple[FloatArray, FloatArray, float]]:
        """Sensor times, true host times and the arrival of each burst."""
        rng = np.random.default_rng(seed)
        sensor = np.arange(round(self.rate * seconds)) / self.rate
        true = 1000 + sensor * (1 + self.ppm * 1e-6)
        start, arrival, now = 0, 0.0, 1000.0
        while start < len(true):
            now += self.burst
            delay = rng.exponential(self.jitter) + (rng.random() < self.stalls) * rng.uniform(0, 0.1)
            arrival = max(arrival, now + delay)
            end = int(np.searchsorted(true, now, side="right"))
            if end > start:
                yield sensor[start:end], true[start:end], arrival
            start = end


def errors(line: Line, seconds: float, settled: float) -> tuple[FloatArray, ClockMap]:
    """The error [s] of each mapped time after ``settled`` seconds."""
    clock, found = ClockMap(), []
    for sensor, true, arrival in line.bursts(seconds):
        host = clock.feed(sensor, arrival)
        if sensor[0] > settled:
            found.append(host - true)
    return np.concatenate(found), clock


@pytest.mark.parametrize("ppm", [30, 1000, -1000])
def test_an_imu_behind_ftdi_bursts_is_known_to_a_millisecond(ppm: float) -> None:
    """200 Hz in bursts of 16 ms, a clock off by up to 1000 ppm: within 1 ms after 10 s, and no step is imagined."""
    error, clock = errors(Line(ppm=ppm), 40, settled=10)
    assert np.abs(error).max() < 1e-3
    assert clock.steps == 0


@pytest.mark.parametrize("ppm", [100, 1000])
def test_a_fast_sensor_is_known_better_than_a_period(ppm: float) -> None:
    """1 kHz in bursts of 5 ms: within 0.7 ms after 10 s."""
    error, _ = errors(Line(rate=1000, ppm=ppm, burst=0.005), 30, settled=10)
    assert np.abs(error).max() < 0.7e-3


def test_the_first_seconds_are_rough_but_usable() -> None:
    """From the first second on the error stays below 2.5 ms, half a period at 200 Hz."""
    error, _ = errors(Line(ppm=1000), 10, settled=0)
    assert np.abs(error).max() < 2.5e-3


def test_a_cheap_resonator_is_followed() -> None:
    """A clock that is 1 % off is learnt: within 1 ms after 10 s."""
    error, clock = errors(Line(ppm=10_000), 40, settled=10)
    assert np.abs(error).max() < 1e-3
    assert clock.steps == 0


def test_a_busy_host_does_not_pull_the_line() -> None:
    """When a third of the bursts come up to 0.1 s late, the error stays below 4 ms and no step is imagined."""
    error, clock = errors(Line(stalls=0.3), 40, settled=10)
    assert np.abs(error).max() < 4e-3
    assert clock.steps == 0


def test_times_ascend_strictly() -> None:
    """Over all bursts and corrections of the line no time repeats or runs backwards."""
    clock = ClockMap()
    host = np.concatenate([clock.feed(sensor, arrival) for sensor, _, arrival in Line(jitter=0.01).bursts(20)])
    assert np.diff(host).min() > 0


@pytest.mark.parametrize("step", [5.0, -3.0, 0.5])
def test_a_step_of_the_sensor_clock_is_found(step: float) -> None:
    """When the sensor's clock jumps after 10 s the times are right again within 2 s, and one step is counted."""
    clock, late = ClockMap(), []
    for sensor, true, arrival in Line(ppm=500).bursts(20):
        jumped = sensor + step * (sensor[0] > 10)
        host = clock.feed(jumped, arrival)
        if sensor[0] > 12:
            late.append(host - true)
    assert clock.steps == 1
    assert clock.step == pytest.approx(-step, abs=0.12)
    assert np.abs(np.concatenate(late)).max() < 2e-3


def test_a_large_step_is_told_to_the_tenth_of_a_second() -> None:
    """A clock that is 1 % fast jumps by an hour: its rate has no part in the size of the step."""
    clock = ClockMap()
    for sensor, _, arrival in Line(ppm=10_000).bursts(12):
        clock.feed(sensor + 3600 * (sensor[0] > 10), arrival)
    assert (clock.steps, clock.step) == (1, pytest.approx(-3600, abs=0.1))
