"""Prints fits, explanations and ladders in a terminal.  Nothing is computed here."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from lostmotion.lab.report import verdict
from lostmotion.lab.results import Explanation, Fit, Ladder

__all__ = ["show_explanation", "show_fit", "show_ladder"]

WIDE = 120
MOST_RANKED = 8


def show_fit(fit: Fit, output: Path) -> None:
    """Prints estimates with intervals, errors by column, and parameters that are not identified."""
    console = _console()
    _print(console, *verdict.of_fit(fit))
    console.print(_estimates(fit))
    for column, rms in fit.rms.items():
        _print(console, f"{column}: error {rms:.3g}, noise about {fit.noise[column]:.3g}")
    if not fit.complete:
        _print(console, "stopped early: the best so far")
    _print(console, f"written to {output}; active effects: {', '.join(fit.model.effects) or 'none'}")


def show_explanation(explanation: Explanation) -> None:
    """Prints the verdict in words, the ranking, and what to record next."""
    console = _console()
    _print(console, *verdict.of_explanation(explanation))
    console.print(_ranking(explanation))
    if explanation.advice:
        _print(console, explanation.advice)


def show_ladder(ladder: Ladder, output: Path) -> None:
    """Prints the error after each added effect."""
    console = _console()
    table = _table("effects", "error on unseen data", "noise")
    for rung in ladder.rungs:
        table.add_row(", ".join(rung.effects) or "none", f"{rung.rms:.3g} {rung.unit}", f"{rung.noise:.3g}")
    console.print(table)
    _print(console, *verdict.of_ladder(ladder))
    effects = ", ".join(ladder.last.best.model.effects) or "none"
    _print(console, f"written to {output}; active effects: {effects}")


def _console() -> Console:
    return Console(width=None if sys.stdout.isatty() else WIDE, highlight=False)


def _print(console: Console, *lines: str) -> None:
    for line in lines:
        console.print(Text(line), soft_wrap=True)  # soft wrap: the terminal wraps, a file keeps its lines


def _table(*columns: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table


def _estimates(fit: Fit) -> Table:
    table = _table("parameter", "value", "95 % interval", "unit", "")
    for e in fit.estimates:
        remark = "at its bound" if e.at_bound else "" if e.identified else "not identifiable from these recordings"
        table.add_row(e.name, f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit, remark)
    return table


def _ranking(explanation: Explanation) -> Table:
    unit = explanation.error.unit
    table = _table("effect", f"error before [{unit}]", f"after [{unit}]", "p")
    for entry in explanation.ranking[:MOST_RANKED]:
        p = "< 0.003" if entry.p_value < 0.003 else f"{entry.p_value:.2g}"
        table.add_row(entry.effect, _error(entry.rms_before), _error(entry.rms_after), p)
    return table


def _error(rms: float) -> str:
    """An error; infinite where the simulated motion of an unseen recording diverges."""
    return f"{rms:.3g}" if math.isfinite(rms) else "diverges"
