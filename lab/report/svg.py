"""Axes with ticks, lines and bands as inline SVG.

Colours are CSS classes of the page, sizes are viewBox units.  plots.py composes the plots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

from lostmotion.lab.quantity import number, raised
from lostmotion.model.motion import FloatArray

__all__ = ["Axis", "Frame"]

LEFT, RIGHT, TOP, BOTTOM = 58, 12, 10, 42
MOST_TICKS = 6


@dataclass(frozen=True, slots=True)
class Axis:
    """An axis from low to high.  label: with the unit; log: whether it is logarithmic, low and high being positive."""

    label: str
    low: float
    high: float
    log: bool = False

    @classmethod
    def around(cls, label: str, *values: ArrayLike, log: bool = False) -> Axis:
        """An axis that contains all finite values, of a logarithmic one all positive values, with a margin."""
        flat = np.concatenate([np.ravel(np.asarray(v, dtype=float)) for v in values])
        flat = flat[np.isfinite(flat) & ((flat > 0) | (not log))]
        if flat.size == 0:
            return cls(label, 0.1 if log else 0.0, 1.0, log)
        low, high = float(flat.min()), float(flat.max())
        if log:
            return cls(label, low / 1.1, high * 1.1, log)
        room = 0.05 * (high - low) or 0.05 * abs(high) or 1.0
        return cls(label, low - room, high + room)

    def share(self, values: ArrayLike) -> FloatArray:
        """The position of values between low (0) and high (1)."""
        array = np.asarray(values, dtype=float)
        if self.log:
            array = np.log(np.maximum(array, self.low / 1e3) / self.low)
            return np.asarray(array / math.log(self.high / self.low))
        return np.asarray((array - self.low) / (self.high - self.low))

    def ticks(self) -> list[tuple[float, str]]:
        """Values and their texts: 1, 2 or 5 times a power of ten apart."""
        if self.log:
            return self._log_ticks()
        step = _step((self.high - self.low) / MOST_TICKS)
        first, last = math.ceil(self.low / step), math.floor(self.high / step)
        decimals = max(0, -math.floor(math.log10(step)))
        return [(i * step, number(i * step, decimals)) for i in range(first, last + 1)]

    def _log_ticks(self) -> list[tuple[float, str]]:
        """1, 2 and 5 in each decade where there are few decades, else every, or every so many, decades."""
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        every = max(1, math.ceil((last - first) / MOST_TICKS))
        within = (1, 2, 5) if math.log10(self.high / self.low) < MOST_TICKS / 2 else (1,)
        found = [(m * 10.0**d, _power(m, d)) for d in range(first, last + 1) if d % every == 0 for m in within]
        return [(value, text) for value, text in found if self.low <= value <= self.high]


@dataclass(frozen=True)
class Frame:
    """A plot with two axes in an SVG of width x height.  ``svg`` composes the pieces that the other methods return."""

    x: Axis
    y: Axis
    width: int = 420
    height: int = 240
    title: str = ""

    @property
    def _inside(self) -> tuple[int, int]:
        """Width and height between the axes."""
        return self.width - LEFT - RIGHT, self.height - TOP - BOTTOM

    def points(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """The SVG coordinates (N, 2) of the points with finite x and y."""
        both = np.column_stack([self.x.share(x), self.y.share(y)])
        both = both[np.all(np.isfinite(both), axis=1)]
        both[:, 1] = np.clip(both[:, 1], -0.02, 1.02)
        return np.asarray(np.array([LEFT, TOP + self._inside[1]]) + both * [self._inside[0], -self._inside[1]])

    def line(self, x: ArrayLike, y: ArrayLike, css: str) -> str:
        """A line through the points; nothing where there are none."""
        points = self.points(x, y)
        return f'<path class="line {css}" d="M{_path(points)}"/>' if points.size else ""

    def dots(self, x: ArrayLike, y: ArrayLike, css: str) -> str:
        """A dot at each point."""
        return "".join(f'<circle class="dot {css}" cx="{a:.1f}" cy="{b:.1f}" r="2.2"/>' for a, b in self.points(x, y))

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, css: str) -> str:
        """The area between two lines."""
        outline = np.concatenate([self.points(x, low), self.points(x, high)[::-1]])
        return f'<path class="band {css}" d="M{_path(outline)}Z"/>' if outline.size else ""

    def level(self, y: float, css: str) -> str:
        """A horizontal line from side to side."""
        return self.line([self.x.low, self.x.high], [y, y], css)

    def svg(self, *pieces: str) -> str:
        """The whole picture, axes and all."""
        title, (width, height) = escape(self.title), self._inside
        return (
            f'<svg class="plot" viewBox="0 0 {self.width} {self.height}" role="img" aria-label="{title}">'
            f"<title>{title}</title>{self._x_axis()}{self._y_axis()}"
            f'<svg x="{LEFT}" y="{TOP}" width="{width}" height="{height}" viewBox="{LEFT} {TOP} {width} {height}">'
            f"{''.join(pieces)}</svg></svg>"
        )

    def _x_axis(self) -> str:
        bottom = TOP + self._inside[1]
        parts = []
        for value, text in self.x.ticks():
            at = LEFT + float(self.x.share(value)) * self._inside[0]
            parts.append(f'<path class="grid" d="M{at:.1f} {TOP}V{bottom}"/>')
            parts.append(f'<text x="{at:.1f}" y="{bottom + 15}" text-anchor="middle">{text}</text>')
        middle = LEFT + self._inside[0] / 2
        parts.append(f'<text class="label" x="{middle:.1f}" y="{self.height - 7}" text-anchor="middle">'
                     f"{escape(self.x.label)}</text>")  # fmt: skip
        return "".join(parts)

    def _y_axis(self) -> str:
        parts = []
        for value, text in self.y.ticks():
            at = TOP + (1 - float(self.y.share(value))) * self._inside[1]
            parts.append(f'<path class="grid" d="M{LEFT} {at:.1f}h{self._inside[0]}"/>')
            parts.append(f'<text x="{LEFT - 5}" y="{at + 3.5:.1f}" text-anchor="end">{text}</text>')
        middle = TOP + self._inside[1] / 2
        parts.append(f'<text class="label" transform="translate(13 {middle:.1f}) rotate(-90)" text-anchor="middle">'
                     f"{escape(self.y.label)}</text>")  # fmt: skip
        return "".join(parts)


def _path(points: FloatArray) -> str:
    return "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _step(rough: float) -> float:
    """The next larger of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(m * power for m in (1, 2, 5, 10) if m * power >= rough * (1 - 1e-9))


def _power(digit: int, exponent: int) -> str:
    if -3 <= exponent <= 3:
        return f"{digit * 10.0**exponent:g}"
    return f"{'' if digit == 1 else f'{digit} × '}10{raised(str(exponent))}"
