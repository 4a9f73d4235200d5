"""The small curves of the first page: how a joint has done over the last months, as one path of SVG."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from lostmotion.daemon import times
from lostmotion.daemon.extremes import EXTREMES
from lostmotion.daemon.reader import Reader
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


def spark(reader: Reader, joint: str, span: timedelta, limit: float) -> Spark:
    """The median severities of a joint in equal pieces of the time until its newest window; of its scores where no
    window has a severity.

    limit: severity [rad] of a warning, up to which the scale reaches at least, so that noise does not look like wear.
    """
    extent = reader.extent(joint)
    if extent is None:
        return Spark("", "no history yet")
    since = max(extent[0], extent[1] - span)
    rows = reader.extremes(joint, since, extent[1] + timedelta(microseconds=1), PIECES)
    columns = dict(zip(EXTREMES, np.array(rows, dtype=float).T, strict=True))
    of = SEVERITY if np.isfinite(columns["severity_median"]).any() else SCORE
    time, value = columns["time_us"], columns[f"{of}_median"]
    known = np.isfinite(value)
    if np.count_nonzero(known) < 2:
        return Spark("", "too little history for a curve")
    words = f"{of} over the last {times.span((extent[1] - since).total_seconds())}"
    top = limit if of == SEVERITY else float(np.max(columns["level"]))
    return Spark(_path(time[known], value[known], top), words)


def _path(time: FloatArray, value: FloatArray, top: float) -> str:
    highest = max(float(value.max()), top)
    x = (time - time[0]) / max(time[-1] - time[0], 1) * WIDTH
    y = (1 - value / highest) * (HEIGHT - 2) + 1
    return "M" + " L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
