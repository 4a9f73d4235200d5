"""Commands that are recorded in steps."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.lab.data.rounded_input import drawn_again, rounding_step, smooth_motion
from lostmotion.model import HandWaved, Sampled
from lostmotion.model.motion import FloatArray


def rounded(values: FloatArray, step: float) -> FloatArray:
    return np.asarray(np.round(values / step) * step)


def read_as(times: FloatArray, values: FloatArray) -> Sampled:
    """The motion of a recording."""
    return smooth_motion(times, values, rounding_step(values))


@pytest.mark.parametrize(
    ("motion", "rate_hz", "step", "angle", "acceleration"),
    [
        (HandWaved(11), 100.0, 5.1e-3, 0.5, 0.04),  # an AX-12A on a usual bus
        (HandWaved(12), 100.0, 1.5e-3, 0.5, 0.02),  # 12 bits
        (HandWaved(13, 0.03, 0.1, 0.6), 100.0, 5.1e-3, 0.5, 0.2),  # slow: the errors of rounding are not independent
        (HandWaved(14), 800.0, 5.1e-3, 0.3, 0.06),
    ],
)
def test_the_rounding_is_smoothed(
    motion: HandWaved, rate_hz: float, step: float, angle: float, acceleration: float
) -> None:
    """The errors of angle and acceleration, as shares of that of rounding and of the acceleration; times jitter."""
    times = np.arange(2000) / rate_hz
    times[1:-1] += np.random.default_rng(1).uniform(-0.2, 0.2, times.size - 2) / rate_hz
    found, inside = read_as(times, rounded(motion.position(times), step)), slice(50, -50)
    off = found.position(times) - motion.position(times)
    assert np.std(off[inside]) < angle * step / np.sqrt(12)
    accelerations = motion.acceleration(times)
    off = found.acceleration(times) - accelerations
    assert np.std(off[inside]) < acceleration * np.std(accelerations)


def test_a_jump_of_the_command_stays_one() -> None:
    """A motion that jumps is not smoothed; goals between which it jumps are no rounding."""
    times, step = np.arange(300) / 100, 1.5e-3
    values = rounded(0.5 * (times > 1.5) + 0.1 * times, step)
    assert np.array_equal(read_as(times, values).values, values)
    goals = np.where(times > 1.5, 0.5, np.where(times > 0.7, 0.3, 0.0))
    assert rounding_step(goals) == 0.0
    assert np.array_equal(read_as(times, goals).values, goals)


def test_an_exact_command_passes_through_its_samples() -> None:
    """What is not rounded is not smoothed; between the samples a quintic spline has a tenth of a cubic one's error."""
    motion, times = HandWaved(15), np.arange(400) / 100
    found = read_as(times, motion.position(times))
    assert rounding_step(found.values) == 0.0
    assert np.array_equal(found.values, motion.position(times))
    between = times[20:-20] + 0.005
    cubic = drawn_again(found, 0.0, np.random.default_rng(0))
    errors = [np.std(one.acceleration(between) - motion.acceleration(between)) for one in (found, cubic)]
    assert errors[0] < errors[1] / 10


def test_the_step_is_found() -> None:
    """Of an offset grid, also with the decimals of a file; not of a finer grid than matters."""
    values = HandWaved(17).position(np.arange(500) / 100)
    assert rounding_step(np.round(rounded(values, 5.1e-3) + 0.0013, 6)) == pytest.approx(5.1e-3, rel=1e-3)
    assert rounding_step(np.round(values, 7)) == 0.0


def test_another_input_is_as_far_from_the_motion() -> None:
    """The difference of two inputs that the readings tell is that of two independent errors."""
    motion, times, step = HandWaved(16), np.arange(2000) / 100, 5.1e-3
    found = read_as(times, rounded(motion.position(times), step))
    again = drawn_again(found, step, np.random.default_rng(3))
    error = np.std(found.values - motion.position(times))
    assert np.std(again.values - found.values) == pytest.approx(error, rel=0.2)
