"""Residual maps: the mean of a residual over a state, with a band and a significance that hold for coloured noise.

A residual that is noise has no mean over anything.  Under that hypothesis the bins' means have a covariance that
follows from the residual's own autocorrelation; Wald's test on them, and Benjamini and Hochberg over all maps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from lostmotion.lab.autoregression import NoiseModel, fit_autoregression
from lostmotion.model.motion import FloatArray

__all__ = ["ResidualMap", "residual_maps"]

BINS = 12
LEAST_IN_BIN = 10
FALSE_DISCOVERIES = 0.05
BAND = 1.96


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """The mean of a residual (K,) over bins of a variable with centres x (K,), and the half width of its 95 % band.

    explained: the share of the residual's mean square that the map takes, less what noise would; samples: independent
    ones that the residual is worth; significant: among all maps, with 5 % false discoveries.
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
    residuals: Sequence[FloatArray],
    variables: Mapping[str, Sequence[FloatArray]],
    noise: NoiseModel | None = None,
) -> tuple[ResidualMap, ...]:
    """A map for each variable, the one that explains most first.

    residuals: one (N_r,) for each recording, NaN where not sampled; variables: by name, one (N_r,) for each recording,
    NaN allowed.  noise: of the residuals; when left out, the autocorrelation of what each map leaves of them.
    """
    found = [_map(name, residuals, series, noise) for name, series in variables.items()]
    return _discovered([one for one in found if one is not None])


def _map(
    name: str, residuals: Sequence[FloatArray], series: Sequence[FloatArray], noise: NoiseModel | None
) -> ResidualMap | None:
    """None for a variable that does not vary."""
    there = [np.isfinite(r) & np.isfinite(x) for r, x in zip(residuals, series, strict=True)]
    x = np.concatenate([x[ok] for x, ok in zip(series, there, strict=True)])
    r = np.concatenate([r[ok] for r, ok in zip(residuals, there, strict=True)])
    if x.size < 4 * LEAST_IN_BIN or np.ptp(x) <= 1e-12 * np.max(np.abs(x)):
        return None
    edges = np.unique(np.quantile(x, np.linspace(0, 1, min(BINS, x.size // LEAST_IN_BIN) + 1)))
    if edges.size < 3:
        return None
    count = edges.size - 1
    inside = [_inside(x, ok, edges) for x, ok in zip(series, there, strict=True)]
    pooled = _inside(x, np.ones(x.size, dtype=bool), edges)
    counts = pooled.sum(axis=1)
    mean = pooled @ r / counts
    left = [np.where(ok, r - mean @ of, np.nan) for r, ok, of in zip(residuals, there, inside, strict=True)]
    covariance, samples = _covariance(inside, noise or fit_autoregression(left), counts)
    if noise is None:  # the map has taken its share of the noise with it
        covariance = covariance * (1 + count / max(samples - count, count))
    by_chance = float(counts @ np.diag(covariance))
    statistic = float(mean @ np.linalg.lstsq(covariance, mean, rcond=1e-9)[0])
    return ResidualMap(
        name, pooled @ x / counts, mean, BAND * np.sqrt(np.diag(covariance)),
        explained=max(float(counts @ mean**2) - by_chance, 0.0) / max(float(r @ r), 1e-300),
        p_value=float(chdtrc(count, max(statistic, 0.0))), samples=samples,
    )  # fmt: skip


def _inside(x: FloatArray, there: NDArray[np.bool_], edges: FloatArray) -> FloatArray:
    """Which samples are in which bin, (K, N) of 0 and 1."""
    bins = np.clip(np.searchsorted(edges, x, "right") - 1, 0, edges.size - 2)
    return np.asarray((bins == np.arange(edges.size - 1)[:, None]) & there, dtype=float)


def _covariance(inside: Sequence[FloatArray], noise: NoiseModel, counts: FloatArray) -> tuple[FloatArray, float]:
    """Of the bins' means (K, K) under this noise, and how many independent samples the recordings are worth."""
    length = 1 << int(2 * max(of.shape[1] for of in inside) - 1).bit_length()
    gamma = noise.autocovariance(min(length // 2 - 1, 4096))
    spread = sum((_spread(of, gamma, length) for of in inside), start=np.zeros((counts.size, counts.size)))
    variance = float(spread.sum()) / float(counts.sum()) ** 2  # of the mean of all
    return spread / np.outer(counts, counts), float(gamma[0]) / max(variance, 1e-300)


def _spread(inside: FloatArray, gamma: FloatArray, length: int) -> FloatArray:
    """Covariance (K, K) of the sums over the bins of a series of autocovariance gamma; inside (K, N) is 0 or 1."""
    circle = np.zeros(length)
    circle[: gamma.size] = gamma
    circle[length - gamma.size + 1 :] = gamma[:0:-1]
    spectrum = np.fft.rfft(circle).real
    smeared = np.fft.irfft(np.fft.rfft(inside, length) * spectrum, length)[:, : inside.shape[1]]
    return np.asarray(inside @ smeared.T)


def _discovered(maps: Sequence[ResidualMap]) -> tuple[ResidualMap, ...]:
    """Benjamini and Hochberg: the maps below the largest p value that is at most its rank's share of 5 %."""
    p = np.sort([one.p_value for one in maps])
    passed = p[p <= FALSE_DISCOVERIES * np.arange(1, p.size + 1) / max(p.size, 1)]
    limit = float(passed[-1]) if passed.size else -1.0
    marked = [replace(one, significant=one.p_value <= limit) for one in maps]
    return tuple(sorted(marked, key=lambda one: -one.explained))
