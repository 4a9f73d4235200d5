"""``lostmotion config check``: is the configuration valid, and what does it come to."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from lostmotion.daemon import config as configuration
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.options import FILE, as_json
from lostmotion.daemon.config import Config
from lostmotion.daemon.sockets import sockets

__all__ = ["config_group"]


@click.group("config")
def config_group() -> None:
    """Check a configuration."""


@config_group.command()
@click.argument("file", type=FILE)
@as_json
def check(file: Path, as_json: bool) -> None:
    """Validate a configuration, and show what is in force for each joint."""
    config = configuration.load(file)
    if as_json:
        output.print_json(_document(config))
    else:
        _print(file, config)


def _document(config: Config) -> dict[str, Any]:
    return {
        "valid": True,
        "robot": config.robot.name,
        "database": str(config.database),
        "accelerometers": [
            {"name": sensor.name, "driver": sensor.driver, "port": sensor.port, "rate_hz": sensor.rate_hz}
            for sensor in config.accelerometers
        ],
        "joints": [
            {
                "name": joint.name,
                "driver": joint.driver,
                "port": joint.port,
                "poll_hz": joint.poll_hz,
                "accelerometer": joint.accelerometer,
                "detector": asdict(config.settings(joint.name)),
            }
            for joint in config.joints
        ],
        "sockets": [asdict(socket) for socket in sockets(config)],
        "notes": list(config.notes),
    }


def _print(path: Path, config: Config) -> None:
    relative = "" if config.database.is_absolute() else " (store.path counts from the working folder)"
    database = f"{config.database.absolute()}{relative}"
    output.print_lines([f"{path}: valid", f"robot {config.robot.name}, database {database}", ""])
    joints = [[j.name, j.driver, j.port, f"{j.poll_hz:g}", j.accelerometer] for j in config.joints]
    output.print_table(("joint", "driver", "port", "poll [Hz]", "accelerometer"), joints, ("poll [Hz]",))
    output.print_lines([""])
    sensors = [
        [s.name, s.driver, s.port, f"{s.rate_hz:g}", f"{s.oscillator.f_res_hz:g}", f"{s.oscillator.zeta:g}"]
        for s in config.accelerometers
    ]
    columns = ("accelerometer", "driver", "port", "rate [Hz]", "f_res [Hz]", "zeta")
    output.print_table(columns, sensors, columns[3:])
    output.print_lines([""])
    rows = [[socket.of, socket.does, socket.address, socket.reach] for socket in sockets(config)]
    if rows:
        output.print_table(("socket of", "does", "address", "open to"), rows)
    else:
        output.print_lines(["sockets: none; nothing listens, and nothing is connected to"])
    output.print_lines([""])
    settings = {joint.name: asdict(config.settings(joint.name)) for joint in config.joints}
    keys = list(next(iter(settings.values())))
    table = [[key, *(_shown(values[key]) for values in settings.values())] for key in keys]
    output.print_table(("detector", *settings), table, tuple(settings))
    output.print_lines([f"note: {note}" for note in config.notes])


def _shown(value: object) -> str:
    if isinstance(value, tuple):
        return " ".join(f"{one:.3g}" for one in value) or "white"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else "auto" if value is None else str(value)
