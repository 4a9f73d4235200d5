"""Several recordings of one question: parts of one, or files in which the same columns mean the same."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.choice import PLUS, parse_map, split_address
from lostmotion.drivers.formats.registry import Opener, is_foreign, open_source
from lostmotion.drivers.formats.runs import STILL, runs_in
from lostmotion.drivers.formats.swinging import power
from lostmotion.drivers.formats.words import UNNAMED, column_of
from lostmotion.drivers.recording import Recording, read_recording

__all__ = ["read_recordings"]

log = logging.getLogger(__name__)

MOST_RUNS = 30
"""of a file that are read: 30 runs of a driven disk, of 300 rows each, were read and explained in 53 s, within the
usual budget of a search"""
SHORT = 0.1
"""Share of the rows of the longest run, below which another one is left out: 0.18 and more of 56 runs in six public
files, 0.02 of the rows of zeros behind a motor's."""
MOVING = ("position", "displacement", "accel")

Read = Callable[[str | Path, Sequence[str]], Recording]
"""reads a file with ``--map``"""


def read_recordings(
    paths: Sequence[str | Path], joint: str = "", terms: Sequence[str] = (), *, base: str = ""
) -> list[Recording]:
    """Reads several; what is the same of them is said once.  Files that have nothing in common but their number of
    rows, as angles in one and torques in another, are one recording.  A column without a name that is the position in
    most files is so in all of them, and an angle that is in degrees in one is so in all, but for a base that
    moves along a line; see ``read_recording``.  A file of several runs, of which none was chosen, is as many
    recordings.  Raises RecordingError."""
    opened: Opener = lru_cache(maxsize=1)(open_source)  # runs of one file stand one after another
    read: Read = partial(_read, joint, set(), base, opened)
    given, tried = paths, [one for path in paths for one in _tried(_runs(path, joint, terms, opened), terms, read)]
    paths, found = [path for path, _ in tried], [one for _, one in tried]
    recordings = [one for one in found if isinstance(one, Recording)]
    whole = partial(_read, joint, set(), base, opened, PLUS.join(map(str, given)), terms)
    if len(recordings) < len(paths) == len(given) > 1:
        try:
            return [whole()]
        except RecordingError:
            quantities = {column_of(Path(path).stem) for path in paths} - {None}
            if not recordings and len(quantities) == len(paths):
                raise  # a file each of the positions and the torques of several joints
    elif len(paths) == len(given) and _are_parts(recordings):
        return [whole()]
    for at, term in enumerate(_agreed(found, base == "oscillator")):
        if term:
            with suppress(RecordingError):
                found[at] = read(paths[at], [*terms, term])
                log.warning("%s: read with --map %s, as the other files are", paths[at], term)
    for one in found:
        if isinstance(one, RecordingError):
            raise one
    return [one for one in found if isinstance(one, Recording)]


def _runs(path: str | Path, joint: str, terms: Sequence[str], opened: Opener) -> list[str | Path]:
    """The address of each run in a file, of very many ``MOST_RUNS`` from the first to the last, as runs of one kind
    stand together; of one run, and of a file that cannot be read, the path."""
    file, choice = split_address(Path(path))
    if not is_foreign(file):
        return [path]
    choice = replace(choice, joint=choice.joint or joint, terms={**parse_map(terms), **choice.terms})
    count = 1
    with suppress(RecordingError):
        count = runs_in(opened(file), choice)
    if count == 1:
        return [path]
    used = np.linspace(0, count - 1, min(count, MOST_RUNS)).astype(int).tolist()
    said = "each is a recording" if len(used) == count else f"{len(used)} of them are used, each as a recording"
    log.warning("%s: found %d runs: %s; for one of them FILE#episode=0", path, count, said)
    return [f"{path}{',' if Path(path) != file else '#'}episode={at}" for at in used]


def _tried(
    runs: Sequence[str | Path], terms: Sequence[str], read: Read
) -> list[tuple[str | Path, Recording | RecordingError]]:
    """The runs of a file and what was read of them, without those of several that cannot be read, have few rows or
    hardly move beside the others, if one is left; a warning names them."""
    found: list[Recording | RecordingError] = []
    for path in runs:
        try:
            found.append(read(path, terms))
        except RecordingError as error:
            found.append(error)
    recordings = [one for one in found if isinstance(one, Recording)]
    if len(runs) < 2 or not recordings:
        return list(zip(runs, found, strict=True))
    rows, moved = max(one.time.size for one in recordings), max(map(_power, recordings))
    used = [
        isinstance(one, Recording) and one.time.size >= SHORT * rows and _power(one) >= STILL**2 * moved
        for one in found
    ]
    if not any(used):
        return list(zip(runs, found, strict=True))
    if left := [str(path) for path, is_used in zip(runs, used, strict=True) if not is_used]:
        log.warning("left out, as they are short, at rest or unreadable beside other runs: %s", ", ".join(left))
    return [one for one, is_used in zip(zip(runs, found, strict=True), used, strict=True) if is_used]


def _power(recording: Recording) -> float:
    """The variance of the motion; 1 where there is none."""
    moved = (power(recording.columns[name]) for name in MOVING if name in recording.columns)
    return next(moved, 1.0)


def _read(joint: str, told: set[str], base: str, opened: Opener, path: str | Path, terms: Sequence[str]) -> Recording:
    return read_recording(path, joint, terms, told, base=base, opened=opened)


def _are_parts(recordings: Sequence[Recording]) -> bool:
    """Whether no column is in two of these recordings, and all have as many rows."""
    columns = [name for one in recordings for name in one.columns]
    return len(recordings) > 1 and len(columns) == len({*columns}) and len({one.time.size for one in recordings}) == 1


def _agreed(found: Sequence[Recording | RecordingError], is_linear: bool) -> list[str]:
    """What to map in each file to read it as the others are; "" for nothing."""
    read = [_position(one) for one in found]
    common = Counter(each for each, _ in read if UNNAMED.fullmatch(each)).most_common(1)
    assumed = {each: unit for each, unit in read if unit and not is_linear}
    terms = []
    for one, (own, unit) in zip(found, read, strict=True):
        is_open = isinstance(one, RecordingError) or UNNAMED.fullmatch(own)
        series = common[0][0] if common and is_open else own
        wanted = assumed.get(series, unit)
        terms.append(f"position={series}{':' * bool(wanted)}{wanted}" if (series, wanted) != (own, unit) else "")
    return terms


def _position(one: Recording | RecordingError) -> tuple[str, str]:
    """The series that is the position of a file of another program, and the unit in which it was assumed to be; ""
    where it was given, or there is none."""
    imported = one.metadata.get("imported", {}) if isinstance(one, Recording) else {}
    return ("", "") if imported.get("position_given") else (
        imported.get("position", ""), imported.get("position_assumed", "")
    )  # fmt: skip
