"""The scores of a joint as an Apache Parquet file, for pandas, DuckDB and their kin; in batches.

Needs pyarrow, which comes with ``lostmotion[parquet]`` and is imported only here.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lostmotion.daemon.commands import output
from lostmotion.daemon.migrations import ADDED
from lostmotion.daemon.reader import Bounds, Reader
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.pipes import STANDARD
from lostmotion.drivers.recording import replaced

if TYPE_CHECKING:
    from pyarrow import Schema

__all__ = ["write"]

NUMBERS = ("play", "play_low", "play_high", "excitation", "temperature")
ROW_GROUP = 50_000
"""rows that are compressed together"""


def write(reader: Reader, joint: str, bounds: Bounds, path: Path) -> None:
    """Writes a row for each score, oldest first, unknown as null; SI units, times in UTC.

    An earlier file is replaced once all is written.  Raises RecordingError.
    """
    pa, parquet = needed("pyarrow", "--parquet"), needed("pyarrow.parquet", "--parquet")
    schema, count = _schema(reader.robot(), joint), 0
    with replaced(path) as file, parquet.ParquetWriter(file, schema, compression="zstd") as writer:
        for rows in reader.batches(joint, bounds, ROW_GROUP):
            time_us, duration_us, score, level, impact, *others = zip(*rows, strict=True)
            numbers = dict(zip((*NUMBERS, "quality", *ADDED), others, strict=True))
            columns = {
                "time": time_us,
                "duration": [value / 1e6 for value in duration_us],
                "impact": [bool(value) for value in impact],
                "score": score,
                "level": level,
            } | numbers
            columns["quality"] = [value or "ok" for value in numbers["quality"]]
            writer.write_table(pa.table({name: columns[name] for name in schema.names}, schema=schema))
            count += len(rows)
    if path != STANDARD:
        output.print_lines([f"{path}: {output.counted(count, 'score')} of {joint}"])


def _schema(robot: str, joint: str) -> Schema:
    import pyarrow as pa

    kinds = {
        "time": pa.timestamp("us", tz="UTC"),
        "duration": pa.float64(),
        **dict.fromkeys(("score", "level", *NUMBERS, *ADDED), pa.float64()),
        "impact": pa.bool_(),
        "quality": pa.dictionary(pa.int8(), pa.string()),
    }
    return pa.schema(list(kinds.items()), metadata={"robot": robot, "joint": joint})
