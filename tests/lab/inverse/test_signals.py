"""The band in which a motion stands out of its noise, and the samples that count."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Sampled


def joint(rate_hz: float, step_rad: float, rest_s: float = 0.0) -> Experiment:
    """A swing of 1 rad and 0.5 to 1.5 Hz for 12 s, read in steps, that begins after a rest."""
    time = np.arange(0.0, 12.0 + rest_s, 1 / rate_hz)
    moving = np.maximum(time - rest_s, 0.0)
    angle = np.sin(2 * np.pi * 0.5 * moving) + 0.3 * np.sin(2 * np.pi * 1.5 * moving)
    noise = 0.3 * step_rad * np.random.default_rng(1).standard_normal(time.size)
    measured = step_rad * np.round((angle + noise) / step_rad)
    return Experiment("joint.csv", Sampled(time, np.cos(time)), time, {"position": measured})


@pytest.mark.parametrize("rate_hz", [100.0, 500.0, 1000.0])
def test_the_noise_of_a_fast_encoder_is_no_motion(rate_hz: float) -> None:
    """The band of the same swing ends between 1.5 and 15 Hz at every rate: at 1 kHz the noise of the speed is more than
    the speed, and counted as motion it made the band 200 Hz wide."""
    assert 1.5 < Signals.of(joint(rate_hz, 3e-3)).band_hz < 15.0


def test_samples_at_rest_do_not_count() -> None:
    """Of 36 s, of which the joint rests for 24, hardly more than the 12 in motion count."""
    signals = Signals.of(joint(200.0, 1e-3, rest_s=24.0))
    at = signals.time[signals.kept]
    assert np.mean(at < 23.0) < 0.02
    assert np.sum(at > 24.5) * np.median(np.diff(at)) > 9.0
