"""The running parabola and the running noise against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.detector.local_fit import REANCHOR, LocalFit
from lostmotion.detector.noise import NoiseLevel
from lostmotion.detector.window import FloatArray


def test_running_sums_equal_a_polynomial_fit() -> None:
    """At each of 500 irregular samples, late in the robot's life: twice the leading coefficient of numpy's polyfit."""
    rng = np.random.default_rng(20)
    time = 1e6 + np.cumsum(rng.uniform(0.004, 0.016, 500))
    angle = 3 + np.sin(7 * time) + 0.01 * rng.normal(size=500)
    fit = LocalFit(0.2)
    for index in range(500):
        curvature = fit.add(time[index], angle[index])
        inside = time[: index + 1] >= time[index] - 0.2 * (1 + 1e-9)
        if time[index] - time[: index + 1][inside][0] < 0.16:
            assert curvature is None
            continue
        t, y = time[: index + 1][inside], angle[: index + 1][inside]
        assert curvature is not None
        at, value, _ = curvature
        assert value == pytest.approx(2 * np.polyfit(t - t.mean(), y, 2)[0], rel=1e-6, abs=1e-6)
        assert at == pytest.approx(t.mean(), abs=1e-7)


@given(
    steps=st.lists(st.tuples(st.floats(0.001, 0.05), st.integers(-3, 3)), min_size=10, max_size=200),
    count=st.sampled_from([5e-3, 1.0]),
)
def test_running_sums_are_those_of_sample_by_sample(steps: list[tuple[float, int]], count: float) -> None:
    """Any motion in whole counts, up and down, with rests and gaps: exactly the sums that take each old sample out and
    put the new one in, one after the other, so that rounding is the same whatever the implementation."""
    fit = LocalFit(0.2)
    sums, kept, anchor, offset, age = np.zeros(7), list[tuple[float, float]](), 0.0, 0.0, REANCHOR

    def terms(time: float, value: float) -> FloatArray:
        t, y = time - anchor, value - offset
        return np.array([t, t * t, t * t * t, (t * t) * (t * t), y, y * t, y * (t * t)])

    time, angle = 1e4, 0.0
    for pause, change in steps:
        time, angle, age = time + pause, angle + change * count, age + 1
        fit.add(time, angle)
        kept.append((time, angle))
        while kept[0][0] < time - 0.2 * (1 + 1e-9):
            sums = sums - terms(*kept.pop(0))
        sums = sums + terms(time, angle)
        if age > REANCHOR:
            (anchor, offset), age, sums = kept[-1], 0, np.zeros(7)
            for one in kept:
                sums = sums + terms(*one)
        assert fit.sums == tuple(sums)
        assert list(fit.samples) == kept


def test_gain_is_the_standard_deviation_of_the_curvature() -> None:
    """Unit noise at 100 Hz in 0.2 s: the spread of the fitted acceleration is ``gain``, within 5 %."""
    rng = np.random.default_rng(21)
    fit = LocalFit(0.2)
    results = [fit.add(0.01 * i, value) for i, value in enumerate(rng.normal(size=20000))]
    values = [value for _, value, _ in filter(None, results)]
    last = results[-1]
    assert last is not None
    assert np.std(values) == pytest.approx(last[2], rel=0.05)


@pytest.mark.parametrize("jitter", [0.0, 0.003])
def test_noise_level_is_the_standard_deviation(jitter: float) -> None:
    """Gaussian errors of 2 mrad on a moving angle, at irregular but true times: within 15 %, averaged over time."""
    rng = np.random.default_rng(22)
    time = np.arange(3000) * 0.01 + rng.uniform(-jitter, jitter, 3000)
    noise = NoiseLevel()
    levels = []
    for t, y in zip(time, np.sin(time) + rng.normal(0, 2e-3, 3000), strict=True):
        noise.add(t, y, 0.0)
        levels.append(noise.level)
    assert np.mean(levels[200:]) == pytest.approx(2e-3, rel=0.15)


def test_a_staircase_is_no_noise() -> None:
    """Goals written at 20 Hz and read at 100 Hz leave no noise behind."""
    noise = NoiseLevel()
    for index in range(300):
        noise.add(0.01 * index, 0.1 * (index // 5), 0.0)
    assert noise.level == 0.0
