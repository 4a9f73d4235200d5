"""Names that the shell completes: joints and accelerometers of a configuration or database.  Prints nothing."""

from __future__ import annotations

import sqlite3
from contextlib import closing, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from lostmotion.drivers.errors import LostmotionError

if TYPE_CHECKING:
    from lostmotion.daemon.config import Config

__all__ = ["accelerometers", "joints"]


def joints(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Joints of the configuration, and those of the database that it no longer has; of a database that is given without
    a configuration, its own.  Nothing where neither is there."""
    given: Path | None = ctx.params.get("database")
    config = _config(ctx) if given is None or ctx.params.get("config") else None
    names = [joint.name for joint in config.joints] if config else []
    given = given or (config.database if config else None)
    if given is not None:
        from lostmotion.daemon.reader import open_readonly

        with suppress(LostmotionError, sqlite3.Error, OSError), closing(open_readonly(given)) as reader:
            names += [row.name for row in reader.joints()]
    return _beginning(names, incomplete)


def accelerometers(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Accelerometers of the configuration."""
    config = _config(ctx)
    return _beginning([sensor.name for sensor in config.accelerometers] if config else [], incomplete)


def _config(ctx: click.Context) -> Config | None:
    """That of --config, else the service's, else the built-in one; None for a wrong one: completion prints no error."""
    from lostmotion.daemon.commands.where import find_config

    with suppress(LostmotionError, OSError):
        return find_config(ctx.params.get("config"))
    return None


def _beginning(names: list[str], incomplete: str) -> list[str]:
    return [name for name in dict.fromkeys(names) if name.startswith(incomplete)]
