"""The plot of a trend in the terminal, by plotext: medians, the present slope, level, change points."""

from __future__ import annotations

import numpy as np

from lostmotion.daemon.commands.trend import DAY, History
from lostmotion.drivers.terminal import blank_plot, plot_text

__all__ = ["plot"]

HEIGHT = 22
TICKS = 5


def plot(history: History) -> str:
    """The plot as text, coloured only for a terminal that wants colours."""
    wear = history.wear
    figure, width = blank_plot(f"{history.joint}: {history.what.split()[0]} over UTC", HEIGHT)
    time, score = history.medians(width - 12)
    lowest, highest = min(score.min(), 0.0), 1.05 * max(score.max(), wear.limit)
    figure.ruler("y").lim(lowest, highest)
    figure.draw(figure.segment((wear.first, wear.last), (wear.limit, wear.limit), marker="─"))
    for change in wear.change_points:  # figure.line would paint a white background
        figure.draw(figure.segment((change, change), (lowest, highest), marker="┊"))
    ends = [wear.first if wear.recent is wear.slope else wear.change_points[-1], wear.last]
    figure.draw(figure.signal(ends, [wear.recent.at(t) for t in ends], marker="braille").lines())
    figure.draw(figure.signal(time.tolist(), score.tolist(), marker="•"))
    ticks = np.linspace(wear.first, wear.last, TICKS).tolist()
    form = "%Y-%m-%d" if history.span > TICKS * DAY else "%H:%M:%S"
    figure.ruler("x").ticks(ticks, [f"{history.utc(t):{form}}" for t in ticks])
    changed = "   ┊ change" if wear.change_points else ""
    return plot_text(figure, width, f"• median   ⢕ Theil-Sen   ─ level {wear.limit:.4g}{changed}")
