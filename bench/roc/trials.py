"""One condition: noise, waveforms and statistics, and the signal-to-noise ratio that each needs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from bench.roc.bounds import likelihoods
from bench.roc.needed import FALSE_ALARM, FOUND, Needed, crossing, needed
from bench.roc.noises import covariance, draw
from bench.roc.rivals import RIVALS, SHIPPED, Known, Statistic
from bench.roc.waveforms import Bar, FloatArray, Windows, joined, windows_of
from lostmotion.detector.window import LEVELS

__all__ = ["BOUNDS", "TOP_DB", "Condition", "Outcome", "run"]

PLAYS = (5e-6, 20e-6, 60e-6, 200e-6)
LIBRARY_SEEDS, TEST_SEEDS = range(20000, 20036), range(21000, 21012)
MUJOCO_LIBRARY_SEEDS, MUJOCO_TEST_SEEDS = range(20000, 20010), range(21000, 21006)
"""MuJoCo takes ten times as long."""
COUNT, CALIBRATION = 4000, 1000
DB, TOP_DB = np.arange(8.0, 33.0), 32.0
BOUND_DB = np.arange(10.0, 21.0)
MOTION = 10.0
"""Root mean square of the arm's own motion in a window, in standard deviations of the white noise."""
SHOWN_DB, ENOUGH = 15.0, 0.97
BOUNDS = ("knows all", "knows all but when, from below", "from above")
NORMAL = NormalDist()


@dataclass(frozen=True)
class Condition:
    """What is different; holes: share of samples missing; clip: range in standard deviations; off: the resonance that
    is set over the true one."""

    name: str
    bar: Bar = field(default_factory=Bar)
    noise: str = "white"
    plays: tuple[float, ...] = PLAYS
    mujoco: bool = False
    holes: float = 0.0
    clip: float = math.inf
    off: float = 1.0
    window_s: float = 0.25


@dataclass(frozen=True, eq=False)
class Outcome:
    """needed: of each bound and rival; healthy and worn: scores at 15 dB, of each rival and of BOUNDS[0] and the last;
    shipped: of each rival with a level of its own, the rate of false alarms and the SNR [dB] for 90 % found with it;
    waveforms: how many the bounds know."""

    condition: Condition
    needed: dict[str, Needed]
    healthy: dict[str, FloatArray]
    worn: dict[str, FloatArray]
    shipped: dict[str, tuple[float, float]]
    waveforms: int


@dataclass(frozen=True, eq=False)
class _Trial:
    """Windows of one condition as a sensor shows them; all randomness comes from rng.

    root: of the noise's covariance; signals: differences between worn and healthy of unit whitened energy; motions: the
    arm's own; which: of the windows, the signal and motion.
    """

    condition: Condition
    rng: np.random.Generator
    root: FloatArray
    signals: FloatArray
    motions: FloatArray
    which: NDArray[np.intp]

    def noise(self, count: int) -> FloatArray:
        bar = self.condition.bar
        return draw(self.rng, self.condition.noise, count, self.signals.shape[1], bar.rate_hz, bar.f_res_hz)

    def windows(self, size: float, which: NDArray[np.intp]) -> FloatArray:
        """Windows with an impact of energy size², clipped and with holes as the condition has it."""
        clip = self.condition.clip
        readings = np.clip(self.noise(len(which)) + size * self.signals[which], -clip, clip) + self.motions[which]
        return np.where(self.rng.random(readings.shape) < self.condition.holes, np.nan, readings)


def run(condition: Condition) -> Outcome:
    """Every difference between worn and healthy is scaled to the same energy in whitened noise, the SNR."""
    bar, rng = condition.bar, np.random.default_rng(6000)
    seeds = (MUJOCO_TEST_SEEDS, MUJOCO_LIBRARY_SEEDS) if condition.mujoco else (TEST_SEEDS, LIBRARY_SEEDS)
    (tested, motion), (known, _) = (_waveforms(condition, some) for some in seeds)
    root = np.linalg.cholesky(covariance(condition.noise, tested.worn.shape[1], bar.rate_hz, bar.f_res_hz))
    library = _whitened(_unit(known.worn - known.healthy, root), root)
    trial = _Trial(condition, rng, root, _unit(tested.worn - tested.healthy, root), _moved(tested),
                   rng.integers(len(motion), size=COUNT))  # fmt: skip
    statistics = {name: make(_calibration(trial, known)) for name, make in RIVALS.items()}
    scores = _scored(statistics, trial)
    found = {name: needed(quiet, loud, DB, motion[trial.which]) for name, (quiet, loud) in scores.items()}
    bounds = _bounds(trial, library, motion[trial.which])
    at = int(np.flatnonzero(DB == SHOWN_DB)[0])
    healthy, worn = ({name: pair[0] if i == 0 else pair[1][at] for name, pair in scores.items()} for i in (0, 1))
    healthy[BOUNDS[0]], worn[BOUNDS[0]] = rng.normal(size=COUNT), rng.normal(10 ** (SHOWN_DB / 20), 1.0, COUNT)
    healthy[BOUNDS[2]], worn[BOUNDS[2]] = bounds[2]
    sure = 20 * math.log10(NORMAL.inv_cdf(1 - FALSE_ALARM) + NORMAL.inv_cdf(FOUND))
    found = {BOUNDS[0]: Needed(sure, 0.0), BOUNDS[1]: bounds[0], BOUNDS[2]: bounds[1]} | found
    return Outcome(condition, found, healthy, worn, _shipped(scores), len(library))


def _waveforms(condition: Condition, seeds: Sequence[int]) -> tuple[Windows, NDArray[np.intp]]:
    """All windows of these motions and plays, and the number of the motion of each."""
    parts = [
        (windows_of(seed, play, condition.bar, condition.window_s, condition.mujoco), number)
        for number, seed in enumerate(seeds)
        for play in condition.plays
    ]
    return joined([part for part, _ in parts]), np.concatenate([np.full(len(p.play), number) for p, number in parts])


def _calibration(trial: _Trial, known: Windows) -> Known:
    """What a user would have: windows of other motions, without play, and with impacts of 15 dB."""
    condition = trial.condition
    other = _Trial(condition, np.random.default_rng(6001), trial.root, _unit(known.worn - known.healthy, trial.root),
                   _moved(known), trial.which)  # fmt: skip
    some = other.rng.integers(len(other.signals), size=CALIBRATION)
    healthy, worn = (other.windows(size, some) for size in (0.0, 10 ** (SHOWN_DB / 20)))
    bar = condition.bar
    return Known(bar.rate_hz, bar.f_res_hz * condition.off, bar.zeta, condition.window_s, healthy, worn)


def _scored(statistics: dict[str, Statistic], trial: _Trial) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Scores without impacts, shape (M,), and with, (SNR, M), of each; inf once nearly all are found."""
    quiet = trial.windows(0.0, trial.which)
    healthy = {name: of(quiet) for name, of in statistics.items()}
    worn = {name: np.full((DB.size, COUNT), math.inf) for name in statistics}
    going = set(statistics)
    for row, db in enumerate(DB):
        loud = trial.windows(10 ** (db / 20), trial.which)
        for name in sorted(going):
            worn[name][row] = statistics[name](loud)
            if db >= SHOWN_DB and np.mean(worn[name][row] > np.quantile(healthy[name], 1 - FALSE_ALARM / 4)) > ENOUGH:
                going.remove(name)
    return {name: (healthy[name], worn[name]) for name in statistics}


def _bounds(
    trial: _Trial, library: FloatArray, motion: NDArray[np.intp]
) -> tuple[Needed, Needed, tuple[FloatArray, FloatArray]]:
    """Who knows all but when, from below and from above; the latter's scores at 15 dB.  Of whole, unclipped windows."""
    sizes = 10 ** (BOUND_DB / 20)
    quiet, loud = (_whitened(trial.noise(COUNT), trial.root) for _ in range(2))
    healthy = likelihoods(quiet, None, library, sizes)
    inside = trial.rng.integers(len(library), size=COUNT)
    same = likelihoods(loud, library[inside], library, sizes)
    fresh = likelihoods(loud, _whitened(trial.signals[trial.which], trial.root), library, sizes)
    at = int(np.flatnonzero(BOUND_DB == SHOWN_DB)[0])
    blocks = inside * len(set(motion.tolist())) // len(library)  # neighbours are of one motion
    return (needed(healthy, same, BOUND_DB, blocks), needed(healthy, fresh, BOUND_DB, motion),
            (healthy[at], fresh[at]))  # fmt: skip


def _shipped(scores: dict[str, tuple[FloatArray, FloatArray]]) -> dict[str, tuple[float, float]]:
    found = {}
    for name, key in SHIPPED.items():
        level = LEVELS[key]  # type: ignore[index]
        healthy, worn = scores[name]
        found[name] = float(np.mean(healthy > level)), crossing(np.mean(worn > level, axis=1), DB)
    return found


def _moved(windows: Windows) -> FloatArray:
    """The arm's own motion, MOTION times as loud as the noise."""
    return MOTION * windows.healthy / np.sqrt(np.mean(windows.healthy**2, axis=1, keepdims=True))


def _whitened(windows: FloatArray, root: FloatArray) -> FloatArray:
    return np.linalg.solve(root, windows.T).T


def _unit(signals: FloatArray, root: FloatArray) -> FloatArray:
    """Scaled to unit energy after whitening."""
    return np.asarray(signals / np.linalg.norm(_whitened(signals, root), axis=1)[:, None])
