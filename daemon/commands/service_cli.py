"""The arguments of ``lostmotion service``; the commands are in ``service.py``."""

from __future__ import annotations

from pathlib import Path

import click

from lostmotion.daemon.cli import FILE
from lostmotion.daemon.commands import service as commands

__all__ = ["service"]

dry_run = click.option("--dry-run", is_flag=True, help="Print what would be done, and do nothing.")

root = click.option("--root", type=FILE, metavar="DIR", help="Only the files, below DIR: for the image of a robot.")


@click.group()
def service() -> None:
    """Install lostmotion as a systemd service on this robot, or remove it."""


@service.command("install", short_help="Write, enable and start the service.")
@click.option("--web", "page", is_flag=True, help="Install the web page (docs/web.md) as a second service.")
@click.option("--print", "print_it", is_flag=True, help="Only print the unit.")
@dry_run
@root
def install(page: bool, print_it: bool, dry_run: bool, root: Path | None) -> None:
    """Write the unit, udev rules and a first configuration; enable and start the service.

    Run it again after an upgrade; an existing configuration is kept.
    """
    if print_it:
        commands.print_unit()
    else:
        commands.install(root, page, dry_run)


@service.command("uninstall", short_help="Stop and remove the service; data stay.")
@click.option("--purge", is_flag=True, help="Remove the configuration and all data as well.")
@dry_run
@root
def uninstall(purge: bool, dry_run: bool, root: Path | None) -> None:
    """Stop the service and remove its unit and udev rules; configuration and data stay."""
    commands.uninstall(root, purge, dry_run)
