"""The report's sections on a fit: the model and its equations, the parameters with intervals, their correlations."""

from __future__ import annotations

from html import escape

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.quantity import Interval, number
from lostmotion.lab.report import verdict
from lostmotion.lab.report.plots import heat_map
from lostmotion.lab.report.tags import Html, Section, cell, note, table
from lostmotion.lab.results import Estimate, Fit
from lostmotion.model import BASES, Model
from lostmotion.model.effects import get_effect

__all__ = ["correlations", "model", "parameters"]

STRONG = 0.95
"""Magnitude of a correlation above which it is reported, as the recordings hardly separate the two parameters."""


def model(built: Model) -> Section:
    """The base and the active effects with their equations."""
    base = BASES[built.base]
    rows = [(cell("base", built.base), _equation(base.equation, base.summary))]
    for name in built.effects:
        effect = get_effect(name)
        rows.append((cell(words.name(name), name), _equation(effect.equation, effect.summary)))
    heading = "The model and its effects" if built.effects else "The model, without effects"
    return Section("model", heading, table(("", "equation"), rows))


def parameters(fit: Fit) -> Section | None:
    """The estimates with their intervals; None where nothing was free."""
    if not fit.estimates:
        return None
    rows = [_row(fit.model, estimate) for estimate in fit.estimates]
    body = table(("parameter", "value>", "95 % interval>"), rows)
    hidden = [e.name for e in fit.estimates if not e.identified]
    text = (
        f"Not identifiable from these recordings: {verdict.joined(hidden)}; take the values as assumed."
        if hidden
        else ""
    )
    return Section("parameters", "Parameters", Html(body + (note(text) if text else "")))


def correlations(fit: Fit) -> Section | None:
    """The correlation of the estimates; None for less than two."""
    names = [e.name for e in fit.estimates]
    matrix = np.atleast_2d(fit.correlation)
    if len(names) < 2 or matrix.shape != (len(names), len(names)):
        return None
    pairs = [f"{names[i]} with {names[j]} ({number(float(matrix[i, j]), 2)})"
             for i in range(len(names)) for j in range(i) if abs(matrix[i, j]) >= STRONG]  # fmt: skip
    text = (
        "Two parameters of a strong colour are identified only together: a change of one compensates a change of the "
        "other."
    )
    if pairs:
        text += f" Strongly correlated: {verdict.joined(pairs)}."
    return Section("correlations", "Correlations of the parameters", Html(note(text) + heat_map(names, matrix)))


def _row(built: Model, estimate: Estimate) -> tuple[Html, ...]:
    meaning = built.parameters[estimate.name].meaning if estimate.name in built.parameters else ""
    interval = Interval(estimate.value, estimate.low, estimate.high, estimate.unit)
    (_, low, high), _ = interval.texts()
    span = f"{low} … {high}" if estimate.identified and interval.known else "–"
    flags = (("not identifiable", not estimate.identified), ("at its bound", estimate.at_bound))
    raised = [Html(f'<span class="flag">{text}</span>') for text, is_set in flags if is_set]
    return (cell(estimate.name, meaning), cell(interval.alone, css="number"), cell(span, *raised, css="number"))


def _equation(text: str, summary: str) -> Html:
    return cell(Html(f"<code>{escape(text)}</code>"), summary)
