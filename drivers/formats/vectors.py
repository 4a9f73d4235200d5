"""Vectors by name, as MAT, NumPy and JSON files hold them, as a table: those of the usual length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.guess import MOTIONS
from lostmotion.drivers.formats.matlab_child import STEP
from lostmotion.drivers.formats.rates import ROWS
from lostmotion.drivers.formats.source import MOST_SERIES, MOST_VALUES, Series, check_count, too_many
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import column_of, is_time

__all__ = ["MOST_BYTES", "check_size", "table_of"]

MOST_BYTES = 8 * MOST_VALUES
EVEN = 1e-3
"""Share of a step of times by which it may differ from the others, by their rounding."""


def check_size(name: str, size: int) -> None:
    """Refuses what would not fit into memory.  Raises RecordingError."""
    if size > MOST_BYTES:
        raise RecordingError(
            f"{name}: found {size / 1e6:.0f} MB, expected at most {MOST_BYTES / 1e6:.0f}; save fewer signals"
        )


def table_of(name: str, kind: str, vectors: Mapping[str, NDArray[np.generic]], advice: str) -> Table:
    """The vectors of one length: of those that several have, or else of all, the largest that a motion has by its name,
    or else the largest; without times those of its rows, where a number says how often they were sampled.  advice:
    where there is none.  Raises RecordingError."""
    steps = {title: float(vector[0]) for title, vector in vectors.items() if vector.size == 1}
    vectors = {title: vector for title, vector in vectors.items() if vector.size > 1}
    if not vectors:
        raise RecordingError(f"{name}: found no vectors of numbers, expected signals; {advice}")
    if len(vectors) > MOST_SERIES:
        raise too_many(name, len(vectors), "vectors")
    lengths = [vector.size for vector in vectors.values()]
    moving = {vector.size for title, vector in vectors.items() if column_of(title) in MOTIONS}
    usual = max(set(lengths), key=lambda length: (lengths.count(length) > 1, length in moving, length))
    check_count(name, usual)
    timed, step = _times(vectors, steps, usual)
    vectors |= timed
    series = [Series(title) for title, vector in vectors.items() if vector.size == usual]
    others = len(vectors) - len(series)
    notes = [step] * bool(step) + [f"{others} vectors that do not have {usual} values are left out"] * bool(others)

    def load(names: Sequence[str]) -> Mapping[str, NDArray[np.generic]]:
        return {title: vectors[title] for title in names}

    return Table(name, kind, series, load, notes)


def _times(
    vectors: Mapping[str, NDArray[np.generic]], steps: Mapping[str, float], rows: int
) -> tuple[dict[str, NDArray[np.generic]], str]:
    """The times (rows,) [s] by the number that says how often rows were sampled, as a vector by its name, and a note of
    it; none where there are times, such numbers that contradict each other, or a vector that ascends by a whole number
    of the steps that they say, as of a recorder that keeps every sixth sample."""
    kept = {title: 1 / step if _is_step(title) else step for title, step in steps.items() if step > 0}
    kept = {title: rate for title, rate in kept.items() if ROWS[0] <= rate <= ROWS[1]}
    if not kept or max(kept.values()) > (1 + EVEN) * min(kept.values()) or any(is_time(title) for title in vectors):
        return {}, ""
    rate = next(iter(kept.values()))
    if any(vector.size == rows and _ascends_by(1 / rate, vector) for vector in vectors.values()):
        return {}, ""
    said = f"{' and '.join(kept)} {'says' if len(kept) == 1 else 'say'}"
    return {"time": np.arange(rows) / rate}, f"time: no times are given; {rate:g} rows a second, as {said}"


def _ascends_by(step: float, vector: NDArray[np.generic]) -> bool:
    """Whether each number is larger than the one before by the same whole number of steps."""
    if vector.dtype.kind not in "iuf":
        return False
    many = np.diff(np.asarray(vector, dtype=np.float64)) / step
    whole = round(float(np.median(many))) if np.isfinite(many).all() else 0
    return whole >= 1 and bool(np.abs(many - whole).max() < EVEN * whole)


def _is_step(title: str) -> bool:
    """Whether the name of a number is that of the time of a row, and not of the rows a second."""
    found = STEP.fullmatch(title)
    return bool(found and found["step"])
