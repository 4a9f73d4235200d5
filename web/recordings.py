"""The recordings that the page offers: files in a folder, taken from a browser within bounds, never executed."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import AsyncIterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from lostmotion.drivers.errors import LostmotionError

__all__ = ["Kept", "RecordingRefusedError", "Shelf", "harmless"]

UNSAFE = re.compile(r"[^\w.+-]+")
LONGEST_NAME = 50
MOST_FILES = 200
TIMES_LARGEST = 16
"""all recordings together may take so many times the largest one"""
LEAST_FREE = 200 * 10**6
"""bytes that stay free on the disk: the database needs them"""
HEAD = 8192
"""bytes in which the header of a recording stands"""


def harmless(wanted: str) -> str:
    """A name from outside as a file may have it, without folders."""
    return UNSAFE.sub("_", Path(wanted.replace("\\", "/")).name).lstrip("._+-")[-LONGEST_NAME - len(".parquet") :]


class RecordingRefusedError(LostmotionError):
    """The file is not taken; status: of HTTP."""

    def __init__(self, text: str, status: int = 422) -> None:
        super().__init__(text)
        self.status = status


@dataclass(frozen=True, slots=True)
class Kept:
    """A recording: its file's name, its size [bytes], its columns without the time, when it came (since 1970) [s]."""

    name: str
    size: int
    columns: tuple[str, ...]
    modified: float


class Shelf:
    """The recordings in a folder."""

    def __init__(self, folder: Path, largest: int) -> None:
        self.folder, self.largest = folder, largest

    def all(self) -> list[Kept]:
        """All of them, newest first."""
        if not self.folder.is_dir():
            return []
        found = [_kept(path) for path in self.folder.glob("*.csv") if path.is_file() and not path.name.startswith(".")]
        return sorted((kept for kept in found if kept), key=lambda kept: -kept.modified)

    def path(self, name: str) -> Path:
        """Where a recording of the list lies.  Raises RecordingRefusedError."""
        if name not in {kept.name for kept in self.all()}:
            raise RecordingRefusedError(f"there is no recording {name[:LONGEST_NAME]!r}; has it been removed?", 404)
        return self.folder / name

    def remove(self, name: str) -> None:
        """Deletes a recording."""
        self.path(name).unlink(missing_ok=True)

    def free(self, wanted: str) -> str:
        """A name like the wanted one, safe as a file's and not taken."""
        stem = harmless(wanted).removesuffix(".csv")[:LONGEST_NAME].rstrip("._") or "recording"
        names = [f"{stem}.csv", *(f"{stem}-{number}.csv" for number in range(2, MOST_FILES + 2))]
        return next(name for name in names if not (self.folder / name).exists())

    async def receive(self, length: int | None, chunks: AsyncIterator[bytes]) -> Path:
        """What a browser sends, as a file that ``keep`` takes, or the caller removes.  length: the announced one
        [bytes].  Raises RecordingRefusedError."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._check_room(length or 0)
        part = self.folder / f".{secrets.token_hex(8)}.part"
        size = 0
        try:
            with part.open("xb") as file:
                async for chunk in chunks:
                    size += len(chunk)
                    if size > self.largest:
                        raise self._too_large()
                    file.write(chunk)
        except BaseException:
            part.unlink(missing_ok=True)
            raise
        return part

    def keep(self, part: Path, wanted: str) -> Kept:
        """Puts a file among the recordings.  Raises RecordingRefusedError."""
        _check(_header(part), wanted)
        path = self.folder / self.free(wanted)
        part.rename(path)
        kept = _kept(path)
        assert kept is not None
        return kept

    def _check_room(self, length: int) -> None:
        if length > self.largest:
            raise self._too_large()
        kept = self.all()
        if len(kept) >= MOST_FILES or sum(one.size for one in kept) + length > TIMES_LARGEST * self.largest:
            raise RecordingRefusedError(
                f"found {len(kept)} recordings already, no room for another: remove some of them first", 413
            )
        disk = os.statvfs(self.folder)
        if disk.f_bavail * disk.f_frsize < LEAST_FREE + length:
            raise RecordingRefusedError("the robot's disk is nearly full: remove some recordings first", 507)

    def _too_large(self) -> RecordingRefusedError:
        return RecordingRefusedError(
            f"found a file of more than {self.largest / 1e6:.3g} MB, expected a shorter recording; "
            "web.upload_mb allows more",
            413,
        )


def _kept(path: Path) -> Kept | None:
    with suppress(OSError):
        found = path.stat()
        columns = tuple(name for name in _header(path) if name != "time")
        return Kept(path.name, found.st_size, columns, found.st_mtime)
    return None


def _header(path: Path) -> list[str]:
    """The names of the columns, as far as the head of the file has them."""
    with path.open("rb") as file:
        text = file.read(HEAD).decode("utf-8-sig", "replace")
    lines = (line for line in text.splitlines() if line.strip() and not line.startswith("#"))
    return [cell.strip()[:LONGEST_NAME] for cell in next(lines, "").split(",")]


def _check(header: list[str], wanted: str) -> None:
    """Whether it looks like a recording; the lab checks its content."""
    if "time" not in header:
        found = ", ".join(header)[:60]
        printable = "".join(letter if letter.isprintable() else "?" for letter in found)
        raise RecordingRefusedError(
            f"{wanted[:LONGEST_NAME]}: found the columns {printable!r}, expected a recording (CSV) with a column time"
        )
