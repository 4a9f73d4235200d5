"""Windows out of recordings, for the ``calibrate`` commands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lostmotion.daemon.commands.calibrate_common import CalibrationError
from lostmotion.daemon.commands.scoring_options import ScoringOptions, settings_for
from lostmotion.detector import ringdown
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.quality import OK, describe
from lostmotion.detector.series import windows_of
from lostmotion.detector.window import DetectorSettings, FloatArray
from lostmotion.drivers.recording import read_recording

__all__ = ["Cuttings", "read_all", "read_settings"]


@dataclass(frozen=True, slots=True, eq=False)
class Cuttings:
    """The sound windows of some recordings.

    accel: from each reversal on [m/s²], shape (M, N), none missing; rate_hz; swing: change of the commanded
    acceleration [rad/s²], (M,); refused: how many windows were not sound; duration: of all recordings [s].
    """

    accel: FloatArray
    rate_hz: float
    swing: FloatArray
    refused: int
    duration: float


def read_settings(path: Path, config: Path | None, options: ScoringOptions) -> DetectorSettings:
    """The settings that are meant for a recording.  Raises LostmotionError."""
    return settings_for(read_recording(path), config, options)


def read_all(paths: Sequence[Path], settings: DetectorSettings, window_s: float | None) -> Cuttings:
    """All windows of the recordings, of ``window_s`` or the length in the settings.  Raises LostmotionError."""
    settings = replace(settings, window_s=window_s or settings.window_s)
    parts = [_read(path, settings) for path in paths]
    rates = {round(part.rate_hz) for part in parts}
    if len(rates) > 1:
        raise CalibrationError(f"found recordings at {sorted(rates)} samples a second, expected one rate for all")
    return Cuttings(
        np.concatenate([part.accel for part in parts]),
        parts[0].rate_hz,
        np.concatenate([part.swing for part in parts]),
        sum(part.refused for part in parts),
        sum(part.duration for part in parts),
    )


def _read(path: Path, settings: DetectorSettings) -> Cuttings:
    recording = read_recording(path)
    times, values = recording.signal("accel")
    try:
        windows = windows_of(
            *recording.signal("command"), times, values, settings,
            resolution=recording.number("resolution_rad", math.nan),
        )  # fmt: skip
    except DetectorError as error:
        raise CalibrationError(f"{path}: {error}") from error
    if not windows:
        raise CalibrationError(f"{path}: found no reversal of the command, expected a motion that goes back and forth")
    sound = [w for w in windows if describe(w, recording.number("range_ms2", math.inf), settings.gentle) == OK]
    rate_hz, length = windows[0].rate_hz, windows[0].accel.size
    filled = [ringdown.filled(window.accel, rate_hz, settings) for window in sound]
    return Cuttings(
        np.array(filled).reshape(-1, length), rate_hz, np.array([window.excitation for window in sound]),
        len(windows) - len(sound), recording.duration,
    )  # fmt: skip
