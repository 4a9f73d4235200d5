"""What the ``calibrate`` commands share: options, printing a result, and its TOML.  Nothing is computed here."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.completion import joints
from lostmotion.daemon.commands.options import FILE, READABLE, combined, config_file, damping, resonance
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.toml_text import toml_value

__all__ = ["CalibrationError", "about_settings", "lines_of", "recordings", "report", "toml_out"]

recordings = click.argument("recordings", type=READABLE, nargs=-1, required=True, metavar="REC...")
about_settings = combined(
    click.option("--worn", type=FILE, multiple=True, metavar="REC", help="Of a joint with play; again for more."),
    config_file,
    click.option("--joint", metavar="NAME", help="The joint whose settings count.", shell_complete=joints),
    resonance,
    damping,
)
toml_out = click.option(
    "-o", "--output", "target", type=FILE, metavar="FILE", help="Write the lines to a new file as well."
)


class CalibrationError(LostmotionError):
    """The recordings do not determine the result."""


def lines_of(values: Mapping[str, Any], comment: str, inline: str = "") -> list[str]:
    """The values as lines of TOML under a comment: a line each, or one inline table of that name."""
    pairs = [f"{key} = {toml_value(value)}" for key, value in values.items()]
    return [f"# {comment}", *([f"{inline} = {{ {', '.join(pairs)} }}"] if inline else pairs)]


def report(
    document: Mapping[str, Any],
    words: Sequence[str],
    warnings: Sequence[str],
    lines: Sequence[str],
    target: Path | None,
    as_json: bool,
) -> None:
    """Prints the answer, warnings on stderr, and writes the TOML lines to a file that must not exist yet.

    Raises OutputError when it does or cannot be written: a configuration is never changed behind its owner's back.
    """
    if target:
        advice = "nothing is merged into a configuration, copy the lines into it yourself"
        output.write_new(target, "".join(f"{line}\n" for line in lines), advice)
    for warning in warnings:
        sys.stderr.write(f"warning: {warning}\n")
    if as_json:
        output.print_json({**document, "warnings": list(warnings), "toml": "\n".join(lines)})
    else:
        output.print_lines([*words, "", *lines])
