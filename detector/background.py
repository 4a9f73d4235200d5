"""The noise of a joint's accelerometer, estimated from the joint's windows, with or without play.

Pure functions of windows; the caller decides when they are called and what is kept.  docs/decisions/0005-ringdown.md
has the measurements.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lostmotion.detector import ringdown
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.median import median
from lostmotion.detector.misfit import directions, split
from lostmotion.detector.whitening import MOST_ORDER, Noise, levinson, rounded, spectrum, unwhitener, whitener
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["LEAST_WINDOWS", "Background", "applied", "distance", "followed", "learn", "learning"]

LEAST_WINDOWS = 20
ROUNDS = 8
"""Most rounds of expectation and maximisation: the likelihood rises by less than 0.1 nats a window after them."""
SETTLED = 0.02
"""A round that raises the likelihood by less than so many nats a window is the last."""
LOUD = 2.0
"""A window whose rings have so many times the energy of the residual is not used for the noise: the part of an impact
that the rings do not explain is then as large as the noise (at 30 dB)."""
CALM = 0.25
"""Least share of windows with information on the noise: with rings at 30 dB the few quiet ones are a biased sample."""
SILENT = 0.8
"""Share of such windows below which the model without rings is rejected: it is 0.88 of those of a bar that a rough gear
excites as much as the noise, nearly all with hum or a fan, 0.45 of those with rings at 25 dB in coloured noise."""
RINGING, LEAST_RINGING = 0.5, 0.02
POWER, LEAST_POWER = 20.0, 3.0
"""First guess and bounds of the share of windows that ring, and of the rings' variance over that of the noise."""
HEALTHY_SCORE, HEALTHY_SHARE = 3.0, 0.02
"""Noise without rings scores above the first in less than 0.3 % of the windows (white, coloured, hum, fan, excited
bar); windows with rings at 25 dB that are mistaken for noise do in 5 to 7 %."""
RARE = 0.45
"""Rings with fewer such windows are rejected: they compensate for an autoregressive model of too few orders for hum (at
200 Hz up to 43 % of healthy windows); of windows with rings at 15 dB mostly more than 54 % do."""
MEMORY = 1000.0
"""Largest weight of the past, in windows."""
CHANGED = 0.1
"""Distance [nats a sample] of a changed noise: 1.5 times the deviation is 0.06, the onset of mains hum 1.1."""
POINTS = 2048
"""Frequencies at which spectra are evaluated."""
TOGETHER = 25
"""Windows whose moments are formed at once: those of a hundred take 7 MB for a moment."""
FREEDOM = ringdown.TRUST
"""Degrees of freedom of Student's t for the loudness of each window."""


@dataclass(frozen=True, slots=True)
class Background:
    """covariance: of the noise at lags of 0, 1, ... samples [m²/s⁴]; windows: number of windows it is estimated from;
    ringing: share of the last ones with a ring."""

    covariance: tuple[float, ...]
    windows: float
    length: int
    ringing: float

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [m/s²]."""
        return math.sqrt(self.covariance[0])

    @property
    def noise(self) -> Noise:
        """The autoregressive model of these covariances; its order has the least Bayesian information criterion."""
        return levinson(np.array(self.covariance), self.windows * self.length)


@dataclass(frozen=True, slots=True)
class _Model:
    """A noise, the share of windows that ring, the variance of the rings' amplitudes over that of the noise, and
    whether the residual of rings contains a misfit."""

    noise: Noise
    ringing: float = RINGING
    power: float = POWER
    misfit: bool = False


@dataclass(frozen=True, slots=True)
class _Fit:
    """likelihood: ln of that of all windows under the model; covariance: of the noise, as expected under it."""

    model: _Model
    likelihood: float
    covariance: FloatArray


def applied(background: Background, settings: DetectorSettings) -> DetectorSettings:
    """The settings with that noise, rounded."""
    noise = rounded(background.noise)
    return replace(settings, noise_ms2=noise.deviation, noise_colour=noise.colour)


def learn(
    windows: FloatArray, rate_hz: float, settings: DetectorSettings, earlier: Background | None = None
) -> Background | None:
    """The noise in windows [m/s²], shape (M, N), none missing, in which the joint may be worn or not.

    A window is slow motion, rings with a certain probability (the hypotheses of ``ringdown``, their amplitudes normal),
    and autoregressive noise whose loudness follows Student's t.  The model's likelihood is maximised by expectation and
    maximisation (Dempster, Laird and Rubin 1977) from several starts: noise without rings; rings in white noise, or in
    the ``earlier`` noise.  The best by Akaike's criterion wins, so the model takes hum for noise but not rings: hum
    neither begins nor decays.  The model without rings is accepted only if the windows then score like noise.
    Otherwise the noise is separated from the part of an impact that rings do not explain (``misfit``).

    None when the windows do not determine the noise because their rings are too loud.  Raises DetectorError for fewer
    than 20 windows.
    """
    work = learning(windows, rate_hz, settings, earlier)
    while True:
        try:
            next(work)
        except StopIteration as finished:
            result: Background | None = finished.value
            return result


def learning(
    windows: FloatArray, rate_hz: float, settings: DetectorSettings, earlier: Background | None = None
) -> Generator[None, None, Background | None]:
    """The same as ``learn`` in rounds: yields after each, about 30 times, and returns the result."""
    count, length = windows.shape
    if count < LEAST_WINDOWS or not np.all(np.isfinite(windows)):
        raise DetectorError(f"found {count} windows, expected at least {LEAST_WINDOWS}, without missing samples")
    bare = replace(settings, noise_ms2=None, noise_colour=())
    white = _white(windows, rate_hz, bare)
    if white.deviation**2 <= ringdown.DUST * float(np.mean(windows**2)):
        return None
    calm = windows[_loudness(windows, rate_hz, bare) < LOUD]
    quiet = len(calm)
    if quiet < max(LEAST_WINDOWS, CALM * count):
        return None
    silent = yield from _fitted(windows, rate_hz, bare, _Model(white, 0.0))
    starts = [_white(calm, rate_hz, bare), *([earlier.noise] if earlier else [])]
    fits = []
    for start in starts:
        fit = yield from _fitted(calm, rate_hz, bare, _Model(start))
        fits.append((yield from _weighed(windows, rate_hz, bare, fit)) if quiet < count else fit)
    best = max(fits, key=_criterion)
    if (
        quiet >= SILENT * count
        and _share_above(windows, rate_hz, bare, silent) < HEALTHY_SHARE
        and (_criterion(silent) > _criterion(best) or _share_above(windows, rate_hz, bare, best) < RARE)
    ):
        best, quiet = silent, count
    else:
        refined = yield from _fitted(windows, rate_hz, bare, replace(best.model, misfit=True))
        best = max(best, refined, key=_criterion)
    return Background(tuple(best.covariance.tolist()), float(quiet), length, best.model.ringing)


def followed(earlier: Background | None, new: Background) -> tuple[Background, bool]:
    """Both pooled, the past with the weight of 1000 windows at most; and whether the noise has changed: the new one is
    then used alone."""
    if earlier is None or len(earlier.covariance) != len(new.covariance):
        return new, False
    if distance(new.noise, earlier.noise) > CHANGED:
        return new, True
    past = min(earlier.windows, MEMORY)
    share = new.windows / (past + new.windows)
    old, now = np.array(earlier.covariance), np.array(new.covariance)
    pooled = (1 - share) * old + share * now
    return replace(new, covariance=tuple(pooled.tolist()), windows=past + new.windows), False


def distance(one: Noise, other: Noise) -> float:
    """Loss when the other noise predicts this one [nats a sample], 0 if the spectra are alike (Itakura, Saito 1968)."""
    ratio = spectrum(one, POINTS) / spectrum(other, POINTS)
    return float(np.mean(ratio - 1 - np.log(ratio))) / 2


def _white(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> Noise:
    """White noise from the residual of slow motion: the median over the windows."""
    slow = ringdown.bank(windows.shape[1], rate_hz, settings).slow
    energy = np.sum((windows - (windows @ slow) @ slow.T) ** 2, axis=1)
    return Noise(math.sqrt(median(energy) / (windows.shape[1] - slow.shape[1])), ())


def _loudness(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """Energy of the best rings over that of their residual, in white noise; shape (M,)."""
    bank = ringdown.bank(windows.shape[1], rate_hz, settings)
    left = windows - (windows @ bank.slow) @ bank.slow.T
    total = np.sum(left**2, axis=1)
    energy = ringdown.explained(left, bank).max(axis=1)
    return np.asarray(energy / np.maximum(total - energy, ringdown.DUST * total + np.finfo(float).tiny))


def _orders(length: int) -> int:
    return min(length // 3, MOST_ORDER)


def _fitted(
    windows: FloatArray, rate_hz: float, settings: DetectorSettings, start: _Model
) -> Generator[None, None, _Fit]:
    """Rounds of expectation and maximisation; ringing of 0 stays 0: the model without rings."""
    model, before = start, -math.inf
    for _ in range(ROUNDS):
        fit, better = _expected(windows, rate_hz, settings, model)
        if fit.likelihood - before < SETTLED * len(windows):
            return fit
        model, before = better, fit.likelihood
        yield
    return _expected(windows, rate_hz, settings, model)[0]


def _weighed(windows: FloatArray, rate_hz: float, settings: DetectorSettings, fit: _Fit) -> Generator[None, None, _Fit]:
    """The likelihood of all windows under the noise fitted to some; share and power of the rings are fitted to all."""
    model = fit.model
    for _ in range(ROUNDS // 2):
        fit_of_all, new = _expected(windows, rate_hz, settings, model)
        model = replace(new, noise=fit.model.noise)
        yield
    return _Fit(model, fit_of_all.likelihood, fit.covariance)


def _expected(windows: FloatArray, rate_hz: float, settings: DetectorSettings, model: _Model) -> tuple[_Fit, _Model]:
    """The likelihood under a model, and the model that is best for what is expected under this one.

    With whitened samples z, of which slow motion and the rings of a hypothesis with orthonormal basis B are unknown,
    the noise's expected z zᵀ is that of the residual, weighted by Student's t, plus the noise's variance along B.
    """
    count, length = windows.shape
    noise = model.noise
    known = replace(settings, noise_colour=noise.colour, noise_ms2=noise.deviation)
    whitening = whitener(length, noise.colour)
    motion = ringdown.slow_basis(length, rate_hz, known)
    white = windows @ whitening.T
    white -= (white @ motion) @ motion.T
    hidden = whitening @ np.linalg.qr(ringdown.slow_motion(length, rate_hz, settings))[0]
    constant = float(np.sum(np.log(np.diag(whitening)))) - float(np.linalg.slogdet(hidden.T @ hidden)[1]) / 2
    bank = ringdown.build(length, rate_hz, known) if model.ringing else None
    columns = None
    if model.ringing and model.misfit:
        columns = whitening @ directions(length, rate_hz, settings)
        columns -= motion @ (motion.T @ columns)
    found = _Moments(0.0, count * motion @ motion.T, 0.0, 0.0, 0.0)
    for i in range(0, count, TOGETHER):
        more = _moments(white[i : i + TOGETHER], model, motion, bank, columns)
        found = _Moments(*map(operator.add, found, more))
    root = unwhitener(length, noise.colour)
    covariance = root @ found.products @ root.T * (noise.deviation**2 / count)
    lags = np.array([np.trace(covariance, lag) / (length - lag) for lag in range(_orders(length) + 1)])
    better = replace(model, noise=levinson(lags, count * (length - motion.shape[1])), ringing=0.0)
    if model.ringing:
        power = found.energy / max(found.amplitudes * noise.deviation**2, 1e-300) - 1
        share = min(max(found.ringing / count, LEAST_RINGING), 1 - LEAST_RINGING)
        better = replace(better, ringing=share, power=max(power, LEAST_POWER))
    return _Fit(model, found.likelihood + count * constant, lags), better


class _Moments(NamedTuple):
    """Sums over windows: ln of the likelihood, the expected z zᵀ over the noise's variance (N, N), the probability of a
    ring, and the energy and number of amplitudes of the rings."""

    likelihood: float
    products: FloatArray
    ringing: float
    energy: float
    amplitudes: float


def _moments(
    white: FloatArray, model: _Model, motion: FloatArray, bank: ringdown.Bank | None, columns: FloatArray | None
) -> _Moments:
    """The sums for whitened windows (M, N) without slow motion; bank: of rings, if any, columns: of their misfit."""
    variance = model.noise.deviation**2
    freedom = white.shape[1] - motion.shape[1] + FREEDOM
    whole = np.sum(white**2, axis=1) + FREEDOM * variance
    likelihood = -freedom / 2 * np.log(whole) + FREEDOM / 2 * math.log(FREEDOM * variance)
    if bank is None:
        white = white * np.sqrt(freedom / whole)[:, None]
        return _Moments(float(likelihood.sum()), white.T @ white, 0.0, 0.0, 0.0)
    rings = _rings(white, whole, freedom, bank, model)
    likelihood += rings.gain
    ring, left = rings.probability, rings.left
    products = np.zeros_like(motion, shape=(white.shape[1],) * 2)
    if columns is not None:
        gain, left, products = split(left, rings.bases, rings.energy, ring, columns, variance)
        likelihood += ring * gain
    loose = np.sum(left**2, axis=1) + FREEDOM * variance
    for rows, weights in ((left, ring * freedom / loose), (white, (1 - ring) * freedom / whole)):
        products += (rows.T * weights) @ rows
    rows = (np.sqrt(ring)[:, None, None] * rings.bases).reshape(-1, white.shape[1])
    products += rows.T @ rows
    return _Moments(float(likelihood.sum()), products, float(ring.sum()), *rings.expected)


class _Rings(NamedTuple):
    """Of each window: ln of the likelihood ratio of rings, probability of a ring, residual of the likeliest one, its
    basis (rows, zero where it has fewer), its energy.  expected: the rings' energy and amplitudes in all windows."""

    gain: FloatArray
    probability: FloatArray
    left: FloatArray
    bases: FloatArray
    energy: FloatArray
    expected: tuple[float, float]


def _rings(white: FloatArray, whole: FloatArray, freedom: float, bank: ringdown.Bank, model: _Model) -> _Rings:
    energy, sizes = ringdown.explained(white, bank), bank.sizes
    # Normal amplitudes of variance S² have a penalty of ln(1 + S²)/2 each, and their energy a factor S² / (1 + S²).
    price = ringdown.PENALTY - math.log1p(model.power) / 2
    share = np.minimum(model.power / (1 + model.power) * energy / whole[:, None], 1 - ringdown.DUST)
    evidence = -freedom / 2 * np.log1p(-share) + bank.prior + sizes * price
    top = evidence.max(axis=1)
    odds = np.exp(evidence - top[:, None])
    log_ring = math.log(model.ringing) + top + np.log(odds.sum(axis=1))
    gain = np.logaddexp(math.log1p(-model.ringing), log_ring)
    ring = np.exp(log_ring - gain)
    odds *= (ring / odds.sum(axis=1))[:, None]
    best, left = evidence.argmax(axis=1), white.copy()
    bases = np.zeros((len(white), int(sizes.max()), white.shape[1]))
    for i in np.flatnonzero(ring > LEAST_RINGING):
        basis = bank.basis(int(best[i]))
        left[i] -= (basis @ white[i]) @ basis
        bases[i, : len(basis)] = basis
    own = np.take_along_axis(energy, best[:, None], 1)[:, 0]
    return _Rings(gain, ring, left, bases, own, (float(np.sum(odds * energy)), float(np.sum(odds @ sizes))))


def _criterion(fit: _Fit) -> float:
    """The likelihood minus Akaike's nat for each order of the noise: without it an autoregressive model of 25 orders is
    as likely as rings of 25 dB."""
    return fit.likelihood - len(fit.model.noise.colour)


def _share_above(windows: FloatArray, rate_hz: float, settings: DetectorSettings, fit: _Fit) -> float:
    """Share of the windows with a score above that of healthy ones under this noise."""
    noise = fit.model.noise
    known = replace(settings, noise_ms2=noise.deviation, noise_colour=noise.colour)
    bank = ringdown.build(windows.shape[1], rate_hz, known)
    return float(np.mean(ringdown.scores(windows, rate_hz, known, bank) > HEALTHY_SCORE))
