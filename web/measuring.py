"""The bar and the motion from a recording that still grows: the results so far, and what is missing."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from lostmotion.daemon import times
from lostmotion.daemon.commands.calibrate_windows import Cuttings, read_all
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.learner import settled
from lostmotion.detector.level import windows_needed
from lostmotion.detector.taps import Calibrated, Estimate, find_taps, pooled
from lostmotion.detector.tuning import least_acceleration, least_amplitude
from lostmotion.detector.window import DetectorSettings, FloatArray
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.recording import read_recording

__all__ = ["Motion", "Taps", "motion", "taps"]

SPECTRUM_S = 2.0
ENOUGH_TAPS = 5
ENOUGH_F, ENOUGH_ZETA = 0.002, 0.1
"""relative widths of the intervals from which more taps bring little: 0.2 % of f_res costs no ring-down, and damping
varies more than this with temperature"""
JUDGED, LEAST_JUDGED = 60, 20
"""windows from which the needed motion is computed"""
AGAIN = 3
"""times as many windows are worth that again: it takes a second or more"""
SMALL_PLAY_DEG = 0.1
MANY_REFUSED = 0.2


@dataclass(frozen=True, slots=True)
class Taps:
    """The bar so far: the spectrum [m/s²] of the last seconds; f_res [Hz] and zeta once there is a tap, else why."""

    seconds: float
    frequency: list[float]
    amplitude: list[float]
    taps: int = 0
    f_res_hz: Estimate | None = None
    zeta: Estimate | None = None
    is_enough: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Motion:
    """The windows so far; reached and wanted: amplitude of the commanded acceleration [rad/s²]; judged: how many
    windows there were when ``wanted`` was computed; missing: what is still to be done, a sentence each."""

    seconds: float
    windows: int
    needed: int
    refused: int
    reached: float | None = None
    wanted: float | None = None
    judged: int = 0
    missing: tuple[str, ...] = field(default=())


def taps(path: Path) -> Taps:
    """The taps in a recording.  Raises LostmotionError where it holds no acceleration."""
    times, accel = read_recording(path).signal("accel")
    rate_hz = (times.size - 1) / max(times[-1] - times[0], 1e-9)
    seconds, frequency, amplitude = float(times[-1] - times[0]), *_spectrum(accel, rate_hz)
    try:
        found = pooled([find_taps(times, accel)])
    except DetectorError as error:
        return Taps(seconds, frequency, amplitude, notes=(str(error),))
    return Taps(
        seconds, frequency, amplitude, found.taps, found.f_res_hz, found.zeta, _is_enough(found), found.warnings
    )  # fmt: skip


def motion(path: Path, settings: DetectorSettings, false_alarm: float, before: Motion | None = None) -> Motion:
    """The windows in a recording of a joint, and what is missing until a level with this rate can be promised.

    before: the result for the same recording when it was shorter.  Raises LostmotionError.
    """
    needed = windows_needed(false_alarm)
    try:
        cut = read_all([path], settings, None)
    except LostmotionError as error:
        seconds = read_recording(path).duration
        return Motion(seconds, 0, needed, 0, missing=(f"Move the joint back and forth ({_cause(path, error)}).",))
    count = len(cut.accel)
    reached = float(np.median(cut.swing)) / 2 if count else math.nan
    if before is not None and before.wanted is not None and count < AGAIN * before.judged:
        wanted, judged = before.wanted, before.judged
    else:
        wanted, judged = _wanted(cut, settings), count
    return Motion(
        cut.duration, count, needed, cut.refused, _known(reached), _known(wanted), judged,
        tuple(_missing(cut, needed, reached, wanted)),
    )  # fmt: skip


def _spectrum(accel: FloatArray, rate_hz: float) -> tuple[list[float], list[float]]:
    """Frequencies [Hz] and amplitudes [m/s²] of the last seconds, by a Hann window."""
    last = accel[-max(round(SPECTRUM_S * rate_hz), 16) :]
    hann = np.hanning(last.size)
    size = np.abs(np.fft.rfft((last - last.mean()) * hann)) * 2 / max(hann.sum(), 1.0)
    frequency = np.fft.rfftfreq(last.size, 1 / rate_hz)
    return frequency.round(2).tolist(), [float(f"{value:.4g}") for value in size]


def _is_enough(found: Calibrated) -> bool:
    def width(of: Estimate) -> float:
        return (of.high - of.low) / of.value

    return found.taps >= ENOUGH_TAPS and width(found.f_res_hz) < ENOUGH_F and width(found.zeta) < ENOUGH_ZETA


def _wanted(cut: Cuttings, settings: DetectorSettings) -> float:
    """The amplitude of a sway that makes a small play detectable [rad/s²]; NaN while there are few windows,
    infinite where none does."""
    if len(cut.accel) < LEAST_JUDGED:
        return math.nan
    windows = cut.accel[-JUDGED:]
    try:
        known = settled(windows, cut.rate_hz, settings)
        amplitude = least_amplitude(windows, cut.rate_hz, known, known.level)
    except DetectorError:
        return math.nan
    return least_acceleration(amplitude, math.radians(SMALL_PLAY_DEG), known)


def _missing(cut: Cuttings, needed: int, reached: float, wanted: float) -> list[str]:
    count = len(cut.accel)
    found = []
    if math.isinf(wanted):
        found.append("Without impacts: these windows have some, which hide those of a play. Is the joint healthy?")
    elif reached < wanted:
        found.append(
            f"Brisker: it reaches {reached:.2g} rad/s², but {wanted:.2g} make {SMALL_PLAY_DEG:g}° of play detectable."
        )
    if count < needed:
        left = f" about {times.span(cut.duration * (needed - count) / count)} more of this motion" if count else ""
        found.append(f"Longer: {needed - count} more windows are needed,{left}." if left else "Longer.")
    if cut.refused > MANY_REFUSED * max(count + cut.refused, 1):
        found.append(f"{cut.refused} windows are not sound: clipped, with gaps, or too gentle.")
    return found


def _cause(path: Path, error: LostmotionError) -> str:
    return str(error).removeprefix(f"{path}: ")


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
