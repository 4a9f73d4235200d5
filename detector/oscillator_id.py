"""The oscillator's resonance and damping from one ring-down.  ``taps`` finds the taps in a recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.window import FloatArray

__all__ = ["Oscillator", "identify"]

LOWEST_HZ = 5.0
"""Slower peaks are the arm's motion, not the bar's."""
LEAST_PEAK = 4.0
"""Least height of a resonance over the median amplitude of the spectrum."""
HALF_WIDTH = 0.2
"""Half-width of the band around the peak that is demodulated, as a share of its frequency."""
LEAST_CYCLES = 6
LEAST_SAMPLES = 32
MOST_MISSING = 0.02
"""Largest share of samples that may be missing: the spectrum is that of the others and a line between them.  Of 60
simulated bars each, with shares of 0 to 0.2 missing singly, 358 or 359 of 360 taps are found, and 98 % of the intervals
of the resonance and 93 % of those of the damping hold the truth at least.  Longer gaps were not tried."""
STEPS = 8
"""Gauss-Newton steps; three are enough from a good start."""


@dataclass(frozen=True, slots=True)
class Oscillator:
    """Undamped resonance [Hz] and damping ratio [-] with their standard deviations (for white noise); cycles: how many
    of the ring-down were used."""

    f_res_hz: float
    zeta: float
    cycles: float
    f_res_std: float
    zeta_std: float


def identify(accel: FloatArray, rate_hz: float, hum_hz: Sequence[float] = ()) -> Oscillator:
    """f_res and zeta of the strongest ring-down in tip acceleration [m/s²], shape (N,), NaN where a sample is missing.

    hum_hz: frequencies of steady lines that may be in it, partly removed already.

    From the maximum of the band around the spectral peak down to the noise, Re(A exp(s t)) and a cubic (the arm's own
    motion) are fitted by least squares; s = (-zeta + i sqrt(1 - zeta²)) 2π f_res starts from the envelope's decay
    and is refined by Gauss-Newton steps.  Within 0.5 % in f_res and 10 % in zeta where the tap is 50 times the noise
    (20 times at 1 kHz).

    Raises DetectorError when nothing moves, no peak stands out, or the ring-down is too short to measure.
    """
    values = np.asarray(accel, dtype=float)
    whole = _whole(values)
    spectrum = np.fft.fft(whole - whole.mean())
    frequency = np.arange(values.size, dtype=np.float64) * (rate_hz / values.size)
    peak = _peak(np.abs(spectrum), frequency, rate_hz)
    band = np.abs(frequency - peak) < HALF_WIDTH * peak
    analytic = 2 * np.fft.ifft(np.where(band, spectrum, 0))
    first, last = _ring_down(np.abs(analytic), rate_hz / peak)
    cycles = (last - first) * peak / rate_hz
    if cycles < LEAST_CYCLES:
        raise DetectorError(
            f"the ring at {peak:.1f} Hz lasts {cycles:.1f} cycles; expected at least {LEAST_CYCLES}: "
            "tap harder, and leave the bar alone until it is still"
        )
    ring = np.abs(analytic[first:last])
    time = np.arange(ring.size) / rate_hz
    decay = float(np.polyfit(time, np.log(ring), 1, w=ring)[0])
    refined, std = _refine(time, values[first:last], complex(decay, 2 * math.pi * peak), hum_hz)
    natural = abs(refined)
    if not (refined.real < 0 and abs(natural / (2 * math.pi * peak) - 1) < HALF_WIDTH):
        raise DetectorError(f"what rings at {peak:.1f} Hz does not decay like a bar that was tapped once; tap again")
    return Oscillator(natural / (2 * math.pi), -refined.real / natural, cycles, std / (2 * math.pi), std / natural)


def _whole(values: FloatArray) -> FloatArray:
    """The samples, with a line over those that are missing.  Raises DetectorError for too few, and for one value."""
    there = np.isfinite(values)
    missing = int(np.sum(~there))
    if values.size < LEAST_SAMPLES or missing > MOST_MISSING * values.size:
        raise DetectorError(
            f"samples: found {values.size}, {missing} of them missing; expected at least {LEAST_SAMPLES}, "
            f"{MOST_MISSING:.0%} of them missing at most"
        )
    whole = np.interp(np.arange(values.size), np.flatnonzero(there), values[there])
    if np.ptp(whole) == 0:
        raise DetectorError(f"all {values.size} samples are {whole[0]:g} m/s²; expected a ring: is the sensor stuck?")
    return whole


def _refine(time: FloatArray, values: FloatArray, exponent: complex, hum_hz: Sequence[float]) -> tuple[complex, float]:
    """The exponent s of Re(A exp(s t)) plus a cubic and steady lines: least squares for A and A ds, then s += ds, from
    the samples that are not missing.

    Also the standard deviation [1/s] of its real part, and as good as that of its imaginary part.
    """
    there = np.isfinite(values)
    time, values = time[there], values[there]
    turns = 2 * np.pi * np.outer(time, hum_hz)
    slow = np.column_stack([np.vander(time / time[-1], 4), np.cos(turns), np.sin(turns)])
    start = exponent
    for _ in range(STEPS):
        wave = np.exp(exponent * time)
        columns = np.column_stack([wave.real, -wave.imag, time * wave.real, -time * wave.imag, slow])
        a, b, c, d = np.linalg.lstsq(columns, values, rcond=None)[0][:4]
        exponent += complex(c, d) / complex(a, b)
        if not abs(exponent / start - 1) < 1:  # no ring-down: ``identify`` says so
            break
    # At convergence c and d are nearly 0, and columns and amplitude those of the solution.
    inverse = np.linalg.pinv(columns)
    left = values - columns @ (inverse @ values)
    variance = float(left @ left) / max(time.size - columns.shape[1], 1)
    return exponent, math.sqrt(variance * float(inverse[2] @ inverse[2])) / abs(complex(a, b))


def _peak(size: FloatArray, frequency: FloatArray, rate_hz: float) -> float:
    inside = (frequency >= LOWEST_HZ) & (frequency < rate_hz / 2)
    if not inside.any():
        raise DetectorError(
            f"{size.size} samples at {rate_hz:g} Hz resolve no frequency above {LOWEST_HZ:g} Hz; record longer"
        )
    # A ring-down is broad: averaging a few bins finds its middle, not a spike of noise.
    smooth = np.convolve(size, np.hanning(7) / 3, mode="same")
    at = int(np.argmax(np.where(inside, smooth, 0)))
    height = float(smooth[at] / np.median(smooth[inside]))
    if height < LEAST_PEAK:
        raise DetectorError(
            f"no resonance stands out: the highest peak, at {frequency[at]:.1f} Hz, is {height:.1f} times the median; "
            f"expected {LEAST_PEAK:g}; was the bar tapped?"
        )
    return float(frequency[at])


def _ring_down(size: FloatArray, period: float) -> tuple[int, int]:
    """First and last sample of the strongest decay: from a cycle after its top down to the noise."""
    top = int(np.argmax(size))
    noise = float(np.quantile(size, 0.1))
    below = np.flatnonzero(size[top:] < max(3 * noise, 0.02 * size[top]))
    end = top + int(below[0]) if below.size else size.size
    # The band filter smooths the tap, and is periodic: the end of the recording contains some of the beginning.
    return top + round(period), min(end, size.size - round(period))
