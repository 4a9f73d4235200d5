"""Settings for a robot: window, bands and noise, optimised on its windows.  ``level`` has levels."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from lostmotion.detector import ringdown
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.score import batch, validate
from lostmotion.detector.spectrum import amplitudes, bands, transform
from lostmotion.detector.whitening import fit_noise, rounded
from lostmotion.detector.window import LEVELS, DetectorSettings, FloatArray, Statistic

__all__ = ["LEAST_WINDOWS", "LONGEST_S", "Tuned", "found_share", "least_acceleration", "least_amplitude", "tune"]

LONGEST_S = 0.5
"""Length of windows for tuning [s]."""
LENGTHS_S = (0.15, 0.2, 0.25, 0.3, 0.4, 0.5)
WIDTHS = (0.07, 0.14, 0.2, 0.28, 0.41, 0.55)
"""Widths of the mask that are tried, as shares of f_res."""
NORM_CENTRES, NORM_WIDTHS = (0.6, 1.4, 1.7, 2.0, 2.5, 3.0), (0.35, 0.7, 1.4)
NOISE_SAMPLES = 400
"""Samples of each window for the noise; more add no information."""
LEAST_WINDOWS = 50
FALSE_ALARM = 0.1
"""Detection is averaged over false-alarm rates from 0 to this one; smaller ones need more windows."""
SWAY_HZ = 1.0
"""Frequency of the sway for which the needed acceleration is reported."""
CLEARLY = 0.01
"""Least gain in the share found for other settings than the usual ones."""
MIDDLING = 0.6
"""Rings are added so large that the usual settings find about this share: where settings differ most."""
LOUDEST = 10.0
"""Rings so many times as large as the rms of the windows are always found in healthy ones: in noise alone (white,
coloured, hum, a fan; 200 to 1000 Hz) 0.6 to 1.6 times are enough for MIDDLING, 2.5 for 90 % above the level.  Where
impacts of 25 times the noise hide them eq. 8 finds no ring at all."""
OPEN_SHARE = 0.7
"""An impact after this share of the window is observed for too short a time."""
ONSET_S = (0.005, 0.09)
WRONG_F, WRONG_ZETA = 0.005, 0.1
"""No calibration is better than this [share]."""


@dataclass(frozen=True, slots=True)
class Tuned:
    """settings: the best; found: by statistic, the share of rings found at false-alarm rates below 10 %, on average
    over the rate, and before: by eq. 8 as it was set; windows: number of healthy ones used."""

    settings: DetectorSettings
    found: dict[Statistic, float]
    before: float
    windows: int


def tune(healthy: FloatArray, rate_hz: float, settings: DetectorSettings, worn: FloatArray | None = None) -> Tuned:
    """The settings with the highest share of worn windows found at few false alarms.

    healthy and worn: acceleration [m/s²] from a reversal on for 0.5 s, shape (M, N) each, none missing.  Without worn
    windows, rings of the oscillator of ``settings`` are added to the healthy ones, from 5 to 90 ms after the reversal
    on, with a rebound and slightly wrong resonance and damping.  The noise (``ringdown``) is that of the healthy ones.
    Raises DetectorError for fewer than 50 healthy windows, and for such as hide large rings.
    """
    if len(healthy) < LEAST_WINDOWS:
        raise DetectorError(
            f"found {len(healthy)} healthy windows, expected at least {LEAST_WINDOWS}: "
            "record a minute or more of brisk motion that changes its direction twice a second"
        )
    usual = _usual(settings, rate_hz)
    if worn is None:
        waves = rings(len(healthy), healthy.shape[1], rate_hz, settings, np.random.default_rng(0))
        worn = healthy + _middling(healthy, waves, rate_hz, usual) * waves
    before = _found(usual, healthy, worn, rate_hz)
    band, best = usual, before + CLEARLY
    for candidate in _bands(usual, healthy, worn, rate_hz):
        if candidate[0] > best:
            best, band = candidate
    ringing = _best_ringdown(replace(settings, statistic="ringdown"), healthy, worn, rate_hz)
    found: dict[Statistic, float] = {"band": max(before, best - CLEARLY * (band is usual)), "ringdown": ringing[0]}
    best_of: Statistic = "ringdown" if found["ringdown"] >= found["band"] - CLEARLY else "band"
    ring = ringing[1]
    chosen = replace(
        band, window_s=(ring if best_of == "ringdown" else band).window_s, statistic=best_of,
        noise_ms2=ring.noise_ms2, noise_colour=ring.noise_colour, level=LEVELS[best_of],
    )  # fmt: skip
    return Tuned(chosen, found, before, len(healthy))


def _usual(settings: DetectorSettings, rate_hz: float) -> DetectorSettings:
    """Eq. 8 as it is set, or the first choice of bands that the rate allows."""
    usual = replace(settings, window_s=settings.window_s or 0.25, statistic="band", noise_ms2=None, noise_colour=())
    f_res = settings.f_res_hz
    others = (
        replace(usual, f_norm_hz=centre * f_res, f_norm_width_hz=width * f_res)
        for centre, width in product(NORM_CENTRES, NORM_WIDTHS)
    )
    refusal = DetectorError("")
    for tried in (usual, *others):
        try:
            validate(tried, rate_hz)
        except DetectorError as error:
            refusal = error
        else:
            return tried
    raise refusal


def rings(count: int, length: int, rate_hz: float, settings: DetectorSettings, rng: np.random.Generator) -> FloatArray:
    """Ring-downs of about unit amplitude after impacts in windows, shape (count, length)."""
    time = np.arange(length) / rate_hz
    omega = 2 * math.pi * settings.f_res_hz * (1 + WRONG_F * rng.normal(size=(count, 1)))
    zeta = settings.zeta * np.exp(WRONG_ZETA * rng.normal(size=(count, 1)))

    def ring(start: FloatArray) -> FloatArray:
        after = time - start
        decay = np.exp(-zeta * omega * np.maximum(after, 0.0))
        return np.asarray(np.where(after >= 0, decay * np.sin(omega * np.sqrt(1 - zeta**2) * after), 0.0))

    first = rng.uniform(*ONSET_S, (count, 1))
    back = rng.uniform(0.0, 0.5, (count, 1)) * ring(first + rng.uniform(0.01, 0.06, (count, 1)))
    return np.asarray(rng.choice((-1.0, 1.0), (count, 1)) * (ring(first) - back))


def least_amplitude(healthy: FloatArray, rate_hz: float, settings: DetectorSettings, level: float) -> float:
    """The amplitude [m/s²] of rings of which 90 % score above ``level`` in these windows, shape (M, N); infinite where
    that takes rings far larger than all else in the windows."""
    waves = rings(len(healthy), healthy.shape[1], rate_hz, settings, np.random.default_rng(1))

    def above(amplitude: float) -> float:
        return float(np.mean(batch(healthy + amplitude * waves, rate_hz, settings) > level))

    size = float(np.std(healthy)) + 1e-6
    return _bisected(above, size, 0.9, LOUDEST * size)


def least_acceleration(amplitude: float, play_rad: float, settings: DetectorSettings) -> float:
    """Amplitude [rad/s²] of a sway at SWAY_HZ whose reversals make rings of ``amplitude`` [m/s²] across a play.

    About a reversal the commanded acceleration is j t, so the gap phi = j t³/6 closes at the speed v = j t²/2 =
    (6 phi)^(2/3) j^(1/3) / 2, and the tip of a bar of length l then rings with l omega_res v: j = 8 v³ / (6 phi)².
    It must also close while the window is open.  A sway of amplitude a has j = 2π f a where its acceleration is zero.
    """
    speed = amplitude / (abs(settings.length_m) * 2 * math.pi * settings.f_res_hz)
    loud = 8 * speed**3 / (6 * play_rad) ** 2
    soon = 6 * play_rad / (OPEN_SHARE * (settings.window_s or LONGEST_S)) ** 3
    return max(loud, soon) / (2 * math.pi * SWAY_HZ)


def found_share(healthy: FloatArray, worn: FloatArray) -> float:
    """Share of worn scores above the levels that let 0 to 10 % of the healthy scores through, averaged."""
    levels = np.sort(healthy)[-max(round(FALSE_ALARM * healthy.size), 1) :]
    return float(np.mean(worn[:, None] > levels))


def _found(settings: DetectorSettings, healthy: FloatArray, worn: FloatArray, rate_hz: float) -> float:
    length = round((settings.window_s or 0.25) * rate_hz)
    return found_share(*(batch(windows[:, :length], rate_hz, settings) for windows in (healthy, worn)))


def _middling(healthy: FloatArray, waves: FloatArray, rate_hz: float, usual: DetectorSettings) -> float:
    most = LOUDEST * float(np.std(healthy)) + 1e-3
    size = _bisected(lambda size: _found(usual, healthy, healthy + size * waves, rate_hz), 1e-3, MIDDLING, most)
    if math.isinf(size):
        raise DetectorError(
            "found impacts in the healthy windows, which hide even large rings; expected a joint without play, and no "
            "other one with play that moves the sensor"
        )
    return size


def _bisected(share: Callable[[float], float], start: float, wanted: float, most: float) -> float:
    """The argument from which a rising function reaches ``wanted``, to 1 %; infinite where that is above ``most``."""
    high = start
    while share(high) < wanted:
        if high > most:
            return math.inf
        high *= 2
    low = high / 2
    while low > 1e-9 * start and share(low) >= wanted:
        low /= 2
    while high / low > 1.01:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if share(middle) >= wanted else (middle, high)
    return high


def _bands(
    usual: DetectorSettings, healthy: FloatArray, worn: FloatArray, rate_hz: float
) -> Iterator[tuple[float, DetectorSettings]]:
    """Each choice of window, mask and norm that the rate allows, with the share it finds."""
    f_res = usual.f_res_hz
    for window_s in LENGTHS_S:
        length = round(window_s * rate_hz)
        to_bins = transform(length, np.arange(length // 2 + 1))
        spectra = [amplitudes(windows[:, :length], to_bins) for windows in (healthy, worn)]
        for width, centre, norm_width in product(WIDTHS, NORM_CENTRES, NORM_WIDTHS):
            tried = replace(
                usual, window_s=window_s, f_width_hz=round(width * f_res, 1),
                f_norm_hz=round(centre * f_res, 1), f_norm_width_hz=round(norm_width * f_res, 1),
            )  # fmt: skip
            try:
                chosen = bands(length, rate_hz, tried)
            except DetectorError:
                continue
            scores = [one[:, chosen.mask].sum(axis=1) / one[:, chosen.norm].mean(axis=1) for one in spectra]
            yield found_share(*scores), tried


def _best_ringdown(
    settings: DetectorSettings, healthy: FloatArray, worn: FloatArray, rate_hz: float
) -> tuple[float, DetectorSettings]:
    """The best length for ``ringdown``, with the noise of the healthy windows, and the share it finds."""
    tried = [replace(noisy(healthy, rate_hz, settings), window_s=window_s) for window_s in LENGTHS_S]
    usable = []
    for one in tried:
        try:
            validate(one, rate_hz)
        except DetectorError:
            continue
        usable.append((_found(one, healthy, worn, rate_hz), one))
    if not usable:
        validate(tried[-1], rate_hz)
    return max(usable, key=lambda pair: pair[0])


def noisy(healthy: FloatArray, rate_hz: float, settings: DetectorSettings) -> DetectorSettings:
    """The settings with the noise of healthy windows, shape (M, N), their slow motion removed."""
    length = min(healthy.shape[1], NOISE_SAMPLES)
    slow = ringdown.slow_basis(length, rate_hz, replace(settings, noise_colour=()))
    noise = rounded(fit_noise(healthy[:, :length], slow))
    return replace(settings, noise_colour=noise.colour, noise_ms2=noise.deviation)
