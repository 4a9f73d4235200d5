"""Elementary functions for lanes, compared with those of the C library."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numba import njit

from lostmotion.model.elementary import cosine, exponential, sine, tanh
from lostmotion.model.kernel import OPTIONS
from lostmotion.model.motion import FloatArray

SIZES = np.concatenate([np.logspace(-12, 5, 4001), [0.0, 1e-300, np.pi / 2, np.pi, 19.0, 354.9, 1e3]])
ARGUMENTS = np.concatenate([SIZES, -SIZES, [np.inf, -np.inf, np.nan]])


def values(function: Callable[[float], float], x: FloatArray) -> FloatArray:
    @njit(**OPTIONS)
    def each(x: FloatArray, out: FloatArray) -> None:
        for i in range(x.size):
            out[i] = function(x[i])

    each(x, out := np.empty_like(x))
    return out


def test_tanh_is_exact_to_rounding() -> None:
    assert values(tanh, ARGUMENTS) == pytest.approx(np.tanh(ARGUMENTS), rel=1e-15, abs=0.0, nan_ok=True)


def test_an_exponential_is_exact_within_the_range_of_numbers() -> None:
    x = ARGUMENTS[~(np.abs(ARGUMENTS) > 700)]
    assert values(exponential, x) == pytest.approx(np.exp(x), rel=1e-15, abs=0.0, nan_ok=True)
    assert values(exponential, np.array([-1e9, 1e9])) == pytest.approx([0.0, 1e304], rel=0.02, abs=1e-304)


@pytest.mark.parametrize(("ours", "theirs"), [(sine, np.sin), (cosine, np.cos)])
def test_sine_and_cosine_are_exact_to_rounding(
    ours: Callable[[float], float], theirs: Callable[[FloatArray], FloatArray]
) -> None:
    """Up to 1e15 rad; an infinite angle has none."""
    x = np.concatenate([ARGUMENTS[np.isfinite(ARGUMENTS)], np.logspace(5, 15, 4001)])
    assert np.abs(values(ours, x) - theirs(x)).max() <= 5e-16
    assert np.isnan(values(ours, np.array([np.inf, -np.inf, np.nan]))).all()
