"""What the bench of the lab stands on: SciPy's right-hand side, and the bar that a column passes through."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench.lab import rhs, through_bar
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from lostmotion.model import HandWaved, Sampled, build_model


def test_scipy_solves_the_same_equations() -> None:
    """The right-hand side of the rival fit gives the model's accelerations to 1e-3 m/s²."""
    model = build_model("play")
    times = np.arange(801) / 800
    drive = Sampled(times, HandWaved(seed=2).position(times))
    spline = CubicSpline(drive.time, drive.values)
    v = {name: parameter.value for name, parameter in model.parameters.items()}
    p = np.array([v[name] for name in ("alpha", "d", "l", "b", "k", "bias", "R1", "R2", "J2", "beta", "n", "m")])
    where = (0.0, 1 / 800, np.ascontiguousarray(spline.c.T))
    y = solve_ivp(lambda t, y: rhs(y, t, p, *where), (0, 0.5), model.initial_state(drive), "DOP853", times[:401],
                  rtol=1e-10, atol=1e-13, max_step=5e-4).y  # fmt: skip
    ours = model.simulate(drive, times[:401], substep_s=1e-5)["accel"]
    np.testing.assert_allclose(-(v["b"] * y[3] + v["k"] * y[2]) / v["m"], ours, atol=1e-3)


@pytest.mark.parametrize("frequency_hz", [1.0, 20.0, 58.0, 90.0])
def test_bar_passes_what_it_should(frequency_hz: float) -> None:
    """A sine comes out with the gain of a bar whose root is pushed, 1/sqrt((1 - r²)² + (2 zeta r)²), within 2 %."""
    f_res, zeta, step = 58.0, 0.02, 1 / 8000
    times = np.arange(40_000) * step
    w = 2 * math.pi * f_res
    out = through_bar(np.sin(2 * math.pi * frequency_hz * times), step, w, zeta * w)[20_000:]
    r = frequency_hz / f_res
    gain = 1 / math.hypot(1 - r * r, 2 * zeta * r)
    assert np.std(out) * math.sqrt(2) == pytest.approx(gain, rel=0.02)
