"""Draws the bar of docs/building.md and prints its table of lengths: `python -m bench.building`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Rectangle

from lostmotion.detector.cantilever import MATERIALS, length_for, rectangle, rod

__all__ = ["FREQUENCIES_HZ", "SECTIONS", "TIPS_G", "main", "table"]

FIGURE = Path(__file__).parent.parent / "docs" / "figures" / "bar.svg"
SECTIONS = {
    "steel, 10 x 1 mm": rectangle(MATERIALS["steel"], 10e-3, 1e-3),
    "aluminium, 15 x 2 mm": rectangle(MATERIALS["aluminium"], 15e-3, 2e-3),
    "carbon rod, 3 mm": rod(MATERIALS["carbon"], 3e-3),
}
TIPS_G = (1, 5, 12)
FREQUENCIES_HZ = (20, 25, 40, 58, 80, 100)
STEEL, GREY, RED, BLUE = "#5b6770", "#c9ced2", "#b2182b", "#2166ac"


def table() -> Iterator[str]:
    """The lengths [mm] by frequency, section and mass of the sensor, as Markdown."""
    yield "| bar | sensor | " + " | ".join(f"{f} Hz" for f in FREQUENCIES_HZ) + " |"
    yield "|---" * (2 + len(FREQUENCIES_HZ)) + "|"
    for name, beam in SECTIONS.items():
        for tip in TIPS_G:
            cells = (f"{length_for(beam, f, tip * 1e-3) * 1e3:.0f}" for f in FREQUENCIES_HZ)
            yield f"| {name} | {tip} g | " + " | ".join(cells) + " |"


def drawing() -> Figure:
    """The bar on a joint, from the side of its axis."""
    figure, axes = plt.subplots(figsize=(9, 4.2))
    _arm(axes)
    _bar(axes)
    _dimension(axes, (62, 162), 33, "L: free length, rings at f_res")
    _dimension(axes, (0, 162), -34, "lever: axis of the joint to the sensor (levers_m)")
    axes.set(xlim=(-32, 205), ylim=(-48, 60), aspect="equal")
    axes.axis("off")
    return figure


def _arm(axes: Axes) -> None:
    axes.add_patch(Rectangle((0, -12), 62, 24, facecolor=GREY, edgecolor=STEEL))
    axes.add_patch(Circle((0, 0), 18, facecolor="white", edgecolor=STEEL, linewidth=1.5))
    axes.add_patch(Circle((0, 0), 2.5, facecolor=STEEL))
    axes.add_patch(Arc((0, 0), 52, 52, theta1=120, theta2=240, color=RED, linewidth=1.5))
    axes.annotate("", (-13.5, 22.3), (-12.5, 22.9), arrowprops={"arrowstyle": "->", "color": RED})
    axes.text(0, 34, "joint", ha="center", color=RED)
    axes.text(26, -10, "link", ha="center", color=STEEL)


def _bar(axes: Axes) -> None:
    axes.add_patch(Rectangle((30, -1), 132, 2, facecolor=STEEL))
    for low in (1, -7):
        axes.add_patch(Rectangle((34, low), 28, 6, facecolor="white", edgecolor=STEEL, hatch="////"))
    for x in (41, 55):
        axes.plot((x, x), (-10, 10), color=STEEL, linewidth=3)
    axes.add_patch(Rectangle((150, 1), 12, 5, facecolor=BLUE))
    axes.annotate("", (156, 24), (156, 8), arrowprops={"arrowstyle": "->", "color": BLUE})
    axes.text(160, 19, "sensor's axis: tangential,\nacross the bar's thin side", color=BLUE, va="center", fontsize=9)
    axes.plot((150, 120, 90, 64, 50, 30), (3.4, 2.6, 2.6, 2.6, 14, 16), color=BLUE, linewidth=1)
    axes.text(
        48, 47, "clamp: two stiff plates, two screws;\ncable taped along the bar, a loop at the clamp", fontsize=9
    )
    axes.annotate("", (48, 9), (60, 45), arrowprops={"arrowstyle": "-", "color": STEEL, "linewidth": 0.7})


def _dimension(axes: Axes, ends: tuple[float, float], height: float, text: str) -> None:
    for x in ends:
        axes.plot((x, x), (height - 3, height + 3), color="black", linewidth=0.7)
    axes.annotate("", (ends[0], height), (ends[1], height), arrowprops={"arrowstyle": "<->", "linewidth": 0.8})
    axes.text(sum(ends) / 2, height + 2, text, ha="center", va="bottom", fontsize=9)


def main() -> None:
    """Prints the table, and writes the drawing."""
    print("\n".join(table()))
    mpl.rcParams |= {"svg.hashsalt": "lostmotion", "svg.fonttype": "path", "font.size": 10}
    drawing().savefig(FIGURE, metadata={"Date": None}, bbox_inches="tight")


if __name__ == "__main__":
    main()
