"""Prints fits, explanations and ladders in a terminal.  Nothing is computed here."""

from __future__ import annotations

import math
from pathlib import Path

import click

from lostmotion.lab.commands.table import print_table
from lostmotion.lab.report import verdict
from lostmotion.lab.results import Explanation, Fit, Ladder

__all__ = ["show_explanation", "show_fit", "show_ladder"]

MOST_RANKED = 8


def show_fit(fit: Fit, output: Path) -> None:
    """Prints estimates with intervals, errors by column, and parameters that are not identified."""
    _print(*verdict.of_fit(fit))
    _print_estimates(fit)
    for column, rms in fit.rms.items():
        _print(f"{column}: error {rms:.3g}, noise about {fit.noise[column]:.3g}")
    if not fit.complete:
        _print("stopped early: the best so far")
    _print(f"written to {output}; active effects: {', '.join(fit.model.effects) or 'none'}")


def show_explanation(explanation: Explanation) -> None:
    """Prints the verdict in words, the ranking, and what to record next."""
    _print(*verdict.of_explanation(explanation))
    _print_ranking(explanation)
    if explanation.advice:
        _print(explanation.advice)


def show_ladder(ladder: Ladder, output: Path) -> None:
    """Prints the error after each added effect."""
    rows = [
        (", ".join(rung.effects) or "none", f"{rung.rms:.3g} {rung.unit}", f"{rung.noise:.3g}") for rung in ladder.rungs
    ]
    print_table(("effects", "error on unseen data", "noise"), rows)
    _print(*verdict.of_ladder(ladder))
    effects = ", ".join(ladder.last.best.model.effects) or "none"
    _print(f"written to {output}; active effects: {effects}")


def _print(*lines: str) -> None:
    """Prints lines as they are: a terminal wraps them."""
    for line in lines:
        click.echo(line)


def _print_estimates(fit: Fit) -> None:
    rows = []
    for e in fit.estimates:
        remark = "at its bound" if e.at_bound else "" if e.identified else "not identifiable from these recordings"
        rows.append((e.name, f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit, remark))
    print_table(("parameter", "value", "95 % interval", "unit", ""), rows)


def _print_ranking(explanation: Explanation) -> None:
    unit, rows = explanation.error.unit, []
    for entry in explanation.ranking[:MOST_RANKED]:
        p = "< 0.003" if entry.p_value < 0.003 else f"{entry.p_value:.2g}"
        rows.append((entry.effect, _error(entry.rms_before), _error(entry.rms_after), p))
    print_table(("effect", f"error before [{unit}]", f"after [{unit}]", "p"), rows)


def _error(rms: float) -> str:
    """An error; infinite where the simulated motion of an unseen recording diverges."""
    return f"{rms:.3g}" if math.isfinite(rms) else "diverges"
