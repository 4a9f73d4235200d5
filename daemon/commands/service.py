"""``lostmotion service``: puts the unit, the udev rules and a first configuration in place, starts it; and back."""

from __future__ import annotations

import grp
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click

import lostmotion
from lostmotion.daemon import config as configuration
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.options import FILE
from lostmotion.daemon.unit import PAGE_UNIT, STATE, UNIT, Layout, ServiceError, check_reachable, template, unit_text

__all__ = ["service"]

BOOTED = Path("/run/systemd/system")
GROUP = "dialout"


class Step(NamedTuple):
    """What is going to be done, in words, and doing it."""

    text: str
    do: Callable[[], object]


dry_run = click.option("--dry-run", is_flag=True, help="Print what would be done, and do nothing.")
root = click.option("--root", type=FILE, metavar="DIR", help="Only the files, below DIR: for the image of a robot.")


@click.group()
def service() -> None:
    """Install lostmotion as a systemd service on this robot, or remove it."""


@service.command(short_help="Write, enable and start the service.")
@click.option("--web", "page", is_flag=True, help="Install the web page (docs/web.md) as a second service.")
@click.option("--print", "print_it", is_flag=True, help="Only print the unit; with --web, both.")
@dry_run
@root
def install(page: bool, print_it: bool, dry_run: bool, root: Path | None) -> None:
    """Write the unit, udev rules and a first configuration; enable and start the service.

    Run it again after an upgrade; an existing configuration is kept.
    """
    if print_it:
        _print_units([UNIT, PAGE_UNIT] if page else [UNIT])
    else:
        _install(root, page, dry_run)


def _print_units(names: list[str]) -> None:
    """One as it is; several as `systemctl cat` prints them, each after its path."""
    folder = Layout(Path("/")).unit.parent
    for name in names:
        head = [f"# {folder / name}"] if len(names) > 1 else []
        output.print_lines([*head, *unit_text(_command(), _version(), name).splitlines()])


def _install(root: Path | None, page: bool, dry_run: bool) -> None:
    """The page, too, where it is wanted or was there before.  Raises ServiceError before anything is changed,
    ConfigError for a configuration that is there and wrong."""
    layout = Layout(root or Path("/"))
    if root is None:
        _check_machine(dry_run)
    command = _command()
    check_reachable([command, Path(sys.executable).resolve(), Path(lostmotion.__file__).resolve()])
    if layout.config.exists():
        _check_config(layout.config)
    units = [UNIT, PAGE_UNIT] if page or layout.page.exists() else [UNIT]
    steps = [*_files(layout, command, units), *(_live_start(units) if root is None else _offline_start(root, units))]
    _go(steps, dry_run)
    if root is None and not dry_run:
        output.print_lines(
            [f"lostmotion runs; sudo {command} status shows the joints, journalctl -u lostmotion the log"]
        )


@service.command(short_help="Stop and remove the service; data stay.")
@click.option("--purge", is_flag=True, help="Remove the configuration and all data as well.")
@dry_run
@root
def uninstall(root: Path | None, purge: bool, dry_run: bool) -> None:
    """Stop the service and remove its unit and udev rules; configuration and data stay."""
    layout = Layout(root or Path("/"))
    if root is None:
        _check_machine(dry_run)
    there = [unit for unit in (layout.page, layout.unit) if unit.exists()]
    do, call = ("stop and disable", ["disable", "--now"]) if root is None else ("disable", [_below(root), "disable"])
    steps = [Step(f"{do} {unit.name}", partial(_systemctl, *call, unit.name)) for unit in there]
    steps += [Step(f"remove {path}", path.unlink) for path in (*there, layout.rules) if path.exists()]
    if not steps:
        output.print_lines([f"not installed: there is no {layout.unit}"])
    elif root is None:
        steps += [Step("systemctl daemon-reload", lambda: _systemctl("daemon-reload")), *_udev()]
    if purge:
        steps += [_remove(path) for path in (layout.config.parent, *layout.state) if path.exists() or path.is_symlink()]
    _go(steps, dry_run)
    left = [path for path in (layout.config.parent, layout.state[0]) if path.exists() and not purge]
    if left:
        output.print_lines([f"kept: {', '.join(map(str, left))}; uninstall --purge removes them"])


def _go(steps: list[Step], dry_run: bool) -> None:
    for step in steps:
        output.print_lines([f"would {step.text}" if dry_run else step.text])
        if not dry_run:
            step.do()


# --- what has to be so before anything is changed -------------------------------------------------------------------


def _check_machine(dry_run: bool) -> None:
    if not BOOTED.is_dir():
        raise ServiceError(
            f"found no systemd ({BOOTED} is missing), expected a machine that runs it; in a container or on another "
            "init system start `lostmotion run --config F` your own way, for an image use --root DIR"
        )
    if os.geteuid() != 0 and not dry_run:
        raise ServiceError(f"found an ordinary user, expected root: sudo {_command()} service ...; or try --dry-run")
    try:
        grp.getgrnam(GROUP)
    except KeyError:
        raise ServiceError(
            f"found no group {GROUP}, expected one that may use serial ports; make it: groupadd --system {GROUP}"
        ) from None


def _command() -> Path:
    """The program that is running, as it was called, with its whole path."""
    called = shutil.which(sys.argv[0])
    if called is None:
        raise ServiceError(f"found no program {sys.argv[0]!r}, expected the installed command lostmotion")
    return Path(called).absolute()


def _version() -> int:
    """systemd's version; 0 where there is none."""
    try:
        text = subprocess.run(["systemctl", "--version"], capture_output=True, text=True).stdout
    except FileNotFoundError:
        return 0
    found = re.match(r"systemd (\d+)", text)
    return int(found[1]) if found else 0


def _check_config(path: Path) -> None:
    database = configuration.load(path).database
    if not database.is_relative_to(STATE):
        raise ServiceError(
            f"{path}: found the database at {database}, expected it below {STATE}, where alone the service may write: "
            f'[store] path = "{STATE}/history.db"'
        )


# --- the steps ------------------------------------------------------------------------------------------------------


def _files(layout: Layout, command: Path, units: list[str]) -> Iterator[Step]:
    for unit in units:
        yield _write(layout.unit.with_name(unit), unit_text(command, _version(), unit))
    yield _write(layout.rules, template(layout.rules.name))
    if not layout.config.exists():
        yield _write(layout.config, template(layout.config.name))


def _live_start(units: list[str]) -> list[Step]:
    return [
        Step("systemctl daemon-reload", lambda: _systemctl("daemon-reload")),
        *_udev(),
        *(Step(f"enable {unit}", partial(_systemctl, "enable", unit)) for unit in units),
        *(Step(f"start {unit}", partial(_restart, unit)) for unit in units),
    ]


def _offline_start(root: Path, units: list[str]) -> list[Step]:
    return [Step(f"enable {unit}", partial(_systemctl, _below(root), "enable", unit)) for unit in units]


def _below(root: Path) -> str:
    """systemctl's option for the file system of an image."""
    return f"--root={root.absolute()}"


def _udev() -> list[Step]:
    """The rules are read again and applied to what is plugged in; a container has no udev."""
    if shutil.which("udevadm") is None:
        return []
    kinds = [f"--subsystem-match={kind}" for kind in ("tty", "usb-serial", "iio")]
    calls = (["control", "--reload"], ["trigger", *kinds])
    return [Step(f"udevadm {' '.join(call)}", partial(_run, "udevadm", *call, check=False)) for call in calls]


def _write(path: Path, text: str) -> Step:
    def write() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        path.chmod(0o644)

    return Step(f"write {path}", write)


def _remove(path: Path) -> Step:
    return Step(f"remove {path}", path.unlink if path.is_symlink() else lambda: shutil.rmtree(path))


def _restart(unit: str) -> None:
    """Starts a unit, or again with the new files; waits until the service is ready."""
    try:
        _systemctl("restart", unit)
    except ServiceError as error:
        last = _run("journalctl", "-u", unit, "-n", "1", "-o", "cat", "-t", "lostmotion", check=False)
        name = unit.removesuffix(".service")
        raise ServiceError(f"installed, but it does not start: {last or error}; journalctl -u {name}") from error


def _systemctl(*arguments: str) -> None:
    _run("systemctl", *arguments)


def _run(*command: str, check: bool = True) -> str:
    """The last line of what a command prints.  Raises ServiceError when it fails and ``check`` is on."""
    done = subprocess.run(command, capture_output=True, text=True)
    last = (done.stderr.strip() or done.stdout.strip()).rpartition("\n")[2]
    if check and done.returncode:
        raise ServiceError(f"{' '.join(command)}: {last}")
    return last
