"""What rings do not explain of an impact, and the noise beside it."""

import numpy as np
import pytest

from lostmotion.detector.misfit import directions, split
from lostmotion.detector.window import DetectorSettings

SETTINGS = DetectorSettings(f_res_hz=58.0, zeta=0.012)
COUNT, LENGTH, RATE = 400, 250, 1000.0


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_noise_is_told_beside_a_misfit(share: float) -> None:
    """Of noise of unit variance, alone and beside a misfit of a tenth of the rings' energy, 0.93 to 1.07 is expected in
    the directions of the misfit, where the latter is 1.5 times as loud as the noise and more."""
    rng = np.random.default_rng(8850)
    columns, energy = directions(LENGTH, RATE, SETTINGS), np.full(COUNT, 316.0)
    size = np.sqrt(share * energy[0] / np.sum(columns**2))
    left = rng.normal(size=(COUNT, LENGTH)) + size * rng.normal(size=(COUNT, columns.shape[1])) @ columns.T
    found = split(left, np.zeros((COUNT, 1, LENGTH)), energy, np.ones(COUNT), columns, 1.0)
    basis = columns / np.linalg.norm(columns, axis=0)
    raw = np.mean((left @ basis) ** 2)
    power = np.mean((found.noise @ basis) ** 2) + np.trace(basis.T @ found.hidden @ basis) / COUNT / basis.shape[1]
    assert power == pytest.approx(1.0, abs=0.07)
    assert (raw > 1.5) == (share > 0)
