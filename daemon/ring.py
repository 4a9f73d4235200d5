"""The last seconds of one accelerometer, written by its poller thread and read by the pipeline.

Hardware is never held up: what the reader has not released in time is overwritten and counted.  A writer that may wait
(a virtual robot) waits instead.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import numpy as np

from lostmotion.daemon.waker import Waker
from lostmotion.drivers.base import AccelBlock, FloatArray

__all__ = ["Ring"]

UNTIL_CLOSED_S = 0.2
"""how often a waiting writer checks whether it has to stop [s]"""


class Ring:
    """Samples in time order; ``capacity`` of them.

    Everything is written twice, ``capacity`` apart, so that any segment lies in one piece and a slice costs one copy.
    ``overwritten`` counts samples lost because nobody had released them; ``unordered`` those that came with a time not
    after the last one's and were left out.  ``waker`` wakes the reader when a writer needs room, or has ended.
    ``range_ms2`` is the sensor's; ``copy`` is given every block as it comes, while somebody records.
    """

    def __init__(self, capacity: int, waker: Waker) -> None:
        self.capacity = capacity
        self._waker = waker
        self.overwritten = 0
        self.unordered = 0
        self.range_ms2 = math.inf
        self.copy: Callable[[AccelBlock], None] | None = None
        self.oldest = math.inf
        """time of the first sample ever [s], +inf before it"""
        self.ended = False
        self._time = np.empty(2 * capacity)
        self._accel = np.empty(2 * capacity)
        self._written = 0  # samples ever written
        self._released = 0  # samples the reader no longer needs
        self._last = -math.inf
        self._changed = threading.Condition()

    @property
    def newest(self) -> float:
        """Time of the newest sample [s]; -inf when there is none, +inf when none will follow."""
        return math.inf if self.ended else self._last

    @property
    def crowded(self) -> bool:
        """Whether more than half of it waits to be released."""
        return self._written - self._released > self.capacity // 2

    def push(self, block: AccelBlock, wait: threading.Event | None = None) -> None:
        """Writes a block.

        wait: the writer may be held up until there is room, or until this event is set; None: it may not.
        """
        if (copy := self.copy) is not None:
            copy(block)
        fresh = int(block.time.searchsorted(self._last, side="right"))
        for first in range(fresh, len(block.time), self.capacity):
            piece = slice(first, first + self.capacity)
            self._write(block.time[piece], block.accel[piece], wait)
        self.unordered += fresh

    def end(self) -> None:
        """Nothing more will be written."""
        self.ended = True
        self._waker.wake()

    def _write(self, time: FloatArray, accel: FloatArray, wait: threading.Event | None) -> None:
        with self._changed:
            while wait and self._written + len(time) - self._released > self.capacity and not wait.is_set():
                self._waker.wake()
                self._changed.wait(UNTIL_CLOSED_S)
            excess = self._written + len(time) - self._released - self.capacity
            if excess > 0:
                self.overwritten += excess
                self._released += excess
            self._place(time, accel)
            if not self._written:
                self.oldest = float(time[0])
            self._written += len(time)
            self._last = float(time[-1])

    def _place(self, time: FloatArray, accel: FloatArray) -> None:
        """Writes at the present place and one capacity further, around the end of the first half if need be."""
        begin = self._written % self.capacity
        fits = min(len(time), self.capacity - begin)
        pieces = [(slice(0, fits), begin), (slice(fits, len(time)), 0)]
        for source, at in pieces if fits < len(time) else pieces[:1]:
            length = source.stop - source.start
            for first in (at, at + self.capacity):
                self._time[first : first + length] = time[source]
                self._accel[first : first + length] = accel[source]

    def slice(self, start: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Times [s] and accelerations [m/s²] with start <= time < end, as far as they are still there; copies."""
        with self._changed:
            low, high = self._bounds()
            first, last = low + self._time[low:high].searchsorted((start, end))
            return self._time[first:last].copy(), self._accel[first:last].copy()

    def release(self, before: float) -> None:
        """Releases the samples before this time [s]."""
        with self._changed:
            low, high = self._bounds()
            self._released += int(self._time[low:high].searchsorted(before))
            self._changed.notify_all()

    def _bounds(self) -> tuple[int, int]:
        """Where the unreleased samples lie, in one piece."""
        low = self._released % self.capacity
        return low, low + self._written - self._released
