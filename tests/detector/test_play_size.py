"""The size of the play from simulated reversals: by eqs. 1-7, and by free flight between hard stops."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from lostmotion.detector.commanded import BEFORE_S
from lostmotion.detector.play_size import play_size, pooled, with_play
from lostmotion.detector.score import score_window
from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings, Score, Window
from lostmotion.model import HandWaved, build_model

SETTINGS = DetectorSettings(f_res_hz=58.0)
STEP = math.radians(300) / 1023
HARD = replace(SETTINGS, flank_exponent=1e4)


def recording(seed: int, play_m: float, seconds: float = 12.0, rate: float = 1000.0) -> tuple[np.ndarray, ...]:
    """Commands in steps of an AX-12A at 100 Hz, and tip acceleration with a noise of 0.1 m/s², of the model."""
    motion, times = HandWaved(seed), np.arange(round(seconds * rate)) / rate
    tip = build_model("play", values={"d": play_m}).simulate(motion, times)["accel"]
    polls = np.arange(0, seconds, 0.01)
    noise = np.random.default_rng(seed).normal(0, 0.1, times.size)
    return polls, np.round(motion.position(polls) / STEP) * STEP, times, tip + noise


@pytest.mark.slow
@pytest.mark.parametrize("play_um", [20, 40, 80, 200])
def test_error_and_intervals(play_um: int) -> None:
    """Median error of a window at most 10 %, of all together at most 5 %; intervals cover 90 % and more: radius 10 mm,
    0.29° steps of the command, four motions that were never used to choose a constant."""
    truth = play_um * 1e-6 / 0.01
    scores = [score for seed in range(8200, 8204) for score in score_series(*recording(seed, play_um * 1e-6), SETTINGS)]
    told = [score for score in scores if math.isfinite(score.play)]
    assert len(told) > 0.6 * len(scores)
    errors = np.array([score.play / truth - 1 for score in told])
    assert np.median(np.abs(errors)) < 0.10
    assert pooled([score.play for score in told]).value == pytest.approx(truth, rel=0.05)
    assert np.mean([score.play_low <= truth <= score.play_high for score in told]) >= 0.9


@lru_cache
def flights(play: float, rate: float = 1000.0) -> tuple[Window, np.ndarray, np.ndarray]:
    """A body that flies freely between hard stops ± play/2 on a swaying shaft, without a rebound: its stretch of tip
    acceleration by the exact ring of each kick, and the shaft's angle."""

    def shaft(t: np.ndarray) -> np.ndarray:
        return np.asarray(0.15 * np.sin(2 * math.pi * 1.7 * t))

    step, total = 2e-5, 0.6
    fine = np.arange(0, total, step)
    angles = shaft(fine)
    rates = np.gradient(angles, step)
    place, speed = angles[0] - play / 2, rates[0]
    kicks: list[tuple[float, float]] = []
    for i in range(1, fine.size):
        place += speed * step
        off = place - angles[i]
        if abs(off) > play / 2:
            place = angles[i] + math.copysign(play / 2, off)
            if (speed - rates[i]) * off > 0:
                kicks.append((fine[i], rates[i] - speed))
                speed = rates[i]
    times = np.arange(0, total, 1 / rate)
    omega, zeta = 2 * math.pi * 58, 0.012
    when, size = (np.array(column) for column in zip(*kicks, strict=True))
    after = times[:, None] - when
    waves = np.where(after >= 0, np.exp(-zeta * omega * np.maximum(after, 0)) * np.sin(omega * after), 0.0)
    accel = 0.1 * omega * waves @ size
    reversal = 0.5 / 1.7
    keep = (times >= reversal - BEFORE_S) & (times < reversal + 0.25)
    window = Window("elbow", reversal - BEFORE_S, 0.45, times[keep], accel[keep], rate)
    polls = np.arange(0, total, 0.01)
    return window, polls, shaft(polls)


@pytest.mark.parametrize("play", [0.004, 0.008, 0.02])
def test_free_flight_between_hard_stops(play: float) -> None:
    """Kinematics alone, no model of the contact: within 12 % and inside of the interval."""
    found = play_size(*flights(play), replace(HARD, noise_ms2=0.05))
    assert found.value == pytest.approx(play, rel=0.12)
    assert found.low <= play <= found.high


def test_commands_that_end_early() -> None:
    """A service has the last commands of a window a little later than its acceleration: 80 ms less change the play by
    less than its interval."""
    window, polls, shaft = flights(0.008)
    early = polls < window.time[-1] - 0.08
    found = play_size(window, polls[early], shaft[early], replace(HARD, noise_ms2=0.05))
    assert found.value == pytest.approx(0.008, rel=0.15)
    assert found.low <= 0.008 <= found.high


def test_why_it_cannot_be_told() -> None:
    """A slow sensor, holes, no commands, one flank only: each has its reason, and no number."""
    window, polls, shaft = flights(0.008)
    holes = replace(window, accel=np.where(np.arange(window.accel.size) == 7, np.nan, window.accel))
    noise = replace(window, accel=np.random.default_rng(0).normal(0, 0.1, window.accel.size))
    slow = replace(window, time=window.time[::5], accel=window.accel[::5], rate_hz=200.0)
    for stretch, commands, words in (
        (slow, (polls, shaft), "too slow"),
        (holes, (polls, shaft), "missing"),
        (window, (polls[:5], shaft[:5]), "too few commands"),
        (noise, (polls, shaft), "both flanks"),
    ):
        found = play_size(stretch, *commands, SETTINGS)
        assert math.isnan(found.value)
        assert words in found.reason


def test_only_impacts_that_can_be_sized_are() -> None:
    """A silent window, a clipped one and a joint that is not to be sized get no play."""
    window, polls, shaft = flights(0.008)
    loud = score_window(replace(window, joint="elbow"), SETTINGS)
    assert loud.impact
    silent: Score = replace(loud, impact=False)
    for score, settings, reason in (
        (silent, SETTINGS, "no impact"),
        (replace(loud, quality="clipped"), SETTINGS, "clipped"),
        (loud, replace(SETTINGS, play_size=False), "not asked for"),
    ):
        assert with_play(score, window, polls.tolist(), shaft.tolist(), settings).play_reason == reason
    assert with_play(loud, window, polls.tolist(), shaft.tolist(), HARD).play == pytest.approx(0.008, rel=0.12)


def test_pooled_is_a_median_with_its_interval() -> None:
    """The interval of 400 medians of 25 normal values covers the truth in 93 to 99 %; five values are too few."""
    rng = np.random.default_rng(8210)
    found = [pooled(rng.normal(1.0, 0.2, 25)) for _ in range(400)]
    assert 0.93 <= np.mean([one.low <= 1.0 <= one.high for one in found]) <= 0.99
    assert "expected at least 6" in pooled([1.0] * 5 + [math.nan]).reason
