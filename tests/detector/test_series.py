"""A whole recording: one score for each reversal, with and without impacts."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.learner import settled
from lostmotion.detector.score import score_window
from lostmotion.detector.series import score_series
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings, FloatArray, Window
from lostmotion.detector.windows import cut
from tests.conftest import Measurements
from tests.detector.synthetic import HandWaved, quantise, ring

SETTINGS = DetectorSettings(f_res_hz=58.0)
X_SERIES = math.radians(360 / 4096)
DURATION = 30.0


def recording(play: float) -> tuple[HandWaved, tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Commands at 100 Hz, tip acceleration at 200 Hz; ``play``: ring-down [m/s²] 40 ms after each reversal."""
    rng = np.random.default_rng(70)
    motion = HandWaved.draw(rng, 0.8, 1.5, 0.3)
    servo, sensor = np.arange(0, DURATION, 0.01), np.arange(0, DURATION, 0.005) + 0.0013
    rings = ring(sensor, motion.reversals(DURATION) + 0.04, 58.0, 0.03).sum(axis=0)
    accel = 0.1 * motion.acceleration(sensor) + play * rings + rng.normal(0, 0.1, sensor.size)
    return motion, (servo, quantise(motion.angle(servo), X_SERIES), sensor, accel)


def test_play_is_told_from_none() -> None:
    """Ring-downs of 1.5 m/s² in 0.1 m/s² of noise: nearly every window above the level; without play nearly none."""
    motion, worn = recording(1.5)
    _, healthy = recording(0.0)
    with_play = score_series(*worn, SETTINGS, "elbow", X_SERIES)
    without = score_series(*healthy, SETTINGS, "elbow", X_SERIES)
    assert abs(len(with_play) - motion.reversals(DURATION).size) <= 2
    assert np.mean([s.impact for s in with_play]) > 0.95
    assert np.mean([s.impact for s in without]) < 0.05
    assert [s.duration for s in with_play] == pytest.approx([0.25] * len(with_play))
    assert all(s.joint == "elbow" and s.excitation > 1 for s in with_play)
    assert {s.quality for s in with_play[:-1]} == {"ok"}


def test_same_as_the_service() -> None:
    """Commands pushed one by one, each window cut from what is there: exactly the scores of the whole recording, with
    the noise from all its windows."""
    _, (servo, commands, sensor, accel) = recording(1.5)
    trigger = Trigger(SETTINGS, 100.0, X_SERIES)
    windows: list[Window] = []
    for time, command in zip(servo, commands, strict=True):
        for found in trigger.push((time,), (command,)):
            segment = (sensor > found.time - 0.5) & (sensor < found.time + 0.5)
            window = cut("joint", sensor[segment], accel[segment], found.time, 0.25, 200.0, excitation=abs(found.swing))
            windows.append(window)
    known = settled([window.accel for window in windows], 200.0, SETTINGS)
    scores = [score_window(window, known) for window in windows]
    whole = score_series(servo, commands, sensor, accel, SETTINGS, resolution=X_SERIES)
    assert len(scores) == len(whole) > 50
    assert [s.score for s in scores] == pytest.approx([s.score for s in whole], rel=1e-9, nan_ok=True)
    assert [(s.time, s.impact, s.quality) for s in scores] == [(s.time, s.impact, s.quality) for s in whole]


@pytest.mark.parametrize(
    ("servo", "sensor", "words"),
    [
        (np.array([0.0]), np.arange(100) / 200, "found 1 commands, expected at least 3"),
        (np.arange(100) / 100, np.empty(0), "0 accelerations"),
        (np.arange(100)[::-1] / 100, np.arange(100) / 200, "do not ascend"),
        (1e15 + np.arange(100) / 100, np.arange(100) / 200, "from 1e.15 s on.*too large to be distinct"),
        (np.arange(100) / 100, np.arange(100) / 50, "expected less than half of the rate"),
    ],
)
def test_recordings_that_tell_nothing_are_refused(servo: FloatArray, sensor: FloatArray, words: str) -> None:
    """One row, none at all, times that run backwards, a sensor too slow: an error in one line."""
    with pytest.raises(DetectorError, match=words):
        score_series(servo, np.zeros(servo.size), sensor, np.zeros(sensor.size), SETTINGS)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_nonsensical_accelerations_give_no_score(share: float) -> None:
    """Where half of the samples or all are near the largest number there is, windows have no score, and the reason in
    their quality."""
    _, (servo, commands, sensor, accel) = recording(1.5)
    accel = np.where(np.random.default_rng(1).random(accel.size) < share, 1e308, accel)
    scores = score_series(servo, commands, sensor, accel, SETTINGS, resolution=X_SERIES)
    assert len(scores) > 50
    assert all(math.isnan(s.score) and not s.impact for s in scores)
    assert all({"gappy", "short"} & set(s.quality.split(",")) for s in scores)


def test_a_robot_at_rest_has_no_windows() -> None:
    """No motion, no windows."""
    assert score_series(np.arange(500) / 100, np.zeros(500), np.arange(1000) / 200, np.zeros(1000), SETTINGS) == []


@pytest.mark.parametrize(("name", "period"), [("0p5Hz_30lb_1in", 1.0), ("1Hz_30lb_0p5in", 0.5)])
def test_a_window_at_each_reversal_of_a_real_recording(real_data: Measurements, name: str, period: float) -> None:
    """A damper with backlash driven by a sine: one window for each half period, and each of them has a score."""
    path = real_data("friction_backlash_30lb") / f"{name}.csv"
    time, command, force = np.loadtxt(path, delimiter=",", skiprows=5, unpack=True)
    settings = DetectorSettings(f_res_hz=40.0, f_width_hz=20.0, f_norm_hz=150.0, f_norm_width_hz=100.0)
    scores = score_series(time, command, time, force, settings)
    starts = np.array([s.time for s in scores])
    middle = np.diff(starts)[1:-1]
    assert middle == pytest.approx(np.full(middle.size, period), rel=0.15)
    assert len(scores) == pytest.approx(time[-1] / period, abs=1.5)
    assert np.isfinite([s.score for s in scores if "short" not in s.quality]).all()
