"""How simulated time passes: no hole where it is continuous, clean ones where it is skipped."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from lostmotion.drivers.schedule import YEAR_S, grid, schedule_step, skips


@pytest.mark.parametrize("speed", [1.0, 4.0, math.inf])
def test_slow_time_has_no_holes(speed: float) -> None:
    """Steps follow each other, and servos are heard all the time."""
    steps = [schedule_step(number, 0.05, speed) for number in range(100)]
    assert not skips(speed)
    assert steps[0].after_rest
    for one, other in pairwise(steps):
        assert (one.end, one.servo_end, other.after_rest) == (other.begin, one.end, False)


def test_slow_time_rests_for_a_second_every_hour() -> None:
    """The first step of the second hour begins a second late, with a stretch of its own."""
    last, first = (schedule_step(number, 0.05, 1.0) for number in (71999, 72000))
    assert (last.end, last.servo_end, last.stretch) == (3600.0, 3599.5, 0)
    assert (first.begin, first.origin, first.stretch, first.after_rest) == (3601.0, 3601.0, 1, True)


def test_fast_time_comes_in_stretches() -> None:
    """A year in a minute: 60 stretches of 4 s of motion over the year, in which the servos are heard 3.5 s."""
    steps = [schedule_step(number, 0.5, 525600.0) for number in range(60 * 8)]
    assert skips(525600.0)
    assert sum(step.after_rest for step in steps) == 60
    assert steps[-8].begin == pytest.approx(YEAR_S * 59 / 60)
    heard = [(step.end - step.begin, max(step.servo_end - step.begin, 0.0)) for step in steps]
    np.testing.assert_allclose(np.sum(heard, axis=0), [60 * 4.0, 60 * 3.5])
    assert all(one.end <= other.begin for one, other in pairwise(steps))


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0, 59.3])
def test_grids_of_consecutive_steps_join(rate_hz: float) -> None:
    """No sample is made twice or left out where one step ends and the next begins, also after a year."""
    for number in (0, 59 * 8):
        steps = [schedule_step(number + part, 0.5, 525600.0) for part in range(8)]
        times = np.concatenate([grid(step.begin, step.end, rate_hz) for step in steps])
        assert len(times) == pytest.approx(4 * rate_hz, abs=1)
        np.testing.assert_allclose(np.diff(times), 1 / rate_hz, atol=1e-7)
