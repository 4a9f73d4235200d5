"""The clock of a robot, and the cycles in which hardware is read."""

from __future__ import annotations

from hypothesis import example, given
from hypothesis import strategies as st

from lostmotion.drivers.clock import CYCLE_S, next_cycle


@given(st.floats(0.0, 1e7), st.sampled_from([CYCLE_S, CYCLE_S / 2, CYCLE_S / 6]))
@example(1.2, CYCLE_S / 6)
def test_the_next_cycle_begins_at_a_multiple_and_soon(now: float, length: float) -> None:
    """After now, and not more than one cycle later; the whole cycle's begin is one of its parts' begins."""
    begin = next_cycle(now, length)
    assert now < begin <= now + length + 1e-6
    assert abs(begin / length - round(begin / length)) < 1e-6
    assert next_cycle(now, length) <= next_cycle(now) + 1e-6
