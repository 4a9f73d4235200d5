"""``lostmotion calibrate``: a command for each thing that is found."""

from __future__ import annotations

import click

from lostmotion.daemon.commands.calibrate_bar import calibrate_bar
from lostmotion.daemon.commands.calibrate_healthy import calibrate_healthy
from lostmotion.daemon.commands.calibrate_level import calibrate_level
from lostmotion.daemon.commands.calibrate_tap import calibrate_tap

__all__ = ["calibrate"]


@click.group(commands=[calibrate_bar, calibrate_tap, calibrate_healthy, calibrate_level])
def calibrate() -> None:
    """Find the detector's settings from recordings, as lines for the configuration."""
