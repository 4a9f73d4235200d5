"""Writes a recording while its samples arrive.  recording.py handles whole recordings."""

from __future__ import annotations

import csv
import io
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from lostmotion.drivers.base import AccelBlock, FloatArray, ServoSample
from lostmotion.drivers.codec.recording_csv import cells, head_text
from lostmotion.drivers.errors import RecordingError, unwritable
from lostmotion.drivers.pipes import STANDARD
from lostmotion.drivers.recording import merge

__all__ = ["Recorder"]

SERVO_COLUMNS = ("command", "position", "torque", "voltage", "current", "temperature")
COLUMNS = (*SERVO_COLUMNS, "accel")
HOLD_S = 1.0  # how long a sample waits for an earlier one of the other source

Samples = tuple[FloatArray, dict[str, FloatArray]]


class Recorder:
    """One joint and its accelerometer, written to a recording, or for ``-`` to standard output, row by row in time
    order.

    Rows are handed to the system as soon as their order is certain, at most HOLD_S late, so that a killed recorder
    leaves a readable file. When one cannot be written, all before it stay and the file is closed; a file without
    any row is removed. A file that was there is replaced with the first rows, and stays where none come. ``origin``
    is the robot time [s] that is 0 in the file; times are rounded to 1 ns. ``late`` counts samples that came more
    than HOLD_S after others of their time and could not be written in order. Raises RecordingError when the file
    cannot be written.
    """

    def __init__(self, path: str | Path, metadata: Mapping[str, Any], origin: float = 0.0) -> None:
        self.rows = 0
        self.late = 0
        self._first = self._last = 0.0
        self._path = Path(path)
        self._origin = origin
        self._pending = {"servo": _nothing(SERVO_COLUMNS), "accel": _nothing(("accel",))}
        self._newest = dict.fromkeys(self._pending, -np.inf)
        self._written_until = -np.inf
        self._size = 0
        self._is_shared = self._path == STANDARD  # standard output: what others have written there stays
        try:
            place = os.dup(sys.stdout.fileno()) if self._is_shared else self._path
            self._file = open(place, "wb", buffering=0, opener=None if self._is_shared else _keeping)  # noqa: SIM115
            is_kept = not self._is_shared and os.fstat(self._file.fileno()).st_size > 0
        except OSError as error:
            raise RecordingError(unwritable(self._path, error)) from error
        self._head = head_text(metadata) + ",".join(("time", *COLUMNS)) + "\n"
        if not is_kept:
            self._begin()

    def add_servo(self, samples: Sequence[ServoSample]) -> None:
        """Takes samples of the joint, in time order."""
        columns = {name: np.array([getattr(sample, name) for sample in samples]) for name in SERVO_COLUMNS}
        self._add("servo", np.array([sample.time for sample in samples]), columns)

    def add_accel(self, block: AccelBlock) -> None:
        """Takes a block of the accelerometer."""
        self._add("accel", block.time, {"accel": block.accel})

    def close(self) -> None:
        """Writes what still waits and closes the file; may be called twice."""
        if self._file.closed:
            return
        self._emit(np.inf)
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _add(self, source: str, times: FloatArray, columns: dict[str, FloatArray]) -> None:
        if len(times) == 0:
            return
        in_time = times > self._written_until
        self.late += int(np.count_nonzero(~in_time))
        old_times, old = self._pending[source]
        self._pending[source] = (
            np.concatenate([old_times, times[in_time]]),
            {name: np.concatenate([old[name], values[in_time]]) for name, values in columns.items()},
        )
        self._newest[source] = max(self._newest[source], float(times[-1]))
        self._emit(max(min(self._newest.values()), max(self._newest.values()) - HOLD_S))

    def _emit(self, until: float) -> None:
        """Writes all rows up to and with the robot time ``until`` [s]."""
        ready = []
        for source, (times, columns) in self._pending.items():
            cut = int(np.searchsorted(times, until, "right"))
            ready.append((times[:cut], {name: values[:cut] for name, values in columns.items()}))
            self._pending[source] = (times[cut:], {name: values[cut:] for name, values in columns.items()})
        times, columns = merge(*ready)
        if len(times) == 0:
            return
        self._written_until = until
        if self._head:
            self._begin()
        text = io.StringIO()
        rounded = np.round(times - self._origin, 9)
        csv.writer(text, lineterminator="\n").writerows(
            zip(cells(rounded), *(cells(columns[name]) for name in COLUMNS), strict=True)
        )
        self._write(text.getvalue())
        self._first, self._last = self._first if self.rows else float(times[0]), float(times[-1])
        self.rows += len(times)

    @property
    def duration(self) -> float:
        """From the first row that was written to the last [s]."""
        return self._last - self._first

    def _begin(self) -> None:
        """Writes the head, in place of what an earlier file held."""
        self._cut(0)
        head, self._head = self._head, ""
        self._write(head)

    def _write(self, text: str) -> None:
        """Writes all of the text, or else none of it and nothing ever after."""
        rest = memoryview(text.encode())
        size = self._size + len(rest)
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            self._cut(self._size)
            self._close()
            if isinstance(error, BrokenPipeError):  # not the disk: the reader of standard output wants no more
                raise
            raise RecordingError(unwritable(self._path, error)) from error
        self._size = size

    def _cut(self, size: int) -> None:
        with suppress(OSError):  # a pipe cannot be cut
            if not self._is_shared:
                self._file.truncate(size)

    def _close(self) -> None:
        try:
            self._file.close()
            if self.rows == 0 and not self._head and self._path.is_file():
                self._path.unlink()
        except OSError as error:
            raise RecordingError(unwritable(self._path, error)) from error


def _keeping(path: str, flags: int) -> int:
    """Opens a file without cutting it."""
    return os.open(path, flags & ~os.O_TRUNC, 0o666)


def _nothing(columns: Sequence[str]) -> Samples:
    return np.empty(0), {name: np.empty(0) for name in columns}
