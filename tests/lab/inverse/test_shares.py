"""Effects that share a torque: what each of them gets."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.lab.inverse.shares import _shapley

TIMES = np.linspace(0.0, 20.0, 4001)
ONE, TWO = np.sin(2.0 * TIMES), np.sin(3.1 * TIMES)


def test_torques_that_share_nothing_get_their_squares() -> None:
    """Two waves of different frequency, one twice as large: 4 to 1, and both together the whole."""
    found = _shapley(2 * ONE + TWO, [ONE, TWO], [], ["one", "two"])
    assert found["one"] / found["two"] == pytest.approx(4.0, rel=0.05)
    assert sum(found.values()) == pytest.approx(1.0)


def test_of_two_that_are_the_same_each_gets_half() -> None:
    """The order in which they are added decides nothing."""
    found = _shapley(ONE, [ONE, 0.1 * ONE], [], ["one", "two"])
    assert found == pytest.approx({"one": 0.5, "two": 0.5})


def test_what_is_there_in_any_case_is_not_divided() -> None:
    """A spring beside an inertia that swings at one frequency: their torques cancel, however large they are, and the
    spring gets what the inertia does not explain."""
    spring = ONE + 0.01 * TWO
    found = _shapley(0.2 * TWO, [20 * spring, TWO], [-ONE], ["spring", "friction"])
    assert found["friction"] == pytest.approx(found["spring"], rel=0.01)
    found = _shapley(0.2 * np.sign(TWO), [20 * spring, np.sign(TWO), ONE * TWO], [-ONE], ["spring", "dry", "other"])
    assert found["dry"] > found["spring"] > found["other"]
