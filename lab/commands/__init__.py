"""The commands of ``lostmotion lab``: one group, one module per command; arguments and text only."""

from __future__ import annotations

import click

from lostmotion.lab.commands.add import add
from lostmotion.lab.commands.compare import compare
from lostmotion.lab.commands.fitting import explain, fit, improve

__all__ = ["lab"]


@click.group()
def lab() -> None:
    """Compare a model with measurements, find the missing effect, and add it."""


for command in (compare, fit, explain, add, improve):
    lab.add_command(command)
