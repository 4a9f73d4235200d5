"""The small curves of the first page: how a joint has done over the last months, as one path of SVG."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from lostmotion.daemon.reader import EXTREMES, Reader
from lostmotion.detector.window import FloatArray

__all__ = ["HEIGHT", "WIDTH", "Spark", "spark"]

WIDTH, HEIGHT = 120, 28
PIECES = 60
SEVERITY, SCORE = "severity", "score"


@dataclass(frozen=True, slots=True)
class Spark:
    """path: SVG's ``d``, from (0, 0) to (WIDTH, HEIGHT); words: the text for a screen reader."""

    path: str
    words: str


def spark(reader: Reader, joint: str, span: timedelta) -> Spark:
    """The largest severities of a joint in equal pieces of the time until its newest window, on a logarithmic scale;
    of the scores where no window has a severity."""
    extent = reader.extent(joint)
    if extent is None:
        return Spark("", "no history yet")
    since = max(extent[0], extent[1] - span)
    rows = reader.extremes(joint, since, extent[1] + timedelta(microseconds=1), PIECES)
    columns = dict(zip(EXTREMES, np.array(rows, dtype=float).T, strict=True))
    of = SEVERITY if np.isfinite(columns["severity_high"]).any() else SCORE
    time, value = columns["time_us"], columns[f"{of}_high"]
    known = np.isfinite(value) & (value > 0)
    if np.count_nonzero(known) < 2:
        return Spark("", "too little history for a curve")
    words = f"{of} over the last {_days(extent[1] - since)}"
    return Spark(_path(time[known], np.log(value[known])), words)


def _path(time: FloatArray, value: FloatArray) -> str:
    low, high = float(value.min()), float(value.max())
    if high - low < math.log(2):  # noise is not drawn as if it were wear
        middle = (low + high) / 2
        low, high = middle - math.log(2) / 2, middle + math.log(2) / 2
    x = (time - time[0]) / max(time[-1] - time[0], 1) * WIDTH
    y = (high - value) / (high - low) * (HEIGHT - 2) + 1
    return "M" + " L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))


def _days(span: timedelta) -> str:
    days = span.total_seconds() / 86400
    return f"{days:.0f} days" if days >= 2 else f"{max(days * 24, 0.1):.2g} hours"
