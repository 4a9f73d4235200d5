"""How well the bar's resonance and damping are followed: `python -m bench.following` (some three minutes).

A robot whose file gives a resonance 5 % too low or 8 % too high, worn from its first window on: what ``ringdown`` then
needs, beside one that was calibrated, after an hour of one window a second.  Impacts by eqs. 1-7 and by MuJoCo's hard
stops, on motions that are used for nothing else; the signal-to-noise ratios are those of ``roc``.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bench.roc.needed import needed, shown
from bench.roc.noises import covariance, draw
from bench.roc.waveforms import Bar, joined, windows_of
from lostmotion.detector import ringdown
from lostmotion.detector.learner import Learner
from lostmotion.detector.tuning import noisy
from lostmotion.detector.window import DetectorSettings

__all__ = ["Robot", "learnt_from"]

FloatArray = NDArray[np.float64]
WINDOWS, COUNT, MOTION = 3600, 1000, 10.0
DB = np.arange(8.0, 33.0)
PLAYS = (5e-6, 20e-6, 60e-6, 200e-6)
LEARNT_SEEDS, TESTED_SEEDS = range(23000, 23006), range(23100, 23106)
BAR = Bar()
OFF = (-0.05, 0.08)


class Robot:
    """Windows of one kind of noise, with impacts of any size; all randomness comes from rng."""

    def __init__(self, seeds: range, noise: str, mujoco: bool, number: int) -> None:
        parts = [(i, windows_of(s, p, BAR, 0.25, mujoco)) for i, s in enumerate(seeds) for p in PLAYS]
        known = joined([part for _, part in parts])
        self.motion = np.concatenate([np.full(len(part.play), i) for i, part in parts])
        root = np.linalg.cholesky(covariance(noise, known.worn.shape[1], BAR.rate_hz, BAR.f_res_hz))
        different = known.worn - known.healthy
        self._signals = different / np.linalg.norm(np.linalg.solve(root, different.T), axis=0)[:, None]
        moved = known.healthy - known.healthy.mean(axis=1, keepdims=True)
        self._motions = moved * (MOTION / np.sqrt(np.mean(moved**2)))
        self._noise, self._rng = noise, np.random.default_rng(number)

    def windows(self, snr_db: float, which: NDArray[np.intp]) -> FloatArray:
        """Windows [noise's standard deviations] with impacts of that SNR [dB]; -inf: without."""
        noise = draw(self._rng, self._noise, which.size, self._signals.shape[1], BAR.rate_hz, BAR.f_res_hz)
        return np.asarray(noise + self._motions[which] + 10 ** (snr_db / 20) * self._signals[which])

    def some(self, count: int) -> NDArray[np.intp]:
        """Which of the waveforms, at random."""
        return self._rng.integers(len(self._signals), size=count)


def learnt_from(robot: Robot, snr_db: float, given: DetectorSettings) -> Learner:
    """What has been learnt after an hour of windows with impacts of that SNR [dB]."""
    windows = robot.windows(snr_db, robot.some(WINDOWS))
    learner = Learner(given, BAR.rate_hz, windows.shape[1])
    for window in windows:
        learner.update(window)
    learner.finish()
    return learner


def main() -> None:
    """A row for each simulator, noise and SNR."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| simulator, noise | worn at [dB] | calibrated | file | as the file says | followed | resonance [Hz] "
          "| damping |\n|" + "---|" * 8)  # fmt: skip
    for mujoco in (False, True):
        for noise in ("white", "coloured", "hum"):
            learnt, tested = (Robot(s, noise, mujoco, i) for i, s in enumerate((LEARNT_SEEDS, TESTED_SEEDS)))
            for snr_db in (15.0, 20.0, 25.0):
                for off in OFF:
                    _row(learnt, tested, noise, mujoco, snr_db, off)


def _row(learnt: Robot, tested: Robot, noise: str, mujoco: bool, snr_db: float, off: float) -> None:
    right = DetectorSettings(f_res_hz=BAR.f_res_hz, zeta=BAR.zeta)
    wrong = replace(right, f_res_hz=BAR.f_res_hz * (1 + off))
    calibrated = noisy(learnt.windows(-math.inf, learnt.some(COUNT)), BAR.rate_hz, right)
    held, followed = (learnt_from(learnt, snr_db, replace(wrong, follow_bar=follow)) for follow in (False, True))
    found = [_needed(tested, settings) for settings in (calibrated, held.settings, followed.settings)]
    now = followed.settings
    print(f"| {'MuJoCo' if mujoco else 'eq. 1'}, {noise} | {snr_db:.0f} | {found[0]} | {off:+.0%} | {found[1]} "
          f"| {found[2]} | {now.f_res_hz:.2f} | {now.zeta:.4f} |", flush=True)  # fmt: skip


def _needed(robot: Robot, settings: DetectorSettings) -> str:
    """The SNR [dB] for 90 % found at 1 % false alarms."""
    which = robot.some(COUNT)
    bank = ringdown.build(round(0.25 * BAR.rate_hz), BAR.rate_hz, settings)
    quiet, *loud = (ringdown.scores(robot.windows(db, which), BAR.rate_hz, settings, bank) for db in (-math.inf, *DB))
    return shown(needed(quiet, np.array(loud), DB, robot.motion[which]), float(DB[-1]))


if __name__ == "__main__":
    main()
