"""MCAP, bags of ROS 1 and 2, and data logs of WPILib as series: which topics have numbers, and those of the chosen ones
over time."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.logs import RECEIPT, Channel, Log, McapLog, RosbagLog
from lostmotion.drivers.formats.messages import BEFORE, Decoder, UnreadableError, decoder_of
from lostmotion.drivers.formats.source import (
    MOST_SERIES,
    MOST_VALUES,
    Choice,
    Samples,
    Series,
    check_count,
    shown,
    too_many,
)
from lostmotion.drivers.formats.table import EPOCH_S
from lostmotion.drivers.formats.wpilog import WpilibLog

__all__ = ["Bag", "open_mcap", "open_rosbag", "open_rosbag1", "open_wpilog"]

LOOKED_AT = 50
"""messages of a topic, to learn its names"""
LATEST_NS = 4_000_000_000_000_000_000
"""in 2096: a stamp beyond is damage"""
MOST_APART_NS = 1_000_000_000
"""between the clocks of stamps: further apart they are not one clock"""
STAMPS = "stamps of the headers"
UNITS = {
    "position": "rad", "positions": "rad", "effort": "N m", "efforts": "N m", "linear_acceleration": "m/s^2"
}  # fmt: skip
"""by the field of ROS's messages (REP 103)"""


@dataclass(slots=True, eq=False)
class _Topic:
    """What is read of a topic: stamps of its headers, 0 for none, and of receipt [ns], and each series' values."""

    stamps: array[int] = field(default_factory=lambda: array("q"))
    received: array[int] = field(default_factory=lambda: array("q"))
    values: dict[str, array[float]] = field(default_factory=dict)


class Bag:
    """A ``Source``.  open_episode: reads one of its ``runs``, by its number from 0; None where it holds one."""

    def __init__(self, path: Path, log: Log) -> None:
        self.kind = log.kind
        self.name = str(path)
        self.runs = 1
        self.open_episode: Callable[[int], Bag] | None = None
        self._log = log
        self._decoders: dict[str, Decoder] = {}
        self._broken = 0
        unknown = []
        for channel in log.channels:
            decoder = decoder_of(channel.kind, channel.encoding, channel.definition)
            if decoder is None:
                unknown.append(f"{channel.topic} ({channel.encoding} {channel.kind})")
            else:
                self._decoders[channel.topic] = decoder
        self._unknown = unknown
        known = {channel.topic: channel for channel in log.channels}
        self._places: dict[str, tuple[str, str]] = {}
        """The topic and the field of each series."""
        self.series = self._look(sorted(self._decoders, key=lambda topic: _rank(known[topic].kind)), known)
        if not self.series and unknown:
            raise RecordingError(
                f"{path}: found {shown(', '.join(unknown))}, expected messages of ROS or JSON with numbers"
            )

    @property
    def notes(self) -> Sequence[str]:
        """What was left out."""
        left = f"topics that are not understood: {shown(', '.join(self._unknown))}"
        broken = f"{self._broken} messages that could not be read were left out"
        return [*self._log.notes, *([left] if self._unknown else []), *([broken] if self._broken else [])]

    def read(self, names: Sequence[str], choice: Choice) -> Samples:
        """The samples of these series.  Raises RecordingError."""
        topics = self._gather(names)
        term = choice.terms.get("time")
        if term and term.name not in ("log", "header"):
            raise RecordingError(f"{self.name}: found time={term.name}, expected log (receipt) or header")
        clock, notes, stamps = _clock(topics, term.name if term else "")
        clock = self._log.clock if clock == RECEIPT else clock
        first = min((int(each[each != 0].min()) for each in stamps.values() if each.any()), default=0)
        values: dict[str, tuple[FloatArray, FloatArray]] = {}
        for topic_name, topic in topics.items():
            order = np.argsort(stamps[topic_name], kind="stable")
            order = order[stamps[topic_name][order] != 0]
            times = np.asarray((stamps[topic_name][order] - first) * 1e-9, dtype=np.float64)
            for name, numbers in topic.values.items():
                values[name] = _sampled(times, np.array(numbers)[order])
        known = EPOCH_S[0] < first * 1e-9 < EPOCH_S[1]
        start = datetime.fromtimestamp(round(first * 1e-9, 6), UTC) if known else None
        broken = [note for note in self.notes if "could not be read" in note]
        return Samples(values, clock, start, [*notes, *broken], self._log.metadata)

    def _look(self, topics: Sequence[str], channels: dict[str, Channel]) -> list[Series]:
        """The series of each topic, from its first messages."""
        found: dict[str, dict[str, bool]] = {topic: {} for topic in topics}
        seen = dict.fromkeys(topics, 0)
        left = {channel.topic: LOOKED_AT if channel.count is None else min(LOOKED_AT, channel.count)
                for channel in self._log.channels if channel.topic in seen}  # fmt: skip
        waiting = {topic for topic, count in left.items() if count}
        for topic, _, data in self._log.messages(topics) if waiting else ():
            seen[topic] += 1
            if seen[topic] <= LOOKED_AT and (decoded := self._decoded(topic, data)):
                for field, value in decoded[1].items():
                    found[topic][field] = found[topic].get(field, False) or value != 0
            if seen[topic] >= left[topic]:
                waiting.discard(topic)
                if not waiting:
                    break
        count = sum(map(len, found.values()))
        if count > MOST_SERIES:
            raise too_many(self.name, count, "series")
        self._broken = 0
        self._places = {_joined(topic, field): (topic, field) for topic in topics for field in _measured(found[topic])}
        return [Series(name, _unit(field, channels[topic])) for name, (topic, field) in self._places.items()]

    def _gather(self, names: Sequence[str]) -> dict[str, _Topic]:
        wanted: dict[str, dict[str, str]] = {}
        for name in names:
            topic, place = self._places[name]
            wanted.setdefault(topic, {})[place] = name
        topics = {topic: _Topic(values={name: array("d") for name in of.values()}) for topic, of in wanted.items()}
        count = 0
        for topic, received, data in self._log.messages(list(wanted)):
            decoded = self._decoded(topic, data)
            if decoded is None:
                continue
            stamp, values = decoded
            if max(received, abs(stamp or 0)) > LATEST_NS:
                self._broken += 1
                continue
            into = topics[topic]
            into.received.append(received)
            into.stamps.append(stamp or 0)
            for field_name, name in wanted[topic].items():
                into.values[name].append(values.get(field_name, math.nan))
            count += 2 + len(wanted[topic])
            if count > MOST_VALUES:
                check_count(self.name, count)
        return topics

    def _decoded(self, topic: str, data: bytes) -> tuple[int | None, dict[str, float]] | None:
        try:
            return self._decoders[topic](data)
        except UnreadableError:
            self._broken += 1
            return None


def open_mcap(path: Path) -> Bag:
    """Raises RecordingError."""
    return Bag(path, McapLog(path))


def open_rosbag(path: Path) -> Bag:
    """A folder or a database.  Raises RecordingError."""
    return Bag(path, RosbagLog(path))


def open_rosbag1(path: Path) -> Bag:
    """Raises RecordingError."""
    return Bag(path, RosbagLog(path, is_ros1=True))


def open_wpilog(path: Path) -> Bag:
    """A data log; where SysId tested a mechanism each test is a run.  Raises RecordingError."""
    log = WpilibLog.of(path)
    bag = Bag(path, log)
    if log.tests:
        bag.runs = len(log.tests)
        bag.open_episode = lambda at: Bag(path, replace(log, part=log.tests[at][1:]))
        names = ", ".join(name for name, _, _ in log.tests)
        log.notes.append(f"{names} are the runs 0 to {bag.runs - 1}, as in FILE#episode=0")
    return bag


def _measured(fields: dict[str, bool]) -> list[str]:
    """The fields without those axes of an accelerometer that are exactly 0 while another is not, so that there is no
    sensor; fields: whether each was anything but 0."""
    axes = [field for field in fields if field.startswith("linear_acceleration.")]
    absent = {field for field in axes if not fields[field]} if any(fields[field] for field in axes) else set()
    return [field for field in fields if field not in absent]


def _clock(topics: dict[str, _Topic], clock: str) -> tuple[str, list[str], dict[str, NDArray[np.int64]]]:
    """The clock that is used, what is odd about it, and the times [ns] of each topic's messages, 0 for none.

    A topic that mostly has no stamps takes part by the delay of the others.
    """
    received = {name: np.array(topic.received, dtype=np.int64) for name, topic in topics.items()}
    stamps = {name: np.array(topic.stamps, dtype=np.int64) for name, topic in topics.items()}
    stamps = {name: each for name, each in stamps.items() if 2 * np.count_nonzero(each) > each.size}
    ahead = {name: float(np.median((each - received[name])[each != 0])) for name, each in stamps.items()}
    apart = max(ahead.values()) - min(ahead.values()) if ahead else 0.0
    if clock == "log" or not ahead:
        return RECEIPT, [], received
    if apart > MOST_APART_NS and not clock:
        return RECEIPT, [f"the stamps of {shown(', '.join(ahead))} are of clocks {apart * 1e-9:.3g} s apart"], received
    shift = round(float(np.median(list(ahead.values()))))
    bare = [name for name in topics if name not in stamps]
    notes = (
        [f"{shown(', '.join(bare))} without stamps: times of receipt, {shift * 1e-6:+.3g} ms as the other topics"]
        if bare
        else []
    )
    lost = sum(int(np.count_nonzero(each == 0)) for each in stamps.values())
    notes += [f"{lost} messages without a stamp among those that have one were left out"] if lost else []
    return STAMPS, notes, {name: stamps.get(name, received[name] + shift) for name in topics}


def _sampled(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    there: NDArray[np.bool_] = ~np.isnan(values)
    return (times, values) if there.all() else (times[there], values[there])


def _rank(kind: str) -> int:
    return BEFORE.index(kind) if kind in BEFORE else len(BEFORE)


def _joined(topic: str, field: str) -> str:
    """The name of a series."""
    return f"{topic}.{field}" if field and not field.startswith("[") else topic + field


def _unit(field_name: str, channel: Channel) -> str:
    if channel.unit or channel.kind not in BEFORE:
        return channel.unit
    words = field_name.partition("[")[0].split(".")
    return next((UNITS[word] for word in words if word in UNITS), "")
