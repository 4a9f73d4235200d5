"""Data logs of WPILib, the library of FIRST's robots: entries of numbers by name, and the tests of SysId among them.

Source: wpilibsuite/allwpilib, wpiutil/doc/datalog.adoc, version 1.0: a header, then records of an entry's number, a
time [µs] and bytes in little endian; those of entry 0 start an entry with its name, type and metadata, or finish it.
Bytes out.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.logs import Channel, Message
from lostmotion.drivers.formats.source import MOST_SERIES, check_count, too_many
from lostmotion.drivers.formats.vectors import check_size

__all__ = ["ENCODING", "WpilibLog", "decoder_of_entry", "unit_of_entry"]

ENCODING = "wpilog"
HEADER = Struct("<6sHI")
"""magic, version, length of the extra header"""
START, FINISH = 0, 1
"""kinds of control records"""
NUMBERS = {"double": "<f8", "float": "<f4", "int64": "<i8"}
STATES = {f"{kind}-{way}" for kind in ("quasistatic", "dynamic") for way in ("forward", "reverse")}
"""of a test of SysId, an entry of text whose name says ``state``; between tests it is ``none``"""
UNITS = {
    "volt": "V", "amp": "A", "ampere": "A", "rotation": "rev", "radian": "rad", "degree": "deg", "meter": "m",
    "second": "s",
}  # fmt: skip
"""by their names in WPILib, in the singular"""
LEAST_NS = 200_000_000
"""Duration of a test: shorter ones were interrupted."""
FOREVER = 1 << 62
"""[ns]: later than all times"""


def decoder_of_entry(kind: str) -> Callable[[bytes], dict[str, float]] | None:
    """What decodes the content of an entry of this type, None for one that holds no numbers.  Raises ValueError."""
    single = kind.removesuffix("[]")
    if single not in NUMBERS:
        return None
    if single == kind:
        return lambda data: {"": float(np.frombuffer(data, NUMBERS[single], 1)[0])}
    return lambda data: {f"[{i}]": float(each) for i, each in enumerate(np.frombuffer(data, NUMBERS[single]))}


def unit_of_entry(metadata: str) -> str:
    """The unit that an entry's metadata are, such as ``Rotation per Second``; "" for others."""
    known = [UNITS.get(word.strip().lower().removesuffix("s"), "") for word in metadata.split(" per ")]
    return "/".join(known) if all(known) else ""


@dataclass
class _Entry:
    """An entry, and its records: their times [µs], and where their content begins and ends in the file."""

    kind: str
    metadata: str
    times: array[int] = field(default_factory=lambda: array("q"))
    begins: array[int] = field(default_factory=lambda: array("q"))
    ends: array[int] = field(default_factory=lambda: array("q"))


@dataclass
class WpilibLog:
    """An open file; see ``logs.Log``.  tests: of SysId, their names, and when each began and ended [ns]; part: of the
    time that is read [ns]."""

    name: str
    data: bytes
    entries: dict[str, _Entry] = field(default_factory=dict)
    channels: list[Channel] = field(default_factory=list)
    kind: str = "WPILib data log"
    clock: str = "the times of the log"
    notes: list[str] = field(default_factory=list)
    metadata: dict[str, Any] = field(default_factory=dict)
    tests: Sequence[tuple[str, int, int]] = ()
    part: tuple[int, int] = (0, FOREVER)

    @classmethod
    def of(cls, path: Path) -> WpilibLog:
        """Raises RecordingError."""
        check_size(str(path), path.stat().st_size)
        log = cls(str(path), path.read_bytes())
        log._read()
        log.channels = [
            Channel(name, one.kind, ENCODING, "", len(one.times), unit_of_entry(one.metadata))
            for name, one in log.entries.items()
            if decoder_of_entry(one.kind)
        ]
        states = [one for name, entry in log.entries.items() for one in log._states(name, entry)]
        log.tests = _tests(states)
        return log

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Those of the topics in the part of the time, one topic after the other."""
        first, last = self.part
        for topic in topics:
            entry = self.entries[topic]
            for at, begin, end in zip(entry.times, entry.begins, entry.ends, strict=True):
                if first <= at * 1000 <= last:
                    yield topic, at * 1000, self.data[begin:end]

    def _states(self, name: str, entry: _Entry) -> list[tuple[int, str]]:
        """When [ns] an entry of text that may be the state of a test was written, and what."""
        if entry.kind != "string" or "state" not in name.lower():
            return []
        places = zip(entry.times, entry.begins, entry.ends, strict=True)
        return [(at * 1000, self.data[begin:end].decode(errors="replace")) for at, begin, end in places]

    def _read(self) -> None:
        """Finds all records, up to where the file ends or is damaged, which is noted.  Raises RecordingError."""
        data, by_id, count = self.data, dict[int, _Entry](), 0
        if len(data) < HEADER.size or HEADER.unpack_from(data)[1] >> 8 != 1:
            raise RecordingError(f"{self.name}: found another version of WPILib's data log, expected 1.0")
        at = HEADER.size + HEADER.unpack_from(data)[2]
        while at < len(data):
            lengths = data[at]
            number, at = _whole(data, at + 1, (lengths & 3) + 1)
            size, at = _whole(data, at, (lengths >> 2 & 3) + 1)
            time, at = _whole(data, at, (lengths >> 4 & 7) + 1)
            begin, at = at, at + size
            if at > len(data) or (number == 0 and not self._control(data[begin:at], by_id)):
                self.notes.append(
                    "the file has no end, as after a loss of power, or is damaged; what comes before was read"
                )
                break
            if (entry := by_id.get(number)) and time < FOREVER // 1000:
                entry.times.append(time)
                entry.begins.append(begin)
                entry.ends.append(at)
                count += 1
        check_count(self.name, count)

    def _control(self, held: bytes, by_id: dict[int, _Entry]) -> bool:
        """Learns from a control record; False for one that is none.  Raises RecordingError for very many entries."""
        if len(held) < 5:
            return False
        number = int.from_bytes(held[1:5], "little")
        if held[0] == FINISH:
            by_id.pop(number, None)
        if held[0] != START:
            return True
        texts, at = [], 5
        for _ in range(3):
            size, at = _whole(held, at, 4)
            texts.append(held[at : at + size].decode(errors="replace"))
            at += size
        if at > len(held):
            return False
        name, kind, metadata = texts
        if name not in self.entries or self.entries[name].kind != kind:  # one may be started anew
            self.entries[name] = _Entry(kind, metadata)
        by_id[number] = self.entries[name]
        if len(self.entries) > MOST_SERIES:
            raise too_many(self.name, len(self.entries), "entries")
        return True


def _whole(data: bytes, at: int, size: int) -> tuple[int, int]:
    """A whole number of so many bytes, and where the next begins."""
    return int.from_bytes(data[at : at + size], "little"), at + size


def _tests(states: Sequence[tuple[int, str]]) -> list[tuple[str, int, int]]:
    """The tests of SysId: their names, and when each began and ended [ns].  The state is logged in every period, or
    when it changes, and is ``none`` after the test."""
    found = list[tuple[str, int, int]]()
    now, begun, last = "", 0, 0
    for at, state in [*sorted(states), (FOREVER, "none")]:
        if state != now:
            end = at if state == "none" and at < FOREVER else last
            if now in STATES and end - begun >= LEAST_NS:
                found.append((now, begun, end))
            now, begun = state, at
        last = at
    return found
