"""Pictures of table 1 and the spectra of its windows, the paper's figures 4 and 5.  Computes no score."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from bench.roc.waveforms import FloatArray
from bench.table1 import (
    F_RES_HZ,
    HEALTHY_M,
    NAMES,
    PLAY_M,
    SNR_DB,
    STATISTICS,
    TESTED,
    Cell,
    measured,
    settings,
)
from lostmotion.detector.spectrum import amplitudes, transform

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

__all__ = ["draw", "draw_spectra"]

COLOURS = ("#2166ac", "#1b7837", "#e08214", "#b2182b")
STYLES = {200.0: "-", 1000.0: "--"}
RATE_HZ, SPECTRUM_DB, LOUD_DB = 200.0, 50.0, (20.0, 30.0, 50.0)
"""Figures 4 and 5 show these rows of the table."""


def draw(found: Sequence[Cell], folder: Path) -> None:
    """table1.png: wrong answers, half of both kinds, over the SNR."""
    figure, axes = plt.subplots(1, 2, figsize=(9.4, 4.2), sharey=True)
    for axis, statistic in zip(axes, STATISTICS, strict=True):
        for play, colour in zip(HEALTHY_M, COLOURS, strict=True):
            for rate, style in STYLES.items():
                row = [c for c in found if (c.statistic, c.rate_hz, c.healthy_m) == (statistic, rate, play)]
                wrong = [100 * (1 - sum(c.youden) / (2 * c.count)) for c in row]
                least = 100 / (4 * row[0].count)
                label = f"healthy: {play * 1e6:g} µm, {rate:g} Hz"
                axis.plot(
                    [c.snr_db for c in row], np.maximum(wrong, least), style, color=colour, marker=".", label=label
                )
        axis.axhline(1.0, color="0.6", lw=0.8)
        axis.text(SNR_DB[-1], 1.05, "paper: 1 %", color="0.4", fontsize=8, ha="right", va="bottom")
        axis.set_yscale("log")
        axis.set_xlabel("SNR of a play of 80 µm [dB]")
        axis.set_title(NAMES[statistic], fontsize=10)
        axis.grid(alpha=0.2, which="both")
    axes[0].set_ylabel("wrong answers [%] (lowest: none)")
    axes[1].legend(fontsize=6.5, loc="upper right")
    _write(figure, folder / "table1.png")


def draw_spectra(folder: Path) -> None:
    """fig4.png and fig5.png: spectra of windows of the table, as eq. 8 takes them, root mean square over all."""
    figure, axis = _axes(f"Figure 4: without play, and with little (SNR {SPECTRUM_DB:g} dB, {RATE_HZ:g} Hz)")
    for play, colour in zip(HEALTHY_M, COLOURS, strict=True):
        _spectrum(axis, measured(RATE_HZ, SPECTRUM_DB, play, TESTED), f"play {play * 1e6:g} µm", colour)
    axis.legend(loc="upper left", fontsize=8)
    _write(figure, folder / "fig4.png")
    figure, axis = _axes(f"Figure 5: with play of {PLAY_M * 1e6:g} µm ({RATE_HZ:g} Hz)")
    for snr, colour in zip(LOUD_DB, ("0.6", "#ef8a62", "#b2182b"), strict=True):
        _spectrum(axis, measured(RATE_HZ, snr, PLAY_M, TESTED), f"SNR {snr:g} dB", colour)
    axis.legend(loc="upper left", fontsize=8)
    _write(figure, folder / "fig5.png")


def _axes(title: str) -> tuple[plt.Figure, Axes]:
    """With the bands of eqs. 8 and 10 shaded; both figures have the same scale."""
    figure, axis = plt.subplots(figsize=(8, 4))
    chosen = settings("band", RATE_HZ, np.empty((0, 0)))
    half = chosen.f_width_hz / 2
    axis.axvspan(F_RES_HZ - half, F_RES_HZ + half, color="0.6", alpha=0.25, lw=0)
    axis.text(F_RES_HZ, 18, "mask", ha="center", fontsize=8)
    low, high = (chosen.f_norm_hz + side * chosen.f_norm_width_hz / 2 for side in (-1, 1))
    axis.axvspan(low, min(high, RATE_HZ / 2), color="0.8", alpha=0.25, lw=0)
    axis.text((low + min(high, RATE_HZ / 2)) / 2, 18, "norm", ha="center", fontsize=8)
    axis.set(xlim=(0, RATE_HZ / 2), ylim=(1e-2, 30), yscale="log", title=title)
    axis.set_xlabel("frequency [Hz]")
    axis.set_ylabel("amplitude [m/s²]")
    axis.grid(alpha=0.2, which="both")
    return figure, axis


def _spectrum(axis: Axes, windows: FloatArray, label: str, colour: str) -> None:
    length = windows.shape[1]
    bins = np.arange(1, length // 2)
    axis.plot(bins * RATE_HZ / length, _rms(amplitudes(windows, transform(length, bins))), color=colour, label=label)


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def _write(figure: plt.Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)
    print(path)
