"""The report's still pictures: spectra, residual curves with a band, the heat map of correlations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from lostmotion.lab.quantity import number, scale
from lostmotion.lab.report.svg import Axis, Frame
from lostmotion.lab.report.views import Spectra
from lostmotion.model.motion import FloatArray

__all__ = ["curve", "heat_map", "spectrum", "stems"]

CELL = 30
SHOWN = 0.3
"""Correlations are written into their cell from this size on."""


def spectrum(spectra: Spectra) -> str:
    """Measured, modelled, residual and noise over frequency, both axes logarithmic."""
    overlay = spectra.overlay
    shown = scale(overlay.unit, float(np.max(spectra.measured)))
    lines = {"measured": spectra.measured, "modelled": spectra.modelled, "residual": spectra.residual}
    lines = {name: values * shown.factor for name, values in lines.items()}
    floor = spectra.noise * shown.factor
    largest = max(float(np.max(values)) for values in lines.values()) or 1.0
    quietest = [v for v in (floor / 3, float(np.quantile(lines["residual"], 0.05)) / 2) if v > 0]
    lowest = min(max(min(quietest, default=0.0), largest / 1e7), largest / 10)
    y = Axis(f"{overlay.what} ({shown.unit}/√Hz)", lowest, 1.5 * largest, log=True)
    x = Axis("frequency (Hz)", float(spectra.frequency[0]), float(spectra.frequency[-1]), log=True)
    frame = Frame(x, y, title=f"Spectra of {overlay.what}, {overlay.recording}")
    noise = frame.level(floor, "noise") if floor > 0 else ""
    return frame.svg(noise, *(frame.line(spectra.frequency, values, name) for name, values in lines.items()))


def curve(
    title: str, x: FloatArray, mean: FloatArray, low: FloatArray, high: FloatArray, labels: tuple[str, str],
    units: tuple[str, str],
) -> str:  # fmt: skip
    """A mean over a variable with a 95 % band, each (K,); labels and SI units of the variable and of the mean."""
    across = scale(units[0], *x)
    up = scale(units[1], *mean, *low, *high)
    x, mean, low, high = x * across.factor, mean * up.factor, low * up.factor, high * up.factor
    ordinate = Axis.around(_label(labels[1], up.unit), mean, low, high, [0.0])
    frame = Frame(Axis.around(_label(labels[0], across.unit), x), ordinate, title=title)
    pieces = (frame.band(x, low, high, "residual"), frame.line(x, mean, "residual"), frame.dots(x, mean, "residual"))
    return frame.svg(frame.level(0.0, "zero"), *pieces)


def stems(title: str, lags: FloatArray, values: FloatArray, bound: float) -> str:
    """Correlations (K,) at lags (K,) [samples], and the band that noise stays in."""
    lags = np.asarray(lags, dtype=float)
    ordinate = Axis.around("correlation", values, [-1.2 * bound, 1.2 * bound])
    frame = Frame(Axis.around("lag (samples)", lags), ordinate, title=title)
    ends = [frame.x.low, frame.x.high]
    lines = [frame.line([lag, lag], [0.0, value], "residual") for lag, value in zip(lags, values, strict=True)]
    return frame.svg(frame.band(ends, [-bound] * 2, [bound] * 2, "residual"), frame.level(0.0, "zero"), *lines)


def heat_map(names: Sequence[str], matrix: FloatArray) -> str:
    """Correlations (P, P), blue for negative and red for positive ones, those that matter as numbers."""
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
    """A parameter with itself says nothing: only the place."""
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
