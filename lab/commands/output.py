"""Writes the outputs of every command of the lab: the report, the curves, the JSON document with sentences."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from lostmotion.lab import words
from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.report import verdict
from lostmotion.lab.results import Errors, Explanation, Fit, Ladder

__all__ = ["write_output"]

Found = Comparison | Fit | Explanation | Ladder


def write_output(found: Found, kind: str, report: Path | None, curves: Path | None, *, as_json: bool) -> bool:
    """Writes the requested outputs; returns True when JSON was printed, so that the command prints no text.  kind: the
    argument of ``write_report``."""
    if report is not None:
        from lostmotion.lab.report import write_report

        write_report(report, **{kind: found})  # type: ignore[arg-type]
    if curves is not None:
        from lostmotion.lab.commands.curves import write_curves

        write_curves(curves, found)
    if as_json:
        click.echo(json.dumps({**found.document(), **_in_words(found)}, ensure_ascii=False, allow_nan=False))
    return as_json


def _in_words(found: Found) -> dict[str, Any]:
    """The sentences for people; of effects also names, and what to look at on the robot."""
    if isinstance(found, Comparison):
        left = (one.variable for column in found.columns.values() for one in column.maps)
        return {"words": verdict.of_comparison(found), "variables": _variables(left)}
    if isinstance(found, Fit):
        return {**_errors(found), "words": verdict.of_fit(found)}
    if isinstance(found, Ladder):
        return {"words": verdict.of_ladder(found), **_effects(found.last)}
    return {"words": verdict.of_explanation(found), **_effects(found)}


def _errors(fit: Fit) -> dict[str, Any]:
    """The keys ``error`` (of the first column) and ``columns`` of a fit; nothing is added, so both errors are one."""
    linear, drive = any(one.is_linear for one in fit.experiments), next((e.drive_unit for e in fit.experiments), "")
    columns = {
        name: Errors(rms, rms, fit.noise.get(name, math.nan), words.column(name, linear, drive)[1]).document()
        for name, rms in fit.rms.items()
    }
    return {"error": next(iter(columns.values())), "columns": columns}


def _effects(explanation: Explanation) -> dict[str, Any]:
    mentioned = dict.fromkeys(_mentioned(explanation))
    return {
        "names": {effect: words.name(effect) for effect in mentioned},
        "look": {effect: text for effect in explanation.missing if (text := words.look(effect))},
        "seen_from": verdict.detectable(explanation),
        "variables": _variables(explanation.residual.depends_on if explanation.residual else ()),
    }


def _variables(names: Iterable[str]) -> dict[str, str]:
    return {name: words.variable(name)[0] for name in names}


def _mentioned(explanation: Explanation) -> Iterable[str]:
    yield from explanation.best.model.effects
    yield from (entry.effect for entry in explanation.ranking)
    yield from explanation.untried
