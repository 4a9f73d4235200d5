"""``lostmotion doctor``: one pass over everything, each as value and allowed range."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.checks import Check
from lostmotion.daemon.commands.checks_devices import PASS_S, check_devices
from lostmotion.daemon.commands.checks_system import (
    check_adapters,
    check_can,
    check_clock,
    check_disk,
    check_history,
    check_learnt,
    check_versions,
    clock_offset,
)
from lostmotion.daemon.commands.where import ETC, config_path, find_config

__all__ = ["doctor"]

BUILT_IN = (
    f"found neither --config nor {ETC}, so this was the simulated robot that is built in; "
    "`lostmotion doctor --find` looks for what is plugged in"
)


def doctor(given: Path | None, as_json: bool) -> int:
    """Prints all checks, and the notes on the configuration; 1 when a check is bad.  Raises ConfigError."""
    config, path = find_config(given, runs=True), config_path(given)
    sys.stderr.write(f"measuring {path or 'the built-in simulated robot'} for about {PASS_S:g} s ...\n")
    notes = [*config.notes, *([] if path else [BUILT_IN])]
    offset = clock_offset()
    checks = check_devices(config)
    checks += [*check_adapters(config), *check_can(config), *check_clock(offset, config.is_virtual)]
    checks += [*check_disk(config), *check_history(config), *check_learnt(config), *check_versions()]
    bad = [check for check in checks if not check.ok]
    if as_json:
        of = {"robot": config.robot.name, "config": str(path) if path else None}
        output.print_json({"ok": not bad, "checks": [asdict(check) for check in checks], "notes": notes} | of)
    else:
        _print(checks, bad)
        output.print_lines([f"note: {note}" for note in notes])
    return int(bool(bad))


def _print(checks: list[Check], bad: list[Check]) -> None:
    from rich.markup import escape

    rows = [
        [
            escape(check.subject),
            escape(check.check),
            escape(f"{_shown(check.value)} {check.unit}".strip()),
            escape(check.allowed),
            "[green]ok[/green]" if check.ok else "[red]BAD[/red]",
        ]
        for check in checks
    ]
    output.print_table(("what", "check", "value", "allowed", ""), rows)
    failed = [f"BAD: {check.subject}: {check.check}: {check.cause}" for check in bad]
    output.print_lines([*failed, f"{len(checks) - len(bad)} of {len(checks)} checks are good"])


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.0f}" if abs(value) >= 1e4 else f"{value:.4g}"
