"""A comparison in the terminal: a table of the recordings, measured and modelled over each other, plain words."""

from __future__ import annotations

import math
import os
import shutil
import sys
from pathlib import PurePath

import click
import numpy as np

from lostmotion.lab.commands.table import print_table
from lostmotion.lab.comparison.compare import Comparison, Overlay
from lostmotion.lab.quantity import quantities, scale
from lostmotion.lab.report.verdict import of_comparison
from lostmotion.model.motion import FloatArray

__all__ = ["show"]

HEIGHT = 16
SHOWN_S = 0.5
"""Length of the segment that the plot shows: a few impacts with their ringing."""


def show(comparison: Comparison) -> None:
    """Prints the comparison."""
    effects = ", ".join(comparison.model.effects) or "none"
    click.echo(f"base {comparison.model.base}, active effects: {effects}")
    _print_table(comparison)
    click.echo(_plot(comparison.of(comparison.column)[0]))
    click.echo("\n".join(of_comparison(comparison)))


def _print_table(comparison: Comparison) -> None:
    rows = []
    for one in comparison.overlays:
        (error, noise), unit = quantities(one.unit, one.rms, one.noise)
        horizon = f"{one.horizon_s:.1f} s" if math.isfinite(one.horizon_s) else "to the end"
        rows.append((PurePath(one.recording).name, one.column, f"{one.fit_percent:.1f}", error, noise, unit, horizon))
    columns = ("recording", "column", "fit %", "error", "noise", "unit", "predictable")
    print_table(columns, rows, right=("fit %", "error", "noise", "predictable"))


def _plot(overlay: Overlay) -> str:
    """Plots a window with a typical error; coloured only in a terminal that supports colours."""
    import plotext

    width = min(shutil.get_terminal_size((100, HEIGHT)).columns, 120)
    plain = not sys.stdout.isatty() or bool(os.environ.get("NO_COLOR"))
    figure = plotext.figure
    figure.clear()
    figure.plot_size(width, HEIGHT)
    figure.theme("colorless" if plain else "simple")
    figure.canvas("default")
    inside = _segment(overlay)
    time = overlay.time[inside].tolist()
    shown = scale(overlay.unit, float(np.max(np.abs(overlay.measured[inside]))))
    figure.title(f"{overlay.what} [{shown.unit}] over time [s], {PurePath(overlay.recording).name}")
    modelled, measured = (values[inside] * shown.factor for values in (overlay.modelled, overlay.measured))
    figure.draw(figure.signal(time, modelled.tolist(), marker="braille").lines().label("modelled"))
    figure.draw(figure.signal(time, measured.tolist(), marker="•").label("measured"))
    return str(figure.build().string(colorless=plain)).strip("\n")


def _segment(overlay: Overlay) -> FloatArray:
    """Samples of the window of half a second with the median error of all windows."""
    seen = np.flatnonzero(np.isfinite(overlay.residual))
    time = overlay.time[seen]
    length = max(SHOWN_S, 60 * float(np.median(np.diff(time))))
    window = ((time - time[0]) // length).astype(int)
    power = np.bincount(window, overlay.residual[seen] ** 2)[: max(int(window[-1]), 1)]
    return np.asarray(seen[window == np.argsort(power)[power.size // 2]])
