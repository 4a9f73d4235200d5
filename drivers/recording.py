"""A recording: what was measured or simulated, as columns over time, and its CSV file.

docs/recordings.md describes the format; codec/recording_csv.py parses its text, formats/ files of other programs.  Only
whole files are handled here: recorder.py writes rows as they arrive, replay.py plays a file back.
"""

from __future__ import annotations

import csv
import io
import logging
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.codec import recording_csv
from lostmotion.drivers.errors import RecordingError, unreadable, unwritable
from lostmotion.drivers.formats.choice import parse_map, split_address
from lostmotion.drivers.formats.registry import Opener, is_foreign, open_source
from lostmotion.drivers.pacing import as_utc
from lostmotion.drivers.pipes import STANDARD, to_output
from lostmotion.drivers.ticks import evened
from lostmotion.drivers.units import COLUMN_UNITS, to_si

__all__ = [
    "Recording",
    "merge",
    "read_recording",
    "replaced",
    "replacing",
    "write_recording",
]

log = logging.getLogger(__name__)

LARGEST = 1e12
"""of a number in the metadata, in any unit"""
LATEST_S = 1e12
"""beyond it a time is not accurate to a tenth of a millisecond; seconds since 1970 are 2e9"""
SHORTEST_S = 1e-9
"""between rows, as a rule; sensors of bars take some 1e-3"""


class _Columns(dict[str, FloatArray]):
    """Columns by name, whose KeyError names those that there are."""

    def __missing__(self, name: str) -> FloatArray:
        raise KeyError(f"no column {name!r}; there are {', '.join(self) or 'none'}")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Columns over time, in SI units.

    time: seconds from an arbitrary origin, shape (N,), never descending, N >= 1; columns: those of the format that
    are there, each of shape (N,), NaN where a cell is empty; metadata: the ``# key = value`` lines; extra: columns
    that the format does not know, as text; truncated: 1 when the file's last line was cut off and left out, else 0.
    """

    time: FloatArray
    columns: Mapping[str, FloatArray]
    metadata: Mapping[str, Any] = field(default_factory=dict)
    extra: Mapping[str, Sequence[str]] = field(default_factory=dict)
    truncated: int = 0
    name: str = "recording"

    def __post_init__(self) -> None:
        object.__setattr__(self, "columns", _Columns(self.columns))

    def __getitem__(self, column: str) -> FloatArray:
        """The values of a column (N,), NaN where a cell is empty; ``time`` is one, too.

        Raises KeyError, which names the columns that there are, for another one.
        """
        return self.time if column == "time" else self.columns[column]

    def __repr__(self) -> str:
        """Its length and columns, without the numbers."""
        what = f"{self.time.size} rows over {self.duration:.4g} s of {', '.join(self.columns) or 'no known columns'}"
        return f"<Recording {self.name!r}: {what}>"

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def start(self) -> datetime | None:
        """UTC of the first row, None where the metadata lack it.  Raises RecordingError for what is no time."""
        start = self.metadata.get("start")
        try:
            return (
                None
                if start is None
                else as_utc(start if isinstance(start, datetime) else datetime.fromisoformat(start))
            )
        except (TypeError, ValueError) as error:
            raise RecordingError(
                f"{self.name}: found start = {start!r}, expected a UTC time such as 2026-01-31T12:00:00Z"
            ) from error

    def signal(self, column: str) -> tuple[FloatArray, FloatArray]:
        """Times [s] and values of one column where it was sampled, shape (M,) each, M >= 1; times that were rounded to
        coarse ticks are evened (``ticks.py``).

        Raises RecordingError when the recording has no such column, or nothing in it.
        """
        values = self.columns.get(column, np.empty(0))
        sampled = ~np.isnan(values)
        if not sampled.any():
            there = ", ".join(name for name, other in self.columns.items() if not np.isnan(other).all()) or "none"
            raise RecordingError(
                f"{self.name}: found samples of {there}, expected {column!r}; this signal was not recorded"
            )
        return self.times(sampled), values[sampled]

    def times(self, rows: NDArray[np.bool_]) -> FloatArray:
        """Times [s] of these rows (M,), evened where they were rounded to coarse ticks."""
        return evened(self.time[rows], lambda: (values[rows] for values in self.columns.values()))

    def number(self, key: str, default: float) -> float:
        """A number of the metadata, 0 or more, or else the default.  Raises RecordingError for anything else."""
        if key not in self.metadata:
            return default
        value = self.metadata[key]
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= LARGEST:
            raise RecordingError(f"{self.name}: # {key}: found {value!r}, expected a number from 0 to {LARGEST:g}")
        return float(value)

    def unit(self, column: str) -> str:
        """The unit in which a column stands here: that of the format unless the metadata name another one."""
        return str(self.metadata.get(f"{column}_unit", COLUMN_UNITS[column]))

    @property
    def foreign_units(self) -> dict[str, str]:
        """Columns that are not in the format's unit (a force in "V", a command in "m"), and their unit."""
        return {name: self.unit(name) for name in self.columns if self.unit(name) != COLUMN_UNITS[name]}


def read_recording(
    path: str | Path,
    joint: str = "",
    terms: Sequence[str] = (),
    told: set[str] | None = None,
    *,
    base: str = "",
    opened: Opener = open_source,
) -> Recording:
    """Reads a recording and converts the units that its metadata name to SI.

    A file of another program is read as well (``formats/``); what was taken for what is logged as a warning, and
    ``FILE#joint=elbow,position=SERIES:deg`` sets it.  joint: which one of such a file is meant, if it has one of that
    name; terms: ``position=SERIES:deg`` for columns that the address does not have; told: what was said of other files,
    and is not repeated; base: of the lab's models, for which it is read; opened: what opens such a file.  A last line
    that was cut off (a recorder was killed) is left out and counted in ``truncated``.  Raises RecordingError, one line:
    the file, the line, what was found and expected, and the likely cause.
    """
    path, choice = split_address(Path(path))
    choice = replace(choice, terms={**parse_map(terms), **choice.terms})
    if not choice and not is_foreign(path):
        recording = _read_own(path)
        _warn_of_units(recording)
    else:
        from lostmotion.drivers.formats.read import imported

        found = imported(path, replace(choice, hint=joint, base=base), opened)
        known = set() if told is None else told
        head, *lines = found.lines()
        new = [line for line in lines if _key(line) not in known]
        if new or told is None:
            log.warning("%s", "\n".join([head, *new]))
        known.update(map(_key, new))
        recording = found.recording
    _check_scale(recording)
    return recording


def _key(line: str) -> str:
    """What makes a line about a file, or a run, different from that about another one: not the number of the run, and
    of an assumed unit no numbers."""
    line = re.sub(r"\bRun #\d+", "", line)
    return re.sub(r"\d[\d.e+-]*", "", line) if "no unit is given, and" in line else line


def _warn_of_units(recording: Recording) -> None:
    """The command, or a speed that the format does not know, may contradict the position."""
    if not recording.extra and "command" not in recording.columns:
        return
    from lostmotion.drivers.formats.consistency import own_doubts

    for warning in own_doubts(recording.time, recording.columns, recording.extra):
        log.warning("%s: %s", recording.name, warning)


def _read_own(path: Path) -> Recording:
    """A file in lostmotion's own format.  Raises RecordingError."""
    try:
        with path.open("rb") as file:
            ends_in_newline = _ends_in_newline(file)
            text = io.TextIOWrapper(file, encoding="utf-8-sig", newline="")
            lines = recording_csv.text_lines(text, str(path))
            table = recording_csv.parse(lines, str(path), ends_in_newline=ends_in_newline)
    except UnicodeDecodeError as error:
        raise RecordingError(
            f"{path}: found the byte 0x{error.object[error.start]:02x}, expected UTF-8 text; is it a binary file?"
        ) from error
    except OSError as error:
        raise RecordingError(unreadable(path, error)) from error
    times = table.columns.pop("time")
    if len(times) == 0:
        raise RecordingError(
            f"{path}: found a header and no rows, expected samples; was the recording stopped at once?"
        )
    _check_times(times, str(path), table.first_line)
    return _in_si(Recording(times, table.columns, table.metadata, table.extra, int(table.truncated), str(path)))


def _check_scale(recording: Recording) -> None:
    """Refuses times that are most probably in another unit.  Raises RecordingError."""
    latest = recording.time[np.argmax(np.abs(recording.time))]
    if abs(latest) > LATEST_S:
        raise RecordingError(
            f"{recording.name}: found the time {latest:g} s, expected at most {LATEST_S:g} s; if the times are in "
            'nanoseconds, write # time_unit = "ns" at the top'
        )
    steps = np.diff(recording.time)
    if steps.any() and (step := np.median(steps[steps > 0])) < SHORTEST_S:
        raise RecordingError(
            f"{recording.name}: found times that are {step:g} s apart, expected at least {SHORTEST_S:g} s; is their "
            "unit right?"
        )


def _ends_in_newline(file: BinaryIO) -> bool:
    """Whether the last line is complete (a pipe's is taken to be); leaves the file at its start."""
    if not file.seekable() or file.seek(0, os.SEEK_END) == 0:
        return True
    file.seek(-1, os.SEEK_END)
    last = file.read(1)
    file.seek(0)
    return last in b"\r\n"


def _check_times(times: FloatArray, name: str, first_line: int) -> None:
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise RecordingError(
            f"{name}: line {first_line + bad[0]}: found the time {times[bad[0]]}, expected seconds; is the cell empty?"
        )
    back = np.flatnonzero(np.diff(times) < 0)
    if back.size:
        index = int(back[0]) + 1
        raise RecordingError(
            f"{name}: line {first_line + index}: found the time {times[index]} after {times[index - 1]}, "
            "expected rows in time order; were two recordings joined, or did a clock step?"
        )


def _in_si(recording: Recording) -> Recording:
    """The recording with every known unit of its metadata converted to SI; others are left as they are."""
    metadata = dict(recording.metadata)
    columns = {"time": recording.time, **recording.columns}
    for column in columns:
        known = to_si(str(metadata.get(f"{column}_unit")))
        if known is not None:
            metadata[f"{column}_unit"], factor = known
            columns[column] = columns[column] * factor
    times = columns.pop("time")
    return Recording(times, columns, metadata, recording.extra, recording.truncated, recording.name)


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes a recording; a file of that name is replaced, at once and only when all is written.

    What is written reads back the same, bit by bit.  Raises RecordingError when the file cannot be written.
    """
    header = ["time", *recording.columns, *recording.extra]
    numbers = [recording.time, *recording.columns.values()]
    with replacing(path) as file:
        file.write(recording_csv.head_text(recording.metadata))
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        for start in range(0, len(recording.time), recording_csv.ROWS_AT_ONCE):
            part = slice(start, start + recording_csv.ROWS_AT_ONCE)
            texts = [column[part] for column in recording.extra.values()]
            writer.writerows(zip(*(recording_csv.cells(values[part]) for values in numbers), *texts, strict=True))


@contextmanager
def replacing(path: str | Path) -> Iterator[TextIO]:
    """A text file that takes the place of ``path``, for ``-`` that goes to standard output, when the block ends without
    an error; else nothing changes.

    Raises RecordingError when it cannot be written.
    """
    with replaced(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        yield file


@contextmanager
def replaced(path: str | Path) -> Iterator[Path]:
    """The same for what writes a file by its path."""
    if Path(path) == STANDARD:
        with to_output() as target:
            yield target
        return
    is_device = Path(path).exists() and not Path(path).is_file()  # /dev/stdout, a pipe: nothing there to replace
    path = Path(path) if is_device else Path(path).resolve()
    target = path if is_device else path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            yield target
            if not is_device:
                target.replace(path)
        finally:
            if not is_device:
                target.unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(unwritable(path, error)) from error


def merge(*sources: tuple[FloatArray, Mapping[str, FloatArray]]) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Joins sources that were sampled at instants of their own into rows in time order.

    Each source is its times [s], shape (M,), in order, and its columns, shape (M,) each.  Samples of several sources at
    exactly the same time share a row; a source's own samples never do.  Returns times, shape (N,), and all columns,
    shape (N,) each, NaN where a source has no sample.
    """
    times = np.concatenate([source_times for source_times, _ in sources])
    nth = np.concatenate([np.arange(len(t)) - np.searchsorted(t, t, "left") for t, _ in sources])
    order = np.lexsort((nth, times))
    starts = np.ones(len(times), dtype=bool)
    starts[1:] = (np.diff(times[order]) != 0) | (np.diff(nth[order]) != 0)
    row = np.empty(len(times), dtype=np.intp)
    row[order] = np.cumsum(starts) - 1
    columns: dict[str, FloatArray] = {}
    end = 0
    for source_times, source_columns in sources:
        begin, end = end, end + len(source_times)
        for name, values in source_columns.items():
            column = columns.setdefault(name, np.full(int(starts.sum()), np.nan))
            column[row[begin:end]] = values
    return times[order][starts], columns
