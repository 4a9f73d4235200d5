"""Reproduces the paper's section 4: `python -m bench.table1 [--figures FOLDER]` (figures 4 and 5, and table 1).

Conditions: an AX-12A-like joint of the model's defaults (gears of 10 mm, play 80 µm: 0.46° at the joint), held still
while the robot is waved by hand (0.5 to 3 Hz, 0.15 rad; six motions for tuning the level, forty others for the table);
without play the driven gear follows exactly, as with the paper's bolted links.  A bar of 58 Hz, zeta 0.012, an
accelerometer of 200 samples a second in steps of 16 g / 32768 with white noise of 0.15 m/s².  Windows of 0.25 s from
each reversal that the service's trigger finds in commands of an AX-12A (0.29°, 100 Hz).  The level is that of eq. 9.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from bench.roc.waveforms import Bar, Windows, joined, windows_of
from lostmotion.detector.level import level
from lostmotion.detector.score import batch
from lostmotion.detector.tuning import noisy
from lostmotion.detector.window import DetectorSettings, FloatArray
from lostmotion.model import Sensor

BAR, PLAY_M, WINDOW_S = Bar(58.0, 0.012, 200.0), 80e-6, 0.25
SENSOR = Sensor(noise=0.15, resolution=9.80665 * 16 / 32768)
TUNING, TESTED = range(9000, 9006), range(9100, 9140)
BAND = DetectorSettings(f_res_hz=58.0, f_norm_hz=85.0, f_norm_width_hz=30.0)
RINGDOWN = DetectorSettings(f_res_hz=58.0, statistic="ringdown")
FALSE_ALARM = 0.001


def measured(windows: Windows, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Healthy and worn windows as the sensor shows them."""
    return tuple(np.array([SENSOR.apply(one, rng) for one in each]) for each in (windows.healthy, windows.worn))  # type: ignore[return-value]


def wilson(hits: int, count: int) -> str:
    """A share with its 95 % interval (Wilson 1927), in per cent."""
    z = 1.96
    share = hits / count
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return f"{100 * share:6.2f} ({100 * max(middle - half, 0):.2f} to {100 * min(middle + half, 1):.2f})"


def main() -> None:
    """Prints table 1 for both statistics; draws figures 4 and 5."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, help="write fig4.png and fig5.png there")
    arguments = parser.parse_args()
    rng = np.random.default_rng(9200)
    tuning, tested = (
        measured(joined([windows_of(seed, PLAY_M, BAR, WINDOW_S) for seed in seeds]), rng) for seeds in (TUNING, TESTED)
    )
    print(f"{len(tested[0])} windows of each class; level from eq. 9 on {len(tuning[0])} others\n")
    print(f"{'':10}{'play':>10}{'detected right [%]':>28}{'wrong [%]':>28}")
    print(f"{'paper':10}{'with':>10}{'98':>28}{'2':>28}\n{'':10}{'without':>10}{'100':>28}{'0':>28}")
    taught = noisy(tuning[0], BAR.rate_hz, RINGDOWN)
    for settings in (BAND, taught):
        healthy, worn = (batch(one, BAR.rate_hz, settings) for one in tested)
        learnt = [batch(one, BAR.rate_hz, settings) for one in tuning]
        labels = np.arange(sum(map(len, learnt))) >= len(learnt[0])
        limit = level(np.concatenate(learnt), labels).value
        right = int(np.sum(worn > limit)), int(np.sum(healthy <= limit))
        for name, play, hits in zip((settings.statistic, ""), ("with", "without"), right, strict=True):
            cells = wilson(hits, len(worn)), wilson(len(worn) - hits, len(worn))
            print(f"{name:10}{play:>10}{cells[0]:>28}{cells[1]:>28}")
        strict = np.quantile(healthy, 1 - FALSE_ALARM)
        missed = wilson(int(np.sum(worn <= strict)), len(worn))
        print(f"{'':10}missed at {FALSE_ALARM:.1%} false alarms: {missed} %; level of eq. 9: {limit:.2f}")
    if arguments.figures:
        from bench.figures import draw_spectra

        draw_spectra(arguments.figures)


if __name__ == "__main__":
    main()
