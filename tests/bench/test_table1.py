"""The repetition of the paper's table 1 has the conditions that it names."""

from __future__ import annotations

import numpy as np
import pytest
from bench import table1
from bench.table1 import PLAY_M, cells, measured, noise_of, tip, wilson, wilson_interval


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """One motion to learn from, one to test."""
    monkeypatch.setattr(table1, "LEARNT", range(9300, 9301))
    monkeypatch.setattr(table1, "TESTED", range(9301, 9302))


def test_wilson_by_hand() -> None:
    """98 of 100: 93.00 to 99.45 %."""
    assert wilson(98, 100) == " 98.00 (93.00 to 99.45)"
    assert wilson_interval(100, 100) == pytest.approx((0.963, 1.0), abs=5e-4)


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_the_windows_have_the_ratio_that_is_named(rate: float) -> None:
    """What the play adds to the median window has 100 000 times the noise's variance at 50 dB; the readings differ from
    the tip by that noise."""
    added = tip(rate, PLAY_M, table1.TESTED) - tip(rate, 0.0, table1.TESTED)
    noise = measured(rate, 50.0, PLAY_M, table1.TESTED) - tip(rate, PLAY_M, table1.TESTED)
    assert np.median(np.sum(added**2, axis=1)) / noise.var() == pytest.approx(1e5, rel=0.06)
    assert noise_of(rate, 30.0) == pytest.approx(10 * noise_of(rate, 50.0))


def test_cells_count_what_they_say() -> None:
    """At 50 dB a play of 80 µm is told from none without an error; 10 µm with the level of a joint without play are not
    accepted, with a level of their own by ring-down they are."""
    found = {(cell.statistic, cell.healthy_m): cell for cell in cells(200.0, 50.0, (0.0, 10e-6))}
    for statistic in ("band", "ringdown"):
        cell = found[statistic, 0.0]
        assert cell.eq9 == cell.youden == (cell.count, cell.count)
        assert cell.untold == cell.count
        assert found[statistic, 10e-6].untold < 0.1 * cell.count
    assert min(found["ringdown", 10e-6].youden) > 0.9 * found["ringdown", 10e-6].count
