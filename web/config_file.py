"""The configuration file as the page changes it: some keys of one joint and its sensor, every other byte as it was.

A change is shown as a diff first, checked as the service checks it, and written at once or not at all; the
previous file lies beside it until it is restored or replaced by the next one.
"""

from __future__ import annotations

import difflib
import hashlib
import os
import tempfile
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lostmotion.daemon import config as configuration
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Change", "ConfigFile", "ConfigFileError", "edited"]

BACKUP = ".before-calibration"
Values = Mapping[str, Any]


class ConfigFileError(LostmotionError):
    """The configuration cannot be changed so."""


@dataclass(frozen=True, slots=True)
class Change:
    """What would change, as a unified diff; digest: of the two files, to be sure that what is done is what was seen."""

    diff: tuple[str, ...]
    digest: str


def edited(text: str, joint: str, oscillator: Values, detector: Values) -> str:
    """The text with these keys in the table ``detector`` of a joint and in the ``oscillator`` of its accelerometer.

    Raises ConfigFileError where the text is not of a kind that can be changed key by key.
    """
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    before = tomllib.loads(text)
    sensor = next(one for one in before["joint"] if one["name"] == joint)["accelerometer"]
    wanted = ((("accelerometer", sensor), "oscillator", oscillator), (("joint", joint), "detector", detector))
    try:
        document: Any = tomlkit.parse(text)
        for (kind, name), table, values in wanted:
            if values:
                _set(next(one for one in document[kind] if one["name"] == name), table, values)
                _set(next(one for one in before[kind] if one["name"] == name), table, values)
        new = tomlkit.dumps(document)
        same = tomllib.loads(new) == before
    except (TOMLKitError, tomllib.TOMLDecodeError, TypeError) as error:
        raise ConfigFileError(f"the file cannot be changed key by key ({error}): copy the lines into it") from error
    if not same:
        raise ConfigFileError("the file is written in a way that cannot be changed key by key: copy the lines into it")
    return new


def _set(item: Any, table: str, values: Values) -> None:
    keys = item.setdefault(table, {})
    is_spaced = hasattr(keys, "as_string") and keys.as_string().endswith(" }")
    keys.update(values)
    if is_spaced and not keys.as_string().endswith(" }"):  # the space before the brace is lost with a new key
        keys.value.item(list(keys)[-1]).trivia.trail = " "


class ConfigFile:
    """A configuration file and the previous one."""

    def __init__(self, path: Path) -> None:
        self.path = Path(os.path.realpath(path))
        self.backup = self.path.with_name(self.path.name + BACKUP)

    def text(self) -> str:
        """What it holds.  Raises ConfigFileError."""
        return self._decoded(self._read(self.path))

    def change(self, new: str) -> Change | None:
        """From what it holds to this text; None where it is the same."""
        return self._change(self._read(self.path), new.encode())

    def change_back(self) -> Change | None:
        """From its content to the previous file; None without one."""
        if not self.backup.exists():
            return None
        return self._change(self._read(self.path), self._read(self.backup))

    def write(self, new: str, digest: str) -> None:
        """Takes a change that was seen.  Raises ConfigFileError, or ConfigError for what the service would refuse."""
        old = self._read(self.path)
        self._expect(self._change(old, new.encode()), digest)
        configuration.loads(new, self.path.name)
        self._replace(self.backup, old)
        self._replace(self.path, new.encode())

    def take_back(self, digest: str) -> None:
        """Restores the previous file, byte for byte.  Raises ConfigFileError."""
        self._expect(self.change_back(), digest)
        self._replace(self.path, self._read(self.backup))
        self.backup.unlink()

    def _expect(self, change: Change | None, digest: str) -> None:
        if change is None or change.digest != digest:
            raise ConfigFileError(f"{self.path.name} is not as it was when this was shown: look at it again")

    def _change(self, old: bytes, new: bytes) -> Change | None:
        if old == new:
            return None
        before, after = (self._decoded(text).splitlines() for text in (old, new))
        diff = difflib.unified_diff(before, after, self.path.name, f"{self.path.name}, changed", lineterm="")
        return Change(tuple(diff), hashlib.sha256(old + b"\0" + new).hexdigest())

    def _decoded(self, content: bytes) -> str:
        try:
            return content.decode()
        except UnicodeDecodeError as error:
            raise ConfigFileError(f"{self.path.name}: found a byte that is no UTF-8, expected TOML") from error

    def _read(self, path: Path) -> bytes:
        try:
            return path.read_bytes()
        except OSError as error:
            raise ConfigFileError(f"{path}: cannot be read: {error.strerror}") from error

    def _replace(self, path: Path, content: bytes) -> None:
        """Writes a file at once or not at all, with the rights of the configuration."""
        try:
            stat = self.path.stat()
            number, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
            part = Path(name)
            try:
                with os.fdopen(number, "wb") as file:
                    os.fchmod(number, stat.st_mode & 0o7777)
                    with suppress(PermissionError):
                        os.fchown(number, stat.st_uid, stat.st_gid)
                    file.write(content)
                    file.flush()
                    os.fsync(number)  # before the name points to it: a power cut leaves the old file or the new one
                part.replace(path)
            finally:
                part.unlink(missing_ok=True)
        except OSError as error:
            raise ConfigFileError(
                f"{path}: cannot be written: {error.strerror}; may this page's user write the folder? "
                "Otherwise copy the lines into the file"
            ) from error
