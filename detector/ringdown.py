"""Likelihood ratio of an impact on the bar during a window, by a model of the oscillator.

An alternative to eq. 8, which uses the oscillator's frequency only.  docs/decisions/0005-ringdown.md has the
measurements.  No level here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector import legendre
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.median import median
from lostmotion.detector.whitening import whiten
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = [
    "SLOW_HZ",
    "SLOW_SHARE",
    "Bank",
    "bank",
    "build",
    "explained",
    "filled",
    "forget",
    "leftover",
    "ring",
    "scores",
    "slow_basis",
    "slow_motion",
    "validate",
]

SLOW_HZ, SLOW_SHARE = 16.0, 0.3
"""Below both, the latter a share of f_res, is motion: an arm's motion up to 3 Hz is fitted to 1e-4."""
STEPS_PER_TAU, MOST_STARTS, LEAST_STARTS = 30, 26, 10
"""Resolution of the start times of impacts."""
LAST_CYCLES = 1.0
"""The latest start of a ring, in cycles before the window's end."""
PENALTY = 1.5
"""Penalty of each free amplitude [nats]: ln(1 + S²)/2 for amplitudes of about S = 4 standard deviations."""
TRUST = 100.0
"""Weight of the calibrated noise, in samples, besides the window's own."""
LEAST_NEW = 0.05
"""Least share of a ring that is orthogonal to the rings before it; less is treated as the same ring."""
LEAST_SAMPLES, LEAST_CYCLES = 16, 3
FILLS = 8
"""Rounds in which missing samples are estimated from the others."""
CHUNK = 2048
TOGETHER = 32
"""Windows whose products with a bank are formed at once: those of a hundred take three megabytes for a moment."""
KEPT = 32
"""Banks that are cached, each of 0.2 MB for windows of 250 samples: one for each joint.  After six updates of the noise
of six joints, the banks of earlier settings took 4 MB more until they were dropped."""
DUST = 1e-12
"""Share of the window's power below which its residual is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """Templates for the windows of one length, in the space of whitened samples.

    slow: orthonormal basis of the arm's motion, (N, P); rings: ring-downs from each start on, without their slow parts,
    in orthonormal pairs, (N, 2 K); starts: [s] from the window's begin, (K,).  Of all H hypotheses of up to R
    amplitudes: columns, (H, R), the rings of each; mixes, (H, R, R), matrices to orthonormal coordinates, one a row,
    zero where rings are missing or nearly collinear; sizes: how many amplitudes each has, prior: log-prior minus
    penalty [nats], both (H,).
    """

    slow: FloatArray
    rings: FloatArray
    starts: FloatArray
    columns: NDArray[np.intp]
    mixes: FloatArray
    sizes: NDArray[np.intp]
    prior: FloatArray

    def basis(self, hypothesis: int) -> FloatArray:
        """Orthonormal basis of one hypothesis in a whitened window, (size, N)."""
        mix = self.mixes[hypothesis]
        return np.asarray(mix[mix.any(axis=1)] @ self.rings[:, self.columns[hypothesis]].T)

    def only(self, hypothesis: int) -> Bank:
        """The same with one hypothesis, which is as likely as they all were."""
        one = slice(hypothesis, hypothesis + 1)
        prior: FloatArray = np.asarray(-PENALTY * self.sizes[one])
        return replace(self, columns=self.columns[one], mixes=self.mixes[one], sizes=self.sizes[one], prior=prior)


_banks: dict[tuple[int, float, DetectorSettings], Bank] = {}


def scores(windows: FloatArray, rate_hz: float, settings: DetectorSettings, chosen: Bank | None = None) -> FloatArray:
    """Signal-to-noise ratio of rings in windows, shape (M, N), [-], shape (M,): about the ring's amplitude in its own
    standard deviations, 0.5 to 2 in noise alone; NaN for a window of one value.

    The hypotheses are: a ring from before the window, or one new start of it, or both, or both and a second start; all
    starts are equally likely, every start has a free amplitude and phase.  With Lambda = sum over all of
    exp(log-likelihood ratio - 1.5 nats for each amplitude) against "only noise" and L = ln(1 + Lambda) the score is
    sqrt(n (exp(2 L / n) - 1)): sqrt(2 L) for small ones, and for large ones the root of the energy ratio E / (T - E) n.

    The log-likelihood ratio of a hypothesis that explains the energy E of the whitened window's total T, with n degrees
    of freedom, is -(n + v)/2 ln(1 - E / (T + v)), v = 100 where the noise is calibrated, else 0: Student's t for a
    noise whose variance is known about as well as from v samples.  ``settings.noise_ms2`` is the standard deviation
    [m/s²] of the noise's one-step prediction error, ``settings.noise_colour`` are its reflection coefficients.  chosen:
    the bank of these settings if it exists.
    """
    chosen = chosen or bank(windows.shape[1], rate_hz, settings)
    parts = [_scores(windows[i : i + CHUNK], chosen, settings) for i in range(0, len(windows), CHUNK)]
    return np.concatenate(parts) if parts else np.empty(0)


@np.errstate(invalid="ignore", over="ignore")  # readings that overflow give NaN
def _scores(windows: FloatArray, chosen: Bank, settings: DetectorSettings) -> FloatArray:
    white = whiten(windows, settings.noise_colour)
    before = _energy(white)
    white -= (white @ chosen.slow) @ chosen.slow.T
    total = _energy(white)
    silent = total <= DUST * before
    trust = 0.0 if settings.noise_ms2 is None else TRUST
    whole = np.where(silent, 1.0, total) + trust * (settings.noise_ms2 or 0.0) ** 2
    freedom = white.shape[1] - chosen.slow.shape[1] + trust
    share = np.minimum(explained(white, chosen) / whole[:, None], 1 - DUST)
    evidence = -freedom / 2 * np.log1p(-share) + chosen.prior
    top = np.maximum(evidence.max(axis=1), 0.0)
    # ln(1 + sum exp): the 1 is "only noise".
    likelihood = top + np.log(np.exp(-top) + np.sum(np.exp(evidence - top[:, None]), axis=1))
    return np.where(silent, np.nan, np.sqrt(freedom * np.expm1(2 * likelihood / freedom)))


def explained(white: FloatArray, chosen: Bank) -> FloatArray:
    """The energy of whitened windows, shape (M, N), that each hypothesis of a bank explains, shape (M, H)."""
    energy = np.empty((len(white), chosen.prior.size))
    pairs = (white @ chosen.rings).T
    if len(white) == 1:  # the running service: half the time of the products below
        amplitudes = np.einsum("hrc,hc->hr", chosen.mixes, pairs[:, 0][chosen.columns])
        return np.asarray(np.einsum("hr,hr->h", amplitudes, amplitudes)[None])
    mixes = np.ascontiguousarray(chosen.mixes)
    for i in range(0, len(white), TOGETHER):
        amplitudes = mixes @ pairs[:, i : i + TOGETHER][chosen.columns]
        energy[i : i + TOGETHER] = np.einsum("hrm,hrm->mh", amplitudes, amplitudes)
    return energy


def _energy(white: FloatArray) -> FloatArray:
    """Sum of the squares of each window, shape (M, N) to (M,)."""
    return np.asarray(np.einsum("mn,mn->m", white, white))


def leftover(windows: FloatArray, rate_hz: float, settings: DetectorSettings) -> float:
    """Residual of slow motion and the best rings in windows (M, N): median of the mean squares of whitened samples
    [m²/s⁴]."""
    chosen = bank(windows.shape[1], rate_hz, settings)
    white = whiten(windows, settings.noise_colour)
    white -= (white @ chosen.slow) @ chosen.slow.T
    left = _energy(white) - explained(white, chosen).max(axis=1)
    return median(left / windows.shape[1])


def filled(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """The window, shape (N,), with missing samples from slow motion and rings fitted to the others."""
    missing = ~np.isfinite(accel)
    if not missing.any() or missing.all():
        return accel
    raw = _raw(accel.size, rate_hz, settings)
    index = np.arange(accel.size)
    values = np.interp(index, index[~missing], accel[~missing])
    for _ in range(FILLS):
        values[missing] = raw[missing] @ (raw.T @ values)
    return values


def validate(length: int, rate_hz: float, settings: DetectorSettings) -> None:
    """Raises DetectorError when windows of ``length`` samples are too short, or the noise's colour is impossible."""
    if settings.f_res_hz >= rate_hz / 2:
        raise DetectorError(
            f"f_res_hz is {settings.f_res_hz:g}; expected less than half of the rate, {rate_hz / 2:g} Hz: "
            "take a faster sensor or a slower oscillator"
        )
    least = max(
        LEAST_SAMPLES, 2 * len(settings.noise_colour) + 1, math.ceil(LEAST_CYCLES * rate_hz / settings.f_res_hz)
    )
    if length < least:
        raise DetectorError(
            f"a window has {length} samples; expected at least {least}, three periods of the oscillator: raise window_s"
        )
    if any(abs(reflection) >= 1 for reflection in settings.noise_colour):
        raise DetectorError(
            f"noise_colour is {settings.noise_colour}; expected reflection coefficients between -1 and 1, "
            "as `lostmotion calibrate healthy` prints them"
        )


def bank(length: int, rate_hz: float, settings: DetectorSettings) -> Bank:
    """The bank for windows of ``length`` samples, at least 16; the last ``KEPT`` ones are cached."""
    key = length, rate_hz, settings
    if (known := _banks.pop(key, None)) is None:
        known = build(length, rate_hz, settings)
        if len(_banks) >= KEPT:
            _banks.pop(next(iter(_banks)), None)
    _banks[key] = known  # the last one is the newest
    return known


def forget(length: int, rate_hz: float, settings: DetectorSettings) -> None:
    """Drops the bank of settings that will not be used again."""
    _banks.pop((length, rate_hz, settings), None)


def build(
    length: int, rate_hz: float, settings: DetectorSettings, most_starts: int = MOST_STARTS, line_hz: float = 0.0
) -> Bank:
    """The same, not cached; line_hz: frequency of a steady line in the windows, 0 for none."""
    time = np.arange(length) / rate_hz
    slow = slow_basis(length, rate_hz, settings, line_hz)
    starts = _starts(length / rate_hz, settings, most_starts)
    pairs = ring((time - starts[:, None]).ravel(), settings).reshape(starts.size, length, 2).transpose(0, 2, 1)
    white = whiten(pairs, settings.noise_colour).transpose(0, 2, 1)
    rings = np.hstack(list(np.linalg.qr(white - slow @ (slow.T @ white))[0]))
    return Bank(slow, rings, starts, *_hypotheses(rings.T @ rings))


def slow_basis(length: int, rate_hz: float, settings: DetectorSettings, line_hz: float = 0.0) -> FloatArray:
    """Orthonormal basis of the arm's motion, and of a steady line [Hz], whitened, shape (N, P)."""
    if not line_hz:
        return _slow_basis(length, _degree(length, rate_hz, settings), settings.noise_colour)
    columns = slow_motion(length, rate_hz, settings)
    turn = 2 * math.pi * line_hz * np.arange(length) / rate_hz
    columns = np.column_stack([columns, np.cos(turn), np.sin(turn)])
    return _orthonormal(whiten(columns.T, settings.noise_colour).T, 1e-9)


@lru_cache(maxsize=16)
def _slow_basis(length: int, degree: int, colour: tuple[float, ...]) -> FloatArray:
    """The same without a line; cached, as a search of fifty resonances uses one."""
    return _orthonormal(whiten(_polynomials(length, degree).T, colour).T, 1e-9)


@lru_cache(maxsize=16)
def _raw(length: int, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """Slow motion and rings before whitening: orthonormal, shape (N, R)."""
    time = np.arange(length) / rate_hz
    pairs = [ring(time - start, settings) for start in _starts(length / rate_hz, settings)]
    return _orthonormal(np.hstack([slow_motion(length, rate_hz, settings), *pairs]), 1e-3)


def _starts(duration: float, settings: DetectorSettings, most: int = MOST_STARTS) -> FloatArray:
    """The window's begin, and moments spread evenly over it [s]."""
    tau = 1 / (2 * math.pi * settings.zeta * settings.f_res_hz)
    last = max(duration - LAST_CYCLES / settings.f_res_hz, 0.5 * duration)
    count = round(min(max(STEPS_PER_TAU * last / tau, LEAST_STARTS), most))
    return np.linspace(0.0, last, count)


def ring(after: FloatArray, settings: DetectorSettings) -> FloatArray:
    """Both phases of eq. 6's free motion from time 0 on, shape (N, 2)."""
    omega = 2 * math.pi * settings.f_res_hz
    exponent = complex(-settings.zeta, math.sqrt(1 - settings.zeta**2)) * omega
    wave = np.where(after >= -1e-12, np.exp(exponent * np.maximum(after, 0.0)), 0.0)
    return np.column_stack([wave.real, wave.imag])


def slow_motion(length: int, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """Polynomials, the highest with zeros as close as a sine of 16 Hz or 0.3 f_res has them, at least cubic; (N, P)."""
    return _polynomials(length, _degree(length, rate_hz, settings))


def _degree(length: int, rate_hz: float, settings: DetectorSettings) -> int:
    top_hz = min(SLOW_HZ, SLOW_SHARE * settings.f_res_hz)
    return max(min(int(2 * top_hz * length / rate_hz + 1e-6), length // 4), 3)  # in spite of a rate's rounding


def _polynomials(length: int, degree: int) -> FloatArray:
    return legendre.values(np.linspace(-1, 1, length), degree)


def _hypotheses(gram: FloatArray) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.intp], FloatArray]:
    """columns, mixes, sizes and prior of a Bank from the products (2 K, 2 K) of its rings."""
    families = _families(gram.shape[0] // 2)
    count, most = sum(map(len, families)), max(family.shape[1] for family in families)
    # The hypotheses lie next to each other in memory: one window's products are then sums over long rows.
    columns, mixes = np.zeros((most, count), np.intp).T, np.zeros((most, most, count)).transpose(2, 0, 1)
    sizes, prior, first = np.empty(count, np.intp), np.empty(count), 0
    for family in families:
        power, directions = np.linalg.eigh(gram[family[:, :, None], family[:, None, :]])
        significant = power > LEAST_NEW
        scale = np.where(significant, 1 / np.sqrt(np.maximum(power, LEAST_NEW)), 0.0)
        own, rings = slice(first, first + len(family)), family.shape[1]
        columns[own, :rings] = family
        mixes[own, :rings, :rings] = (directions * scale[:, None, :]).transpose(0, 2, 1)
        sizes[own] = significant.sum(axis=1)
        prior[own] = -PENALTY * sizes[own] - math.log(len(family))
        first = own.stop
    return columns, mixes, sizes, prior


@lru_cache(maxsize=16)
def _families(starts: int) -> tuple[NDArray[np.intp], ...]:
    """The rings of each hypothesis, shape (hypotheses, rings), grouped by their number: a start, the begin and a start,
    the begin and two."""
    later = range(1, starts)
    families = [(k,) for k in range(starts)], [(0, k) for k in later], [(0, *two) for two in combinations(later, 2)]
    return tuple(
        (2 * np.array(family, dtype=np.intp)[:, :, None] + (0, 1)).reshape(len(family), -1) for family in families
    )


def _orthonormal(columns: FloatArray, least: float) -> FloatArray:
    """Orthonormal basis of the columns, scaled alike, without singular values below a share of the largest."""
    basis, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(basis[:, size > least * size[0]])
