"""The joints of the bench of attribution move as documented."""

from __future__ import annotations

import numpy as np
import pytest
from bench.arm import LINK_M, arm
from bench.attribution import SECONDS, motions
from bench.roc.waveforms import LENGTH_M, Bar

from lostmotion.model import Sine


def test_half_of_the_time_both_joints_move_alike() -> None:
    """The second joint's acceleration is the first's, to a fifth of its size, in 45 to 65 % of all instants; on its own
    in fewer than 25 %."""
    times = np.arange(0, SECONDS, 0.01)
    for together, low, high in ((True, 0.45, 0.65), (False, 0.0, 0.25)):
        one, other = (motion.acceleration(times) for motion in motions(8702, together))
        alike = np.mean(np.abs(one - other) < 0.2 * one.std())
        assert low <= alike <= high


def test_mujocos_arm_without_play_by_hand() -> None:
    """Slow motions: the tip accelerates by (link + bar) theta_1'' + bar theta_2'' and the bar adds (f / f_res)²."""
    times = np.arange(2000) / 1000
    still, moved = Sine(1.0, 1e-9), Sine(1.0, 0.05)
    peak = 0.05 * (2 * np.pi) ** 2 * (1 + (1 / 58) ** 2)
    for motion, lever in (((moved, still), LINK_M + LENGTH_M), ((still, moved), LENGTH_M)):
        assert np.abs(arm(motion, times, (0.0, 0.0), Bar())[1000:]).max() == pytest.approx(lever * peak, rel=0.02)
