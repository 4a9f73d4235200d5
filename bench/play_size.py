"""How well the size of the play is told: `python -m bench.play_size`.

Twelve seconds of hand-waved motion each, commands of an AX-12A (0.29°, 100 Hz), gears of 10 mm, a bar of 58 Hz whose
setting is 0.3 % off, noise of 0.1 m/s²; the model's gears (eq. 1) and MuJoCo's hard stops.  Seeds used nowhere else.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bench.roc.waveforms import POLL_HZ, RADIUS_M, RECORD_S, STEP_RAD, Bar, tip
from lostmotion.detector.play_size import pooled
from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings, Score
from lostmotion.model import HandWaved

SEEDS = range(8300, 8310)
PLAYS = (10e-6, 20e-6, 40e-6, 80e-6, 200e-6)
SETTINGS = DetectorSettings(f_res_hz=58.0 * 1.003, noise_ms2=0.1)
NOISE = 0.1


def recorded(seed: int, play_m: float, bar: Bar, mujoco: bool) -> list[Score]:
    """The scores of one recording."""
    motion, times = HandWaved(seed), np.arange(round(RECORD_S * bar.rate_hz)) / bar.rate_hz
    accel = tip(motion, times, play_m, bar, mujoco) + np.random.default_rng(seed).normal(0, NOISE, times.size)
    polls = np.arange(0, RECORD_S, 1 / POLL_HZ)
    told = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
    settings = replace(SETTINGS, flank_exponent=1e4 if mujoco else 11.0)
    return [score for score in score_series(polls, told, times, accel, settings) if score.impact]


def main() -> None:
    """A row for each simulator, rate and play."""
    print("simulator  rate [Hz]  play [µm]  windows  told  median error  pooled error  covered")
    for mujoco in (False, True):
        for rate in (500.0, 1000.0, 3200.0):
            for play in PLAYS:
                scores = [score for seed in SEEDS for score in recorded(seed, play, Bar(rate_hz=rate), mujoco)]
                told = [score for score in scores if math.isfinite(score.play)]
                truth = play / RADIUS_M
                error = float(np.median([abs(score.play / truth - 1) for score in told])) if told else math.nan
                cover = float(np.mean([s.play_low <= truth <= s.play_high for s in told])) if told else math.nan
                all_of_them = pooled([score.play for score in told]).value / truth - 1
                name = "MuJoCo" if mujoco else "model"
                print(f"{name:9} {rate:10.0f} {play * 1e6:10.0f} {len(scores):8d} {len(told) / len(scores):5.0%}"
                      f" {error:13.1%} {all_of_them:+13.1%} {cover:8.0%}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
