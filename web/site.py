"""What all pages share: the robot, its database, its configuration.  No HTTP here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from lostmotion.daemon.commands.where import ETC
from lostmotion.daemon.config import Config, ConfigError, default, load
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.paths import expanded
from lostmotion.daemon.reader import Reader, open_readonly

if TYPE_CHECKING:
    from lostmotion.daemon.commands.fleet_ask import Fleet

__all__ = ["Site"]


@dataclass(frozen=True, slots=True)
class Site:
    """One robot's page.

    config_file: None for the built-in simulated robot; given_database: instead of the configured one; look_s: how often
    the database is looked at for news [s]; fleet: the robots of the fleet's page, None where there are none.
    """

    config_file: Path | None
    given_database: Path | None = None
    look_s: float = 0.05
    fleet: Fleet | None = None

    @classmethod
    def of(cls, config_file: Path | None, database: Path | None, fleet: Fleet | None = None) -> Site:
        """The site of a configuration: that given, else the installed one, else the built-in one."""
        return cls(config_file or (ETC if ETC.exists() else None), database, fleet=fleet)

    def config(self) -> Config:
        """The configuration as it is in the file now.  Raises ConfigError."""
        if self.config_file is None:
            return _built_in()
        try:
            changed = self.config_file.stat().st_mtime_ns
        except OSError:
            changed = 0  # loading raises the error
        return _loaded(self.config_file, changed)

    @property
    def database(self) -> Path:
        """Where the database lies.  Raises ConfigError."""
        return self.given_database or self.config().database

    @property
    def lab_folder(self) -> Path:
        """Where recordings and runs of the lab are.  Raises ConfigError or PathError."""
        given = self.config().web.lab
        return (expanded("web.lab", given) if given else self.database.parent / "lab").resolve()

    def reader(self) -> Reader:
        """The database, as it is now at its path: a damaged one may have been moved aside.  Raises ReaderError."""
        return open_readonly(self.database)

    def places(self) -> Mapping[str, str]:
        """Where each device is plugged in, by the names that the service gives them."""
        config = self.config()
        sensors = {sensor.name: getattr(sensor, "port", "") for sensor in config.accelerometers}
        return sensors | {f"{joint.driver} {joint.port}": joint.port for joint in config.joints if joint.port}

    @property
    def alarm(self) -> AlarmOptions:
        """The limits of alarms; their defaults where the configuration cannot be read."""
        try:
            return self.config().alarm
        except ConfigError:
            return AlarmOptions()

    @property
    def spark_span(self) -> timedelta:
        """What the small curves of the first page show."""
        return timedelta(days=365)


@lru_cache(maxsize=1)
def _built_in() -> Config:
    return default(runs=False)


@lru_cache(maxsize=4)
def _loaded(path: Path, changed_ns: int) -> Config:
    """A configuration, read again when its file has changed: the database is looked for many times a second."""
    return load(path)
