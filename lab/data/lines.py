"""Lines in the spectrum of a signal, from ringing or hum.  Nothing is fitted here."""

from __future__ import annotations

import numpy as np

from lostmotion.model.motion import FloatArray

__all__ = ["spectral_lines"]

MOST = 6
APART = 0.1
"""Width of a line, as a share of its frequency."""
CLEAR = 100.0
"""Times the noise, the median over all frequencies: the largest of 10 000 bins of white noise is ten times its mean."""


def spectral_lines(values: FloatArray, rate_hz: float) -> tuple[float, ...]:
    """Frequencies [Hz] of the lines in the spectrum of values (N,), NaN where not sampled, the largest first, six at
    most."""
    from scipy.signal import periodogram

    known = np.isfinite(values)
    there = np.interp(np.arange(values.size), np.flatnonzero(known), values[known])
    spectrum: tuple[FloatArray, FloatArray] = periodogram(  # type: ignore[call-overload]  # the stubs lack "linear"
        there, rate_hz, "blackmanharris", detrend="linear"
    )
    frequency, power = spectrum
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > CLEAR * np.median(power)))
    found: list[float] = []
    for at in peaks[np.argsort(-power[peaks])]:
        if all(abs(frequency[at] - one) > APART * one for one in found):
            found.append(float(frequency[at]))
    return tuple(found[:MOST])
