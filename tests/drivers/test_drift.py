"""The error of an integrated speed: of what swings it is how fast the middle of the swings moves on."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.drivers.formats.swinging import drift_of

TIME = np.arange(0.0, 20.0, 0.01)


@pytest.mark.parametrize(
    ("offset", "ripple", "found"), [(0.05, 1.0, 0.05), (-0.3, 1.0, -0.3), (10.0, 1.0, 0.0), (3.0, 0.0, 0.0)]
)
def test_only_of_what_swings(offset: float, ripple: float, found: float) -> None:
    """An offset of a swing is its error; the speed of a wheel that turns with a ripple, or evenly, is none."""
    speed = offset + ripple * np.exp(-TIME / 30) * np.cos(2 * np.pi * 0.5 * TIME)
    position = np.cumsum(speed) * 0.01
    assert drift_of(TIME, position, speed) == pytest.approx(found, abs=0.01)
