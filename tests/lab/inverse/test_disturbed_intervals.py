"""The intervals of simulated motions where a torque that no column shows disturbs them."""

import numpy as np
from bench.intervals import fitted


def test_frictions_of_disturbed_swings_lie_in_their_intervals() -> None:
    """With blocks of four correlation times of the residual, and without the leverage of a block, none of the six
    intervals held."""
    off = [one for seed in (3, 6, 7) for name, one in fitted("swing", seed).items() if "friction" in name]
    assert np.sum(np.abs(off) <= 1) >= 5


def test_the_inertia_of_a_motor_whose_torque_was_recorded_early_lies_in_its_interval() -> None:
    """While the estimated delay counted as known, the inertia was off by 2 to 11 half widths of its interval."""
    assert all(abs(fitted("motor", seed)["J"]) <= 1 for seed in (3, 5, 7))
