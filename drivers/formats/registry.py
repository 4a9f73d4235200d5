"""Which format a file has: by how it begins, not by its name.  The openers are imported when a file needs one."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from lostmotion.drivers.errors import RecordingError, unreadable
from lostmotion.drivers.formats.choice import parts_of
from lostmotion.drivers.formats.source import Source
from lostmotion.drivers.formats.words import column_of, is_input
from lostmotion.drivers.units import COLUMN_UNITS

__all__ = ["FORMATS", "Format", "Opener", "is_foreign", "open_source"]

EXPECTED = (
    "lostmotion's CSV, PlotJuggler's or other text, a workbook, MAT, NumPy, JSON, HDF5, Parquet, MCAP, a bag of ROS, "
    "a data log of WPILib or a LeRobot dataset"
)
BOM = b"\xef\xbb\xbf"
"""with which some programs begin a text in UTF-8"""
MOST_LETTERS = 2000
"""in the name of a series: words are sought in names, in the worst case (brackets) for 3 s in one of 2000 letters, and
for half a minute in one of 8000"""
NUMBERS = re.compile(r"[\s,;|.eE+-]*\d[\d\s,;|.eE+:/-]*")
"""a row without names, which may begin with a date or a time of day"""
START = 1 << 16
"""bytes that are looked at"""
Opener = Callable[[Path], Source]
"""opens a file.  Raises RecordingError"""


@dataclass(frozen=True, slots=True)
class Format:
    """kind: for people; opener: ``module:function`` here, "" for what is not read; advice: what to do then."""

    kind: str
    begins: bytes
    opener: str = ""
    advice: str = ""


FORMATS = (
    Format("Parquet", b"PAR1", "parquet:open_parquet"),
    Format("MAT", b"MATLAB ", "matlab:open_matlab"),
    Format("HDF5", b"\x89HDF\r\n\x1a\n", "hdf5:open_hdf5"),
    Format("MCAP", b"\x89MCAP0\r\n", "bag:open_mcap"),
    Format("rosbag2", b"SQLite format 3\x00", "bag:open_rosbag"),
    Format("ROS 1 bag", b"#ROSBAG", "bag:open_rosbag1"),
    Format("WPILib data log", b"WPILOG", "bag:open_wpilog"),
    Format("workbook, ZIP or NumPy archive", b"PK\x03\x04", "workbook:open_zip"),
    Format("workbook of Excel 97", b"\xd0\xcf\x11\xe0", "workbook:open_workbook"),
    Format("NumPy array", b"\x93NUMPY", "arrays:open_numpy"),
    Format("JSON", b"{", "arrays:open_json"),
    Format("JSON", b"[", "arrays:open_json"),
    Format(
        "XML, as Tracker, Logger Pro and CASSY Lab save a project",
        b"<?xml",
        advice="export its table as text (Tracker: File, Export, Data File; Logger Pro: File, Export As, CSV)",
    ),
    Format("gzip", b"\x1f\x8b", advice="unpack it: gunzip"),
    Format("zstd", b"\x28\xb5\x2f\xfd", advice="unpack it: unzstd"),
    Format("Rerun", b"RRF", advice="it is for looking; export it from the recording it was made of"),
)


def is_foreign(path: Path) -> bool:
    """Whether a file is another program's, and not lostmotion's CSV (or a pipe, or not there)."""
    try:
        if path.is_dir() or parts_of(path):
            return True
        if not path.is_file():
            return False
        with path.open("rb") as file:
            start = file.read(START)
    except OSError:
        return False
    return _format(start, path) is not None or not _is_own(start)


def open_source(path: Path) -> Source:
    """Raises RecordingError for what no opener knows."""
    try:
        if path.is_dir():
            return _open_folder(path)
        if parts := parts_of(path):
            from lostmotion.drivers.formats.parts import joined

            return joined(str(path), parts, open_source)
        if path.exists() and not path.is_file():
            raise RecordingError(f"{path}: found a pipe or device, expected a file, which is read more than once")
        with path.open("rb") as file:
            start = file.read(START)
        if not start:
            raise RecordingError(f"{path}: found an empty file, expected {EXPECTED}")
        found = _format(start, path) or Format("text", b"", "text:open_text")
        if not found.opener:
            raise RecordingError(f"{path}: found {found.kind}, expected {EXPECTED}; {found.advice}")
        return _with_short_names(path, _opener(found.opener)(path))
    except OSError as error:
        raise RecordingError(unreadable(path, error)) from error


def _with_short_names(path: Path, source: Source) -> Source:
    """The source.  Raises RecordingError for a name of thousands of letters, in which words would be sought for
    minutes."""
    longest = max((len(series.name) for series in source.series), default=0)
    if longest > MOST_LETTERS:
        raise RecordingError(
            f"{path}: found a series with a name of {longest} characters, expected at most {MOST_LETTERS}; "
            "is it a recording?"
        )
    return source


def _open_folder(path: Path) -> Source:
    """A dataset's, or a bag's, also one without metadata.yaml, as a killed recorder leaves it."""
    if (path / "meta" / "info.json").exists():
        return _opener("lerobot:open_lerobot")(path)
    if (path / "metadata.yaml").exists():
        return _opener("bag:open_rosbag")(path)
    parts = sorted([*path.glob("*.mcap"), *path.glob("*.db3")])
    if len(parts) == 1:
        return open_source(parts[0])
    there = sorted(each.name for each in path.iterdir())[:6]
    raise RecordingError(f"{path}: found a folder with {', '.join(there) or 'nothing in it'}, expected {EXPECTED}")


def _opener(name: str) -> Opener:
    module, _, function = name.partition(":")
    opener: Opener = getattr(import_module(f"lostmotion.drivers.formats.{module}"), function)
    return opener


def _format(start: bytes, path: Path) -> Format | None:
    plain = start.removeprefix(BOM)
    for one in FORMATS:
        if plain.startswith(one.begins):
            return one
    if path.suffix == ".mat":  # version 4 begins with a number
        return Format("MAT", b"", "matlab:open_matlab")
    return None


def _is_own(start: bytes) -> bool:
    """Whether text may be lostmotion's: a header with ``time``, and a column of ours or none that looks like one.

    Numbers below ``time`` and names that nobody knows, without metadata of ours, are another program's.
    Text without any such header is left to recording.py, too, whose errors describe what is wrong, unless a header
    of another program's follows, or numbers without a header.
    """
    lines = re.split(r"\r\n|\r|\n", start.decode("utf-8-sig", errors="replace"))
    header = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    names = [cell.strip(' "') for cell in header.split(",")]
    ours = set(names) & set(COLUMN_UNITS)
    comments = [line for line in lines if line.startswith("#")]
    if "time" in ours:
        others = [name for name in names if name not in ours]
        below = "".join(lines[lines.index(header) + 1 :][:1])
        is_full = NUMBERS.fullmatch(below) and all(cell.strip() for cell in below.split(","))
        is_driven = ours & {"position", "displacement"} and any(is_input(name) for name in others)
        if not comments and is_full and ((ours == {"time"} and others) or is_driven):
            return False
        return not any((column := column_of(name)) and column not in ours for name in others)
    if header and comments and not any("=" in line for line in comments):  # names behind a #, and no metadata
        return False
    if NUMBERS.fullmatch(header):
        return False
    is_whole = len(lines) > 1 or len(start) == START  # a header of a thousand names is cut off here
    return not (is_whole and any(letter.isalpha() for letter in header))
