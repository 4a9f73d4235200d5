"""The options for a file of another program: ``--map`` and what may stand behind a ``#``.  Text in, Choice out.

position=/joint_states.position[elbow]       the series of that name
position=angle:deg                           in that unit, whatever its name
position=raw*0.00153398-3.14159              times a number, and a number added
position=raw*25.4:mm                         which makes this unit of it
position=motor - output:deg                  the difference of two series of a table
torque=                                      this column is left out
time=log                                     (MCAP, rosbag2) when a message was received, not the stamp of its header
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import Choice, Term
from lostmotion.drivers.units import COLUMN_UNITS, to_si

__all__ = ["NUMBER", "PLUS", "parse_map", "parse_term", "parts_of", "split_address"]

PLUS = "+"
"""between the files of one recording"""
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
SCALED = re.compile(rf"(?P<name>.+?)\s*\*\s*(?P<factor>{NUMBER})\s*(?P<offset>[+-]\s*{NUMBER})?")
KEYS = ("joint", "topic", "episode", "rate_hz")
SPELT = {"rate-hz": "rate_hz", "rate": "rate_hz"}


def parse_map(texts: Iterable[str]) -> dict[str, Term]:
    """The terms of ``COLUMN=SERIES[:UNIT]`` and ``COLUMN=SERIES*FACTOR[+OFFSET]`` texts.  Raises RecordingError."""
    terms: dict[str, Term] = {}
    for text in texts:
        column, equals, term = text.partition("=")
        column = column.strip()
        if not equals or column not in COLUMN_UNITS:
            raise RecordingError(
                f"--map: found {text!r}, expected COLUMN=SERIES[:UNIT] with a column of {', '.join(COLUMN_UNITS)}"
            )
        if column in terms:
            raise RecordingError(f"--map: found {column!r} twice, expected it once")
        terms[column] = parse_term(term.strip())
    return terms


def parse_term(text: str) -> Term:
    """A series, with its unit or what is done to its numbers.  Raises RecordingError."""
    name, colon, unit = text.rpartition(":")
    if colon and name and to_si(unit.strip()) is not None:
        return replace(_scaled(name.strip()), unit=unit.strip())
    if colon and name and re.fullmatch(r"[A-Za-zµ°][\w^/°µ ]*", unit.strip()):
        raise RecordingError(
            f"--map: found the unit {unit!r} in {text!r}, expected one that is known, such as deg, mm, ms, g or N m; "
            "any other as a number: SERIES*FACTOR"
        )
    return _scaled(text)


def _scaled(text: str) -> Term:
    """A series, with what is done to its numbers.  Raises RecordingError."""
    found = SCALED.fullmatch(text)
    if found is None:
        return Term(text)
    factor, offset = float(found["factor"]), float((found["offset"] or "0").replace(" ", ""))
    if not math.isfinite(factor) or factor == 0 or not math.isfinite(offset):
        raise RecordingError(f"--map: found the factor {found['factor']!r} in {text!r}, expected a number other than 0")
    return Term(found["name"], factor=factor, offset=offset)


def parts_of(path: Path) -> list[Path]:
    """The files of a recording: of ``q.csv+tau.csv`` two; [] for a path that does not name several files."""
    if PLUS not in str(path) or path.exists():
        return []
    parts = [Path(each) for each in str(path).split(PLUS)]
    return parts if all(part.is_file() for part in parts) else []


def _is_there(path: Path) -> bool:
    return path.exists() or bool(parts_of(path))


def split_address(path: Path) -> tuple[Path, Choice]:
    """``FILE#joint=elbow,episode=3,position=/x.y:deg`` → the file, and the options for it.  Raises RecordingError."""
    text = str(path)
    marks = [at for at, letter in enumerate(text) if letter == "#" and _is_there(Path(text[:at]))]
    if not marks or _is_there(path):
        return path, Choice()
    name, fragment = text[: marks[0]], text[marks[0] + 1 :]
    pairs = re.split(rf",(?=(?:{'|'.join((*KEYS, *SPELT, *COLUMN_UNITS))})=)", fragment)
    parts = [pair.partition("=") for pair in pairs]
    pairs = [f"{SPELT.get(key, key)}{equals}{value}" for key, equals, value in parts]
    known = {key: pair.removeprefix(f"{key}=") for pair in pairs for key in KEYS if pair.startswith(f"{key}=")}
    terms = parse_map(pair for pair in pairs if pair.partition("=")[0] not in KEYS)
    try:
        episode = int(known["episode"]) if "episode" in known else None
        rate_hz = float(known["rate_hz"]) if "rate_hz" in known else None
    except ValueError as error:
        raise RecordingError(f"{path}: found {fragment!r}, expected numbers for episode and rate_hz") from error
    topics = (known["topic"],) if "topic" in known else ()
    return Path(name), Choice(terms, known.get("joint", ""), topics, episode, rate_hz)
