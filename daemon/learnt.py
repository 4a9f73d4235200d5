"""What the service has learnt of a joint's windows, as rows of the database.  Units SI, NaN is unknown."""

from __future__ import annotations

import math
from datetime import datetime

import msgspec

__all__ = ["BarRow", "FlankRow", "NoiseChange", "NoiseRow"]


class NoiseChange(msgspec.Struct, frozen=True):
    """The noise of a joint's windows was learnt, or became another one: when, and how in words."""

    time: datetime
    text: str


class BarRow(msgspec.Struct, frozen=True):
    """Resonance [Hz] and damping ratio of a joint's bar as its windows show them: a ``detector.bar.Bar``; used_hz and
    used_zeta: what the scores are made with."""

    f_res_hz: float
    f_deviation: float
    zeta: float
    zeta_deviation: float
    windows: int
    used_hz: float
    used_zeta: float


class NoiseRow(msgspec.Struct, frozen=True):
    """The noise of a joint's windows as the service has learnt it, and for what it holds.

    f_res_hz, rate_hz and length: of the bar in the file, the accelerometer and the windows that it was learnt from;
    covariance, told and ringing: a ``detector.background.Background``; seen: windows so far; changes: the last ones;
    zeta: of the bar in the file; bar: what the windows show of it.
    """

    joint: str
    f_res_hz: float
    rate_hz: float
    length: int
    covariance: tuple[float, ...]
    told: float
    ringing: float
    seen: int
    changes: tuple[NoiseChange, ...] = ()
    zeta: float = 0.0
    bar: BarRow | None = None

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise [m/s²], NaN where only the bar is known yet."""
        return math.sqrt(self.covariance[0]) if self.covariance else math.nan

    @property
    def resonance(self) -> str:
        """Resonance and damping that the scores are made with, in words."""
        if self.bar is None:
            return f"resonance {self.f_res_hz:.4g} Hz, damping {self.zeta:.2g}, as in the file"
        used, given = (self.bar.used_hz, self.bar.used_zeta), (self.f_res_hz, self.zeta)
        seen = f"windows show {self.bar.f_res_hz:.4g} ± {2 * self.bar.f_deviation:.2g} Hz, {self.bar.zeta:.2g}"
        source = "as in the file" if used == given else f"followed; in the file {given[0]:.4g} Hz, {given[1]:.2g}"
        return f"resonance {used[0]:.4g} Hz, damping {used[1]:.2g}, {source}; {seen}"


class FlankRow(msgspec.Struct, frozen=True):
    """The elasticity of a joint's tooth flanks (``detector.flank.FlankLaw``), after so many windows; softness: median
    of 1/n with the ends of its 95 % interval; servo: likelihood of each way in which its servo may follow
    (``detector.servo.ServoLaw``), delay: mean and standard deviation [s]."""

    joint: str
    likelihood: tuple[float, ...]
    windows: int
    softness: tuple[float, float, float]
    servo: tuple[float, ...] = ()
    delay: tuple[float, float] | None = None

    def __str__(self) -> str:
        middle, low, high = self.softness
        delay = f"; servo delay {self.delay[0] * 1e3:.0f} ± {2e3 * self.delay[1]:.0f} ms" if self.delay else ""
        exponent = f"contact exponent 1/n = {middle:.2g} ({low:.2g} to {high:.2g}; 0: hard teeth)"
        return f"{exponent}, from {self.windows} windows{delay}"
