"""Files of messages by topic: MCAP, read by ``mcap``, and bags of ROS 1 and 2, read by ``rosbags``.  Bytes out."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from struct import Struct
from typing import Any, Protocol

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.source import MOST_SERIES, reason, shown, too_many
from lostmotion.drivers.toml_text import TomlError, loads

__all__ = ["OWN", "RECEIPT", "Channel", "Log", "McapLog", "RosbagLog"]

OWN = "lostmotion"
"""the name of the metadata that ``lostmotion export`` writes"""
RECEIPT = "when messages were received"
MOST_BYTES = 1 << 29
"""of a record that is loaded at once; chunks have some 1e6"""
RECORD, MESSAGE = Struct("<BQ"), Struct("<HIQQ")
"""of MCAP: kind and length; channel, number, time of receipt and of sending"""
SCHEMA_RECORD, CHANNEL_RECORD, MESSAGE_RECORD = 3, 4, 5
Message = tuple[str, int, bytes]
"""topic, when it was received [ns], content"""


@dataclass(frozen=True, slots=True)
class Channel:
    """A topic.  kind: type of its messages; definition: the text that describes them, "" for none; count: of messages,
    where it is known; unit: of its numbers, "" where the log does not say it."""

    topic: str
    kind: str
    encoding: str
    definition: str
    count: int | None = None
    unit: str = ""


class Log(Protocol):
    """An open file.  clock: what the times of its messages are."""

    kind: str
    clock: str
    channels: list[Channel]
    notes: list[str]
    metadata: dict[str, Any]

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Those of the topics, roughly in order of time.  Raises RecordingError."""


class McapLog:
    """Read from its beginning on, chunk by chunk; so is one without its end, as a killed recorder leaves it.

    mcap's own reader of messages takes 30 µs a message and, by topic, the whole file into memory; here records within
    a chunk are distinguished by their first bytes, and only those of the topics looked into (MCAP 1.0, records).
    """

    def __init__(self, path: Path) -> None:
        self.kind, self.clock = "MCAP", RECEIPT
        self.notes: list[str] = []
        self.metadata: dict[str, Any] = {}
        self._path = path
        self._mcap = needed("mcap.stream_reader", path)
        self._found: dict[str, Channel] = {}
        counts = self._summary()
        if not counts:
            for _ in self.messages(()):
                pass
        if self.notes and not self._found:
            raise RecordingError(f"{path}: found damage before the first message, expected some; is the file whole?")
        self.channels = [replace(each, count=counts.get(each.topic)) for each in self._found.values()]

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Up to where the file ends or is damaged, which is noted.  Raises RecordingError where that is at once."""
        count, by_id, schemas = 0, dict[int, str](), dict[int, Any]()
        try:
            with self._path.open("rb") as file:
                reader = self._mcap.StreamReader(file, emit_chunks=True, record_size_limit=MOST_BYTES)
                for record in reader.records:
                    count += 1
                    kind = type(record).__name__
                    if kind == "Chunk":
                        stream, size = self._mcap.get_chunk_data_stream(record)
                        yield from self._in_chunk(stream.read(size), topics, by_id, schemas)
                    elif kind == "Message" and by_id.get(record.channel_id) in topics:
                        yield by_id[record.channel_id], record.log_time, record.data
                    elif kind in ("Channel", "Schema"):
                        self._learn(record, by_id, schemas)
                    elif kind == "Metadata" and record.name == OWN:
                        self.metadata |= _values(record.metadata)
        except RecordingError:
            raise
        except Exception as error:  # whatever damage makes of it
            if count == 0:
                raise RecordingError(
                    f"{self._path}: cannot be read as MCAP: {reason(error)}; is the file damaged?"
                ) from error
            note = "the file has no end, as after a crash of the recorder, or is damaged; what comes before was read"
            self.notes += [] if note in self.notes else [note]

    def _in_chunk(
        self, data: bytes, topics: Collection[str], by_id: dict[int, str], schemas: dict[int, Any]
    ) -> Iterator[Message]:
        at = 0
        while at + RECORD.size <= len(data):
            kind, length = RECORD.unpack_from(data, at)
            begin, at = at + RECORD.size, at + RECORD.size + length
            if kind == MESSAGE_RECORD:
                channel, _, received, _ = MESSAGE.unpack_from(data, begin)
                if by_id.get(channel) in topics:
                    yield by_id[channel], received, data[begin + MESSAGE.size : at]
            elif kind in (SCHEMA_RECORD, CHANNEL_RECORD):
                reader = self._mcap.Schema if kind == SCHEMA_RECORD else self._mcap.Channel
                self._learn(reader.read(self._mcap.ReadDataStream(BytesIO(data[begin:at]))), by_id, schemas)

    def _learn(self, record: Any, by_id: dict[int, str], schemas: dict[int, Any]) -> None:
        if type(record).__name__ == "Schema":
            schemas[record.id] = record
            return
        schema = schemas.get(record.schema_id)
        kind, text = schema.name if schema else "", ""
        if schema and schema.encoding in ("ros1msg", "ros2msg"):
            text = schema.data.decode(errors="replace")
            kind = kind if "/msg/" in kind else kind.replace("/", "/msg/")  # as ROS 1 calls it
        by_id[record.id] = record.topic
        self._found[record.topic] = Channel(record.topic, kind, record.message_encoding, text)
        if len(self._found) > MOST_SERIES:
            raise too_many(str(self._path), len(self._found), "topics")

    def _summary(self) -> dict[str, int]:
        """How many messages each topic has, by the index at the end; {} where there is none."""
        with self._path.open("rb") as file, suppress(Exception):
            reader = needed("mcap.reader", self._path).SeekingReader(file, record_size_limit=MOST_BYTES)
            summary = reader.get_summary()
            for record in summary.schemas.values():
                self._learn(record, {}, summary.schemas)
            for record in summary.channels.values():
                self._learn(record, {}, summary.schemas)
            counts = summary.statistics.channel_message_counts
            return {channel.topic: counts.get(channel.id, 0) for channel in summary.channels.values()}
        self._found.clear()
        return {}


def _values(texts: Mapping[str, str]) -> dict[str, Any]:
    """The metadata of a recording as ``to_mcap`` writes them, but for what follows from the messages."""
    found: dict[str, Any] = {}
    for key, text in texts.items():
        if key not in ("start", "imported") and not key.endswith("_unit"):
            with suppress(TomlError):
                found |= {key: loads(f"value = {text}")["value"]}
    return found


class RosbagLog:
    """A folder with metadata.yaml, or a single ``.db3``; a ``.bag`` of ROS 1 (is_ros1)."""

    def __init__(self, path: Path, is_ros1: bool = False) -> None:
        self.kind, self.clock = "ROS 1 bag" if is_ros1 else "rosbag2", RECEIPT
        self.notes: list[str] = []
        self.metadata: dict[str, Any] = {}
        self._path = path
        self._rosbags = needed("rosbags.rosbag1" if is_ros1 else "rosbags.rosbag2", path)
        try:
            with self._rosbags.Reader(path) as reader:
                found = {
                    each.topic: Channel(
                        each.topic, each.msgtype, "ros1" if is_ros1 else "cdr",
                        each.msgdef.data if each.msgdef.format.name == "MSG" else "",
                    )
                    for each in reader.connections
                }  # fmt: skip
        except Exception as error:
            raise self._damaged(error) from error
        self.channels = [*found.values()]  # in ROS 1 each publisher of a topic is a connection

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Raises RecordingError."""
        try:
            with self._rosbags.Reader(self._path) as reader:
                chosen = [each for each in reader.connections if each.topic in topics]
                for connection, received, data in reader.messages(connections=chosen) if chosen else ():
                    yield connection.topic, int(received), bytes(data)  # SQLite's columns may hold any type
        except RecordingError:
            raise
        except Exception as error:
            raise self._damaged(error) from error

    def _damaged(self, error: Exception) -> RecordingError:
        return RecordingError(
            f"{self._path}: cannot be read as {self.kind}: {shown(reason(error))}; is it damaged, or still being "
            "written?"
        )
