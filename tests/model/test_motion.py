"""Motions agree with their own derivatives, keep to their band, and go by name; the sensor does what it says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.model import Chirp, HandWaved, ModelError, Motion, Sampled, Sensor, Sine, Step, by_name
from lostmotion.model.pieces import cut

TIMES = np.linspace(-1.0, 12.0, 4001)
MOTIONS = [
    Sine(),
    HandWaved(seed=3),
    Chirp(),
    Step(0.3, 0.2, 0.5),
    Sampled(np.arange(200) / 50, np.sin(np.arange(200) / 9)),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: type(motion).__name__)
def test_derivatives(motion: Motion) -> None:
    """Velocity and acceleration are the derivatives of position, as differences show."""
    h = 1e-5
    inside = TIMES[(np.abs(TIMES) > 2 * h) & (np.abs(TIMES - 10) > 2 * h) & (np.abs(TIMES - 3.98) > 2 * h)]
    for value, slope in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        difference = (value(inside + h) - value(inside - h)) / (2 * h)
        assert np.max(np.abs(difference - slope(inside))) < 2e-3 * max(np.max(np.abs(difference)), 1e-3)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: type(motion).__name__)
def test_pieces_follow_the_motion(motion: Motion) -> None:
    """The polynomials that the solver reads agree with the motion between their knots, to 1e-6 of its size."""
    pieces = cut(motion, 0.2, 3.0)
    middle = np.diff(pieces.knots) * 0.3
    value = sum(c * middle**i for i, c in enumerate(pieces.coefficients.T))
    exact = motion.position(pieces.knots[:-1] + middle + 0.2)
    assert np.max(np.abs(value - exact)) < 1e-6 * np.max(np.abs(exact))
    assert pieces.knots[0] == 0.0
    assert pieces.knots[-1] == 3.0


@pytest.mark.parametrize("name", ["sine:3,-0.2", "hand-waved:7", "chirp:8,0.5,10,0.3", "step:-0.3,0.2,0.5"])
def test_peaks_are_not_exceeded(name: str) -> None:
    """What a motion says of its velocity and acceleration holds, and is no more than three times what it reaches."""
    motion = by_name(name)
    for values, peak in zip((motion.velocity(TIMES), motion.acceleration(TIMES)), motion.peaks(), strict=True):
        assert np.max(np.abs(values)) <= peak * (1 + 1e-9) < 3 * np.max(np.abs(values))


def test_every_sample_is_a_knot_however_long_the_run() -> None:
    """An hour that begins with a second of recording at 1 kHz loses no sample, nor where the run ends with one."""
    time = 1e9 + np.arange(1001) / 1000
    drive = Sampled(time, np.sin(time))
    assert cut(drive, time[0], 3600.0).knots[:1001] == pytest.approx(time - time[0], abs=1e-6)
    assert cut(drive, time[-1] - 3600, 3600.0).knots[-1001:] == pytest.approx(time - time[-1] + 3600, abs=1e-6)


def test_hand_waved_is_irregular_and_band_limited() -> None:
    """It has the size it is asked for, nothing outside its band, does not repeat, and is the same for the same seed."""
    motion = HandWaved(seed=1, amplitude_rad=0.2, low_hz=0.5, high_hz=3.0)
    t = np.arange(0, 400, 0.02)
    x = motion.position(t)
    assert np.sqrt(2 * np.mean(x**2)) == pytest.approx(0.2, rel=0.05)
    power = np.abs(np.fft.rfft(x * np.hanning(x.size))) ** 2
    f = np.fft.rfftfreq(x.size, 0.02)
    assert power[(f < 0.45) | (f > 3.05)].sum() < 1e-6 * power.sum()
    assert abs(np.corrcoef(x[:10000], x[10000:])[0, 1]) < 0.5
    assert np.array_equal(x, HandWaved(1, 0.2).position(t))
    assert not np.allclose(x, HandWaved(2, 0.2).position(t))


def test_samples_are_met_and_continued_straight() -> None:
    """The spline passes through the samples and goes on with its last slope."""
    time, values = np.array([0.0, 0.1, 0.25, 0.3]), np.array([0.0, 0.5, -0.2, 0.1])
    motion = Sampled(time, values)
    assert motion.position(time) == pytest.approx(values)
    slope = motion.velocity(np.array([0.3]))[0]
    assert motion.position(np.array([0.5]))[0] == pytest.approx(0.1 + 0.2 * slope)
    assert motion.acceleration(np.array([0.5]))[0] == 0.0


@pytest.mark.parametrize(
    ("text", "motion"),
    [
        ("sine:6,0.02", Sine(6.0, 0.02)),
        ("sine", Sine()),
        ("hand-waved", HandWaved()),
        ("hand-waved:7,0.3", HandWaved(7, 0.3)),
        ("chirp:1,9,5,0.1", Chirp(1.0, 9.0, 5.0, 0.1)),
        ("step:0.1,0.05,1", Step(0.1, 0.05, 1.0)),
    ],
)
def test_by_name(text: str, motion: Motion) -> None:
    """The texts of the command line name the motions."""
    assert by_name(text) == motion


@given(st.one_of(st.text(), st.from_regex(r"(sine|hand-waved|chirp|step):[-0-9.,a-z]{0,12}", fullmatch=True)))
def test_any_text_is_a_motion_or_refused(text: str) -> None:
    """No text leads to anything but a motion or one clear error."""
    try:
        motion = by_name(text)
    except ModelError:
        return
    assert np.isfinite(motion.position(np.zeros(1))).all()


def test_sensor_chain() -> None:
    """Noise has the size asked for, the range clips, readings are whole counts."""
    rng = np.random.default_rng(0)
    noisy = Sensor(noise=0.1).apply(np.zeros(20000), rng)
    assert np.std(noisy) == pytest.approx(0.1, rel=0.03)
    readings = Sensor(noise=0.05, resolution=0.01, range=1.0).apply(np.linspace(-3, 3, 1000), rng)
    assert np.max(np.abs(readings)) == 1.0
    assert readings / 0.01 == pytest.approx(np.round(readings / 0.01), abs=1e-6)
    assert np.array_equal(Sensor().apply(noisy, rng), noisy)


def test_coloured_noise() -> None:
    """Coloured noise keeps its size and has the correlation asked for between neighbours."""
    noise = Sensor(noise=2.0, noise_colour=0.9).apply(np.zeros(200_000), np.random.default_rng(0))
    assert np.std(noise) == pytest.approx(2.0, rel=0.03)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.9, abs=0.01)


@given(
    st.sampled_from(["noise", "resolution", "range", "noise_colour"]),
    st.sampled_from([-1.0, float("nan")]),
)
def test_sensor_refuses_nonsense(name: str, bad: float) -> None:
    """Negative or missing properties of a sensor are refused."""
    with pytest.raises(ModelError):
        Sensor(**{name: bad})
