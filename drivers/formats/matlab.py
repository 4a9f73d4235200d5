"""MAT files of MATLAB and Octave, up to version 7, read by SciPy; structures become names with dots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.source import MOST_SERIES, MOST_VALUES, Series, check_count, reason, too_many
from lostmotion.drivers.formats.table import Table

__all__ = ["open_matlab"]

MOST_BYTES = 8 * MOST_VALUES
DEEPEST = 16
WIDEST = 64
"""columns of a matrix that are signals side by side"""


def open_matlab(path: Path) -> Table:
    """All vectors of the usual length, by name; columns of matrices as ``name[0]``.  Raises RecordingError."""
    if path.stat().st_size > MOST_BYTES:
        raise RecordingError(
            f"{path}: found {path.stat().st_size / 1e6:.0f} MB, expected at most {MOST_BYTES / 1e6:.0f}; "
            "save fewer signals"
        )
    vectors = dict(_vectors(_contents(path), "", 0))
    if not vectors:
        raise RecordingError(
            f"{path}: found no vectors of numbers, expected signals; save objects such as timeseries as arrays: "
            "t = ts.Time; y = ts.Data; save('x.mat', 't', 'y', '-v7')"
        )
    if len(vectors) > MOST_SERIES:
        raise too_many(str(path), len(vectors), "vectors")
    lengths = [vector.size for vector in vectors.values()]
    usual = max(set(lengths), key=lambda length: (lengths.count(length) > 1, length))
    check_count(str(path), usual)
    series = [Series(name) for name, vector in vectors.items() if vector.size == usual]
    others = len(vectors) - len(series)
    notes = [f"{others} vectors that do not have {usual} values are left out"] if others else []

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        return {name: vectors[name] for name in names}

    return Table(str(path), "MAT", series, load, notes)


def _contents(path: Path) -> dict[str, Any]:
    io = needed("scipy.io", path)
    with path.open("rb") as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
        raise RecordingError(
            f"{path}: found a MAT file of version 7.3 (HDF5), expected 7 or older; in MATLAB: save('x.mat', '-v7')"
        )
    try:
        contents: dict[str, Any] = io.loadmat(path, simplify_cells=True)
    except MemoryError:
        raise
    except Exception as error:  # SciPy raises almost anything on a damaged file
        raise RecordingError(f"{path}: cannot be read as a MAT file: {reason(error)}; is it damaged?") from error
    return contents


def _vectors(value: Any, name: str, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Everything of numbers with more than one row, by name."""
    if depth > DEEPEST:
        return
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1)
        return
    if not isinstance(value, np.ndarray):
        return
    if value.dtype == object:
        for index, inner in enumerate(value.ravel()[:WIDEST]):
            yield from _vectors(inner, f"{name}[{index}]", depth + 1)
    elif value.dtype.kind in "iuf" and value.size > 1:
        yield from _columns(np.squeeze(value), name)


def _columns(value: NDArray[Any], name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    if value.ndim == 1:
        yield name, value
    elif value.ndim == 2:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        if tall.shape[1] <= WIDEST:
            yield from ((f"{name}[{index}]", tall[:, index]) for index in range(tall.shape[1]))
