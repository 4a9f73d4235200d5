"""What the lab's commands print in a terminal: sentences, tables, and a plot of the measured and the modelled
signal."""

from __future__ import annotations

import math
from pathlib import Path, PurePath

import click
import numpy as np

from lostmotion.drivers.terminal import blank_plot, plot_text
from lostmotion.lab.commands.table import print_table
from lostmotion.lab.comparison.compare import Comparison, Overlay
from lostmotion.lab.quantity import SMALLEST_P, Scale, quantities, scale
from lostmotion.lab.report import verdict
from lostmotion.lab.results import Explanation, Fit, Ladder
from lostmotion.model.effects.registry import own
from lostmotion.model.motion import FloatArray

__all__ = ["show"]

HEIGHT = 16
SHOWN_S = 0.5
"""Length of the segment that the plot shows: a few impacts with their ringing."""
LEGEND = "• measured   ⢕ modelled"
MOST_RANKED = 8


def show(found: Comparison | Fit | Explanation | Ladder, output: Path | None) -> None:
    """Prints a result; output: the model file that was written, of a fit or a ladder."""
    if isinstance(found, Comparison):
        _show_comparison(found)
    elif isinstance(found, Explanation):
        _show_explanation(found)
    elif isinstance(found, Fit):
        _print(*verdict.of_fit(found))
        _print_estimates(found)
        _print_written(found, output)
    else:
        _show_ladder(found)
        _print_written(found.last.best, output)


def _show_comparison(comparison: Comparison) -> None:
    """Prints the comparison."""
    effects = ", ".join(comparison.model.effects) or "none"
    click.echo(f"base {comparison.model.base}, active effects: {effects}")
    _print_recordings(comparison)
    click.echo(_plot(comparison.of(comparison.column)[0]))
    click.echo("\n".join(verdict.of_comparison(comparison)))


def _print_recordings(comparison: Comparison) -> None:
    rows = []
    for one in comparison.overlays:
        (error, noise), unit = quantities(one.unit, one.rms, one.noise)
        horizon = f"{one.horizon_s:.1f} s" if math.isfinite(one.horizon_s) else "to the end"
        rows.append((PurePath(one.recording).name, one.column, f"{one.fit_percent:.1f}", error, noise, unit, horizon))
    columns = ("recording", "column", "fit %", "error", "noise", "unit", "predictable")
    print_table(columns, rows, right=("fit %", "error", "noise", "predictable"))


def _plot(overlay: Overlay) -> str:
    """A plot of a window with a typical error, coloured only in a terminal that supports colours."""
    inside = _segment(overlay)
    time = overlay.time[inside].tolist()
    shown = scale(overlay.unit, float(np.max(np.abs(overlay.measured[inside]))))
    title = f"{overlay.what} [{shown.unit}] over time [s], {PurePath(overlay.recording).name}"
    figure, width = blank_plot(title, HEIGHT)
    modelled, measured = (values[inside] * shown.factor for values in (overlay.modelled, overlay.measured))
    figure.draw(figure.signal(time, modelled.tolist(), marker="braille").lines())
    figure.draw(figure.signal(time, measured.tolist(), marker="•"))
    return plot_text(figure, width, LEGEND)


def _segment(overlay: Overlay) -> FloatArray:
    """The indices of the samples in that window of half a second whose error is the median of all windows."""
    seen = np.flatnonzero(np.isfinite(overlay.residual))
    time = overlay.time[seen]
    length = max(SHOWN_S, 60 * float(np.median(np.diff(time))))
    window = ((time - time[0]) // length).astype(int)
    power = np.bincount(window, overlay.residual[seen] ** 2)[: max(int(window[-1]), 1)]
    return np.asarray(seen[window == np.argsort(power)[power.size // 2]])


def _show_explanation(explanation: Explanation) -> None:
    """Prints the verdict in words, the ranking, and what to record next."""
    _print(*verdict.of_explanation(explanation))
    _print_ranking(explanation)
    if explanation.advice:
        _print(explanation.advice)


def _show_ladder(ladder: Ladder) -> None:
    """Prints the error after each added effect."""
    shown = scale(ladder.rungs[0].unit, *(rung.rms for rung in ladder.rungs))
    rows = [
        (", ".join(rung.effects) or "none", _error(rung.rms, shown), _error(rung.noise, shown)) for rung in ladder.rungs
    ]
    print_table(("effects", f"error on unseen data [{shown.unit}]", f"noise [{shown.unit}]"), rows)
    _print(*verdict.of_ladder(ladder))


def _print(*lines: str) -> None:
    """Prints lines as they are: a terminal wraps them."""
    for line in lines:
        click.echo(line)


def _print_written(fit: Fit, output: Path | None) -> None:
    _print(f"written to {output}; active effects: {', '.join(fit.model.effects) or 'none'}")


def _print_estimates(fit: Fit) -> None:
    rows = []
    for e in fit.estimates:
        remark = "at its bound" if e.at_bound else "" if e.identified else "not identifiable from these recordings"
        rows.append((e.name, f"{e.value:.5g}", f"{e.low:.5g} to {e.high:.5g}", e.unit, remark))
    print_table(("parameter", "value", "95 % interval", "unit", ""), rows)


def _print_ranking(explanation: Explanation) -> None:
    """Prints the best of the effects that were tried, and the user's own in any case."""
    ranking = explanation.ranking
    asked = [one for one in ranking[MOST_RANKED:] if own([one.effect])]
    if not (tried := [*ranking[:MOST_RANKED], *asked]):
        return
    shown = scale(explanation.error.unit, *(rms for entry in tried for rms in (entry.rms_before, entry.rms_after)))
    rows = []
    for entry in tried:
        p = f"< {SMALLEST_P:g}" if entry.p_value < SMALLEST_P else f"{entry.p_value:.2g}"
        rows.append((entry.effect, _error(entry.rms_before, shown), _error(entry.rms_after, shown), p))
    print_table(("effect", f"error before [{shown.unit}]", f"after [{shown.unit}]", "p"), rows)


def _error(rms: float, shown: Scale) -> str:
    """An error as text; it is infinite where the simulated motion of an unseen recording diverges."""
    return f"{rms * shown.factor:.3g}" if math.isfinite(rms) else "diverges"
