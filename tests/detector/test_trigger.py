"""The trigger on motions whose reversals are known, on rest, on ramps, on steps and on a bad stream."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings, Reversal
from tests.detector.synthetic import FloatArray, HandWaved, quantise

SETTINGS = DetectorSettings(f_res_hz=58.0)
AX_12, X_SERIES = math.radians(300 / 1024), math.radians(360 / 4096)


def found(time: FloatArray, angle: FloatArray, rate_hz: float, resolution: float) -> list[Reversal]:
    """The reversals of a whole stream."""
    return Trigger(SETTINGS, rate_hz, resolution).push(time, angle)


def recall_and_precision(reversals: list[Reversal], motion: HandWaved, duration: float) -> tuple[float, float]:
    """Shares of the strong true reversals that were found, and of the found ones that are true, within 60 ms."""
    times = np.array([r.time for r in reversals])
    truth = motion.reversals(duration)
    strength = float(np.sqrt(np.mean(motion.acceleration(np.arange(0, duration, 0.01)) ** 2)))
    strong = motion.reversals(duration, 0.5 * strength)
    strong = strong[(strong > 0.5) & (strong < duration - 0.5)]
    hit = np.abs(times - strong[:, None]).min(axis=1) < 0.06
    right = np.abs(truth - times[:, None]).min(axis=1) < 0.06
    return float(hit.mean()), float(right.mean())


@pytest.mark.parametrize(
    ("rate", "step", "jitter"),
    [(50, AX_12, 0), (100, AX_12, 0), (100, AX_12, 1), (100, X_SERIES, 1), (100, 0.0, 0), (1000, X_SERIES, 1)],
)
@pytest.mark.parametrize("known", [True, False])
def test_hand_waved_motions(rate: int, step: float, jitter: int, known: bool) -> None:
    """0.8-2 Hz, 0.3 rad: at least 98 % of the strong reversals and 98 % true ones, whatever the encoder."""
    rng = np.random.default_rng(rate + jitter)
    motion = HandWaved.draw(rng, 0.8, 2.0, 0.3)
    time = np.arange(0, 60, 1 / rate)
    angle = quantise(motion.angle(time), step) + jitter * step * rng.integers(-1, 2, time.size)
    recall, precision = recall_and_precision(found(time, angle, rate, step if known else math.nan), motion, 60)
    assert recall >= 0.98
    assert precision >= 0.98


def test_irregular_sampling() -> None:
    """3 ms of jitter in the (true) times and every twentieth poll missed: found all the same."""
    rng = np.random.default_rng(11)
    motion = HandWaved.draw(rng, 0.8, 2.0, 0.3)
    time = np.arange(0, 60, 0.01) + rng.uniform(-3e-3, 3e-3, 6000)
    time = time[rng.random(6000) > 0.05]
    reversals = found(time, quantise(motion.angle(time), X_SERIES), 100, X_SERIES)
    assert recall_and_precision(reversals, motion, 60) == (1.0, 1.0)


def test_time_swing_and_latency_of_a_sine() -> None:
    """1 Hz, 0.5 rad: zero crossings every half second within 5 ms, the swing's sign and size, seen within 150 ms."""
    time = np.arange(0, 10, 0.01)
    reversals = found(time, quantise(0.5 * np.sin(2 * np.pi * time), X_SERIES), 100, X_SERIES)[1:-1]
    peak = 0.5 * (2 * math.pi) ** 2
    nearest = np.round(2 * np.array([r.time for r in reversals])) / 2
    assert nearest == pytest.approx(np.arange(nearest.size) * 0.5 + nearest[0])
    for reversal, truth in zip(reversals, nearest, strict=True):
        assert reversal.time == pytest.approx(truth, abs=0.005)
        assert reversal.seen - truth < 0.15
        # Just after k + 0 s the acceleration -sin is negative; the parabola shows 80 to 95 % of the extreme before.
        assert math.copysign(1, reversal.swing) == (1 if truth % 1 else -1)
        assert 0.8 * peak < abs(reversal.swing) < 1.3 * peak


@pytest.mark.parametrize("rate", [50, 100, 1000])
@pytest.mark.parametrize("step", [AX_12, X_SERIES])
@pytest.mark.parametrize("known", [True, False])
def test_nothing_at_rest(rate: int, step: float, known: bool) -> None:
    """A joint at rest, also one whose reading flickers by a step in either direction, never triggers."""
    time = np.arange(0, 100 if rate < 1000 else 30, 1 / rate)
    rng = np.random.default_rng(12)
    flicker = step * rng.integers(-1, 2, time.size)
    rare = step * (rng.random(time.size) < 0.02)
    resolution = step if known else math.nan
    for angle in (np.full(time.size, 0.3), 0.3 + flicker, 0.3 + rare):
        assert found(time, angle, rate, resolution) == []


@pytest.mark.parametrize("rate", [50, 100])
@pytest.mark.parametrize("speed", [0.003, 0.02, 0.1, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("jitter", [0, 1])
def test_nothing_at_constant_speed(rate: int, speed: float, jitter: int) -> None:
    """A ramp in steps of an encoder, also with ±1 step of jitter, has no acceleration and no reversal."""
    rng = np.random.default_rng(13)
    time = np.arange(0, 60, 1 / rate)
    for step in (AX_12, X_SERIES):
        angle = quantise(speed * time, step) + jitter * step * rng.integers(-1, 2, time.size)
        assert found(time, angle, rate, step) == []


def test_unquantised_noise_is_learnt() -> None:
    """1 mrad of Gaussian noise on a ramp of unknown resolution does not trigger."""
    time = np.arange(0, 100, 0.01)
    angle = 0.1 * time + np.random.default_rng(14).normal(0, 1e-3, time.size)
    assert found(time, angle, 100, math.nan) == []


@pytest.mark.parametrize("rate", [50, 100, 1000])
@pytest.mark.parametrize("resolution", [AX_12, 0.0, math.nan])
def test_a_jump_of_the_goal_is_one_reversal(rate: int, resolution: float) -> None:
    """Goals written every two seconds: one trigger each, where the new goal is first seen, signed as the jump."""
    time = np.arange(0, 10, 1 / rate)
    goal = np.select([time < 1.999, time < 3.999, time < 5.999, time < 7.999], [0.0, 0.3, 0.6, 0.2], 0.25)
    reversals = found(time, goal, rate, resolution)
    assert [r.time for r in reversals] == pytest.approx([2.0, 4.0, 6.0, 8.0], abs=0.011)
    assert [math.copysign(1, r.swing) for r in reversals] == [1, 1, -1, 1]
    assert reversals[2].swing == pytest.approx(-11.5 * 0.4 / 0.2**2)
    assert max(r.seen - r.time for r in reversals) <= 0.061


@pytest.mark.parametrize("step", [AX_12, X_SERIES, 0.0])
def test_a_trapezoidal_profile_reverses_where_the_braking_sets_in(step: float) -> None:
    """0.2 s of 20 rad/s², half a second of steady speed, 0.2 s of braking: one reversal, within 60 ms of the brake."""
    fine = np.arange(0, 4, 1e-3)
    acceleration = np.select([fine < 1, fine < 1.2, fine < 1.7, fine < 1.9], [0.0, 20.0, 0.0, -20.0], 0.0)
    angle = np.cumsum(np.cumsum(acceleration)) * 1e-6
    (reversal,) = found(fine[::10], quantise(angle[::10], step), 100, step)
    assert reversal.time == pytest.approx(1.7, abs=0.06)
    assert reversal.swing < -19.9


def test_direction_survives_a_rest_and_not_a_hole() -> None:
    """Braking, rest and setting off in the same direction is a reversal; across a hole in time nobody knows."""
    time = np.arange(0, 6, 0.01)

    def move(start: float) -> FloatArray:
        x = np.clip(time - start, 0, 1)
        return np.asarray(0.5 * (x - np.sin(2 * np.pi * x) / (2 * np.pi)))

    angle = quantise(move(1.0) + move(4.0), X_SERIES)
    whole = found(time, angle, 100, X_SERIES)
    assert [r.time for r in whole] == pytest.approx([1.5, 4.0, 4.5], abs=0.1)
    keep = (time < 2.5) | (time > 2.6)
    assert [r.time for r in found(time[keep], angle[keep], 100, X_SERIES)] == pytest.approx([1.5, 4.5], abs=0.02)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    rate=st.sampled_from([50, 100, 400]),
    cuts=st.lists(st.integers(0, 400), max_size=30),
)
def test_the_cut_of_the_stream_does_not_matter(seed: int, rate: int, cuts: list[int]) -> None:
    """Any pushes of the same samples give exactly the same reversals."""
    rng = np.random.default_rng(seed)
    time = np.arange(400) / rate + rng.uniform(0, 0.3 / rate, 400)
    angle = quantise(HandWaved.draw(rng, 0.5, 3, 0.2).angle(time), X_SERIES)
    angle[rng.random(400) < 0.01] = math.nan
    whole = found(time, angle, rate, X_SERIES)
    trigger = Trigger(SETTINGS, rate, X_SERIES)
    pieces = zip(np.split(time, sorted(cuts)), np.split(angle, sorted(cuts)), strict=True)
    assert [r for t, y in pieces for r in trigger.push(t, y)] == whole


def test_one_by_one_is_the_same() -> None:
    """Single samples as plain floats, as the service pushes them."""
    time = np.arange(0, 10, 0.01)
    angle = quantise(HandWaved.draw(np.random.default_rng(15), 0.5, 3, 0.2).angle(time), AX_12)
    whole = found(time, angle, 100, AX_12)
    trigger = Trigger(SETTINGS, 100, AX_12)
    assert [r for t, y in zip(time, angle, strict=True) for r in trigger.push((t,), (y,))] == whole
    assert len(whole) > 10


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=60))
def test_no_stream_breaks_it(samples: list[tuple[float, float]]) -> None:
    """Whatever comes (NaN, infinities, times in any order) is used or counted as dropped."""
    trigger = Trigger(SETTINGS, 100, math.nan)
    trigger.push([time for time, _ in samples], [angle for _, angle in samples])
    ascending = 0
    last = -math.inf
    for time, angle in samples:
        if last < time < math.inf and math.isfinite(angle):
            ascending += 1
            last = time
    assert trigger.dropped == len(samples) - ascending


def test_unusable_samples_are_dropped_and_counted() -> None:
    """Repeats, steps back in time and NaN among good samples change nothing but the count."""
    time = np.arange(0, 10, 0.01)
    angle = 0.5 * np.sin(2 * np.pi * time)
    bad_time = np.insert(time, [300, 500, 700], [time[299], 1.0, time[699] + 0.005])
    bad_angle = np.insert(angle, [300, 500, 700], [9.0, 9.0, math.nan])
    trigger = Trigger(SETTINGS, 100, 0.0)
    assert trigger.push(bad_time, bad_angle) == found(time, angle, 100, 0.0)
    assert trigger.dropped == 3


def test_least_acceleration_of_the_settings() -> None:
    """Below min_acceleration nothing counts: a sine of 4.9 rad/s² is lost at 6 and kept at 3."""
    time = np.arange(0, 20, 0.01)
    angle = 0.5 * np.sin(2 * np.pi * 0.5 * time)
    counts = [
        len(Trigger(DetectorSettings(f_res_hz=58.0, min_acceleration=least), 100, X_SERIES).push(time, angle))
        for least in (3.0, 6.0)
    ]
    assert counts == [19, 0]


def test_a_rate_that_is_none_is_refused() -> None:
    """The message has the rate and its source."""
    with pytest.raises(DetectorError, match="is 0 Hz; expected a positive number"):
        Trigger(SETTINGS, 0.0, AX_12)
