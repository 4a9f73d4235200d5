"""Resonance and damping from a joint's own windows: found, not taken from hum, and followed in steps."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Generator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lostmotion.detector import learner as learning
from lostmotion.detector.bar import Bar, finding, moved, used
from lostmotion.detector.learner import BarChange, Learner
from lostmotion.detector.window import DetectorSettings, FloatArray
from tests.detector.synthetic import Scene, ring

GIVEN = DetectorSettings(f_res_hz=58.0)
RATE, LENGTH = 1000.0, 250
WORN = Scene(motion=20.0, impact=15.0)


def shown(windows: FloatArray, given: DetectorSettings = GIVEN, rate: float = RATE) -> Bar | None:
    """What windows show of the bar."""
    work: Generator[None, None, Bar | None] = finding(windows, rate, given)
    while True:
        try:
            next(work)
        except StopIteration as finished:
            found: Bar | None = finished.value
            return found


def line(rng: np.random.Generator, count: int, hz: float, wander: float = 0.0) -> FloatArray:
    """A steady line four times as powerful as the white noise beside it, its frequency of that scatter."""
    time, phase = np.arange(LENGTH) / RATE, rng.uniform(0, 2 * math.pi, (count, 1))
    turn = 2 * math.pi * rng.normal(hz, wander, (count, 1))
    return np.asarray(rng.normal(size=(count, LENGTH)) + 2 * math.sqrt(2) * np.sin(turn * time + phase))


@pytest.mark.parametrize("rate", [200.0, 1000.0])
@pytest.mark.parametrize("off", [-0.12, -0.05, 0.0, 0.08])
def test_the_resonance_is_found_whatever_the_file_says(off: float, rate: float) -> None:
    """In a scene with motion, coloured noise, rebounds and rings from before, each with a resonance of its own about 58
    Hz (0.5 Hz), it is found within 2 % of that."""
    given = replace(GIVEN, f_res_hz=58.0 * (1 + off))
    found = shown(WORN.worn(np.random.default_rng(8900), 100, rate, 0.25), given, rate)
    assert found is not None
    assert found.f_res_hz == pytest.approx(58.0, rel=0.02)
    assert 0 < found.f_deviation < 0.005 * 58
    assert found.zeta == pytest.approx(0.012, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("count", [25, 100])
def test_rings_in_white_noise(count: int) -> None:
    """Of 59 Hz and 0.012, at 20 dB, ten times over: within 0.2 % and 25 %, and within two standard deviations."""
    rng = np.random.default_rng(8901)
    time = np.arange(LENGTH) / RATE
    for _ in range(10):
        hits = ring(time, rng.uniform(0.005, 0.09, count), 59.0, 0.012)
        found = shown(rng.normal(size=(count, LENGTH)) + 3 * rng.choice((-1, 1), (count, 1)) * hits)
        assert found is not None
        assert found.f_res_hz == pytest.approx(59.0, rel=0.002)
        assert found.zeta == pytest.approx(0.012, rel=0.25)
        assert abs(found.f_res_hz - 59.0) < 2 * found.f_deviation < 0.01 * 59
        assert abs(math.log(found.zeta / 0.012)) < 2 * found.zeta_deviation
        assert found.windows == count


@pytest.mark.parametrize(("hz", "wander"), [(50.0, 0.0), (60.0, 0.0), (63.0, 0.5), (58.0, 0.0)])
def test_a_steady_line_is_no_bar(hz: float, wander: float) -> None:
    """Mains hum, a fan, and a line on the very resonance neither decay nor begin: no bar is found, nor of noise."""
    rng = np.random.default_rng(8902)
    assert shown(line(rng, 100, hz, wander)) is None
    assert shown(rng.normal(size=(100, LENGTH))) is None


def test_a_line_beside_rings_is_no_bar() -> None:
    """Rings of 58 Hz with a hum of 50 Hz that is as loud: the resonance is 58 Hz or not found."""
    rng = np.random.default_rng(8903)
    hits = 10 * ring(np.arange(LENGTH) / RATE, rng.uniform(0.005, 0.09, 100), 58.0, 0.012)
    found = shown(line(rng, 100, 50.0) + hits)
    assert found is None or found.f_res_hz == pytest.approx(58.0, rel=0.01)


def test_nothing_beyond_the_reach() -> None:
    """A ring of 90 Hz, another mode than the bar's 58 Hz, is not taken for it."""
    rng = np.random.default_rng(8904)
    hits = 10 * ring(np.arange(LENGTH) / RATE, rng.uniform(0.005, 0.09, 100), 90.0, 0.012)
    assert shown(rng.normal(size=(100, LENGTH)) + hits) is None


def test_a_look_that_rests_holds_little() -> None:
    """Between its rounds a search holds less than 0.6 MB beside the windows, and at most 4 MB within one: all joints of
    a robot learn at the same time."""
    windows = WORN.worn(np.random.default_rng(8903), 100, RATE, 0.25)
    shown(windows)  # what is prepared once
    held = peak = 0
    tracemalloc.start()
    for _ in finding(windows, RATE, GIVEN):
        now, most = tracemalloc.get_traced_memory()
        held, peak = max(held, now), max(peak, most)
    tracemalloc.stop()
    assert 0 < held < 0.6e6
    assert peak < 4e6


def test_steps_are_no_jumps() -> None:
    """From 58 Hz towards 63.8 Hz: by 2 % a look, then by half of what is left; a value is used when it is three of its
    standard deviations from the file's, a damping below the file's never."""
    found = Bar(63.8, 0.1, 0.006, 0.05, 100)
    known = moved(None, found, GIVEN)
    assert known.f_res_hz == pytest.approx(58.0 * 1.02)
    for _ in range(12):
        known = moved(known, found, GIVEN)
    assert known.f_res_hz == pytest.approx(63.8, rel=1e-3)
    assert known.zeta == pytest.approx(0.006, rel=0.01)
    assert used(known, GIVEN) == replace(GIVEN, f_res_hz=round(known.f_res_hz, 2))
    assert used(Bar(58.5, 0.18, 0.013, 0.10, 100), GIVEN) == GIVEN
    assert used(Bar(58.6, 0.18, 0.024, 0.10, 100), GIVEN) == replace(GIVEN, f_res_hz=58.6, zeta=0.024)
    assert used(Bar(58.6, 0.30, 0.024, 0.50, 100), GIVEN) == GIVEN
    assert used(None, GIVEN) == GIVEN


def test_what_is_found_again_is_looked_at_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bar as the file has it is looked at after 50 windows and not again before 2050; another one also after 100,
    200, 500 and 1000, until a look finds what is known."""
    looks: list[int] = []

    def finds(f_res_hz: float) -> list[int]:
        def look(windows: FloatArray, rate_hz: float, given: DetectorSettings) -> Generator[None, None, Bar | None]:
            looks.append(learner.seen)
            return Bar(f_res_hz, 0.1, 0.012, 0.1, 100)
            yield

        monkeypatch.setattr(learning, "finding", look)
        learner = Learner(GIVEN, RATE, LENGTH)
        looks.clear()
        for window in np.random.default_rng(8906).normal(size=(2200, LENGTH)):
            learner.update(window)
        return looks.copy()

    assert finds(58.1) == [51]
    assert finds(63.8) == [51, 101, 201, 501, 1001, 2001]


def test_one_look_serves_all_joints_of_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three joints that come to their look at the same time one looks, and the others take what it has confirmed;
    a look that finds another bar, or no end, serves nobody."""
    looked: list[float] = []

    def finds(f_res_hz: float, rounds: int) -> list[float]:
        def look(windows: FloatArray, rate_hz: float, given: DetectorSettings) -> Generator[None, None, Bar | None]:
            looked.append(float(windows[0, 0]))
            for _ in range(rounds if len(looked) == 1 else 1):
                yield
            return Bar(f_res_hz, 0.1, 0.012, 0.1, 100)

        monkeypatch.setattr(learning, "finding", look)
        monkeypatch.setattr(learning, "learning", lambda *_: iter(()))
        looked.clear()
        looks = learning.BarLooks()
        learners = [Learner(GIVEN, RATE, LENGTH, looks) for _ in range(3)]
        for window in np.random.default_rng(8907).normal(size=(95, LENGTH)):
            for number, learner in enumerate(learners):
                window[0] = number
                learner.update(window)
        assert all(learner.bar is not None for learner in learners[1:])
        return looked.copy()

    assert finds(58.1, 60) == [0]
    assert finds(63.8, 60) == [0, 1, 2]
    assert finds(58.1, 10_000) == [0, 1]


@pytest.mark.slow
def test_a_wrong_file_is_corrected_and_reported() -> None:
    """With 5 % too low a resonance in the file the learner uses one within 1.5 % of the windows' after 1000 of them,
    and reports it; with ``follow_bar`` off it stays, and a restart goes on."""
    rng = np.random.default_rng(8905)
    wrong = replace(GIVEN, f_res_hz=58.0 * 0.95)
    windows = np.vstack([WORN.worn(rng, 50, RATE, 0.25) for _ in range(21)])
    learner, held = (Learner(replace(wrong, follow_bar=follow), RATE, LENGTH) for follow in (True, False))
    reports: list[Any] = [change for window in windows if (change := learner.update(window))]
    for window in windows[:250]:
        held.update(window)
    assert learner.settings.f_res_hz == pytest.approx(58.0, rel=0.015)
    changes = [change for change in reports if isinstance(change, BarChange)]
    assert changes
    assert changes[0].before == (wrong.f_res_hz, wrong.zeta)
    assert "resonance and damping of the bar have moved from 55.1 Hz" in str(changes[0])
    assert (held.settings.f_res_hz, held.settings.zeta) == (wrong.f_res_hz, wrong.zeta)
    resumed = Learner(wrong, RATE, LENGTH)
    resumed.resume(learner.background, learner.seen, learner.bar)
    assert resumed.settings == learner.settings
