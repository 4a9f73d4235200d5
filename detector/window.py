"""The values of the detector: settings, reversals, windows and scores.  No I/O, no clock."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["GENTLE", "LEVELS", "ZETA", "DetectorSettings", "FloatArray", "Reversal", "Score", "Statistic", "Window"]

FloatArray = NDArray[np.float64]
Statistic = Literal["band", "ringdown"]
ZETA = 0.012
"""Damping ratio of a usual bar."""
GENTLE = 0.5
"""Change of the commanded acceleration [rad/s²] below which an impact of one arc-minute of play is within a sensor's
noise: a gap phi crossed under a ends in sqrt(2 a phi), times l omega_res about 0.6 m/s² at the tip of the usual bar."""
LEVELS: Mapping[Statistic, float] = MappingProxyType({"band": 8.0, "ringdown": 4.5})
"""Default levels, before any calibration; see docs/decisions/0002-score.md and 0005-ringdown.md."""


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """The parameters of eqs. 8-10 and of the trigger, in SI units.

    f_res_hz and zeta are the oscillator's resonance and damping ratio.  A window_s of None means: from the length of
    the ring-down (``windows.window_length``).  min_acceleration [rad/s²] is the least commanded acceleration on both
    sides of a reversal that counts; None means: the least above quantisation and noise of the command.  level: that of
    the statistic (``LEVELS``) unless given; with "band" it belongs to window_s and f_width_hz: noise alone scores about
    as much as the mask has bins, which is f_width_hz times the window's length.

    statistic: "band", eq. 8, or "ringdown" (``ringdown.scores``), which alone uses the noise: noise_ms2 [m/s²] is the
    standard deviation of the one-step prediction error of a healthy window's noise; noise_colour its reflection
    coefficients (``whitening.fit_noise``), () for white.  With neither given a ``learner.Learner`` learns both from the
    windows.  length_m: from the joint's axis to the accelerometer [m], negative where the joint turns the other way
    round; flank_exponent and contact_accel: n of eq. 1 and beta R2 / J2 [rad/s²], the joint's acceleration under the
    force beta, None if unknown (``flank``); play_size: whether it is estimated, which needs an accelerometer and a
    command in rad; gentle: windows of less excitation [rad/s²] are no evidence (``quality``); follow_bar: whether a
    learner follows f_res_hz and zeta too (``bar``).
    """

    f_res_hz: float
    zeta: float = ZETA
    window_s: float | None = 0.25
    f_width_hz: float = 12.0
    f_norm_hz: float = 100.0
    f_norm_width_hz: float = 40.0
    level: float = math.nan
    min_acceleration: float | None = None
    statistic: Statistic = "ringdown"
    noise_ms2: float | None = None
    noise_colour: tuple[float, ...] = ()
    length_m: float = 0.10
    flank_exponent: float | None = None
    contact_accel: float | None = None
    play_size: bool = True
    gentle: float = GENTLE
    follow_bar: bool = True

    def __post_init__(self) -> None:
        if math.isnan(self.level):
            object.__setattr__(self, "level", LEVELS[self.statistic])


@dataclass(frozen=True, slots=True)
class Reversal:
    """The commanded acceleration changed direction.

    time: the zero crossing, robot time [s]; seen: the time at which that was certain [s]; swing: the change of the
    commanded acceleration from its extreme before to its value when the new direction was certain [rad/s²], signed as
    after; at a jump of the goal, the swing of the trigger's parabola, signed as the jump.
    """

    time: float
    seen: float
    swing: float


@dataclass(frozen=True, slots=True)
class Window:
    """Tip acceleration after one reversal: time [s] and accel [m/s²], shape (N,), from start, lasting duration [s].

    One sample every 1 / rate_hz; accel is NaN where a sample is missing.
    """

    joint: str
    start: float
    duration: float
    time: FloatArray
    accel: FloatArray
    rate_hz: float
    excitation: float = float("nan")
    """largest change of the commanded acceleration around the reversal [rad/s²]"""
    temperature: float = float("nan")
    """of the servo [°C]"""


@dataclass(frozen=True, slots=True)
class Score:
    """The detector's result for one window.

    time: start of the window, robot time [s]; score: the statistic that the settings choose [-], NaN when the window
    cannot be scored; level: the level of eq. 9 it was compared with; impact: score > level; play, play_low, play_high:
    size of the play [rad], NaN where it cannot be estimated, for the reason in play_reason; severity, severity_low,
    severity_high: equivalent play [rad], NaN where it is unknown; band, ringdown: both statistics [-], whichever of
    them is the score, NaN where one cannot be computed; quality: "ok", or what is wrong with the window,
    comma-separated.
    """

    joint: str
    time: float
    duration: float
    score: float
    level: float
    impact: bool
    play: float = float("nan")
    play_low: float = float("nan")
    play_high: float = float("nan")
    excitation: float = float("nan")
    temperature: float = float("nan")
    quality: str = "ok"
    play_reason: str = ""
    severity: float = float("nan")
    severity_low: float = float("nan")
    severity_high: float = float("nan")
    band: float = float("nan")
    ringdown: float = float("nan")
