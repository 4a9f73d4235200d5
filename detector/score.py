"""The score of a window for rings of the oscillator: eq. 8, or the statistic of ``ringdown``.  ``level`` has levels."""

from __future__ import annotations

import math

import numpy as np

from lostmotion.detector import ringdown
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.quality import LEAST_SHARE, describe, mended, scoreless
from lostmotion.detector.spectrum import bands, normalised_mask
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Statistic, Window
from lostmotion.detector.windows import window_length

__all__ = ["batch", "score", "score_window", "validate"]

STATISTICS: tuple[Statistic, ...] = ("band", "ringdown")
CHUNK = 4096
"""Windows scored at once: the spectra of a chunk stay in the cache."""


def score(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> float:
    """The statistic of the settings [-] of one window: o of eq. 8, the sum over the mask of the normalised spectrum, or
    ``ringdown.scores``.

    accel: tip acceleration [m/s²], shape (N,), one sample every 1 / rate_hz, none missing.  NaN when the norm is zero
    (no noise) or a sample is NaN.  White noise scores about the number of bins in the mask, or 0.6.

    Raises DetectorError when N samples at this rate do not resolve the bands of the settings.
    """
    accel = np.asarray(accel)
    return (_ringdown if settings.statistic == "ringdown" else _band)(accel, rate_hz, settings)


def batch(accel2d: FloatArray, rate_hz: float, settings: DetectorSettings) -> FloatArray:
    """``score`` of many windows of one length: shape (M, N) to shape (M,)."""
    if settings.statistic == "ringdown":
        return ringdown.scores(accel2d, rate_hz, settings)
    chunks = [accel2d[i : i + CHUNK] for i in range(0, len(accel2d), CHUNK)]
    parts = [normalised_mask(chunk, rate_hz, settings).sum(axis=1) for chunk in chunks]
    return np.concatenate(parts) if parts else np.empty(0)


def score_window(window: Window, settings: DetectorSettings, range_ms2: float = math.inf) -> Score:
    """A window's score, both statistics and quality; few missing samples are interpolated, too many give NaN.

    range_ms2: the largest acceleration that the sensor shows [m/s²].  Raises DetectorError as ``score`` does; the
    statistic that is not the score is NaN instead.
    """
    quality = describe(window, range_ms2, settings.gentle)
    there = int(np.count_nonzero(np.isfinite(window.accel)))
    statistics = {name: _statistic(name, window, there, settings) for name in STATISTICS}
    value = statistics[settings.statistic]
    return Score(
        joint=window.joint,
        time=window.start,
        duration=window.duration,
        score=value,
        level=settings.level,
        impact=value > settings.level,
        excitation=window.excitation,
        temperature=window.temperature,
        quality=scoreless(quality) if math.isnan(value) else quality,
        band=statistics["band"],
        ringdown=statistics["ringdown"],
    )


def _statistic(name: Statistic, window: Window, there: int, settings: DetectorSettings) -> float:
    """One statistic of a window of which so many samples are there; NaN where it cannot be computed, unless it is the
    score."""
    accel, rate_hz = window.accel, window.rate_hz
    if there < max(LEAST_SHARE * accel.size, 1):
        return math.nan
    is_whole = there == accel.size
    try:
        if name == "band":
            return _band(accel if is_whole else mended(accel), rate_hz, settings)
        if name != settings.statistic:
            ringdown.validate(accel.size, rate_hz, settings)
        return _ringdown(accel if is_whole else ringdown.filled(accel, rate_hz, settings), rate_hz, settings)
    except DetectorError:
        if name == settings.statistic:
            raise
        return math.nan


def _band(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> float:
    """o of eq. 8."""
    return float(normalised_mask(accel, rate_hz, settings).sum())


def _ringdown(accel: FloatArray, rate_hz: float, settings: DetectorSettings) -> float:
    """The statistic of ``ringdown``."""
    return float(ringdown.scores(accel[None], rate_hz, settings)[0])


def validate(settings: DetectorSettings, rate_hz: float) -> None:
    """Raises DetectorError, with a message for the user, when windows at this rate cannot be scored.

    A norm band that reaches beyond the Nyquist frequency is cut there; an error only if too little of it is left.
    """
    positive = {"rate_hz": rate_hz, "f_res_hz": settings.f_res_hz, "f_width_hz": settings.f_width_hz}
    positive |= {"f_norm_hz": settings.f_norm_hz, "f_norm_width_hz": settings.f_norm_width_hz, "level": settings.level}
    if settings.window_s is not None:
        positive["window_s"] = settings.window_s
    for name, value in positive.items():
        if not (value > 0 and math.isfinite(value)):
            raise DetectorError(f"{name} is {value:g}; expected a positive number")
    if not 0 < settings.zeta < 1:
        raise DetectorError(
            f"zeta is {settings.zeta:g}; expected a damping ratio between 0 and 1, a bar's is near 0.01"
        )
    length = round(window_length(settings, rate_hz) * rate_hz)
    if settings.statistic == "ringdown":
        ringdown.validate(length, rate_hz, settings)
    else:
        bands(length, rate_hz, settings)
