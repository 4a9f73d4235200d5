"""The folder of recordings: what is taken into it, and what is not."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from lostmotion.web import recordings
from lostmotion.web.recordings import Kept, RecordingRefusedError, Shelf

TINY = b"time,command,position\n0,0,0\n0.01,0.1,0.1\n"


def take(shelf: Shelf, wanted: str, length: int | None, chunks: AsyncIterator[bytes]) -> Kept:
    """Receives and keeps."""
    return shelf.keep(asyncio.run(shelf.receive(length, chunks)), wanted)


async def pieces(*parts: bytes) -> AsyncIterator[bytes]:
    """What a browser sends, as it comes."""
    for part in parts:
        yield part


def test_two_of_one_name_are_kept(tmp_path: Path) -> None:
    """The second gets another name; comments before the header are no header."""
    shelf = Shelf(tmp_path, 50_000)
    first = take(shelf, "x.csv", None, pieces(TINY[:9], TINY[9:]))
    second = take(shelf, "x.csv", len(TINY) + 14, pieces(b'# joint = "a"\n', TINY))
    assert [first.name, second.name] == ["x.csv", "x-2.csv"]
    assert second.columns == ("command", "position")
    assert second.size == len(TINY) + 14


def test_a_recording_without_an_end_is_refused(tmp_path: Path) -> None:
    """What does not say how large it is is counted as it comes; nothing is left of it."""

    async def endless() -> AsyncIterator[bytes]:
        yield TINY
        while True:
            yield b"0.03,0.1,0.1\n" * 100

    shelf = Shelf(tmp_path, 50_000)
    with pytest.raises(RecordingRefusedError, match=r"more than 0\.05 MB"):
        take(shelf, "x.csv", None, endless())
    assert list(tmp_path.iterdir()) == []


def test_a_full_folder_takes_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By number, by size and by what is free on the disk; all are said in words."""
    shelf = Shelf(tmp_path, 100)
    for _ in range(3):
        take(shelf, "x.csv", None, pieces(TINY))
    monkeypatch.setattr(recordings, "TIMES_LARGEST", 1)
    with pytest.raises(RecordingRefusedError, match="found 3 recordings already"):
        take(shelf, "x.csv", None, pieces(TINY))
    monkeypatch.setattr(recordings, "TIMES_LARGEST", 100)
    monkeypatch.setattr(recordings, "MOST_FILES", 3)
    with pytest.raises(RecordingRefusedError, match="remove some of them"):
        take(shelf, "x.csv", None, pieces(TINY))
    monkeypatch.setattr(recordings, "MOST_FILES", 30)
    monkeypatch.setattr(recordings, "LEAST_FREE", 10**18)
    with pytest.raises(RecordingRefusedError, match="nearly full"):
        take(shelf, "x.csv", None, pieces(TINY))
