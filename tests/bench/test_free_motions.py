"""The simulated free motions of the bench lose what they are said to lose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.free_motions import KINDS, drawn, graded, recorded


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "dropped"])
def test_the_stated_share_is_left(kind: str) -> None:
    """The last swing is as large as drawn, to a fifth; a pendulum from which nothing is missing loses nothing."""
    swing = replace(drawn(kind, 1), base="oscillator", sensor="clean", noise=1e-4, periods=8.0, left=0.4, phase=0.0)
    place = next(iter(recorded(swing).columns.values()))
    period = round(swing.rate)
    share = np.ptp(place[-period:]) / np.ptp(place[:period])
    assert share == pytest.approx(0.4 ** (7 / 8), rel=0.2)
    if kind == "none":
        place = next(iter(recorded(replace(swing, base="joint", amplitude=0.3)).columns.values()))
        assert np.ptp(place[-period:]) == pytest.approx(np.ptp(place[:period]), rel=0.01)


def test_the_slow_part_of_coloured_noise_is_no_second_mode() -> None:
    """Noise with a correlation of 0.9 beside a mass that is damped: one slow swing of it was called a mode."""
    swing = drawn("viscous", 505)
    assert swing.sensor == "colour"
    assert graded(swing) == "right"
