"""Arrays of NumPy (npy, npz) and numbers in JSON: a vector of each list or column, by name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.matlab_child import STEP, columns_of
from lostmotion.drivers.formats.source import reason
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.text import open_text
from lostmotion.drivers.formats.vectors import check_size, table_of

__all__ = ["open_json", "open_numpy"]

ADVICE = "save each signal as an array of numbers: np.savez('x.npz', time=t, position=q)"
DEEPEST = 8


def open_numpy(path: Path) -> Table:
    """A .npy file, whose columns are signals, or the arrays of an .npz file by their names.  Raises RecordingError."""
    check_size(str(path), path.stat().st_size)
    try:
        loaded = np.load(path, allow_pickle=False)
        arrays = dict(loaded) if isinstance(loaded, np.lib.npyio.NpzFile) else {"column": loaded}
    except Exception as error:  # NumPy raises almost anything on a damaged file
        raise RecordingError(f"{path}: cannot be read as NumPy arrays: {reason(error)}; {ADVICE}") from error
    vectors = {name: vector for key, value in arrays.items() for name, vector in _columns(value, key)}
    return table_of(str(path), "NumPy", vectors, ADVICE)


def _columns(value: NDArray[Any], name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """The columns of an array, or the fields of its records."""
    for field in value.dtype.names or ():
        yield from _columns(value[field], field)
    if value.dtype.kind in "iuf" and value.size > 1:
        yield from columns_of(np.squeeze(value), name)
    elif value.dtype.kind in "iuf" and value.size == 1 and STEP.fullmatch(name):
        yield name, value.ravel()


def open_json(path: Path) -> Table:
    """Lists of numbers by their keys, or the numbers of a list of objects, one a line or all in one; of a list of runs,
    objects that hold lists, the longest.  What is no JSON is read as text.  Raises RecordingError."""
    check_size(str(path), path.stat().st_size)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        held = json.loads(text)
    except (ValueError, RecursionError):
        try:
            held = [json.loads(line) for line in text.splitlines() if line.strip()]
        except (ValueError, RecursionError):
            return open_text(path)
    notes: list[str] = []
    vectors = dict(_vectors(held, "", 0, notes))
    table = table_of(str(path), "JSON", vectors, "as in {'time': [0, 0.01], 'angle': [0.1, 0.2]}")
    return replace(table, notes=[*table.notes, *notes])


def _vectors(value: Any, name: str, depth: int, notes: list[str]) -> Iterator[tuple[str, NDArray[Any]]]:
    """The lists of numbers in a value; those of a list of objects are the columns of a table, but where these hold
    lists of different lengths, or there is one of them, each is a run.  What a person should know is added to notes."""
    if isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
        lengths = [max((len(held) for held in row.values() if isinstance(held, list)), default=0) for row in value]
        if max(lengths) > 1 and (len(lengths) == 1 or len({*lengths}) > 1):
            longest = lengths.index(max(lengths))
            if len(value) > 1:
                notes.append(f"{name or 'the list'} holds {len(value)} runs: number {longest + 1} is used, the longest")
            yield from _vectors(value[longest], name, depth, notes)
            return
        keys = dict.fromkeys(key for row in value for key in row)
        value = {key: [row.get(key) for row in value] for key in keys}
    if isinstance(value, Mapping) and depth < DEEPEST:
        for key, inner in value.items():
            yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1, notes)
    elif isinstance(value, int | float) and STEP.fullmatch(name):
        yield name, np.array([value], dtype=float)
    elif isinstance(value, list) and len(value) > 1:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            return
        yield from columns_of(np.squeeze(array), name or "column")
