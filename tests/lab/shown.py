"""Pages of docs/ that show files, commands and what these print: their parts, and whether a run prints the like."""

from __future__ import annotations

import re
import shlex
from contextlib import chdir
from pathlib import Path

from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from tests.test_readme import commands

__all__ = ["check_page", "missing_lines", "shown_files", "shown_output"]

NUMBER = re.compile(r"[-−]?\d+(\.\d+)?(e[-+]?\d+)?")
SPACE = re.compile(r"[\s─]+")


def check_page(page: str, folder: Path) -> None:
    """Writes the page's files into the folder and runs its commands there; each succeeds and prints what is shown.
    They run in this process, as a process of its own takes a second to begin; each command of the README has one."""
    for name, text in shown_files(page).items():
        (folder / name).write_text(text)
    printed = ""
    for command in commands(page):
        program, *arguments = shlex.split(command)
        assert program == "lostmotion"
        with chdir(folder):
            done = CliRunner().invoke(cli, arguments)
        assert done.exit_code == 0, f"{command}\n{done.stdout}{done.stderr}"
        printed += done.stdout
    assert missing_lines(shown_output(page), printed) == []


def shown_files(page: str) -> dict[str, str]:
    """The files that the page shows, by name."""
    return dict(re.findall(r"^`(\S+)`:\n\n```\w+\n(.*?)```", page, flags=re.DOTALL | re.MULTILINE))


def shown_output(page: str) -> str:
    """What the page says that commands print."""
    blocks = re.findall(r"```console\n(.*?)```", page, flags=re.DOTALL)
    return "\n".join(line for block in blocks for line in block.splitlines() if not line.startswith("$ "))


def missing_lines(shown: str, printed: str) -> list[str]:
    """Shown lines that were not printed, numbers and the widths of columns apart; "…" stands for what was left out."""
    there = {_shape(line) for line in printed.splitlines()}
    return [line for line in shown.splitlines() if line != "…" and _shape(line) not in there]


def _shape(line: str) -> str:
    return SPACE.sub(" ", NUMBER.sub("#", line)).strip()
