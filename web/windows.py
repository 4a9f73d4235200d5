"""A raw window as people look at it: the wave, its spectrum, and the bands in which eqs. 8 and 10 look for the bar."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

from lostmotion.daemon.records import WindowRow, iso
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.quality import mended
from lostmotion.detector.spectrum import amplitudes, bands, frequencies, transform
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.codec.recording_csv import head_text

__all__ = ["Picture", "csv", "picture"]

Band = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Picture:
    """A window: time [s] from its begin, tip acceleration [m/s²], frequency [Hz], amplitude [m/s²]; f_res_hz: the
    bar's resonance; mask, norm: the bands of eqs. 10 and 8 [Hz], empty where there are none; commanded: times [s] and
    angles [rad] of the motion before and in it, empty where it was not kept."""

    time: str
    is_impact: bool
    rate_hz: float
    seconds: list[float]
    accel: list[float]
    frequency: list[float]
    amplitude: list[float]
    f_res_hz: float | None
    mask: list[Band]
    norm: list[Band]
    commanded: list[list[float]]


def picture(row: WindowRow, settings: DetectorSettings | None) -> Picture:
    """What there is to see of a window; without settings the bar is unknown."""
    accel = row.accel.astype(np.float64)
    length = accel.size
    frequency = frequencies(length, row.rate_hz)
    whole = mended(accel) if np.isfinite(accel).any() else np.zeros(length)
    amplitude = amplitudes(whole, transform(length, np.arange(frequency.size))) if length > 1 else np.zeros(1)
    mask, norm = _bands(length, row.rate_hz, settings)
    return Picture(
        iso(row.time),
        row.impact,
        row.rate_hz,
        (row.offset + np.arange(length) / row.rate_hz).round(6).tolist(),
        [float(f"{value:.6g}") for value in accel],
        frequency.round(3).tolist(),
        [float(f"{value:.5g}") for value in amplitude],
        settings.f_res_hz if settings else None,
        mask,
        norm,
        [[float(f"{value:.6g}") for value in numbers] for numbers in row.command],
    )


def csv(row: WindowRow, settings: DetectorSettings | None) -> str:
    """The window as a recording, with the commanded motion where it was kept."""
    text = io.StringIO()
    bar = {"f_res_hz": settings.f_res_hz, "zeta": settings.zeta} if settings else {}
    text.write(head_text({"joint": row.joint, "begin": iso(row.time)} | bar))
    text.write("time,command,accel\n")
    commands = {round(time, 6): _cell(angle) for time, angle in row.command.T.tolist()}
    accels = {round(row.offset + k / row.rate_hz, 6): _cell(value) for k, value in enumerate(row.accel.tolist())}
    for time in sorted({*commands, *accels}):
        text.write(f"{time:.6f},{commands.get(time, '')},{accels.get(time, '')}\n")
    return text.getvalue()


def _cell(value: float) -> str:
    return f"{value:.7g}" if np.isfinite(value) else ""


def _bands(length: int, rate_hz: float, settings: DetectorSettings | None) -> tuple[list[Band], list[Band]]:
    """The bands' edges [Hz], half a bin beyond the outermost bins."""
    if settings is None:
        return [], []
    try:
        found = bands(length, rate_hz, settings)
    except DetectorError:
        return [], []
    width = rate_hz / length
    runs = np.split(found.norm, np.flatnonzero(np.diff(found.norm) > 1) + 1)
    norm = [(float(run[0] - 0.5) * width, float(run[-1] + 0.5) * width) for run in runs if run.size]
    return [((found.mask.start - 0.5) * width, (found.mask.stop - 0.5) * width)], norm
