"""Pictures of receiver operating characteristics."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from bench.roc.trials import BOUNDS, Outcome

mpl.use("Agg")
import matplotlib.pyplot as plt

__all__ = ["draw"]

FloatArray = NDArray[np.float64]
STYLES = {
    BOUNDS[0]: ("0.6", "--", "knows all"),
    BOUNDS[2]: ("0.3", ":", "knows all but when"),
    "ring-down, calibrated": ("#b2182b", "-", ""),
    "ring-down, own noise": ("#ef8a62", "-", ""),
    "eq. 8": ("#2166ac", "-", ""),
    "RMS": ("#1b7837", "-", "RMS, f_res ± 20 %"),
    "peak": ("#e08214", "-", "peak, f_res ± 20 %"),
    "envelope": ("#762a83", "-", "envelope, f_res ± 20 %"),
    "spectral kurtosis": ("0.75", "-", ""),
}
"""Colour, line and label (the rival's own name where it is empty)."""
SHOWN = ("1 kHz, 58 Hz", "200 Hz, 58 Hz")


def draw(outcomes: list[Outcome], folder: Path) -> None:
    """roc.png: two conditions at 15 dB, side by side."""
    chosen = [outcome for outcome in outcomes if outcome.condition.name in SHOWN]
    figure, axes = plt.subplots(1, len(chosen), figsize=(4.6 * len(chosen), 4.2), sharey=True, squeeze=False)
    for axis, outcome in zip(axes[0], chosen, strict=True):
        for name, (colour, style, label) in STYLES.items():
            alarms, found = curve(outcome.healthy[name], outcome.worn[name])
            axis.plot(alarms, found, color=colour, ls=style, label=label or name, lw=1.8 if style == "-" else 1.3)
        axis.set_xscale("log")
        axis.set_xlim(1e-3, 1)
        axis.set_ylim(0, 1)
        axis.set_xlabel("false alarms")
        axis.set_title(f"{outcome.condition.name}, SNR 15 dB", fontsize=10)
        axis.grid(alpha=0.2, which="both")
    axes[0, 0].set_ylabel("impacts found")
    axes[0, -1].legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "roc.png", dpi=90)
    plt.close(figure)


def curve(healthy: FloatArray, worn: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rates of false alarms and of found ones at each level."""
    levels = np.sort(healthy)[::-1]
    alarms = np.arange(1, levels.size + 1) / levels.size
    return alarms, 1 - np.searchsorted(np.sort(worn), levels, side="left") / worn.size
