"""Which joint has the play: joints that fly freely between hard stops, their impulses ringing one bar or two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from lostmotion.detector.attribution import ODD, PLAYS, Attribution, Evidence, Mover, attribute, evidence
from lostmotion.detector.commanded import BEFORE_S
from lostmotion.detector.window import DetectorSettings
from lostmotion.detector.windows import cut

SETTINGS = DetectorSettings(f_res_hz=58.0, noise_ms2=0.1)
RATE, SECONDS, LENGTH = 1000.0, 8.0, 0.1
PLAY, BOUNCE = 0.006, 0.6
EVEN = (0.5, 0.5)


def waved(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and phases of a motion of four lines; each has an acceleration of 8 rad/s²."""
    rng = np.random.default_rng(seed)
    return rng.uniform([0.5, 1.0, 1.5, 2.2], [1.0, 1.5, 2.2, 3.0]), rng.uniform(0, 2 * math.pi, 4)


def shaft(seed: int, times: np.ndarray, order: int) -> np.ndarray:
    """The commanded angle [rad] (order 0), its rate or its acceleration."""
    rates, phases = waved(seed)
    omega = 2 * math.pi * rates
    lines = 8 * omega ** (order - 2.0) * np.sin(np.outer(times, omega) + phases + (order - 2) * math.pi / 2)
    return np.asarray(lines.sum(axis=1))


@lru_cache
def impulses(seed: int) -> tuple[tuple[float, float], ...]:
    """Times [s] and sizes [rad/s] of the impulses that a body gets between stops ± PLAY / 2 on a swaying shaft: it
    flies freely, and leaves a stop with BOUNCE times the speed at which it came."""
    step = 2e-5
    times = np.arange(0, SECONDS, step)
    angle, rate = shaft(seed, times, 0), shaft(seed, times, 1)
    place, speed = angle[0] - PLAY / 2, rate[0]
    struck = []
    for time, stop, drift in zip(times, angle, rate, strict=True):
        place += speed * step
        beyond = place - stop
        if abs(beyond) > PLAY / 2 and beyond * (speed - drift) > 0:
            impulse = (1 + BOUNCE) * (drift - speed)
            place, speed = stop + math.copysign(PLAY / 2, beyond), speed + impulse
            struck.append((float(time), float(impulse)))
    return tuple(struck)


@lru_cache
def tip(seed: int, worn: bool) -> np.ndarray:
    """Tip acceleration [m/s²] at RATE of one joint, at LENGTH from its axis: q'' + l theta'', by SciPy's exact ring."""
    from scipy.signal import lsim

    omega, zeta = 2 * math.pi * 58.0, 0.012
    fine = 2e-4
    times = np.arange(0, SECONDS, fine)
    if worn:
        place = np.zeros(times.size)
        for time, impulse in impulses(seed):
            place[min(round(time / fine), times.size - 1)] += impulse / fine
    else:
        place = shaft(seed, times, 2)
    transfer = ([2 * zeta * omega, omega**2], [1, 2 * zeta * omega, omega**2])
    _, felt, _ = lsim(transfer, LENGTH * place, times)
    return np.asarray(felt)[:: round(1 / fine / RATE)]


def evidence_of(
    worn: Sequence[int], seeds: Sequence[int] = (11, 12), levers: Sequence[tuple[float, ...]] = ((0.1,), (0.1,)),
    rate: float = RATE, noise: float = 0.1,
) -> list[Evidence]:  # fmt: skip
    """The evidence of successive windows of 0.25 s of joints of which some have play."""
    times = np.arange(0, SECONDS, 1 / rate)
    every = round(RATE / rate)
    alone = [tip(seed, joint in worn)[::every] for joint, seed in enumerate(seeds)]
    tips = np.array(levers).T / LENGTH @ np.array(alone)
    tips = tips + np.random.default_rng(5).normal(0, noise, tips.shape)
    polls = np.arange(0, SECONDS, 0.01)
    movers = [Mover(polls, shaft(seed, polls, 0), arms) for seed, arms in zip(seeds, levers, strict=True)]
    found: list[Evidence] = []
    for start in np.arange(1.0, SECONDS - 0.5, 0.25):
        segments = [cut("", times, accel, start - BEFORE_S, 0.25 + BEFORE_S, rate) for accel in tips]
        window = evidence(
            segments,
            movers,
            [replace(SETTINGS, noise_ms2=noise)] * len(tips),
            max(start, found[-1].until if found else 0),
        )
        assert window is not None
        found.append(window)
    return found


@pytest.mark.parametrize("worn", [(), (0,), (1,)])
def test_names_the_joint_with_play(worn: tuple[int, ...]) -> None:
    """One accelerometer, six seconds: the right set of joints with more than 95 %; both accelerate alike."""
    sets = attribute(evidence_of(worn), EVEN).sets
    assert sets[sum(2**joint for joint in worn)] > 0.95


def test_both() -> None:
    """Two joints with play are both found."""
    assert attribute(evidence_of((0, 1)), EVEN).joints.min() > 0.9


def test_names_do_not_matter() -> None:
    """Joints in another order have the same probabilities, to rounding."""
    one, other = attribute(evidence_of((0,)), EVEN), attribute(evidence_of((1,), seeds=(12, 11)), EVEN)
    assert one.joints == pytest.approx(other.joints[::-1], abs=1e-9)


def test_a_lever_arm_has_a_sign() -> None:
    """Of two joints that move alike, one on a lever arm the other way round: the sign of the impulses distinguishes
    them apart."""
    windows = evidence_of((0,), seeds=(11, 11), levers=((0.1,), (-0.1,)))
    assert attribute(windows, EVEN).joints == pytest.approx([1, 0], abs=0.02)


def test_the_same_motion_cannot_be_told_apart_by_one_accelerometer() -> None:
    """Two joints that always move alike are equally probable, and neither is acquitted."""
    joints = attribute(evidence_of((0,), seeds=(11, 11)), EVEN).joints
    assert joints[0] == pytest.approx(joints[1], abs=1e-9)
    assert 0.4 < joints[0] < 0.9


@pytest.mark.parametrize("worn", [0, 1])
def test_two_accelerometers_tell_the_same_motion_apart(worn: int) -> None:
    """With a second accelerometer that the second joint does not move, two seconds are enough."""
    windows = evidence_of((worn,), seeds=(11, 11), levers=((0.25, 0.1), (0.1, 0.0)))[:8]
    assert attribute(windows, EVEN).joints[worn] > 0.95
    assert attribute(windows, EVEN).joints[1 - worn] < 0.05


def test_too_much_noise_leaves_it_open() -> None:
    """Where no impulse can stand out of the noise, no joint is accused, and none acquitted."""
    joints = attribute(evidence_of((0,), noise=20.0), EVEN).joints
    assert np.all((joints > 0.25) & (joints < 0.75))


def test_nothing_heard_leaves_the_prior() -> None:
    """Without windows the probabilities are those of before."""
    assert attribute([], (0.2, 0.7)).joints == pytest.approx([0.2, 0.7])


def test_an_odd_window_does_not_decide() -> None:
    """A window that is certain, but wrong, moves the odds by no more than (1 - ODD + ODD/4) / (ODD/4)."""
    certain = Evidence(0.0, np.where(np.arange(4) == 1, 0.0, -1e6) * np.ones((len(PLAYS), 1)))
    sets = attribute([certain], EVEN).sets
    assert sets[1] / sets[2] == pytest.approx((1 - ODD + ODD / 4) / (ODD / 4), rel=1e-6)


def test_joints_of_a_set_by_hand() -> None:
    """Sets 0, 1, 2, 3 are none, first, second, both."""
    members = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])
    assert attribute([], EVEN).members == pytest.approx(members)
    assert Attribution(np.array([0.1, 0.2, 0.3, 0.4]), members, 1).joints == pytest.approx([0.6, 0.7])


def test_many_joints_do_not_double_the_sets() -> None:
    """Of eight joints on one accelerometer, most of them close by, no more than two may have play at once; the worn one
    is named all the same."""
    levers = [(0.1 if joint in (3, 5) else 0.01,) for joint in range(8)]
    found = attribute(evidence_of((3,), seeds=range(11, 19), levers=levers), [0.1] * 8)
    assert found.sets.size == 1 + 8 + 28
    assert found.joints[3] > 0.95
    assert np.delete(found.joints, 3).max() < 0.3


def test_says_nothing_without_data() -> None:
    """A missing sample, commands that do not cover the window, a rest of a window too short: None."""
    times, polls = np.arange(0, 1, 1e-3), np.arange(0, 1, 0.01)
    segment = cut("", times, np.random.default_rng(1).normal(0, 0.1, 1000), 0.3, 0.45, RATE)
    movers = [Mover(polls, shaft(seed, polls, 0), (0.1,)) for seed in (11, 12)]
    assert evidence([segment], movers, [SETTINGS], 0.5) is not None
    assert evidence([segment], movers, [SETTINGS], 0.72) is None
    short = [movers[0], replace(movers[1], times=polls[:40], commands=movers[1].commands[:40])]
    assert evidence([segment], short, [SETTINGS], 0.5) is None
    holed = segment.accel.copy()
    holed[300] = np.nan
    assert evidence([replace(segment, accel=holed)], movers, [SETTINGS], 0.5) is None


@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0, 1000.0])
@pytest.mark.parametrize("f_res", [0.2, 2.0, 4.9, 20.0, 90.0])
@pytest.mark.parametrize("length", [0.22, 0.45, 1.2])
def test_any_bar_at_any_rate(rate: float, f_res: float, length: float) -> None:
    """Whatever a configuration may ask for, there is an answer of finite likelihoods, or none."""
    times, polls = np.arange(0, 8, 1 / rate), np.arange(0, 8, 0.01)
    segment = cut("", times, np.random.default_rng(1).normal(0, 0.1, times.size), 1.0, length, rate)
    movers = [Mover(polls, shaft(seed, polls, 0), (0.1,)) for seed in (11, 12)]
    window = evidence([segment], movers, [replace(SETTINGS, f_res_hz=f_res)], 1.2)
    assert window is None or np.isfinite(window.likelihood).all()


@pytest.mark.slow
def test_probabilities_are_kept_and_no_more_cautious_than_they_were() -> None:
    """Four pairs of motions in noise of 0.3 m/s², one, none or both worn, after 2 to 16 windows: of the answers of 95 %
    and more at least 95 % are right, and wrong ones are fewer than by the probabilities.  40 to 57 % of the answers are
    that sure; with 0.6 times the TRUST 29 % were, with 1.7 times 65 %."""
    made = []
    for pair in range(4):
        seeds = (200 + 2 * pair, 201 + 2 * pair)
        for worn in ((), (0,), (1,), (0, 1)):
            windows = evidence_of(worn, seeds=seeds, noise=0.3)
            for count in (2, 4, 8, 16):
                joints = attribute(windows[:count], EVEN).joints
                made += [(max(p, 1 - p), (p > 0.5) == (joint in worn)) for joint, p in enumerate(joints)]
    sure, right = (np.array(column) for column in zip(*made, strict=True))
    assert right[sure >= 0.95].mean() >= 0.95
    assert np.sum(~right) < np.sum(1 - sure)
    assert 0.40 < np.mean(sure >= 0.95) < 0.57


@pytest.mark.slow
@pytest.mark.parametrize("worn", [0, 1])
def test_mujoco_arm(worn: int) -> None:
    """MuJoCo's arm of two links, whose joints move together half of the time: the right one after forty windows."""
    from bench.attribution import CASES, window_evidence

    case = next(case for case in CASES if case.mujoco and case.together)
    joints = attribute(window_evidence(case, 8701, (worn,))[0][:40], EVEN).joints
    assert joints[worn] > 0.9
    assert joints[1 - worn] < 0.5
