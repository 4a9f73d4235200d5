"""Legendre's polynomials against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.detector.legendre import derivative, values


@pytest.mark.parametrize("degree", [0, 1, 2, 5, 16, 40])
def test_same_as_numpy(degree: int) -> None:
    """Values, and derivatives of every order up to the third."""
    place = np.linspace(-1, 1, 101)
    assert values(place, degree) == pytest.approx(np.polynomial.legendre.legvander(place, degree), abs=1e-13)
    unit = np.eye(degree + 1)
    for order in range(min(degree, 3) + 1):
        expected = np.polynomial.legendre.legder(unit, order)
        assert derivative(degree, order) == pytest.approx(expected, rel=1e-12)
