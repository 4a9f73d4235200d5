"""Resonance and damping of a joint's bar, estimated from the windows after the joint's reversals.

Pure functions of windows; ``learner`` calls them and uses the values.  ``oscillator_id`` is for taps on the bar.
docs/decisions/0012-following-the-bar.md has the measurements.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector import ringdown
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["Bar", "agrees", "finding", "moved", "used"]

REACH = 0.2
"""The resonance is searched for within this share of the configured value."""
COARSE, FINE, FINE_STEPS = 0.02, 0.005, 5
"""Steps of the search, as shares of the resonance (a window of 0.25 s resolves 4 Hz), and how many fine ones a side."""
SAMPLES, STARTS = 8.0, 12
"""Samples a period (a faster sensor's are averaged) and start times of rings in the coarse search, which then takes an
eighth of the time.  The fine search uses all: with these its damping is a third too small."""
CLEAR = 10.0
"""Windows are used whose rings are so many nats likelier than white noise alone."""
LEAST_WINDOWS = 20
NEW = 0.15
"""Share of the log-likelihood that new rings within the window contribute at least, in addition to one from before it:
0.26 to 0.65 for rings after reversals, 0.09 and less for steady hum or a fan."""
FOREIGN, APART = 0.025, 0.75
"""Where a steady line farther away than APART / (length of the window) adds this share of the log-likelihood, there is
another source, and no resonance is estimated: hum beside rings would bias it by 2 to 15 %."""
MISFIT, ZETA_MISFIT = 0.003, 0.1
"""Relative standard deviations of the errors of resonance and damping by bounces and the colour of the noise."""
SURE = 3.0
"""An estimate is used if it is so many standard deviations from the configured value."""
SHARE, STEP, ZETA_STEP = 0.5, 0.02, 0.25
"""Gain of one estimate in the update of the known values, and the largest steps of resonance and ln zeta."""
ZETAS = 2.0 ** np.arange(-1.0, 2.1, 0.5)
"""Damping ratios that are compared, over the configured one."""


@dataclass(frozen=True, slots=True)
class Bar:
    """Resonance [Hz] and its standard deviation; damping ratio and the standard deviation of its logarithm; windows:
    how many of the last block show it."""

    f_res_hz: float
    f_deviation: float
    zeta: float
    zeta_deviation: float
    windows: int


def used(known: Bar | None, given: DetectorSettings) -> DetectorSettings:
    """The settings with the estimated resonance and damping, each where it differs significantly from the given one.  A
    damping below the given one is not used: bouncing teeth prolong a ring."""
    if known is None:
        return given
    f_res, zeta = given.f_res_hz, given.zeta
    if abs(known.f_res_hz - f_res) > SURE * known.f_deviation:
        f_res = round(known.f_res_hz, 2)
    if known.zeta > zeta and math.log(known.zeta / zeta) > SURE * known.zeta_deviation:
        zeta = float(f"{known.zeta:.3g}")
    return replace(given, f_res_hz=f_res, zeta=zeta)


def agrees(known: Bar | None, found: Bar, given: DetectorSettings) -> bool:
    """Whether an estimate agrees with the known values, within ``SURE`` of its standard deviations."""
    f_res, zeta = _so_far(known, given)
    resonance, damping = abs(found.f_res_hz - f_res), abs(math.log(found.zeta / zeta))
    return resonance < SURE * found.f_deviation and damping < SURE * found.zeta_deviation


def moved(known: Bar | None, found: Bar, given: DetectorSettings) -> Bar:
    """The known values after one more estimate: half of the difference is added, in limited steps."""
    f_res, zeta = _so_far(known, given)
    f_res *= 1 + _limited(SHARE * (found.f_res_hz / f_res - 1), STEP)
    zeta *= math.exp(_limited(SHARE * math.log(found.zeta / zeta), ZETA_STEP))
    return replace(found, f_res_hz=f_res, zeta=zeta)


def _so_far(known: Bar | None, given: DetectorSettings) -> tuple[float, float]:
    return (known.f_res_hz, known.zeta) if known else (given.f_res_hz, given.zeta)


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)


def finding(windows: FloatArray, rate_hz: float, given: DetectorSettings) -> Generator[None, None, Bar | None]:
    """The bar from windows [m/s²], shape (M, N), without missing samples; in rounds, each as long as scoring all
    windows with a new bank.

    The log-likelihood of a resonance and a damping ratio is the sum over the windows of ln(1 + Lambda) of
    ``ringdown.scores`` in white noise of unknown size.  It is searched within ``REACH`` of the given resonance, and for
    the damping from half of the given one to four times.  Standard deviations are those of an M-estimator (Huber 1967):
    the scatter of the windows' slopes over the curvature, so that disagreeing windows increase them.

    None where fewer than 20 windows show a ring, or none that begins within the window and decays, or where there is
    also a steady line, or where the best value is at an end of the search.
    """
    # The noise is not used: it may have been estimated with a wrong resonance.  Hum is excluded below.
    bare = replace(given, noise_ms2=None, noise_colour=())
    tried = given.f_res_hz * (1 + np.arange(-REACH, REACH + COARSE / 2, COARSE))
    coarse = yield from _likelihood_grid(
        *_averaged(windows, rate_hz, given.f_res_hz), [replace(bare, f_res_hz=float(f_res)) for f_res in tried], STARTS
    )
    clear = np.max(coarse, axis=0) > CLEAR
    if clear.sum() < LEAST_WINDOWS:
        return None
    windows = windows[clear]
    best = int(np.argmax(np.sum(coarse, axis=1, where=clear)))
    if best in (0, tried.size - 1):
        return None
    settings = replace(bare, f_res_hz=float(tried[best]))
    settings, zeta_deviation = yield from _damping(windows, rate_hz, settings)
    if not math.isfinite(zeta_deviation):
        return None
    fine = settings.f_res_hz * (1 + FINE * np.arange(-FINE_STEPS, FINE_STEPS + 1))
    log_likelihoods = yield from _likelihood_grid(
        windows, rate_hz, [replace(settings, f_res_hz=float(f_res)) for f_res in fine]
    )
    f_res, deviation = _maximum(log_likelihoods, fine)
    settings = replace(settings, f_res_hz=f_res)
    if not math.isfinite(deviation) or not (yield from _is_alone(windows, rate_hz, settings)):
        return None
    deviation, zeta_deviation = math.hypot(deviation, MISFIT * f_res), math.hypot(zeta_deviation, ZETA_MISFIT)
    return Bar(f_res, deviation, settings.zeta, zeta_deviation, int(clear.sum()))


def _averaged(windows: FloatArray, rate_hz: float, f_res_hz: float) -> tuple[FloatArray, float]:
    """Means of as many neighbouring samples as leave SAMPLES a period, and their rate [Hz]."""
    many = max(int(rate_hz / (SAMPLES * f_res_hz)), 1)
    count = windows.shape[1] // many
    return windows[:, : count * many].reshape(len(windows), count, many).mean(axis=2), rate_hz / many


def _damping(
    windows: FloatArray, rate_hz: float, settings: DetectorSettings
) -> Generator[None, None, tuple[DetectorSettings, float]]:
    """The settings with the likeliest damping ratio, and the standard deviation of its logarithm; the given ones and
    NaN where it lies at an end of the grid."""
    tried = [replace(settings, zeta=settings.zeta * float(factor)) for factor in ZETAS]
    log_likelihoods = yield from _likelihood_grid(windows, rate_hz, tried)
    size, deviation = _maximum(log_likelihoods, np.log(ZETAS))
    if not math.isfinite(deviation):
        return settings, math.nan
    return replace(settings, zeta=settings.zeta * math.exp(size)), deviation


def _maximum(log_likelihoods: FloatArray, at: NDArray[np.floating[Any]]) -> tuple[float, float]:
    """Argument of the largest sum of log-likelihoods, shape (P, M), on an even grid (P,), and its standard deviation;
    NaN where it is at an end."""
    best = int(np.argmax(log_likelihoods.sum(axis=1)))
    if best in (0, at.size - 1):
        return math.nan, math.nan
    step = float(at[1] - at[0])
    slope = (log_likelihoods[best + 1] - log_likelihoods[best - 1]) / (2 * step)
    bend = float(np.sum(2 * log_likelihoods[best] - log_likelihoods[best + 1] - log_likelihoods[best - 1])) / step**2
    if not bend > 0:
        return math.nan, math.nan
    return float(at[best] + np.sum(slope) / bend), math.sqrt(float(slope @ slope)) / bend


def _likelihood_grid(
    windows: FloatArray, rate_hz: float, tried: Sequence[DetectorSettings], most_starts: int = ringdown.MOST_STARTS
) -> Generator[None, None, FloatArray]:
    """ln(1 + Lambda) of each window with each of the settings, shape (P, M); a round for each.

    No name holds a bank between two rounds: the looks of six joints at once would keep six, 0.2 MB each.
    """
    length, found = windows.shape[1], []
    for settings in tried:
        found.append(
            _log_likelihoods(windows, rate_hz, settings, ringdown.build(length, rate_hz, settings, most_starts))
        )
        yield
    return np.array(found)


def _log_likelihoods(
    windows: FloatArray, rate_hz: float, settings: DetectorSettings, bank: ringdown.Bank
) -> FloatArray:
    freedom = windows.shape[1] - bank.slow.shape[1]
    return np.asarray(freedom / 2 * np.log1p(ringdown.scores(windows, rate_hz, settings, bank) ** 2 / freedom))


def _is_alone(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> Generator[None, None, bool]:
    """Whether the ring begins anew within the windows, and no steady line elsewhere adds to it."""
    length = windows.shape[1]
    whole, new = _new(windows, rate_hz, settings)
    if new < NEW * whole:
        return False
    yield
    apart = APART * rate_hz / length
    tried = settings.f_res_hz * (1 + np.arange(-1.5 * REACH, 1.5 * REACH, 2 * COARSE))
    for line in tried[(np.abs(tried - settings.f_res_hz) > apart) & (tried < rate_hz / 2)]:
        if _with_line(windows, rate_hz, settings, float(line)) - whole > FOREIGN * whole:
            return False
        yield
    return True


def _new(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> tuple[float, float]:
    """The log-likelihood of all windows, and the contribution of rings that begin within them.

    Its bank is not cached, as it is needed once.
    """
    bank = ringdown.build(windows.shape[1], rate_hz, settings)
    whole = float(_log_likelihoods(windows, rate_hz, settings, bank).sum())
    before = float(_log_likelihoods(windows, rate_hz, settings, bank.only(0)).sum())
    return whole, whole - before


def _with_line(windows: FloatArray, rate_hz: float, settings: DetectorSettings, line_hz: float) -> float:
    """The log-likelihood of all windows with a steady line in addition to the rings."""
    length = windows.shape[1]
    bank = ringdown.build(length, rate_hz, settings, line_hz=line_hz)
    slow = ringdown.slow_basis(length, rate_hz, settings)
    return float(_log_likelihoods(windows, rate_hz, settings, bank).sum()) + _line(windows, slow, bank.slow)


def _line(windows: FloatArray, slow: FloatArray, with_line: FloatArray) -> float:
    """Increase of the log-likelihood of all windows by a steady line, minus the penalty of its amplitudes."""
    without, left = (np.sum((windows - (windows @ basis) @ basis.T) ** 2, axis=1) for basis in (slow, with_line))
    freedom = windows.shape[1] - slow.shape[1]
    return float(
        np.sum(freedom / 2 * np.log(without / np.maximum(left, ringdown.DUST * without)) - 2 * ringdown.PENALTY)
    )
