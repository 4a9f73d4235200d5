"""Draws the paper's figures 1, 2, 4 and 5 from the model into docs/figures: `python -m bench.figures`.

The paper gives no values but the 6 Hz of its sine.  These are the defaults of the base `play` (AX-12A-like); figures 1
and 2 have a quarter of its play and a sine of 0.1 rad, so that the sine can still be seen below the impacts.  Figures 4
and 5 are ``table1_figures``'.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from bench.table1_figures import draw_spectra
from lostmotion.model import Motion, Sine, Trajectory, build_model

__all__ = ["main"]

FOLDER = Path(__file__).parent.parent / "docs" / "figures"
DRIVEN, PLAIN, GREY = "#b2182b", "#2166ac", "0.6"
SHOWN = (1.0, 1.5)
"""The segment [s] of figures 1 and 2: three periods, long after the start."""
WITHOUT_PLAY = 1e-8
"""Play [m] of a joint that has none: its impacts are lost in the noise."""
SINE, PLAY = Sine(6.0, 0.1), 2e-5
"""Motion and play [m] of figures 1 and 2."""


def simulated(play: float, motion: Motion) -> Trajectory:
    """Eight seconds at 2 kHz of the default joint with a play [m]."""
    return build_model("play", (), {"d": play}).simulate(motion, np.arange(16_001) / 2000)


def figure_1() -> Figure:
    """Response of the gears to a sine: impacts are peaks of the angular acceleration."""
    run = simulated(PLAY, SINE)
    lost = 1e3 * (run["position"] - run["command"])
    free = 1e3 * PLAY / 2 / build_model("play").parameters["R2"].value
    t = run.time - SHOWN[0]
    figure, axes = plt.subplots(3, 1, figsize=(8, 8.5), sharex=True, height_ratios=(1, 1, 1.6))
    axes[0].plot(t, 1e3 * run["command"], color=PLAIN, label=r"gear 1, $\theta_1$ (the command)")
    axes[0].plot(t, 1e3 * run["position"], color=DRIVEN, label=r"gear 2, $\theta_2$")
    axes[0].set_ylabel("angle [mrad]")
    axes[0].set_title(
        f"Figure 1: gears with {2 * free:.0f} mrad of play under a sine of 6 Hz, {1e3 * SINE.amplitude_rad:.0f} mrad"
    )
    axes[1].plot(t, lost, color="k", label=r"$\theta_2-\theta_1=\Delta d/R$")
    axes[1].axhspan(-free, free, color=GREY, alpha=0.25, label=r"within the play, $\pm d/2R$")
    axes[1].set_ylabel("lost motion [mrad]")
    axes[2].plot(t, run["acceleration"], color=DRIVEN, label=r"gear 2, $\omega_2'$")
    axes[2].plot(
        t, SINE.acceleration(run.time), color=PLAIN, label=r"gear 1, $\omega_1'$: what it would be without play"
    )
    axes[2].set_ylabel("angular acceleration [rad/s²]")
    finish(axes)
    return figure


def figure_2() -> Figure:
    """Acceleration of the bar's free end: the ripple that the impacts leave on the sine."""
    play, none = simulated(PLAY, SINE), simulated(WITHOUT_PLAY, SINE)
    t = play.time - SHOWN[0]
    figure, axes = plt.subplots(2, 1, figsize=(8, 6.5), sharex=True, height_ratios=(1, 2))
    axes[0].plot(t, 1e3 * play["displacement"], color=DRIVEN, label="with play")
    axes[0].plot(t, 1e3 * none["displacement"], color=PLAIN, label="without")
    axes[0].set_ylabel("deflection q [mm]")
    axes[0].set_title("Figure 2: the bar's free end under the same sine; it rings at 58 Hz after each impact")
    axes[1].plot(t, play["accel"], color=DRIVEN, label="with play")
    axes[1].plot(t, none["accel"], color=PLAIN, label="without")
    axes[1].set_ylabel(r"tip acceleration $q''+\omega_2' l$ [m/s²]")
    finish(axes)
    return figure


def finish(axes: np.ndarray) -> None:
    """What the figures over time share: reversals of the commanded acceleration, grid, legends, limits."""
    times = np.linspace(SHOWN[0] + 1e-3, SHOWN[1] - 1e-3, 5001)
    commanded = SINE.acceleration(times)
    reversals = times[1:][np.diff(np.sign(commanded)) != 0] - SHOWN[0]
    for axis in axes:
        for i, reversal in enumerate(reversals):
            axis.axvline(
                reversal,
                color=GREY,
                lw=0.8,
                ls="--",
                label="reversal of the commanded acceleration" if i == 0 else None,
            )
        axis.grid(alpha=0.2)
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.2 * (high - low))  # room for the legend
        axis.legend(loc="upper right", fontsize=8, ncols=3, framealpha=0.9)
    axes[-1].set_xlim(0, SHOWN[1] - SHOWN[0])
    axes[-1].set_xlabel("time [s]")


def write(figures: dict[int, Figure], folder: Path) -> None:
    """Each as figN.png."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, figure in figures.items():
        figure.tight_layout()
        path = folder / f"fig{number}.png"
        figure.savefig(path, dpi=110)
        print(path)


def main() -> None:
    """Writes fig1.png, fig2.png, fig4.png and fig5.png."""
    write({1: figure_1(), 2: figure_2()}, FOLDER)
    draw_spectra(FOLDER)


if __name__ == "__main__":
    main()
