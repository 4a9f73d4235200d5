"""One recording in several files, as ``q.csv+tau.csv``: tables with as many rows as each other."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import DATE, Series, Source
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import UNNAMED, column_of, is_time

__all__ = ["joined"]


def joined(name: str, paths: Sequence[Path], opened: Callable[[Path], Source]) -> Table:
    """The tables of all files as one.  A series whose name says no quantity gets that of its file in front; the times
    are those of the first file that has them, also where no name tells them.  Raises RecordingError."""
    tables = [_table(path, opened(path)) for path in paths]
    found: dict[str, tuple[Table, Series]] = {}
    for path, table in zip(paths, tables, strict=True):
        has_time = any(_is_time(one) for _, one in found.values())
        for at, one in enumerate(table.series):
            if not (has_time and _is_time(one)) and not (one.name == table.clock and _repeats(table, tables)):
                found.setdefault(_named(one.name, path.stem, at, table, found), (table, one))

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        loaded: dict[str, NDArray[Any]] = {}
        for table in tables:
            own = {each: found[each][1].name for each in names if found[each][0] is table}
            values = table.load(list(own.values())) if own else {}
            loaded |= {each: values[inner] for each, inner in own.items()}
        _check_rows(name, {each: len(values) for each, values in loaded.items()})
        return loaded

    series = [replace(one, name=each) for each, (_, one) in found.items()]
    kinds = dict.fromkeys(table.kind for table in tables)
    notes = [note for table in tables for note in table.notes]
    metadata = {key: value for table in reversed(tables) for key, value in table.metadata.items()}
    return Table(name, f"{len(tables)} files of {', '.join(kinds)}", series, load, notes, metadata)


def _table(path: Path, source: Source) -> Table:
    if not isinstance(source, Table):
        raise RecordingError(f"{path}: found {source.kind}, expected a table, as one of several files of a recording")
    return source


def _is_time(one: Series) -> bool:
    return is_time(one.name) or one.unit == DATE


def _repeats(table: Table, tables: Sequence[Table]) -> bool:
    """Whether the times of a table, which no name tells, are those of the first table with such times."""
    first = next(each for each in tables if each.clock)
    times, own = (np.asarray(each.load([each.clock])[each.clock], dtype=float) for each in (first, table))
    return (
        first is not table and times.size == own.size and bool(np.abs(times - own).max() < np.median(np.diff(own)) / 2)
    )


def _named(name: str, stem: str, at: int, table: Table, taken: Mapping[str, object]) -> str:
    """The name of a series among those of other files."""
    if UNNAMED.fullmatch(name):
        return f"{stem}[{at}]" if len(table.series) > 1 else stem
    says = is_time(name) or column_of(name) is not None
    return name if says and name not in taken else f"{stem}/{name}"


def _check_rows(name: str, rows: Mapping[str, int]) -> None:
    if len(set(rows.values())) > 1:
        each = ", ".join(f"{count} of {series}" for series, count in rows.items())
        raise RecordingError(f"{name}: found {each}, expected as many rows in each file; are they of one recording?")
