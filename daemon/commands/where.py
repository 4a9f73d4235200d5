"""Finds the configuration and the database of a command."""

from __future__ import annotations

from pathlib import Path

from lostmotion.daemon import config as configuration
from lostmotion.daemon.config import Config
from lostmotion.daemon.reader import Reader, open_readonly
from lostmotion.drivers.errors import LostmotionError

__all__ = ["ETC", "UnknownJointError", "config_path", "find_config", "find_database", "open_joint", "open_reader"]

ETC = Path("/etc/lostmotion/lostmotion.toml")


class UnknownJointError(LostmotionError):
    """The database holds no such joint."""


def find_config(given: Path | None, *, runs: bool = False) -> Config:
    """The configuration that was given, else the service's, else the built-in one; runs: whether the robot of that one
    is to run.  Raises ConfigError."""
    path = config_path(given)
    return configuration.load(path) if path else configuration.default(runs=runs)


def config_path(given: Path | None) -> Path | None:
    """The file of ``find_config``; None for the built-in one."""
    return given or (ETC if ETC.exists() else None)


def find_database(config: Path | None, database: Path | None) -> Path:
    """The database given, else that of ``find_config``.  Raises ConfigError."""
    return database or find_config(config).database


def open_reader(config: Path | None, database: Path | None) -> Reader:
    """That database for reading.  Raises ConfigError or ReaderError."""
    return open_readonly(find_database(config, database))


def open_joint(joint: str, config: Path | None, database: Path | None) -> Reader:
    """The database, which must know the joint.  Raises UnknownJointError, ConfigError or ReaderError."""
    reader = open_reader(config, database)
    known = [row.name for row in reader.joints()]
    if joint not in known:
        reader.close()
        there = f"there are {', '.join(known)}" if known else "it holds none yet; has a window been scored?"
        raise UnknownJointError(f"found no joint {joint!r} in the database; {there}")
    return reader
