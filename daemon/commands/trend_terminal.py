"""The plot of a trend in the terminal, by plotext: medians, the present slope, level, change points."""

from __future__ import annotations

import shutil

import numpy as np

from lostmotion.daemon.commands.trend import DAY, History
from lostmotion.drivers.terminal import has_colours

__all__ = ["plot"]

HEIGHT = 22
TICKS = 5


def plot(history: History) -> str:
    """The plot as text, coloured only for a terminal that wants colours."""
    import plotext

    width = min(shutil.get_terminal_size((100, HEIGHT)).columns, 120)
    plain = not has_colours()
    wear = history.wear
    figure = plotext.figure
    figure.clear()
    figure.plot_size(width, HEIGHT)
    figure.theme("colorless" if plain else "simple")
    figure.canvas("default")
    figure.title(f"{history.joint}: {history.what.split()[0]} over UTC")
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
    legend = f"• median   ⢕ Theil-Sen   ─ level {wear.limit:.4g}{changed}"
    return f"{str(figure.build().string(colorless=plain)).strip(chr(10))}\n{legend:^{width}}".rstrip()
