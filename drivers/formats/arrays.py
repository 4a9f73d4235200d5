"""Arrays of NumPy (npy, npz) and numbers in JSON: a vector of each list or column, by name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.matlab_child import STEP, columns_of
from lostmotion.drivers.formats.source import reason
from lostmotion.drivers.formats.sysid import tests_of
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


@dataclass
class _Runs:
    """chosen: the number of the run that is read, None for the longest; names: of the runs, where they have some;
    count: of all runs, 0 where there is one."""

    chosen: int | None
    names: Sequence[str] = ()
    count: int = 0
    note: str = ""

    def of(self, rows: Sequence[Mapping[str, Any]], name: str) -> Mapping[str, Any]:
        """That of these runs which is read.  The first such list is that of the runs, and has a note; of another one it
        is the longest."""
        longest = max(range(len(rows)), key=lambda at: _rows_of(rows[at]))
        if len(rows) < 2 or self.count:
            return rows[longest]
        at, self.count = longest if self.chosen is None else self.chosen, len(rows)
        held = f"{name or 'the list'} holds {len(rows)} runs"
        held = f"{', '.join(self.names)} are the runs 0 to {len(rows) - 1}" if self.names else held
        if self.chosen is None:
            self.note = f"{held}: {at} is used, as in FILE#episode={at}"
        return rows[at]


def open_json(path: Path) -> Table:
    """Lists of numbers by their keys, or the numbers of a list of objects, one a line or all in one; of a list of runs,
    objects that hold lists, the longest or that of a number from 0; the tests of WPILib's SysId are such runs.  What is
    no JSON is read as text.  Raises RecordingError."""
    check_size(str(path), path.stat().st_size)
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    try:
        held = json.loads(text)
    except (ValueError, RecursionError):
        try:
            held = [json.loads(line) for line in text.splitlines() if line.strip()]
        except (ValueError, RecursionError):
            return open_text(path)
    return _table(path, held)


def _table(path: Path, held: Any, episode: int | None = None) -> Table:
    """The table of what a file of JSON holds, of several runs that of this number, by default the longest.  Raises
    RecordingError."""
    tests = tests_of(held)
    runs = _Runs(episode, list(tests))
    vectors = dict(_vectors(runs.of([*tests.values()], "") if tests else held, "", 0, runs))
    table = table_of(str(path), "JSON", vectors, "as in {'time': [0, 0.01], 'angle': [0.1, 0.2]}")
    if not runs.count:
        return table
    notes = [*table.notes, runs.note] if runs.note else table.notes
    return replace(table, notes=notes, open_episode=partial(_table, path, held), runs=runs.count)


def _rows_of(run: Mapping[str, Any]) -> int:
    """The length of the longest list in a run."""
    return max((len(held) for held in run.values() if isinstance(held, list)), default=0)


def _vectors(value: Any, name: str, depth: int, runs: _Runs) -> Iterator[tuple[str, NDArray[Any]]]:
    """The lists of numbers in a value; those of a list of objects are the columns of a table, but where these hold
    lists of different lengths, or there is one of them, each is a run."""
    if isinstance(value, list) and value and all(isinstance(row, Mapping) for row in value):
        lengths = [_rows_of(row) for row in value]
        if max(lengths) > 1 and (len(lengths) == 1 or len({*lengths}) > 1):
            yield from _vectors(runs.of(value, name), name, depth, runs)
            return
        keys = dict.fromkeys(key for row in value for key in row)
        value = {key: [row.get(key) for row in value] for key in keys}
    if isinstance(value, Mapping) and depth < DEEPEST:
        for key, inner in value.items():
            yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1, runs)
    elif isinstance(value, int | float) and STEP.fullmatch(name):
        yield name, np.array([value], dtype=float)
    elif isinstance(value, list) and len(value) > 1:
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            return
        yield from columns_of(np.squeeze(array), name or "column")
