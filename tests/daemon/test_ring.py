"""The ring buffer: order, overwriting, waiting."""

from __future__ import annotations

import threading

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.daemon.ring import Ring
from lostmotion.daemon.waker import Waker
from lostmotion.drivers.base import AccelBlock


def block(first: int, count: int) -> AccelBlock:
    """Samples at whole seconds whose values are their times."""
    times = np.arange(first, first + count, dtype=np.float64)
    return AccelBlock(times, times)


def ring(capacity: int = 8) -> Ring:
    """A ring with a waker of its own."""
    return Ring(capacity, Waker())


@given(st.lists(st.tuples(st.integers(1, 20), st.booleans()), max_size=30))
def test_it_holds_the_last_samples_in_order(pushes: list[tuple[int, bool]]) -> None:
    """Whatever the block sizes and releases, a slice is what a list would give, and the overwritten are counted."""
    buffer, kept, pushed, overwritten = ring(8), list[float](), 0, 0
    for count, release in pushes:
        buffer.push(block(pushed, count))
        kept += range(pushed, pushed + count)
        pushed += count
        overwritten += max(len(kept) - 8, 0)
        kept = kept[-8:]
        if release and len(kept) > 3:
            buffer.release(kept[3])
            kept = kept[3:]
        times, accel = buffer.slice(-1.0, 1e9)
        assert times.tolist() == kept
        assert accel.tolist() == kept
    assert buffer.overwritten == overwritten


def test_a_slice_is_half_open() -> None:
    """start <= time < end."""
    buffer = ring()
    buffer.push(block(0, 8))
    assert buffer.slice(2.0, 5.0)[0].tolist() == [2.0, 3.0, 4.0]


def test_a_step_back_in_time_is_left_out_and_counted() -> None:
    """Samples not after the newest one are dropped: a slice stays in order."""
    buffer = ring()
    buffer.push(block(0, 4))
    buffer.push(block(2, 4))
    assert buffer.slice(0.0, 9.0)[0].tolist() == [0, 1, 2, 3, 4, 5]
    assert buffer.unordered == 2


def test_a_bell_is_heard_once() -> None:
    """However often it is rung before anyone waits; and from another thread by one who waits already."""
    waker = Waker()
    waker.wake()
    waker.wake()
    assert (waker.wait(0), waker.wait(0.01)) == (True, False)
    thread = threading.Timer(0.05, waker.wake)
    thread.start()
    assert waker.wait(60.0)
    thread.join()


def test_a_patient_writer_waits_and_loses_nothing() -> None:
    """A writer far faster than its reader is held up: every sample arrives once, none is overwritten."""
    buffer, stop, seen = ring(16), threading.Event(), list[float]()
    writer = threading.Thread(target=lambda: [buffer.push(block(7 * i, 7), stop) for i in range(100)])
    writer.start()
    while len(seen) < 700:
        times, _ = buffer.slice(-1.0, 1e9)
        seen += times.tolist()
        if len(times):
            buffer.release(times[-1] + 0.5)
    writer.join(60.0)
    assert seen == list(range(700))
    assert buffer.overwritten == 0


def test_a_waiting_writer_can_be_stopped() -> None:
    """The stop event ends the wait though nobody reads."""
    buffer, stop = ring(8), threading.Event()
    writer = threading.Thread(target=lambda: buffer.push(block(0, 20), stop))
    writer.start()
    stop.set()
    writer.join(60.0)
    assert not writer.is_alive()
