"""The report's static plots as SVG: spectra, curves with a band, errors over time, correlations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from lostmotion.lab.quantity import number, scale
from lostmotion.lab.report.svg import Axis, Frame
from lostmotion.lab.report.views import Amplitudes
from lostmotion.model.motion import FloatArray

__all__ = ["curve", "heat_map", "history", "spectrum", "stems"]

CELL = 30
SHOWN = 0.3
"""Magnitude of a correlation from which on its number is written into its cell."""


def spectrum(found: Amplitudes) -> str:
    """Measured, modelled, residual and noise over frequency, both axes logarithmic."""
    trace = found.trace
    shown = scale(trace.unit, float(np.max(found.measured)))
    lines = {"measured": found.measured, "modelled": found.modelled, "residual": found.residual, "noise": found.noise}
    lines = {name: values * shown.factor for name, values in lines.items()}
    largest = float(np.nanmax(list(lines.values()))) or 1.0
    quietest = [v for v in (np.min(lines["noise"]) / 3, np.quantile(lines["residual"], 0.05) / 2) if v > 0]
    lowest = min(max(min(quietest, default=0.0), largest / 1e7), largest / 10)
    y = Axis(f"{trace.what} ({shown.unit}/√Hz)", float(lowest), 1.5 * largest, log=True)
    x = Axis("frequency (Hz)", float(found.frequency[0]), float(found.frequency[-1]), log=True)
    frame = Frame(x, y, title=f"Spectra of {trace.title}")
    return frame.svg(*(frame.line(found.frequency, values, name) for name, values in lines.items()))


def history(title: str, label: str, unit: str, start: FloatArray, rms: FloatArray, noise: float) -> str:
    """Root mean squares (K,) over the times (K,) [s] of their segments, with the level of the noise."""
    shown = scale(unit, *rms)
    ordinate = Axis.around(_label(label, shown.unit), rms * shown.factor, [0.0, noise * shown.factor])
    frame = Frame(Axis.around("time (s)", start), ordinate, title=title)
    pieces = frame.line(start, rms * shown.factor, "residual"), frame.dots(start, rms * shown.factor, "residual")
    return frame.svg(frame.level(noise * shown.factor, "noise"), *pieces)


def curve(
    title: str, x: FloatArray, mean: FloatArray, low: FloatArray, high: FloatArray, labels: tuple[str, str],
    units: tuple[str, str],
) -> str:  # fmt: skip
    """A mean over a variable x with the ends of a 95 % band, (K,) each; labels, units: those of the variable and of the
    mean, SI."""
    across = scale(units[0], *x)
    up = scale(units[1], *mean, *low, *high)
    x, mean, low, high = x * across.factor, mean * up.factor, low * up.factor, high * up.factor
    ordinate = Axis.around(_label(labels[1], up.unit), mean, low, high, [0.0])
    frame = Frame(Axis.around(_label(labels[0], across.unit), x), ordinate, title=title)
    pieces = (frame.band(x, low, high, "residual"), frame.line(x, mean, "residual"), frame.dots(x, mean, "residual"))
    return frame.svg(frame.level(0.0, "zero"), *pieces)


def stems(title: str, lags: FloatArray, values: FloatArray, bound: float) -> str:
    """Correlations (K,) over lags (K,) [samples], with the band that contains those of noise."""
    lags = np.asarray(lags, dtype=float)
    ordinate = Axis.around("correlation", values, [-1.2 * bound, 1.2 * bound])
    frame = Frame(Axis.around("lag (samples)", lags), ordinate, title=title)
    ends = [frame.x.low, frame.x.high]
    lines = [frame.line([lag, lag], [0.0, value], "residual") for lag, value in zip(lags, values, strict=True)]
    return frame.svg(frame.band(ends, [-bound] * 2, [bound] * 2, "residual"), frame.level(0.0, "zero"), *lines)


def heat_map(names: Sequence[str], matrix: FloatArray) -> str:
    """A matrix of correlations (P, P): blue for negative and red for positive ones, large ones with their number."""
    margin = 12 + round(6.2 * max(map(len, names)))
    size = CELL * len(names)
    cells = []
    for i, row in enumerate(matrix):
        name = escape(names[i])
        middle = CELL * i + CELL / 2
        cells.append(f'<text x="{margin - 6}" y="{middle + 4:g}" text-anchor="end">{name}</text>')
        cells.append(f'<text transform="translate({margin + middle + 4:g} {size + 8}) rotate(-90)" '
                     f'text-anchor="end">{name}</text>')  # fmt: skip
        cells += [_cell(margin + CELL * j, CELL * i, float(value)) for j, value in enumerate(row[:i])]
        cells.append(_own_cell(margin + CELL * i, CELL * i))
    label = "Correlations of the estimated parameters"
    return (
        f'<svg class="plot heat" viewBox="0 0 {margin + size + 4} {size + margin}" style="max-width:'
        f'{margin + size + 4}px" role="img" aria-label="{label}"><title>{label}</title>{"".join(cells)}</svg>'
    )


def _own_cell(x: float, y: float) -> str:
    """The diagonal cell of a parameter with itself, without a number."""
    return f'<rect class="own" x="{x:g}" y="{y:g}" width="{CELL - 1}" height="{CELL - 1}"/>'


def _cell(x: float, y: float, value: float) -> str:
    strength = min(abs(value), 1.0) if math.isfinite(value) else 0.0
    css = "plus" if value > 0 else "minus"
    rect = (f'<rect class="{css}" x="{x:g}" y="{y:g}" width="{CELL - 1}" height="{CELL - 1}" '
            f'fill-opacity="{0.04 + 0.9 * strength**2:.2f}"/>')  # fmt: skip
    if strength < SHOWN:
        return rect
    text = number(value, 1 if strength < 0.95 else 2).replace("0.", ".")
    dark = ' class="strong"' if strength > 0.7 else ""
    return rect + (f'<text{dark} x="{x + CELL / 2 - 0.5:g}" y="{y + CELL / 2 + 3.5:g}" font-size="9.5" '
                   f'text-anchor="middle">{text}</text>')  # fmt: skip


def _label(what: str, unit: str) -> str:
    return f"{what} ({unit})" if unit else what
