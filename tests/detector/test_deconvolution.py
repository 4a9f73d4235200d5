"""The inverse of eq. 7: the joint's speed from the accelerometer, and the memory that this takes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.detector import deconvolution
from lostmotion.detector.deconvolution import edges, integrated, inverse, mistuned, noise_of
from lostmotion.detector.window import DetectorSettings, FloatArray

SETTINGS = DetectorSettings(f_res_hz=58.0, zeta=0.012, length_m=0.10)
LENGTH, RATE_HZ, NOISE = 850, 1000.0, 0.1


def rung(jump: float, at: float, settings: DetectorSettings = SETTINGS) -> FloatArray:
    """Tip accelerations after the joint's speed has changed once, by eq. 7's closed form."""
    since = np.arange(LENGTH) / RATE_HZ - at
    omega, zeta = 2 * np.pi * settings.f_res_hz, settings.zeta
    damped = omega * np.sqrt(1 - zeta**2)
    # q = -l sin(w t) exp(-z w0 t) / w is a free motion after q' = -l; the tip has the acceleration q'' then.
    phasor = np.exp((-zeta * omega + 1j * damped) * since)
    q2 = ((-zeta * omega + 1j * damped) ** 2 * phasor).imag / damped
    return np.where(since >= 0, -settings.length_m * jump * q2, 0.0)


def test_a_change_of_speed_is_found() -> None:
    """The impulses add up to the jump, where it was; beside it next to nothing."""
    inverted = inverse(LENGTH, RATE_HZ, NOISE, SETTINGS)
    impulses = inverted.impulses(rung(0.2, 0.4))
    near = np.abs(inverted.times - 0.4) < 0.01
    assert impulses[near].sum() == pytest.approx(0.2, rel=0.03)
    assert np.abs(np.cumsum(impulses)[inverted.times < 0.38]).max() < 0.01


def test_a_wrong_resonance_turns_up_as_an_angle() -> None:
    """What it adds is the difference of the two inverses' angles."""
    accel, share = rung(0.2, 0.4), 0.005
    right = inverse(LENGTH, RATE_HZ, NOISE, SETTINGS)
    wrong = inverse(LENGTH, RATE_HZ, NOISE, replace(SETTINGS, f_res_hz=58.0 * (1 + share)))
    angles = [integrated(one.impulses(accel), one.step) for one in (wrong, right)]
    expected = np.interp(right.times, wrong.times, angles[0]) - angles[1]
    added = mistuned(LENGTH, RATE_HZ, NOISE, SETTINGS, share) @ accel
    inside = right.times < 0.8
    assert np.abs(expected[inside]).max() > 4e-5
    assert np.allclose(added[inside], expected[inside], atol=2e-6)


def test_edges_see_a_jump_and_no_slow_motion() -> None:
    """A jump stands out by more than ten standard deviations of the noise, a sway of 1 Hz by none."""
    sharp = edges(LENGTH, RATE_HZ, NOISE, SETTINGS)
    time = np.arange(LENGTH) / RATE_HZ
    middle = slice(2 * sharp.width, -2 * sharp.width)
    jump, sway = (sharp.impulses(accel) / sharp.deviation for accel in (rung(0.2, 0.4), np.sin(2 * np.pi * time)))
    assert np.abs(jump[middle]).max() > 10
    assert np.abs(sway[middle]).max() < 1


@pytest.mark.parametrize(
    "make",
    [
        lambda length: inverse(length, RATE_HZ, NOISE, SETTINGS),
        lambda length: mistuned(length, RATE_HZ, NOISE, SETTINGS, 0.005),
        lambda length: edges(length, RATE_HZ, NOISE, SETTINGS),
    ],
)
def test_memory_that_is_taken_for_a_moment(make: Callable[[int], object]) -> None:
    """Made for a sensor, each takes less than 8 MB (15 when it was made of all samples at once)."""
    make(60)
    tracemalloc.start()
    try:
        make(LENGTH + 1)
        assert tracemalloc.get_traced_memory()[1] < 8e6
    finally:
        tracemalloc.stop()


def test_a_noise_that_is_learnt_anew_has_no_inverse_of_its_own() -> None:
    """A noise that wavers by 5 %, and its colour, which no inverse knows, have one or two of them in all: with one each
    the service of a worn joint took 50 MB more."""
    deconvolution._inverse.cache_clear()
    rng = np.random.default_rng(5)
    for deviation in 0.1 * (1 + rng.uniform(-0.05, 0.05, 20)):
        known = replace(SETTINGS, noise_ms2=float(deviation), noise_colour=(float(rng.uniform(-0.5, 0.5)),))
        noise = noise_of(np.zeros(LENGTH), known)
        assert noise == pytest.approx(deviation, rel=0.1)
        inverse(LENGTH, RATE_HZ, noise, known)
    assert deconvolution._inverse.cache_info().currsize <= 2
