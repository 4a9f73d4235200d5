"""Sentences on what cannot be estimated: when they are given, and that they are right."""

from __future__ import annotations

import re

import numpy as np
import pytest

from lostmotion.detector.limits import poll_limit, rate_limit, window_limit
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings
from tests.detector.synthetic import HandWaved, ring


def test_rate_limit_has_what_to_change() -> None:
    """Eight samples a period of the bar are enough; with 3.4 the sentence has the rate and the bar that would do."""
    assert rate_limit(58.0, 464.0, "the size") == ""
    assert rate_limit(58.0, 200.0, "the size") == (
        "the size cannot be estimated: found 3.4 samples a period of the bar (200 Hz, bar of 58 Hz), "
        "expected at least 8: take a sensor of 464 Hz or faster, or a bar of 25 Hz or slower"
    )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (DetectorSettings(f_res_hz=58.0), ""),
        (DetectorSettings(f_res_hz=25.0), ""),
        (DetectorSettings(f_res_hz=58.0, window_s=0.1), 'a window of 0.1 s holds 35% .* "auto" makes it 0.34 s'),
        (DetectorSettings(f_res_hz=58.0, window_s=0.04), "holds 0% of the energy"),
        (DetectorSettings(f_res_hz=10.0, zeta=0.005, window_s=None), "take a bar whose ring is shorter"),
    ],
)
def test_window_limit(settings: DetectorSettings, words: str) -> None:
    """Half of the ring-down's energy has to fall into the window; where a longer window would help, the sentence has
    it."""
    assert re.search(words or "^$", window_limit(settings, 1000.0))


def test_window_limit_counts_the_energy() -> None:
    """Of a ring-down that begins 50 ms after the reversal, a window of 0.1 s holds the share in the sentence: a sum
    over rings of any phase."""
    time = np.arange(0.05, 5.0, 1e-4)
    waves = ring(time, np.full(8, 0.05), 58.0, 0.012, np.arange(8)[:, None] * np.pi / 4)
    share = np.sum(waves[:, time < 0.1] ** 2) / np.sum(waves**2)
    assert f"holds {share:.0%}" in window_limit(DetectorSettings(f_res_hz=58.0, window_s=0.1), 1000.0)


def test_poll_limit() -> None:
    """Thirty commands a second are enough; ten follow a motion up to 1 Hz."""
    assert poll_limit(30.0) == ""
    assert poll_limit(10.0).startswith("reversals of motions above 1 Hz are missed")


def test_reversals_are_missed_above_the_motion_in_the_sentence() -> None:
    """With 10 commands in a period of the fastest motion at least 95 % of its strong reversals are found, with 5 fewer
    than 80 %."""
    rng = np.random.default_rng(8900)
    for polls, low, high in ((30.0, 0.95, 1.0), (15.0, 0.0, 0.8)):
        hit = wanted = 0
        for _ in range(4):
            motion = HandWaved.draw(rng, 1.5, 3.0, 0.15)
            time = np.arange(0.0, 30.0, 1 / polls)
            found = Trigger(DetectorSettings(f_res_hz=58.0), polls, 0.0).push(time, motion.angle(time))
            seen = np.array([reversal.time for reversal in found])
            least = 0.5 * float(np.sqrt(np.mean(motion.acceleration(time) ** 2)))
            true = motion.reversals(30.0, least)
            true = true[(true > 1.0) & (true < 29.0)]
            hit += sum(bool((np.abs(seen - at) < 0.1).any()) for at in true)
            wanted += true.size
        assert low <= hit / wanted <= high
