"""Apache Parquet files, as pandas, Polars and LeRobot write them; needs pyarrow, which is imported late."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.source import MOST_SERIES, Series, check_count, reason, too_many
from lostmotion.drivers.formats.table import Table

__all__ = ["as_numbers", "open_parquet", "readable"]

MOST_IN_LIST = 1000
"""entries of a list in a cell, as joints of a robot are"""


def open_parquet(path: Path) -> Table:
    """A column of lists becomes a series for each place in the list: ``state[0]``, ``state[1]``.

    Raises RecordingError.
    """
    pq = needed("pyarrow.parquet", path)
    with readable(path), pq.ParquetFile(path) as file:
        rows, schema = file.metadata.num_rows, file.schema_arrow
        lists = {one.name: _length(file, one) for one in schema if _is_list(one.type)}
    if rows == 0:
        raise RecordingError(f"{path}: found no rows, expected samples; was the recording stopped at once?")
    series = []
    for one in schema:
        if one.name in lists:
            series += [Series(f"{one.name}[{place}]") for place in range(lists[one.name])]
        elif _is_number(one.type):
            series.append(Series(one.name))
    if len(series) > MOST_SERIES:
        raise too_many(str(path), len(series), "columns")

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        check_count(str(path), rows * len(names))
        columns = sorted({_column_of(name, schema.names) for name in names})
        with readable(path):
            table = pq.read_table(path, columns=columns)
            return {name: as_numbers(table, name) for name in names}

    return Table(str(path), "Parquet", series, load)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turns pyarrow's error on a damaged file into one line.  Raises RecordingError."""
    import pyarrow as pa

    try:
        yield
    except (pa.ArrowException, OSError, ValueError) as error:
        raise RecordingError(
            f"{path}: cannot be read as Parquet: {reason(error)}; is it damaged, or cut off?"
        ) from error


def as_numbers(table: Any, name: str) -> NDArray[Any]:
    """A column of a pyarrow table, or a place in one of lists; null becomes NaN, times stay times."""
    import pyarrow as pa
    import pyarrow.compute as pc

    column = table.column(_column_of(name, table.column_names))
    if _is_list(column.type):
        place = 0 if name in table.column_names else int(name[name.rindex("[") + 1 : -1])
        column = pc.list_element(column, place)
    if pa.types.is_timestamp(column.type):
        return np.asarray(column.cast(pa.timestamp("ns")).to_numpy())
    if pa.types.is_duration(column.type):
        return np.asarray(column.cast(pa.int64()).to_numpy(), dtype=float) * _tick(column.type.unit)
    if pa.types.is_integer(column.type) and column.null_count == 0:
        return np.asarray(column.to_numpy())
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=float)


def _tick(unit: str) -> float:
    return {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]


def _column_of(name: str, columns: Sequence[str]) -> str:
    return name if name in columns else name[: name.rindex("[")]


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
    return is_list and _is_number(kind.value_type)


def _is_number(kind: Any) -> bool:
    import pyarrow as pa

    types = pa.types
    return bool(
        types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind) or types.is_timestamp(kind)
        or types.is_duration(kind)
    )  # fmt: skip


def _length(file: Any, field: Any) -> int:
    """How many entries the lists of a column have, from the first row."""
    import pyarrow as pa

    if pa.types.is_fixed_size_list(field.type):
        return min(int(field.type.list_size), MOST_IN_LIST)
    first = next(file.iter_batches(batch_size=1, columns=[field.name]), None)
    value = first.column(0)[0].as_py() if first is not None and first.num_rows else None
    return min(len(value or ()), MOST_IN_LIST)
