"""Prints fits, explanations and ladders in a terminal.  Nothing is computed here."""

from __future__ import annotations

import math
from pathlib import Path

import click

from lostmotion.lab.commands.table import print_table
from lostmotion.lab.quantity import SMALLEST_P, Scale, scale
from lostmotion.lab.report import verdict
from lostmotion.lab.results import Explanation, Fit, Ladder

__all__ = ["show_explanation", "show_fit", "show_ladder"]

MOST_RANKED = 8


def show_fit(fit: Fit, output: Path) -> None:
    """Prints errors by column, and estimates with intervals and whether they are identified."""
    _print(*verdict.of_fit(fit))
    _print_estimates(fit)
    _print(f"written to {output}; active effects: {', '.join(fit.model.effects) or 'none'}")


def show_explanation(explanation: Explanation) -> None:
    """Prints the verdict in words, the ranking, and what to record next."""
    _print(*verdict.of_explanation(explanation))
    _print_ranking(explanation)
    if explanation.advice:
        _print(explanation.advice)


def show_ladder(ladder: Ladder, output: Path) -> None:
    """Prints the error after each added effect."""
    shown = scale(ladder.rungs[0].unit, *(rung.rms for rung in ladder.rungs))
    rows = [
        (", ".join(rung.effects) or "none", _error(rung.rms, shown), _error(rung.noise, shown)) for rung in ladder.rungs
    ]
    print_table(("effects", f"error on unseen data [{shown.unit}]", f"noise [{shown.unit}]"), rows)
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
    tried = explanation.ranking[:MOST_RANKED]
    if not tried:
        return
    shown = scale(explanation.error.unit, *(rms for entry in tried for rms in (entry.rms_before, entry.rms_after)))
    rows = []
    for entry in tried:
        p = f"< {SMALLEST_P:g}" if entry.p_value < SMALLEST_P else f"{entry.p_value:.2g}"
        rows.append((entry.effect, _error(entry.rms_before, shown), _error(entry.rms_after, shown), p))
    print_table(("effect", f"error before [{shown.unit}]", f"after [{shown.unit}]", "p"), rows)


def _error(rms: float, shown: Scale) -> str:
    """An error; infinite where the simulated motion of an unseen recording diverges."""
    return f"{rms * shown.factor:.3g}" if math.isfinite(rms) else "diverges"
