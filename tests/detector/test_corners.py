"""Whether a commanded motion has corners."""

from __future__ import annotations

import math

import numpy as np
import pytest
from bench.hardstops import Trapezoids

from lostmotion.detector.commanded import cornered, smoothed
from lostmotion.detector.corners import CLEAR, CORNERS_UNKNOWN, EVERY, SMOOTH, CornerLaw
from lostmotion.detector.window import Window

STEP = math.radians(300) / 1023


def after(law: CornerLaw, *evidence: float) -> CornerLaw:
    """The law after windows of that evidence."""
    for told in evidence:
        law = law.updated(told)
    return law


def test_corners_are_possible_until_windows_exclude_them() -> None:
    """One window of 10 nats, or three of 6, exclude corners; windows of 2.4 nats, as corners give at most, never do;
    six windows of corners bring them back."""
    assert not CORNERS_UNKNOWN.none
    assert after(CORNERS_UNKNOWN, 10.0).none
    assert not after(CORNERS_UNKNOWN, 6.0).none
    assert after(CORNERS_UNKNOWN, 6.0, 6.0, 6.0).none
    assert not after(CORNERS_UNKNOWN, *[2.4] * 100).none
    assert not after(CORNERS_UNKNOWN, *[8.0] * 50, *[-40.0] * 6).none
    assert after(SMOOTH, math.nan, -100.0).none


def test_both_are_tried_until_it_is_clear_and_then_seldom() -> None:
    """One window of EVERY, once the evidence is clear."""
    assert CORNERS_UNKNOWN.asks_both
    assert not SMOOTH.asks_both
    law, asked = after(CORNERS_UNKNOWN, *[8.0] * 8), 0
    assert law.evidence > CLEAR
    for _ in range(10 * EVERY):
        asked += law.asks_both
        law = law.updated(8.0 if law.asks_both else math.nan)
    assert asked == 10


@pytest.mark.parametrize("seed", [1, 2])
def test_the_doubt_covers_what_corners_do(seed: int) -> None:
    """Commands of a trapezoid in steps of 5 mrad: at its corners the motion with corners is at most 3 of its standard
    deviations wrong, the smooth one 3.5 and more."""
    motion, clock = Trapezoids(seed), np.arange(0.0, 0.45, 1e-3)
    far = {True: 0.0, False: 0.0}
    for start in np.arange(0.5, 12.0, 0.23):
        polls = np.arange(start - 0.2, start + 0.5, 0.01)
        told = np.round(motion.position(polls) / STEP) * STEP
        window = Window("elbow", start, 0.45, start + clock, np.zeros(clock.size), 1e3)
        smooth = smoothed(polls, told, window)
        assert smooth is not None
        for is_smooth, found in ((True, smooth), (False, cornered(polls, told, window, smooth))):
            basis = found.basis(clock)
            off = basis @ found.coefficients - motion.position(start + clock)
            doubt = np.sqrt(np.sum((basis @ found.covariance) * basis, axis=1))
            far[is_smooth] = max(far[is_smooth], float(np.quantile(np.abs(off) / doubt, 0.99)))
    assert far[False] < 3
    assert far[True] > 3.5
