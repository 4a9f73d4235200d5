"""The answers as a picture: which effect was hidden, which one was named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

from bench.hidden_effects.catalogue import INSIDE, OUTSIDE
from bench.hidden_effects.scoring import NOTHING, OUTSIDE_CATALOGUE, Score

__all__ = ["draw_confusion"]


def draw_confusion(scores: Sequence[Score], path: Path) -> None:
    """Rows: the truth; columns: the first answer.  A pair counts in both its rows, each with its own answer."""
    shown = {name for s in scores for name in s.truth}
    rows = [name for name in (*INSIDE, NOTHING, *OUTSIDE) if name in shown]
    columns = [*INSIDE, NOTHING, OUTSIDE_CATALOGUE, "no answer"]
    counts = np.zeros((len(rows), len(columns)), dtype=int)
    for s in scores:
        for name in s.truth:
            answer = name if name in s.told else (*s.told, "no answer")[0]
            counts[rows.index(name), columns.index(answer)] += 1
    figure, axis = plt.subplots(figsize=(2.5 + 0.42 * len(columns), 3.2 + 0.34 * len(rows)))
    share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    right = np.array([[row == c or (row in OUTSIDE and c == OUTSIDE_CATALOGUE) for c in columns] for row in rows])
    colours = np.where(right[..., None], mpl.colormaps["Blues"](share), mpl.colormaps["Reds"](share))
    colours[counts == 0] = 1.0
    axis.imshow(colours, aspect="auto")
    for (i, j), count in np.ndenumerate(counts):
        if count:
            colour = "white" if share[i, j] > 0.6 else "black"
            axis.text(j, i, str(count), ha="center", va="center", color=colour, fontsize=9, weight="bold")
    axis.set_xticks(range(len(columns)), [name.replace("_", " ") for name in columns], rotation=60, ha="right")
    axis.set_yticks(range(len(rows)), [name.replace("_", " ") for name in rows])
    axis.set_xlabel("answer of lab explain (of a pair: the effect itself where it was named)")
    axis.set_ylabel("hidden effect")
    axis.set_title(f"{len(scores)} recordings with a hidden effect; red: wrong answers")
    axis.set_xticks(np.arange(len(columns)) - 0.5, minor=True)
    axis.set_yticks(np.arange(len(rows)) - 0.5, minor=True)
    axis.grid(which="minor", color="0.9")
    axis.tick_params(which="minor", length=0)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    plt.close(figure)
