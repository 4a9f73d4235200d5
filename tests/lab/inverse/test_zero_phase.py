"""The compiled filter against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from lostmotion.lab.inverse.zero_phase import ORDER, lowpass


@pytest.mark.parametrize("shape", [(700,), (3, 1500), (12,)])
@pytest.mark.parametrize("band", [0.003, 0.05, 0.3])
def test_it_is_scipys(shape: tuple[int, ...], band: float) -> None:
    """The same numbers to rounding, also of signals shorter than the padding, and the given ones stay as they are."""
    values = 5.0 + np.random.default_rng(1).standard_normal(shape).cumsum(-1)
    before, padding = values.copy(), min(shape[-1] - 1, round(3 / band))
    exact = sosfiltfilt(butter(ORDER, 2 * band, output="sos"), values, padlen=padding)
    assert lowpass(values, band) == pytest.approx(exact, rel=1e-9, abs=1e-9)
    assert np.array_equal(values, before)
