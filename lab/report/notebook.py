"""How notebooks display a comparison, a fit, an explanation or a ladder: as sentences and tables, and as a plot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.quantity import quantities, scale, with_unit
from lostmotion.lab.report import fitted, misfit, verdict
from lostmotion.lab.report.tags import Html, cell, paragraphs, probability, table
from lostmotion.lab.report.views import Trace, traces_of
from lostmotion.lab.results import Displayed, Explanation, Fit, Ladder, Rung

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["html", "plot"]

WIDTH, HEIGHT = 8.0, 3.6
"""Size of the two plots of one column of one recording [inch]."""
BESIDE: dict[str, Any] = {"loc": "lower right", "bbox_to_anchor": (1, 1), "ncols": 2, "frameon": False}
"""Where a legend is: above its plot, on no curve."""


def html(found: Displayed) -> str:
    """The verdict in sentences and a table, as HTML without style sheets, as a notebook has its own."""
    told = paragraphs(verdict.of(found))
    if isinstance(found, Ladder):
        return told + _rungs(found.rungs)
    if isinstance(found, Explanation):
        return told + _ranking(found)
    if isinstance(found, Fit):
        parameters = fitted.parameters(found)
        return told + (parameters.body if parameters else "")
    assert isinstance(found, Comparison)
    return told + misfit.errors(found).body


def plot(found: Displayed) -> Figure:
    """A figure of the measured and the modelled signal over time, and of the residual with and without the missing
    effects, for each column of each recording, the unseen one first.  Raises ImportError without matplotlib."""
    from matplotlib.figure import Figure

    drawn = traces_of(found)
    figure = Figure(figsize=(WIDTH, HEIGHT * len(drawn)), layout="constrained")
    rows: Any = figure.subplots(2 * len(drawn), 1, squeeze=False, gridspec_kw={"height_ratios": [2, 1] * len(drawn)})
    for at, trace in enumerate(drawn):
        _draw(trace, rows[2 * at, 0], rows[2 * at + 1, 0])
    return figure


def _draw(trace: Trace, above: Any, below: Any) -> None:
    shown = scale(trace.unit, float(abs(trace.measured).max()))
    above.plot(trace.time, trace.measured * shown.factor, label="measured")
    above.plot(trace.time, trace.modelled * shown.factor, label="modelled", linewidth=1)
    above.set_title(trace.title, loc="left")
    above.set(ylabel=f"{trace.what} [{shown.unit}]", xticklabels=[])
    above.legend(**BESIDE)
    if trace.before is not None:
        left = (trace.measured - trace.before) * shown.factor
        below.plot(trace.time, left, color="0.6", linewidth=1, label="without what was found")
    below.plot(trace.time, trace.residual * shown.factor, color="C4", linewidth=1, label="measured - modelled")
    below.set(xlabel="time [s]", ylabel=f"residual [{shown.unit}]")
    below.legend(**BESIDE)


def _rungs(rungs: tuple[Rung, ...]) -> Html:
    rows = []
    for rung in rungs:
        (error, noise), unit = quantities(rung.unit, rung.rms, rung.noise)
        cells = (cell(with_unit(error, unit), css="number"), cell(with_unit(noise, unit), css="number"))
        rows.append((cell(", ".join(rung.effects) or "no effects"), *cells))
    return table(("effects", "error on unseen data>", "noise>"), rows)


def _ranking(found: Explanation) -> Html:
    rows = []
    for one in found.ranking:
        (before, after), unit = quantities(found.error.unit, one.rms_before, one.rms_after)
        cells = [cell(with_unit(text, unit), css="number") for text in (before, after)]
        rows.append((cell(one.effect), *cells, cell(probability(one.p_value), css="number")))
    return table(("effect", "error without>", "with>", "p>"), rows)
