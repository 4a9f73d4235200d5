"""Residual maps: the mean of a residual over bins of a state, with a band and a significance for coloured noise.

Under the null hypothesis that the residual is noise, its means over bins are zero, with a covariance that follows from
its autocorrelation.  Wald's test is made of the means of each map, and the false discovery rate over all maps is
limited after Benjamini and Hochberg (1995).  A comparison and the description of a residual use these maps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from lostmotion.lab import policy, words
from lostmotion.lab.data.autoregression import NoiseModel, fit_autoregression
from lostmotion.lab.results import Curve, Finding
from lostmotion.model.motion import FloatArray

__all__ = ["ResidualMap", "finding", "residual_maps"]

BINS = 12
"""Largest number of bins of a map."""
LEAST_IN_BIN = 10
"""Least number of samples in a bin."""


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """The mean of a residual over K bins of a variable.

    x: centres of the bins (K,); mean (K,); half_width: of the 95 % band of the means for noise (K,); explained: share
    of the residual's mean square that the map explains, less the share expected for noise; p_value: of Wald's test;
    samples: effective number of independent samples; significant: among all maps, with 5 % false discoveries.
    """

    variable: str
    x: FloatArray
    mean: FloatArray
    half_width: FloatArray
    explained: float
    p_value: float
    samples: float
    significant: bool = False


def residual_maps(
    residuals: Sequence[FloatArray], variables: Mapping[str, Sequence[FloatArray]]
) -> tuple[ResidualMap, ...]:
    """A map of the residuals over each variable, the one that explains most first.

    residuals: one (N_r,) for each recording, NaN where not sampled; variables: by name, one (N_r,) for each recording,
    NaN allowed.  The noise is estimated from the residual of the map with the largest share.
    """
    binned = [one for name, x in variables.items() if (one := _binned(name, residuals, x)) is not None]
    if not binned:
        return ()
    noise = fit_autoregression(max(binned, key=lambda one: one.share).left(residuals))
    return _discovered([_map(one, noise) for one in binned])


def finding(
    acts_on: str,
    size: str,
    unit: str,
    maps: Sequence[ResidualMap],
    rubbing: Sequence[ResidualMap] = (),
    speed: str = "",
) -> Finding:
    """The description of a residual by the state that explains most of it, and by those that explain nearly as much.

    acts_on: the equation; size: the residual in words; unit: of the residual; maps: the best one first; rubbing: those
    of the residual times the direction of the motion, the mean of which is a dry friction that depends on a state;
    speed: the name of the speed, on which such a friction depends as well.
    """
    first = (maps[0].explained if maps else 0.0), (rubbing[0].explained if rubbing else 0.0)
    if max(first) < policy.FOLLOWS_STATE:
        return Finding(acts_on, (), f"{size}; it follows no single state")
    rubs = policy.FOLLOWS_ALSO * first[1] > first[0] or first[0] < policy.FOLLOWS_STATE
    best = rubbing[0] if rubs else maps[0]
    least = max(policy.FOLLOWS_STATE, policy.FOLLOWS_ALSO * best.explained)
    also = (speed,) if rubs else tuple(one.variable for one in maps[1:] if one.explained > least)
    variable, its_unit = words.variable(best.variable)
    low, high = best.mean - best.half_width, best.mean + best.half_width
    curve = Curve(best.variable, its_unit, best.x, best.mean, low, high, unit)
    what = f"is dry friction whose size follows {variable}" if rubs else f"follows {variable}"
    return Finding(acts_on, (best.variable, *also), f"{size}; {100 * best.explained:.0f} % of it {what}", curve)


@dataclass(frozen=True, eq=False)
class _Binned:
    """The mean of a residual (K,) over the bins of a variable with centres x (K,).

    counts: samples in each bin (K,); inside: for each recording whether a sample is in a bin, (K, N_r) of 0 and 1;
    power: sum of the squared residual.
    """

    variable: str
    x: FloatArray
    mean: FloatArray
    counts: FloatArray
    inside: tuple[FloatArray, ...]
    power: float

    @property
    def share(self) -> float:
        """The share of the squared residual that the means explain."""
        return float(self.counts @ self.mean**2) / max(self.power, 1e-300)

    def left(self, residuals: Sequence[FloatArray]) -> list[FloatArray]:
        """The residuals less the mean of their bin; NaN outside of the bins."""
        pairs = zip(residuals, self.inside, strict=True)
        return [np.where(inside.any(axis=0), r - self.mean @ inside, np.nan) for r, inside in pairs]


def _binned(name: str, residuals: Sequence[FloatArray], series: Sequence[FloatArray]) -> _Binned | None:
    """The means over the bins of one variable; None for a variable that does not vary."""
    there = [np.isfinite(r) & np.isfinite(x) for r, x in zip(residuals, series, strict=True)]
    pooled = np.concatenate([x[ok] for x, ok in zip(series, there, strict=True)])
    if pooled.size < 4 * LEAST_IN_BIN or np.ptp(pooled) <= 1e-12 * np.max(np.abs(pooled)):
        return None
    edges = np.unique(np.quantile(pooled, np.linspace(0, 1, min(BINS, pooled.size // LEAST_IN_BIN) + 1)))
    if edges.size < 3:
        return None
    count = edges.size - 1
    sums, centres, counts, power = np.zeros(count), np.zeros(count), np.zeros(count), 0.0
    inside = []
    for r, x, ok in zip(residuals, series, there, strict=True):
        bins = np.clip(np.searchsorted(edges, x, "right") - 1, 0, count - 1)
        sums += np.bincount(bins[ok], r[ok], count)
        centres += np.bincount(bins[ok], x[ok], count)
        counts += np.bincount(bins[ok], minlength=count)
        power += float(r[ok] @ r[ok])
        inside.append(np.asarray((bins == np.arange(count)[:, None]) & ok, dtype=float))
    return _Binned(name, centres / counts, sums / counts, counts, tuple(inside), power)


def _map(binned: _Binned, noise: NoiseModel) -> ResidualMap:
    length = 1 << int(2 * max(of.shape[1] for of in binned.inside) - 1).bit_length()
    gamma = noise.autocovariance(min(length // 2 - 1, 4096))
    spread = sum((_spread(of, gamma, length) for of in binned.inside), start=np.zeros((binned.x.size, binned.x.size)))
    counts, mean, count = binned.counts, binned.mean, binned.x.size
    samples = float(gamma[0]) * float(counts.sum()) ** 2 / max(float(spread.sum()), 1e-300)
    # the map also fits a share of the noise, so that its residual underestimates the noise
    covariance = spread / np.outer(counts, counts) * (1 + count / max(samples - count, count))
    statistic = float(mean @ np.linalg.lstsq(covariance, mean, rcond=1e-9)[0])
    explained = binned.share - float(counts @ np.diag(covariance)) / max(binned.power, 1e-300)
    p_value = float(chdtrc(count, max(statistic, 0.0)))
    half_width = policy.HALF_WIDTH * np.sqrt(np.diag(covariance))
    return ResidualMap(binned.variable, binned.x, mean, half_width, max(explained, 0.0), p_value, samples)


def _spread(inside: FloatArray, gamma: FloatArray, length: int) -> FloatArray:
    """Covariance (K, K) of the sums over the bins of a series of autocovariance gamma; inside (K, N) is 0 or 1."""
    circle = np.zeros(length)
    circle[: gamma.size] = gamma
    circle[length - gamma.size + 1 :] = gamma[:0:-1]
    spectrum = np.fft.rfft(circle).real
    smeared = np.fft.irfft(np.fft.rfft(inside, length) * spectrum, length)[:, : inside.shape[1]]
    return np.asarray(inside @ smeared.T)


def _discovered(maps: Sequence[ResidualMap]) -> tuple[ResidualMap, ...]:
    """The maps, those marked as significant whose p-value is at most the largest one that is below its rank's share of
    the level (Benjamini and Hochberg)."""
    p = np.sort([one.p_value for one in maps])
    passed = p[p <= policy.FALSE_NAME * np.arange(1, p.size + 1) / max(p.size, 1)]
    limit = float(passed[-1]) if passed.size else -1.0
    marked = [replace(one, significant=one.p_value <= limit) for one in maps]
    return tuple(sorted(marked, key=lambda one: -one.explained))
