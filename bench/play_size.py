"""How well the size of the play is estimated: `python -m bench.play_size` (`--quick`: a representative part, 3
minutes).

Recordings of twelve seconds, sampled at 1 kHz: eq. 1 with other inertias, exponents and dampings, hard stops with other
restitutions, friction and bars (``joints``), and MuJoCo; motions from hand-waved to trapezoidal; commands of an AX-12A
(0.29°, 100 Hz); gears of 10 mm, a bar of 58 Hz.  Nothing is set quite right: the resonance by 0.3 %, the lever by 1 %,
a delay of 1.5 ms, an offset of 0.05 m/s² (standard deviations, drawn for each recording).  Seeds used nowhere else.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from bench.joints import F_RES_HZ, LENGTH_M, RADIUS_M, Gear, Lagging, motion_of, tip
from bench.roc.waveforms import POLL_HZ, STEP_RAD
from lostmotion.detector.pooling import PlaySize, pooled
from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings, Score
from lostmotion.model import Motion

__all__ = ["CELLS", "Cell", "Summary", "recorded", "summary_of"]

RECORD_S, RATE_HZ = 13.0, 1000.0
TUNED, LEVER, DELAY_S, OFFSET = 0.003, 0.01, 0.0015, 0.05
LAG_HZ = 12.0
"""Corner of the servo that lags: 26 ms."""


@dataclass(frozen=True)
class Cell:
    """One row of the table: a gear, a motion of ``joints.motion_of`` (or "... lagging") and the sensor's noise."""

    gear: Gear
    motion: str
    noise: float = 0.1

    def __str__(self) -> str:
        g = self.gear
        if g.kind == "eq1":
            name = f"eq. 1, J2 x {g.inertia:g}, n {g.exponent}, alpha x {g.alpha:g}"
        else:
            stops = "MuJoCo" if g.kind == "mujoco" else "stops"
            name = f"{stops}, restitution {g.restitution:g}, friction {g.friction:g}, reaction {g.reaction:g}"
        return f"{name} | {self.motion} | {self.noise:g}"


@dataclass(frozen=True)
class Summary:
    """Results of a cell for one play: windows, those with a size, median error, pooled size, share of intervals that
    hold."""

    windows: int
    values: int
    error: float
    together: PlaySize
    covered: float


SOFT = [Gear("eq1"), Gear("eq1", inertia=10.0), Gear("eq1", inertia=0.1), Gear("eq1", exponent=5),
        Gear("eq1", exponent=31), Gear("eq1", alpha=10.0)]  # fmt: skip
HARD = [Gear(), Gear(restitution=0.0), Gear(restitution=0.6), Gear(restitution=0.9), Gear(friction=2.0),
        Gear(reaction=0.25), Gear("mujoco", reaction=0.25)]  # fmt: skip
CELLS = [
    *(Cell(gear, motion) for gear in SOFT for motion in ("hand", "sines6")),
    *(Cell(gear, motion) for gear in HARD for motion in ("hand", "sines6")),
    *(Cell(Gear(reaction=0.25, friction=1.0), m) for m in ("sines2", "sines10", "trapezoid", "least-jerk")),
    *(Cell(Gear(), m) for m in ("hand lagging", "sines2 lagging")),
    *(Cell(gear, "sines6", noise) for gear in (Gear("eq1"), Gear(reaction=0.25)) for noise in (0.02, 0.5)),
]
QUICK = [0, 2, 5, 12, 18, 23, 24, 25, 27, 28, 31, 32]
PLAYS, QUICK_PLAYS = (5e-6, 10e-6, 20e-6, 50e-6, 200e-6, 1000e-6), (10e-6, 50e-6)
SEEDS, QUICK_SEEDS = range(8700, 8704), range(8700, 8702)


def recorded(seed: int, play_m: float, cell: Cell, known: bool = False, seconds: float = RECORD_S) -> list[Score]:
    """The windows with an impact of one recording; known: the settings give the gear's A and n."""
    rng = np.random.default_rng([seed, round(play_m * 1e7)])
    motion: Motion = motion_of(cell.motion.split()[0], seed)
    moved = Lagging(motion, LAG_HZ).followed if "lagging" in cell.motion else motion
    times = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    accel = tip(moved, times, play_m, cell.gear) + rng.normal(0, cell.noise, times.size) + rng.normal(0, OFFSET)
    settings = DetectorSettings(
        f_res_hz=F_RES_HZ * (1 + TUNED * rng.normal()),
        noise_ms2=cell.noise,
        length_m=LENGTH_M * (1 + LEVER * rng.normal()),
    )
    if known:
        soft = cell.gear.kind == "eq1"
        settings = replace(settings, flank_exponent=float(cell.gear.exponent) if soft else 1e4,
                           contact_accel=1000.0 / cell.gear.inertia)  # fmt: skip
    polls = np.arange(0, seconds, 1 / POLL_HZ)
    commands = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
    late = rng.normal(0, DELAY_S)
    return [score for score in score_series(polls - late, commands, times, accel, settings) if score.impact]


def summary_of(
    cell: Cell, play_m: float, seeds: Iterable[int], known: bool = False, seconds: float = RECORD_S
) -> Summary:
    """The results for the windows of all recordings."""
    scores = [score for seed in seeds for score in recorded(seed, play_m, cell, known, seconds)]
    sized = [score for score in scores if math.isfinite(score.play)]
    truth = play_m / RADIUS_M
    together = pooled([s.play for s in sized], [(s.play_high - s.play_low) / 2 for s in sized])
    error = float(np.median([abs(s.play / truth - 1) for s in sized])) if sized else math.nan
    covered = float(np.mean([s.play_low <= truth <= s.play_high for s in sized])) if sized else math.nan
    return Summary(len(scores), len(sized), error, together, covered)


def main() -> None:
    """A row for each cell and play."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a representative part")
    quick = parser.parse_args().quick
    print("| gear | motion | noise [m/s²] | play [µm] | windows | estimated | median error | pooled | its interval "
          "| covered | pooled, gear known | covered |\n|" + "---|" * 12)  # fmt: skip
    for cell in [CELLS[i] for i in QUICK] if quick else CELLS:
        for play in QUICK_PLAYS if quick else PLAYS:
            seeds, truth = QUICK_SEEDS if quick else SEEDS, play / RADIUS_M
            one, known = summary_of(cell, play, seeds), summary_of(cell, play, seeds, known=True)
            ends = f"{_share(one.together.low / truth - 1)} to {_share(one.together.high / truth - 1)}"
            print(f"| {cell} | {play * 1e6:.0f} | {one.windows} | {one.values / max(one.windows, 1):.0%} "
                  f"| {_share(one.error, '')} | {_share(one.together.value / truth - 1)} | {ends} "
                  f"| {_share(one.covered, '')} | {_share(known.together.value / truth - 1)} "
                  f"| {_share(known.covered, '')} |", flush=True)  # fmt: skip


def _share(value: float, sign: str = "+") -> str:
    """In per cent, or - where there is no size."""
    return f"{value:{sign}.0%}" if math.isfinite(value) else "-"


if __name__ == "__main__":
    main()
