"""Lines of numbers, as a microcontroller prints them: ``value`` or ``t_us,value`` or more columns.

Columns are separated by a comma, a semicolon or a tab; lines end with LF or CR LF.  A line that begins with ``#`` is a
comment; ``#lost N`` says that N readings are missing in its place, as when a sensor's FIFO has run over.
"""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

__all__ = ["CsvDecoder"]

MAX_LINE = 256
"""a line longer than this [bytes] is garbage without line ends, and is not kept"""
LOST = re.compile(rb"#lost (\d{1,5})\r?")
TO_COMMAS = bytes.maketrans(b";\t_", b",,?")
"""also spoils 1_000, which float() takes and no device prints"""
OF_NUMBERS = b"0123456789+-. \r"
"""what a printed number is made of, but for an exponent"""


class CsvDecoder:
    """Cuts a stream into rows of numbers.

    A broken line becomes None in its place and is counted in ``broken``: one that is not all numbers (NaN and infinity
    are none), or that has another number of columns than the others, as happens when bytes are lost.  The second line
    running with the same new number of columns is believed, so a change of format costs one line.  Readings that the
    device reports as lost are None, too, but counted in ``lost``.  The first line
    after ``reset`` is dropped without counting, for it is rarely whole.  ``table`` returns the same as ``feed`` in a
    quarter of the time, where all lines are as they nearly always are.
    """

    def __init__(self) -> None:
        self.broken = self.lost = 0
        self._rest = b""
        self._columns = 0
        self._new_columns = 0
        self._skip_first = True

    def feed(self, data: bytes) -> list[tuple[float, ...] | None]:
        """The rows that are complete now."""
        *lines, self._rest = (self._rest + data.translate(TO_COMMAS)).split(b"\n")
        if len(self._rest) > MAX_LINE:
            lines.append(self._rest)
            self._rest = b""
        if lines and self._skip_first:
            del lines[0]
            self._skip_first = False
        return [row for line in lines for row in (self._lost_rows(line) if line[:1] == b"#" else (self._row(line),))]

    def table(self, data: bytes) -> NDArray[np.float64] | None:
        """The same as an array, shape (rows, columns); None, and nothing is taken in, where a line is not plainly one
        more of the same or none is complete: that is ``feed``'s."""
        text = self._rest + data.translate(TO_COMMAS)
        end = text.rfind(b"\n") + 1
        lines = text[:end]
        marks = lines.translate(None, OF_NUMBERS)
        plain = marks == (b"," * (self._columns - 1) + b"\n") * lines.count(b"\n")
        if not plain or not self._columns or self._skip_first or len(text) - end > MAX_LINE:
            return None
        try:
            numbers = [*map(float, lines[:-1].replace(b"\n", b",").split(b","))]
        except ValueError:
            return None
        if not math.isfinite(sum(numbers)):
            return None
        self._rest = text[end:]
        self._new_columns = 0
        return np.array(numbers).reshape(-1, self._columns)

    def reset(self) -> None:
        """The line was opened anew, most likely in the middle of a reading."""
        self._rest = b""
        self._skip_first = True

    def _lost_rows(self, comment: bytes) -> list[None]:
        """A place for each reading that the comment reports as lost."""
        found = LOST.fullmatch(comment)
        count = int(found[1]) if found else 0
        self.lost += count
        return [None] * count

    def _row(self, line: bytes) -> tuple[float, ...] | None:
        try:
            row = tuple(map(float, line.split(b",")))
        except ValueError:
            row = ()
        if row and all(map(math.isfinite, row)) and (len(row) == self._columns or self._fits(len(row))):
            self._new_columns = 0
            return row
        self.broken += 1
        return None

    def _fits(self, columns: int) -> bool:
        """Whether a row with another number of columns is to be believed: the first one, and the second running."""
        if columns == self._new_columns or not self._columns:
            self._columns = columns
        self._new_columns = columns
        return columns == self._columns
