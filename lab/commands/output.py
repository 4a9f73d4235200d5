"""Writes the outputs of the lab's commands: the report, the curves, and the JSON document or the text."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
import numpy as np

from lostmotion.drivers.recording import replacing
from lostmotion.lab import words
from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.data.experiment import axis_of
from lostmotion.lab.report import verdict
from lostmotion.lab.report.views import Trace, traces_of
from lostmotion.lab.results import Errors, Explanation, Fit, Ladder
from lostmotion.model.motion import FloatArray

__all__ = ["write_output"]

Found = Comparison | Fit | Explanation | Ladder
KINDS = {Comparison: "comparison", Fit: "fit", Explanation: "explanation", Ladder: "ladder"}
"""The arguments of ``write_report``."""
DIGITS = 6
"""of each number of a curve: more than a plot can show"""


def write_output(
    found: Found, report: Path | None, curves: Path | None, output: Path | None = None, *, as_json: bool
) -> None:
    """Writes the requested files, and prints the result as JSON or as text; output: the model file that was written."""
    if report is not None:
        from lostmotion.lab.report import write_report

        write_report(report, **{KINDS[type(found)]: found})  # type: ignore[arg-type]
    if curves is not None:
        _write_curves(curves, found)
    if as_json:
        click.echo(json.dumps({**found.document(), **_in_words(found)}, ensure_ascii=False, allow_nan=False))
        return
    from lostmotion.lab.commands.terminal import show  # late: it draws

    show(found, output)


def _in_words(found: Found) -> dict[str, Any]:
    """The keys with sentences; for a search also the names of effects, and what to inspect on the robot."""
    told: dict[str, Any] = {"words": verdict.of(found)}
    if isinstance(found, Comparison):
        left = (one.variable for column in found.columns.values() for one in column.maps)
        return told | {"variables": _variables(left)}
    if isinstance(found, Fit):
        return _errors(found) | told
    return told | _effects(found.last if isinstance(found, Ladder) else found)


def _errors(fit: Fit) -> dict[str, Any]:
    """The keys ``error`` (of the first column) and ``columns`` of a fit, in which the errors before and after are
    equal."""
    axis = axis_of(fit.experiments)
    columns = {
        name: Errors(rms, rms, fit.noise.get(name, math.nan), words.column(name, *axis)[1]).document()
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


def _write_curves(path: Path, found: Found) -> None:
    """Writes each column of each recording: measured, modelled, and modelled without what was found.

    A file of that name is replaced, once all is written.  Raises RecordingError when it cannot be written.
    """
    document = [_curve(trace) for trace in traces_of(found)]
    with replacing(path) as file:
        json.dump(document, file, ensure_ascii=False, allow_nan=False)


def _curve(trace: Trace) -> dict[str, Any]:
    return {
        "recording": trace.recording,
        "column": trace.column,
        "what": trace.what,
        "unit": trace.unit,
        "noise": trace.noise if np.isfinite(trace.noise) else None,
        "time": trace.time.round(9).tolist(),
        "measured": _numbers(trace.measured),
        "modelled": _numbers(trace.modelled),
        "before": None if trace.before is None else _numbers(trace.before),
    }


def _numbers(values: FloatArray) -> list[float | None]:
    """The values, None for NaN and infinity, which JSON cannot represent: a wrong model may diverge."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values]
