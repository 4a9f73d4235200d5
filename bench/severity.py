"""How well each figure measures the severity of play: `python -m bench.severity [--rate 200] [--found] [--quick]`.

Four motions, gears of 10 mm with 2 to 1000 um of play, commands of an AX-12A (0.29°, 100 Hz), a bar of 58 Hz whose
setting is 0.3 % off; three simulators: eq. 1, MuJoCo's hard stops (nothing was fitted to it), and ``hardstops`` with a
restitution of 0.3, friction and a bar of 5 g.  Seeds used nowhere else.  Spearman's correlation with the true play, of
single windows and of medians of ten, over all motions together; the median of each figure; how many of the 95 %
intervals hold the truth.  With --found instead: how often each figure is above the level
that 1 % of healthy windows of the same motion exceed, for smooth motions and for trapezoids.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.stats import spearmanr

from bench.hardstops import MOTIONS, hard_stops
from bench.roc.waveforms import POLL_HZ, RADIUS_M, STEP_RAD, Bar, FloatArray, tip, tip_without_play
from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings, Score

SEEDS = range(8400, 8402)
PLAYS = (2e-6, 5e-6, 10e-6, 30e-6, 60e-6, 100e-6, 300e-6, 1000e-6)
FIGURES = ("band", "ringdown", "severity")
SMOOTH = tuple(name for name in MOTIONS if name != "trapezoids")
GROUPS = (SMOOTH, ("trapezoids",))
Limits = dict[str, tuple[FloatArray, ...]]
FALSE = 0.01
HEALTHY_SEEDS = range(8500, 8510)
RECORD_S, TOGETHER = 13.0, 10


def recorded(simulator: str, motion_name: str, seed: int, play_m: float, bar: Bar, noise: float) -> list[Score]:
    """The scores of one recording, of a joint without play where it is 0; the first second is left out."""
    motion, times = MOTIONS[motion_name](seed), np.arange(round(RECORD_S * bar.rate_hz)) / bar.rate_hz
    if not play_m:
        accel = tip_without_play(motion, times, bar)
    elif simulator == "stops":
        accel = hard_stops(motion, times, play_m / RADIUS_M, bar)
    else:
        accel = tip(motion, times, play_m, bar, simulator == "MuJoCo")
    accel = accel + np.random.default_rng(seed).normal(0, noise, times.size)
    polls = np.arange(0, RECORD_S, 1 / POLL_HZ)
    commands = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
    settings = DetectorSettings(f_res_hz=bar.f_res_hz * 1.003, f_norm_hz=85.0 if bar.rate_hz < 300 else 100.0,
                                f_norm_width_hz=25.0 if bar.rate_hz < 300 else 40.0)  # fmt: skip
    return [score for score in score_series(polls, commands, times, accel, settings, resolution=STEP_RAD)
            if 1 < score.time < RECORD_S - 0.4]  # fmt: skip


def medians(values: FloatArray) -> list[float]:
    """Medians of ten windows each, spread over the recording."""
    count = values.size // TOGETHER
    return [float(np.nanmedian(values[k::count])) for k in range(count)] if count else []


def rows(simulator: str, bar: Bar, noise: float, quick: bool) -> Iterator[str]:
    """A line for each play and two of correlations; quick: of every other play, one recording of each motion."""
    plays, seeds = (PLAYS[::2], SEEDS[:1]) if quick else (PLAYS, SEEDS)
    truth: list[float] = []
    scores: list[Score] = []
    grouped: dict[str, tuple[list[float], list[float]]] = {figure: ([], []) for figure in FIGURES}
    for play in plays:
        there: list[Score] = []
        for name in MOTIONS:
            these = [score for seed in seeds for score in recorded(simulator, name, seed, play, bar, noise)]
            for figure in FIGURES:
                middles = medians(np.array([getattr(score, figure) for score in these]))
                grouped[figure][0].extend([play] * len(middles))
                grouped[figure][1].extend(middles)
            there += these
        angle = play / RADIUS_M
        held = np.mean([score.severity_low <= angle <= score.severity_high for score in there])
        sized = np.mean([math.isfinite(score.play) for score in there])
        middle = {figure: np.nanmedian([getattr(score, figure) for score in there]) for figure in FIGURES}
        truth += [play] * len(there)
        scores += there
        yield (f"{simulator:7} {play * 1e6:5.0f} {angle * 1e3:7.1f} {middle['band']:8.1f} {middle['ringdown']:9.1f}"
               f" {middle['severity'] * 1e3:10.2f} {held:8.0%} {sized:6.0%} {len(there):8d}")  # fmt: skip
    each = [spearmanr(truth, [getattr(s, figure) for s in scores], nan_policy="omit")[0] for figure in FIGURES]
    tens = [spearmanr(*grouped[figure])[0] for figure in FIGURES]
    yield f"{simulator:7} Spearman, windows {each[0]:6.3f} {each[1]:9.3f} {each[2]:10.3f}"
    yield f"{simulator:7} Spearman, tens    {tens[0]:6.3f} {tens[1]:9.3f} {tens[2]:10.3f}"


def found(simulator: str, bar: Bar, noise: float, limits: Limits) -> Iterator[str]:
    """A line for each play: how many windows, and medians of ten, lie above the limit of their motion."""
    for play in PLAYS[1:]:
        row = f"{simulator:7} {play / RADIUS_M * 1e3:7.1f}"
        for names in GROUPS:
            for figures, among in ((figures_of, 0), (tens_of, 1)):
                over = [figures(simulator, name, SEEDS, play, bar, noise) > limits[name][among] for name in names]
                row += "  " + "".join(f"{share:8.1%}" for share in np.mean(np.concatenate(over), axis=0))
        yield row


def limits_of(bar: Bar, noise: float) -> Limits:
    """The level of each figure, of windows and of medians of ten, that 1 % of healthy windows of each motion exceed."""
    return {
        name: tuple(
            np.nanquantile(figures("stops", name, HEALTHY_SEEDS, 0.0, bar, noise), 1 - FALSE, axis=0)
            for figures in (figures_of, tens_of)
        )
        for name in MOTIONS
    }


def figures_of(simulator: str, name: str, seeds: range, play: float, bar: Bar, noise: float) -> FloatArray:
    """Each of FIGURES of all windows, shape (M, 3)."""
    scores = (score for seed in seeds for score in _kept(simulator, name, seed, play, bar, noise))
    return np.array([[getattr(score, figure) for figure in FIGURES] for score in scores])


def tens_of(simulator: str, name: str, seeds: range, play: float, bar: Bar, noise: float) -> FloatArray:
    """The same of medians of ten windows of one recording."""
    each = [figures_of(simulator, name, range(seed, seed + 1), play, bar, noise) for seed in seeds]
    return np.concatenate([np.column_stack([medians(column) for column in one.T]) for one in each])


_kept = lru_cache(maxsize=None)(recorded)


def main(arguments: list[str]) -> None:
    """A table for each simulator."""
    parser = argparse.ArgumentParser(prog="python -m bench.severity")
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--noise", type=float, default=0.5)
    parser.add_argument("--simulators", default="model,MuJoCo,stops")
    parser.add_argument("--found", action="store_true", help="how often play is found, at 1 %% false alarms")
    parser.add_argument("--quick", action="store_true", help="half of the plays and of the recordings")
    asked = parser.parse_args(arguments)
    print(f"{asked.rate:g} Hz, noise {asked.noise:g} m/s²")
    limits = limits_of(Bar(rate_hz=asked.rate), asked.noise) if asked.found else {}
    if asked.found:
        print("         [mrad]  smooth motions: windows: eq. 8, ringdown, severity; tens; trapezoids: the same")
    else:
        print("          [um]  [mrad]   eq. 8  ringdown  severity [mrad]  held   told  windows")
    for simulator in asked.simulators.split(","):
        given = (simulator, Bar(rate_hz=asked.rate), asked.noise)
        for row in found(*given, limits) if asked.found else rows(*given, asked.quick):
            print(row, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
