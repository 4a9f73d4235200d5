"""The detector's statistics and those of a textbook of vibration monitoring, each with what a user would give it.

A rival is made of what a user knows of a robot (`Known`) and is then a function of windows, shape (M, N), to scores,
shape (M,); larger means worn.  A new one is a line in RIVALS.  All but the detector's own get windows without slow
motion and look at a band: that of f_res ± 20 %, or one chosen on windows of a joint that is known to be worn.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector import ringdown
from lostmotion.detector.learner import settled
from lostmotion.detector.quality import mended
from lostmotion.detector.score import batch
from lostmotion.detector.tuning import found_share, noisy
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["RIVALS", "SHIPPED", "Known", "Statistic", "crest", "in_band", "kurtosis", "peak", "rms"]

Statistic = Callable[[FloatArray], FloatArray]
Band = tuple[float, float]
"""Its ends [Hz]."""
BAND = 0.2
"""Half-width of the band around f_res, as a share of it."""
CENTRES, HALF_WIDTHS = (0.7, 0.85, 1.0, 1.15, 1.4), (0.05, 0.1, 0.2, 0.4)
"""Bands from which one is chosen, as shares of f_res."""
KURTOGRAM_SPLITS = (2, 3, 4, 6, 8, 12)
"""The kurtogram divides the frequencies up to half of the rate into so many equal bands."""
LEAST_LINES = 4
"""Fewer have no kurtosis."""
LINES = 8
"""The envelope's spectrum is looked at up to this line: a window holds no more than a few impacts."""


@dataclass(frozen=True, eq=False)
class Known:
    """What a user has: the sensor's rate [Hz], the bar as it is set, and windows of a joint without and with play to
    calibrate with, shape (M, N), NaN where a sample is missing."""

    rate_hz: float
    f_res_hz: float
    zeta: float
    window_s: float
    healthy: FloatArray
    worn: FloatArray

    @property
    def ringdown(self) -> DetectorSettings:
        """Settings of the ring-down's statistic that have not been calibrated."""
        return DetectorSettings(
            f_res_hz=self.f_res_hz, zeta=self.zeta, statistic="ringdown", window_s=self.window_s, level=np.nan
        )

    @property
    def band(self) -> Band:
        """f_res ± 20 %."""
        return (1 - BAND) * self.f_res_hz, (1 + BAND) * self.f_res_hz

    def calm(self, windows: FloatArray) -> FloatArray:
        """Without missing samples, and without the arm's own motion (polynomials, as the ring-down's statistic)."""
        whole = windows if np.isfinite(windows).all() else np.array([mended(window) for window in windows])
        slow = ringdown.bank(windows.shape[1], self.rate_hz, self.ringdown).slow
        return np.asarray(whole - (whole @ slow) @ slow.T)


def analytic(windows: FloatArray, rate_hz: float, band: Band) -> NDArray[np.complex128]:
    """Analytic signal (Hilbert) of a band: its real part is band-passed, its magnitude the envelope."""
    frequency = np.fft.fftfreq(windows.shape[1], 1 / rate_hz)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return np.fft.ifft(np.where(inside, 2 * np.fft.fft(windows, axis=1), 0), axis=1)


def peak(windows: FloatArray) -> FloatArray:
    """The largest magnitude."""
    return np.abs(windows).max(axis=1)


def rms(windows: FloatArray) -> FloatArray:
    """Root mean square."""
    return np.asarray(np.sqrt(np.mean(windows**2, axis=1)))


def kurtosis(windows: FloatArray) -> FloatArray:
    """Fourth moment over the second squared."""
    power = np.abs(windows) ** 2
    return np.asarray(np.mean(power**2, axis=1) / np.maximum(np.mean(power, axis=1), 1e-300) ** 2)


def crest(windows: FloatArray) -> FloatArray:
    """Peak over root mean square."""
    return peak(windows) / rms(windows)


def envelope_line(signal: NDArray[np.complex128]) -> FloatArray:
    """The highest line but DC of the envelope's spectrum."""
    return np.asarray(np.abs(np.fft.rfft(np.abs(signal), axis=1))[:, 1:LINES].max(axis=1))


def in_band(of: Statistic) -> Callable[[Known], Statistic]:
    """A statistic of the signal behind the band-pass f_res ± 20 %."""
    return lambda known: _behind(known, known.band, of)


def chosen_rms(known: Known) -> Statistic:
    """RMS behind the band-pass that finds most of the worn windows to calibrate with."""
    bands = [((c - w) * known.f_res_hz, (c + w) * known.f_res_hz) for c in CENTRES for w in HALF_WIDTHS]

    def found(band: Band) -> float:
        of = _behind(known, band, rms)
        return found_share(of(known.healthy), of(known.worn))

    return _behind(known, max((band for band in bands if _holds_bins(known, band)), key=found), rms)


def envelope(known: Known) -> Statistic:
    """Envelope analysis of f_res ± 20 %."""
    return lambda windows: envelope_line(analytic(known.calm(windows), known.rate_hz, known.band))


def envelope_by_kurtogram(known: Known) -> Statistic:
    """Envelope analysis of the band with the largest mean spectral kurtosis of worn windows (Antoni's kurtogram)."""
    mean = kurtogram(known.calm(known.worn)).mean(axis=0)
    band = _kurtogram_bands(known.worn.shape[1])[int(mean.argmax())]
    line = known.rate_hz / known.worn.shape[1]
    return lambda windows: envelope_line(
        analytic(known.calm(windows), known.rate_hz, (band.start * line, (band.stop - 1) * line))
    )


def spectral_kurtosis(known: Known) -> Statistic:
    """The largest kurtosis of the envelopes of all bands of the kurtogram."""
    return lambda windows: kurtogram(known.calm(windows)).max(axis=1)


def kurtogram(windows: FloatArray) -> FloatArray:
    """Kurtosis of the envelope of each band, shape (M, bands); a band of n lines has n independent samples."""
    spectra, bands = np.fft.fft(windows, axis=1), _kurtogram_bands(windows.shape[1])
    return np.column_stack([kurtosis(np.abs(np.fft.ifft(spectra[:, band], axis=1))) for band in bands])


def eq8(known: Known) -> Statistic:
    """The paper's o with the bands of the defaults, the norm's moved below half of a slow sensor's rate."""
    f_set, nyquist = known.f_res_hz, known.rate_hz / 2
    settings = DetectorSettings(f_res_hz=f_set, zeta=known.zeta, window_s=known.window_s, f_width_hz=0.2 * f_set,
                                f_norm_hz=1.72 * f_set, f_norm_width_hz=0.7 * f_set, statistic="band")  # fmt: skip
    if 1.55 * f_set >= nyquist:
        width = min(0.2 * f_set, 1.8 * (nyquist - f_set))
        settings = replace(settings, f_width_hz=width, f_norm_hz=0.65 * f_set, f_norm_width_hz=0.5 * f_set)
    return lambda windows: batch(np.array([mended(window) for window in windows]), known.rate_hz, settings)


def ringdown_own_noise(known: Known) -> Statistic:
    """The ring-down's statistic that takes the noise from the window itself."""
    return _ringdown(known, known.ringdown)


def ringdown_calibrated(known: Known) -> Statistic:
    """The same with noise learnt from healthy windows, as by `lostmotion calibrate healthy`."""
    healthy = _filled(known.healthy, known, known.ringdown)
    return _ringdown(known, noisy(healthy, known.rate_hz, known.ringdown))


def ringdown_learnt(known: Known) -> Statistic:
    """The default: noise learnt from windows of a joint that may be worn; here it is not."""
    return _ringdown(known, settled(known.healthy, known.rate_hz, known.ringdown))


def ringdown_learnt_worn(known: Known) -> Statistic:
    """The same on a robot whose joint is worn from the first day on."""
    return _ringdown(known, settled(known.worn, known.rate_hz, known.ringdown))


RIVALS: Mapping[str, Callable[[Known], Statistic]] = MappingProxyType(
    {
        "ring-down, calibrated": ringdown_calibrated,
        "ring-down, learnt": ringdown_learnt,
        "... of a worn joint": ringdown_learnt_worn,
        "ring-down, own noise": ringdown_own_noise,
        "eq. 8": eq8,
        "RMS": in_band(rms),
        "RMS, chosen band": chosen_rms,
        "peak": in_band(peak),
        "envelope": envelope,
        "envelope, kurtogram": envelope_by_kurtogram,
        "spectral kurtosis": spectral_kurtosis,
        "kurtosis": in_band(kurtosis),
        "crest factor": in_band(crest),
    }
)
SHIPPED = MappingProxyType({"ring-down, learnt": "ringdown", "ring-down, own noise": "ringdown", "eq. 8": "band"})
"""Those that come with a level, and its key in ``window.LEVELS``."""


def _behind(known: Known, band: Band, of: Statistic) -> Statistic:
    return lambda windows: of(analytic(known.calm(windows), known.rate_hz, band).real)


def _holds_bins(known: Known, band: Band) -> bool:
    """Whether two lines of a window's spectrum lie in the band, and it ends below half of the rate."""
    return (band[1] - band[0]) * known.healthy.shape[1] / known.rate_hz >= 2 and band[1] < known.rate_hz / 2


def _kurtogram_bands(length: int) -> list[slice]:
    """The lines of each band that has enough of them."""
    edges = [np.linspace(1, length // 2, n + 1).astype(int) for n in KURTOGRAM_SPLITS]
    bands = [slice(int(low), int(high)) for some in edges for low, high in pairwise(some)]
    return [band for band in bands if band.stop - band.start >= LEAST_LINES]


def _ringdown(known: Known, settings: DetectorSettings) -> Statistic:
    return lambda windows: batch(_filled(windows, known, settings), known.rate_hz, settings)


def _filled(windows: FloatArray, known: Known, settings: DetectorSettings) -> FloatArray:
    if np.isfinite(windows).all():
        return windows
    return np.array([ringdown.filled(window, known.rate_hz, settings) for window in windows])
