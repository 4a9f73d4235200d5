"""The plot of a trend as a picture, by matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.daemon.commands.trend import DAY, History
from lostmotion.detector.trend import Slope
from lostmotion.detector.window import FloatArray
from lostmotion.drivers.recording import replaced

__all__ = ["draw"]

DateArray = NDArray[np.datetime64]
Axes = Any  # matplotlib's, which is imported when a picture is asked for

MANY = 500
SMOOTH, IMPACT, LINE, LEVEL = "#8fa3b3", "#d98b5f", "#1f4e79", "#b3261e"


def draw(history: History, path: Path) -> None:
    """Writes the picture, in the form that the suffix names.  Raises RecordingError."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 5.5), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _scores(axes, history)
    _trend(axes, history)
    _finish(axes, history)
    figure.legend(loc="outside lower center", ncols=4, fontsize="small", frameon=False, markerscale=2.5)
    with replaced(path) as part:
        figure.savefig(part, format=path.suffix.removeprefix(".").lower())


def _scores(axes: Axes, history: History) -> None:
    size = 4 if history.time.size > MANY else 8
    for impact, colour, label in ((False, SMOOTH, "window without impact"), (True, IMPACT, "window with impact")):
        which = history.impact == impact
        if which.any():
            when, score = _dates(history, history.time[which]), history.value[which]
            axes.plot(when, score, ".", ms=size, mec="none", alpha=0.6, color=colour, label=label)
    days = history.span / DAY
    pieces, name = (round(days), "daily median") if days >= 10 else (60, "median of a 60th of the time")
    time, score = history.medians(pieces)
    axes.plot(_dates(history, time), score, color="black", lw=1, label=name)


def _trend(axes: Axes, history: History) -> None:
    wear = history.wear
    if wear.recent is wear.slope:
        _line(axes, history, wear.slope, wear.first, "-", "Theil-Sen slope, 95 %")
    else:
        _line(axes, history, wear.slope, wear.first, "--", "Theil-Sen slope of all, 95 %")
        _line(axes, history, wear.recent, wear.change_points[-1], "-", "Theil-Sen slope since the last change, 95 %")
    axes.axhline(wear.limit, color=LEVEL, lw=1.5, ls="--", label=f"level {wear.limit:.4g}")
    if wear.change_points:
        when, across = _dates(history, np.array(wear.change_points)), axes.get_xaxis_transform()
        axes.vlines(when, 0, 1, transform=across, color="0.3", lw=1, ls=":", label="change")


def _line(axes: Axes, history: History, slope: Slope, begin: float, style: str, label: str) -> None:
    """A slope from ``begin`` [s] on, and the band between the ends of its interval, turned about the median point."""
    time = np.array([begin, min(max(slope.centre, begin), history.wear.last), history.wear.last])
    middle, when = slope.at(slope.centre), _dates(history, time)
    low, high = (middle + rate * (time - slope.centre) for rate in (slope.low, slope.high))
    axes.fill_between(when, np.minimum(low, high), np.maximum(low, high), color=LINE, alpha=0.2, lw=0)
    axes.plot(when, [slope.at(t) for t in time], style, color=LINE, lw=2, label=label)


def _dates(history: History, time: FloatArray) -> DateArray:
    """UTC of times [s], shape (N,), as matplotlib takes it."""
    start = np.datetime64(history.start.replace(tzinfo=None), "us")
    return np.asarray(start + np.round(time * 1e6).astype("timedelta64[us]"))


def _finish(axes: Axes, history: History) -> None:
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator()  # type: ignore[no-untyped-call]
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
    axes.set_xlabel("time (UTC)")
    axes.set_ylabel(history.what)
    top = max(float(history.value.max()), history.wear.limit)
    axes.set_ylim(min(0.0, float(history.value.min())), 1.08 * top)
    trend = history.wear.trend
    found = f"{trend.direction}, p = {trend.p_value:.2g}" if trend.direction != "none" else "no trend"
    axes.set_title(f"{history.joint}: {history.wear.count} {history.many}, {found}", loc="left")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
