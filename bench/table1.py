"""Repeats the paper's section 4: `python -m bench.table1 [--figures FOLDER]` (table 1, figures 4 and 5).

An AX-12A-like joint of the model's defaults (gears of 10 mm, play 80 µm: 0.46° at the joint), held still while the
robot is waved by hand (0.5 to 3 Hz, 0.15 rad): six motions to learn the level from by eq. 9, others for the table.
Windows of 0.25 s from each reversal that the service's trigger finds in commands of an AX-12A (0.29°, 100 Hz); a bar of
58 Hz, zeta 0.012; an accelerometer with steps of 16 g / 32768 and white noise.  What changes:

    rate     samples a second
    SNR      energy of what the play of 80 µm adds to a window over the noise's variance, its median over all windows
    healthy  the play of the joint that counts as healthy, 0: the driven gear follows exactly, as with the bolted links
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path

import numpy as np

from bench.roc.waveforms import Bar, FloatArray, joined, windows_of
from lostmotion.detector.level import Level, level, youden
from lostmotion.detector.score import batch
from lostmotion.detector.tuning import noisy
from lostmotion.detector.window import DetectorSettings
from lostmotion.model import Sensor

__all__ = ["HEALTHY_M", "RATES_HZ", "SNR_DB", "STATISTICS", "Cell", "cells", "measured", "settings", "tip", "wilson"]

PLAY_M, WINDOW_S, F_RES_HZ, ZETA = 80e-6, 0.25, 58.0, 0.012
RATES_HZ, SNR_DB, HEALTHY_M = (200.0, 500.0, 1000.0, 3200.0), (20.0, 30.0, 40.0, 50.0, 60.0), (0.0, 1e-6, 5e-6, 10e-6)
LEARNT, TESTED = range(9000, 9006), range(9100, 9118)
RESOLUTION = 9.80665 * 16 / 32768
STATISTICS = ("band", "ringdown")
NAMES = {"band": "eq. 8", "ringdown": "ring-down, calibrated"}


@dataclass(frozen=True)
class Cell:
    """Of count windows each: those with play found, and those of the healthy joint accepted as such.

    eq9 and youden: both counts with a level that was learnt from windows of that joint by eq. 9 and by Youden's J;
    untold: accepted with the level of eq. 9 that was learnt from a joint without any play.
    """

    statistic: str
    rate_hz: float
    snr_db: float
    healthy_m: float
    count: int
    eq9: tuple[int, int]
    youden: tuple[int, int]
    untold: int


@lru_cache(maxsize=16)
def tip(rate_hz: float, play_m: float, seeds: Sequence[int]) -> FloatArray:
    """Tip acceleration [m/s²] without noise in all windows of these motions, shape (M, N)."""
    bar = Bar(F_RES_HZ, ZETA, rate_hz)
    windows = joined([windows_of(seed, play_m or PLAY_M, bar, WINDOW_S) for seed in seeds])
    return windows.worn if play_m else windows.healthy


def noise_of(rate_hz: float, snr_db: float) -> float:
    """Standard deviation of the noise [m/s²] that makes this SNR."""
    added = tip(rate_hz, PLAY_M, TESTED) - tip(rate_hz, 0.0, TESTED)
    return math.sqrt(float(np.median(np.sum(added**2, axis=1))) / 10 ** (snr_db / 10))


def measured(rate_hz: float, snr_db: float, play_m: float, seeds: Sequence[int]) -> FloatArray:
    """The windows as the sensor shows them."""
    sensor = Sensor(noise=noise_of(rate_hz, snr_db), resolution=RESOLUTION)
    rng = np.random.default_rng([9200, round(rate_hz), round(snr_db), round(play_m * 1e6), seeds[0]])
    return np.array([sensor.apply(window, rng) for window in tip(rate_hz, play_m, seeds)])


def settings(statistic: str, rate_hz: float, healthy: FloatArray) -> DetectorSettings:
    """Eq. 8 with the bands of the defaults, at 200 Hz with a norm below half of that; or ring-down with the noise of
    healthy windows."""
    if statistic == "ringdown":
        return noisy(healthy, rate_hz, DetectorSettings(f_res_hz=F_RES_HZ, zeta=ZETA, statistic="ringdown"))
    if rate_hz < 400:
        return DetectorSettings(f_res_hz=F_RES_HZ, zeta=ZETA, f_norm_hz=85.0, f_norm_width_hz=30.0, statistic="band")
    return DetectorSettings(f_res_hz=F_RES_HZ, zeta=ZETA, statistic="band")


def cells(rate_hz: float, snr_db: float, plays: Sequence[float] = HEALTHY_M) -> Iterator[Cell]:
    """Of both statistics and each play that counts as healthy; the first one must be 0."""
    learnt, tested = (
        {play: measured(rate_hz, snr_db, play, seeds) for play in (*plays, PLAY_M)} for seeds in (LEARNT, TESTED)
    )
    for statistic in STATISTICS:
        without = settings(statistic, rate_hz, learnt[0.0])
        usual = _level(level, without, rate_hz, learnt[0.0], learnt[PLAY_M])
        for play in plays:
            own = settings(statistic, rate_hz, learnt[play])
            worn, healthy = (batch(tested[one], rate_hz, own) for one in (PLAY_M, play))
            counts = []
            for rule in (level, youden):
                limit = _level(rule, own, rate_hz, learnt[play], learnt[PLAY_M])
                counts.append((int(np.sum(worn > limit)), int(np.sum(healthy <= limit))))
            untold = int(np.sum(batch(tested[play], rate_hz, without) <= usual))
            yield Cell(statistic, rate_hz, snr_db, play, len(worn), counts[0], counts[1], untold)


def _level(
    rule: Callable[[FloatArray, FloatArray], Level], chosen: DetectorSettings, rate_hz: float, healthy: FloatArray,
    worn: FloatArray,
) -> float:  # fmt: skip
    """The level that a rule makes of windows without play and with."""
    scores = [batch(windows, rate_hz, chosen) for windows in (healthy, worn)]
    return rule(np.concatenate(scores), np.repeat([0.0, 1.0], [len(healthy), len(worn)])).value


def wilson(hits: int, count: int) -> str:
    """A share with its 95 % interval (Wilson 1927), in per cent."""
    low, high = wilson_interval(hits, count)
    return f"{100 * hits / count:6.2f} ({100 * low:.2f} to {100 * high:.2f})"


def wilson_interval(hits: int, count: int) -> tuple[float, float]:
    """The ends of a share's 95 % interval (Wilson 1927)."""
    z = 1.96
    share = hits / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _percent(hits: int, count: int) -> str:
    """Two digits where they count: 100 only where none is missing."""
    share = 100 * hits / count
    return f"{share:.1f}" if 0 < share < 100 else f"{share:.0f}"


def _print_paper(found: Sequence[Cell]) -> None:
    """The paper's experiment: level by eq. 9, healthy is without play."""
    print("\nlevel by eq. 9, healthy without play: found with play / accepted without [%]\n")
    _print_head("statistic", "rate [Hz]", *(f"{snr:g} dB" for snr in SNR_DB))
    for statistic, rate in product(STATISTICS, RATES_HZ):
        row = [c for c in found if (c.statistic, c.rate_hz, c.healthy_m) == (statistic, rate, 0.0)]
        _print_row(NAMES[statistic], f"{rate:g}", *(_pair(c.eq9, c.count) for c in row))


def _print_healthy(found: Sequence[Cell]) -> None:
    """Joints with some play that count as healthy."""
    print("\nlevel by Youden's J, the healthy joint has some play: found with 80 µm / accepted [%]\n")
    _print_head("statistic", "rate [Hz]", "healthy [µm]", *(f"{snr:g} dB" for snr in SNR_DB))
    for statistic, rate, play in product(STATISTICS, RATES_HZ, HEALTHY_M[1:]):
        row = [c for c in found if (c.statistic, c.rate_hz, c.healthy_m) == (statistic, rate, play)]
        _print_row(NAMES[statistic], f"{rate:g}", f"{play * 1e6:g}", *(_pair(c.youden, c.count) for c in row))


def _print_untold(found: Sequence[Cell]) -> None:
    """What becomes of small plays where the level was learnt from a joint that had none."""
    print("\naccepted [%] with the level of eq. 9 learnt from a joint without any play\n")
    _print_head("statistic", "rate [Hz]", "play [µm]", *(f"{snr:g} dB" for snr in SNR_DB))
    for statistic, rate, play in product(STATISTICS, RATES_HZ[::2], HEALTHY_M[1:]):
        row = [c for c in found if (c.statistic, c.rate_hz, c.healthy_m) == (statistic, rate, play)]
        _print_row(NAMES[statistic], f"{rate:g}", f"{play * 1e6:g}", *(_percent(c.untold, c.count) for c in row))


def _print_head(*cells: str) -> None:
    _print_row(*cells)
    _print_row(*["---"] * len(cells))


def _print_row(*cells: str) -> None:
    print("| " + " | ".join(cells) + " |")


def _pair(counts: tuple[int, int], count: int) -> str:
    return " / ".join(_percent(hits, count) for hits in counts)


def main() -> None:
    """Prints the tables, and draws them with figures 4 and 5."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, help="write table1.png, fig4.png and fig5.png there")
    arguments = parser.parse_args()
    found = [cell for rate in RATES_HZ for snr in SNR_DB for cell in cells(rate, snr)]
    count = found[0].count
    print(f"paper (AX-12A): 98 / 100.  Here {count} windows of each kind in every cell; 95 % intervals: of "
          f"{wilson(count, count).strip()}, of {wilson(round(0.98 * count), count).strip()}")  # fmt: skip
    noises = ", ".join(f"{noise_of(rate, 50.0):.2f} at {rate:g} Hz" for rate in RATES_HZ)
    print(f"noise at 50 dB [m/s²]: {noises}")
    for table in (_print_paper, _print_healthy, _print_untold):
        table(found)
    if arguments.figures:
        from bench.table1_figures import draw, draw_spectra

        draw(found, arguments.figures)
        draw_spectra(arguments.figures)


if __name__ == "__main__":
    main()
