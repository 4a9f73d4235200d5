"""One condition: noise, waveforms and statistics, and the signal-to-noise ratio that each needs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from statistics import NormalDist

import numpy as np

from bench.roc.noises import covariance, draw
from bench.roc.rivals import CLASSICS, average_likelihood, envelope_line
from bench.roc.waveforms import Bar, FloatArray, Windows, from_model, from_mujoco, joined
from lostmotion.detector import ringdown
from lostmotion.detector.quality import mended
from lostmotion.detector.score import batch
from lostmotion.detector.tuning import noisy
from lostmotion.detector.window import DetectorSettings

__all__ = ["ORDER", "Condition", "Outcome", "run"]

PLAYS = (5e-6, 20e-6, 60e-6, 200e-6)
LIBRARY_SEEDS, TEST_SEEDS = range(1000, 1006), range(5000, 5004)
COUNT, HEALTHY_FOR_CALIBRATION = 4000, 1000
DB = np.arange(8.0, 33.0)
FALSE_ALARM, FOUND = 0.01, 0.9
MOTION = 10.0
"""Root mean square of the arm's own motion in a window, in standard deviations of the white noise."""
SHOWN_DB, ENOUGH = 15.0, 0.97
NORMAL = NormalDist()
Statistic = Callable[[FloatArray, float], FloatArray]
ORDER = ("knows all", "knows all but when", "ringdown", "ringdown, own noise", "band (eq. 8)", *CLASSICS, "envelope")


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
    """needed: SNR [dB] for 90 % found at 1 % false alarms, NaN where 32 dB do not do; healthy and worn: scores at
    15 dB, of each statistic."""

    condition: Condition
    needed: dict[str, float]
    healthy: dict[str, FloatArray]
    worn: dict[str, FloatArray]


@lru_cache(maxsize=4)
def waveforms(bar: Bar, plays: tuple[float, ...], seeds: range, mujoco: bool, window_s: float) -> Windows:
    """All windows of these motions and plays."""
    make = from_mujoco if mujoco else from_model
    return joined([make(seed, play, bar, window_s) for seed in seeds for play in plays])


def run(condition: Condition) -> Outcome:
    """Every difference between worn and healthy is scaled to the same energy in whitened noise, the SNR."""
    bar = condition.bar
    rng = np.random.default_rng(6000)
    tested, known = (
        waveforms(bar, condition.plays, seeds, condition.mujoco, condition.window_s)
        for seeds in (TEST_SEEDS, LIBRARY_SEEDS)
    )
    length = tested.worn.shape[1]
    root = np.linalg.cholesky(covariance(condition.noise, length, bar.rate_hz, bar.f_res_hz))
    signals, library = (_unit(windows.worn - windows.healthy, root) for windows in (tested, known))
    which = rng.integers(len(signals), size=COUNT)
    motion = MOTION * tested.healthy / np.sqrt(np.mean(tested.healthy**2, axis=1, keepdims=True))

    def windows(size: float, count: int = COUNT) -> FloatArray:
        chosen = rng.integers(len(signals), size=count) if count != COUNT else which
        noise = draw(rng, condition.noise, count, length, bar.rate_hz, bar.f_res_hz)
        told = np.clip(noise + size * signals[chosen], -condition.clip, condition.clip) + motion[chosen]
        return np.where(rng.random(told.shape) < condition.holes, np.nan, told)

    statistics = _statistics(condition, windows(0.0, HEALTHY_FOR_CALIBRATION), root, library @ np.linalg.inv(root).T,
                             motion[which])  # fmt: skip
    quiet = windows(0.0)
    needed = _needed(statistics, windows, quiet)
    size = 10 ** (SHOWN_DB / 20)
    loud = windows(size)
    healthy, worn = ({name: of(told, size) for name, of in statistics.items()} for told in (quiet, loud))
    healthy["knows all"], worn["knows all"] = rng.normal(size=COUNT), rng.normal(size, 1.0, COUNT)
    return Outcome(condition, needed, healthy, worn)


def _needed(
    statistics: dict[str, Statistic], windows: Callable[[float], FloatArray], quiet: FloatArray
) -> dict[str, float]:
    """SNR [dB] by statistic; the bounds know the size, so their limits depend on it."""
    limits = {name: np.quantile(of(quiet, 0.0), 1 - FALSE_ALARM) for name, of in statistics.items()}
    found: dict[str, list[float]] = {name: [] for name in statistics}
    for db in DB:
        size = 10 ** (db / 20)
        loud = windows(size)
        for name, statistic in statistics.items():
            if found[name] and found[name][-1] > ENOUGH:
                found[name].append(1.0)
                continue
            limit = np.quantile(statistic(quiet, size), 1 - FALSE_ALARM) if name.startswith("knows") else limits[name]
            found[name].append(float(np.mean(statistic(loud, size) > limit)))
    needed = {name: _crossing(shares) for name, shares in found.items()}
    needed["knows all"] = 20 * math.log10(NORMAL.inv_cdf(1 - FALSE_ALARM) + NORMAL.inv_cdf(FOUND))
    return needed


def _statistics(
    condition: Condition, healthy: FloatArray, root: FloatArray, library: FloatArray, motion: FloatArray
) -> dict[str, Statistic]:
    """By name; the second argument is the true size, which only the bound may use."""
    bar = condition.bar
    f_set = bar.f_res_hz * condition.off
    own = DetectorSettings(f_res_hz=f_set, zeta=bar.zeta, statistic="ringdown", window_s=condition.window_s)
    slow = ringdown.bank(healthy.shape[1], bar.rate_hz, own).slow
    taught = noisy(_filled(healthy, bar.rate_hz, own), bar.rate_hz, own)
    band = _band(f_set, bar, condition.window_s)

    def calm(windows: FloatArray) -> FloatArray:
        whole = np.array([mended(window) for window in windows]) if condition.holes else windows
        return np.asarray(whole - (whole @ slow) @ slow.T)

    def bound(windows: FloatArray, size: float) -> FloatArray:
        whole = np.array([mended(window) for window in windows]) if condition.holes else windows
        return average_likelihood(np.linalg.solve(root, (whole - motion).T).T, library, size)

    return {
        "knows all but when": bound,
        "ringdown": lambda w, s: batch(_filled(w, bar.rate_hz, taught), bar.rate_hz, taught),
        "ringdown, own noise": lambda w, s: batch(_filled(w, bar.rate_hz, own), bar.rate_hz, own),
        "band (eq. 8)": lambda w, s: batch(np.array([mended(x) for x in w]), bar.rate_hz, band),
        **{name: lambda w, s, of=of: of(calm(w)) for name, of in CLASSICS.items()},
        "envelope": lambda w, s: envelope_line(calm(w), bar.rate_hz, f_set),
    }


def _band(f_set: float, bar: Bar, window_s: float) -> DetectorSettings:
    """Eq. 8 as the defaults have it, the norm band moved below half of a slow sensor's rate."""
    usual = DetectorSettings(f_res_hz=f_set, zeta=bar.zeta, window_s=window_s, f_width_hz=0.2 * f_set,
                             f_norm_hz=1.72 * f_set, f_norm_width_hz=0.7 * f_set)  # fmt: skip
    if 1.55 * f_set < bar.rate_hz / 2:
        return usual
    width = min(0.2 * f_set, 1.8 * (bar.rate_hz / 2 - f_set))
    return replace(usual, f_width_hz=width, f_norm_hz=0.65 * f_set, f_norm_width_hz=0.5 * f_set)


def _filled(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    if np.isfinite(windows).all():
        return windows
    return np.array([ringdown.filled(window, rate_hz, settings) for window in windows])


def _unit(signals: FloatArray, root: FloatArray) -> FloatArray:
    """Scaled to unit energy after whitening."""
    return np.asarray(signals / np.linalg.norm(np.linalg.solve(root, signals.T), axis=0)[:, None])


def _crossing(shares: list[float]) -> float:
    """SNR [dB] from which the share stays above FOUND; NaN when it does not get there."""
    below = np.flatnonzero(np.array(shares) < FOUND)
    if below.size == 0:
        return float(DB[0])
    i = int(below[-1])
    if i + 1 >= DB.size:
        return math.nan
    return float(DB[i] + (FOUND - shares[i]) / (shares[i + 1] - shares[i]))
