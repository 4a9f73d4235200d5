"""The band in which a motion stands out of its noise, and the samples that count."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np
import pytest

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.explain import fitted
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.lab.inverse.problem import InverseModel, Point
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import ModelError, Sampled, build_model
from lostmotion.model.motion import FloatArray


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


@pytest.mark.parametrize("samples", [400, 1600, 6000])
def test_the_noise_of_an_angle_is_that_of_its_readings(samples: int) -> None:
    """In the mean of twenty draws within a tenth, whatever the number of segments of the spectrum: it was 0.83 of it
    for one."""
    time = np.arange(samples) / 100
    found = []
    for seed in range(20):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(samples)
        measured = {"position": np.sin(2 * np.pi * 0.5 * time) + noise}
        found.append(Signals.of(Experiment("joint.csv", Sampled(time, time), time, measured)).position_noise)
    assert np.mean(found) == pytest.approx(1e-3, rel=0.1)


def test_samples_at_rest_do_not_count() -> None:
    """Of 36 s, of which the joint rests for 24, hardly more than the 12 in motion count."""
    signals = Signals.of(joint(200.0, 1e-3, rest_s=24.0))
    at = signals.time[signals.kept]
    assert np.mean(at < 23.0) < 0.02
    assert np.sum(at > 24.5) * np.median(np.diff(at)) > 9.0


def quivering(amplitude: float, seed: int) -> Experiment:
    """Steps of 1 rad of an arm of 0.06 kg m² with viscous friction, in closed form, at whose encoder something quivers
    at 11 to 40 Hz that its torque does not make."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 4.0, 1e-3)
    rate = 2 * np.pi * (0.8 + 0.3 * seed)
    damped, decay = rate * np.sqrt(1 - 0.4**2), np.exp(-0.4 * rate * time)
    angle = 1 - decay * (np.cos(damped * time) + 0.4 * rate / damped * np.sin(damped * time))
    speed = decay * rate**2 / damped * np.sin(damped * time)
    acceleration = rate**2 * (1 - angle) - 2 * 0.4 * rate * speed
    torque = 0.06 * acceleration + 0.4 * speed + 1e-3 * rng.standard_normal(time.size)
    shaken = sum(
        size * np.sin(2 * np.pi * hz * time + seed) for hz, size in ((11, 0.2), (18, 1.0), (27, 0.2), (40, 0.1))
    )
    measured = angle + amplitude * np.exp(-time) * shaken + 1e-6 * rng.standard_normal(time.size)
    return Experiment(f"arm{seed}.csv", Sampled(time, torque), time, {"position": measured})


@pytest.mark.slow
@pytest.mark.parametrize("amplitude", [0.0, 2e-3])
def test_motion_that_the_torque_does_not_make_narrows_the_band(
    amplitude: float, caplog: pytest.LogCaptureFixture
) -> None:
    """A quiver of 2 mrad moves the arm with 26 rad/s², its torque with 30: the band ends below it, and inertia and
    friction are right within 2 %.  A warning says that this leaves half of the torque out.  Without it the band ends
    where the angle falls into its noise."""
    recorded = [quivering(amplitude, seed) for seed in range(4)]
    found = fitted(
        build_model("joint", ["viscous_friction"]), recorded, Method.TORQUE, {"torque": 1e-3, "position": 1e-5}
    )
    values = {one.name: one.value for one in found.estimates}
    assert values["J"] == pytest.approx(0.06, rel=0.02)
    assert values["viscous_friction.b_v"] == pytest.approx(0.4, rel=0.02)
    channel = Channel.of(recorded)
    band, widest = channel.band_hz, max(Signals.of(one).band_hz for one in recorded)
    with caplog.at_level(logging.WARNING):
        channel.warn("arm0.csv")
    assert ("of the torque's variance" in caplog.text) == (channel.share < 1 / 2) == (amplitude > 0)
    assert band == widest if amplitude == 0.0 else band < min(widest, 15.0)


@pytest.mark.parametrize(("lost", "is_refused"), [(2, True), (4, False)])
def test_a_fit_ends_where_the_motion_can_still_be_simulated(
    lost: int, is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A simulation that fails for the derivatives after a step ends the fit at the values before it; for those at the
    first values it is refused.  The first simulation is of the first values, the second one for the derivatives."""
    model, residuals, asked = build_model("joint", ["viscous_friction"]), InverseModel.residuals, list[FloatArray]()

    def overflowing(self: InverseModel, points: Sequence[Point]) -> FloatArray:
        asked.append(residuals(self, points))
        if len(asked) == lost:
            asked[-1][-1] = math.inf
        return asked[-1]

    monkeypatch.setattr(InverseModel, "residuals", overflowing)
    data = InverseModel.of([Signals.of(quivering(0.0, 0))], model)
    if is_refused:
        with pytest.raises(ModelError, match="near the first values"):
            regressed(model, data)
    else:
        assert np.isfinite(regressed(model, data).z).all()
        assert len(asked) > lost


def test_a_slow_motion_keeps_some_samples_for_each_regressor() -> None:
    """A joint that turns by sines of 0.05 and 0.15 Hz for 16 s, read at 30 Hz in steps of 1 mrad: its angle falls into
    its noise below half a hertz, and a regression with six columns has 24 samples all the same, and more where its
    neighbours move it."""
    time = np.arange(0.0, 16.0, 1 / 30)
    angle = np.sin(2 * np.pi * 0.05 * time) + 0.3 * np.sin(2 * np.pi * 0.15 * time)
    noise = 2e-2 * np.random.default_rng(2).standard_normal(time.size)
    slow = Experiment("slow.csv", Sampled(time, np.cos(time)), time, {"position": angle + noise})
    signals, disturbed = Signals.of(slow), Signals.of(slow, is_disturbed=True)
    assert signals.band_hz < 1.0
    assert 22 <= signals.kept.size < 40
    assert disturbed.band_hz == pytest.approx(40 / 16, rel=0.01)
    assert 60 <= disturbed.kept.size < 120
