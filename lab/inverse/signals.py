"""Motion and torque of a recording within the band in which the angle exceeds its noise.  Nothing is fitted here.

Every signal of the regression passes the same zero-phase low-pass filter (parallel filtering), which preserves linear
relations between them, and is then sampled at the rate that the band needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import spectral_lines
from lostmotion.lab.inverse.zero_phase import lowpass
from lostmotion.model.motion import FloatArray

__all__ = ["COLUMNS", "LEAST_SAMPLES", "Signals", "is_moving"]

FASTEST = 0.2
"""Share of the sampling rate: the highest end of a band, where the second derivative of the spline is accurate to 1
%."""
WHOLE = 2.0
"""Cutoff of the filter that smooths the motion, times the end of the band: its gain at the end of the band is 99.6 %.
Dry friction needs the true speed; with a cutoff at the end of the band, a fast sine near it reduced a damper's friction
from 50 N to 23 N."""
LEAST_SAMPLES, REGRESSORS = 4, 6
"""For each regressor of the usual joint (channel.py), and their number.  With fewer samples in motion, those at rest
count, too; they know nothing of friction, and 125 of them outvoted 70 in motion."""
SPLINE = 5
"""Degree of the spline that is differentiated.  Central differences are 3 % too small at a twentieth of the rate."""
SLOWEST = 4.0
"""Periods in the recording: the lowest end of a band taken from others, and of the band of an accelerometer."""
RINGS = 0.25
"""Share of the frequency of a ring-down, below which an accelerometer feels its own drift."""
PER_PERIOD = 2.5
"""Samples that are kept per period of the end of the band."""
EDGE = 2.0
"""Periods of the end of the band that are left out at both ends of a recording."""
SETTLED = 0.15
"""Periods of the end of the band to a rest or a reversal, within which samples do not count: friction is anything
between its limits while a part sticks, and the filter spreads that.  Of 96 intervals of 32
simulated joints that stick 57 held without it, 77 with 0.15, 67 with 0.25 and 46 with 0.4; Coulomb friction was off by
2.2, 1.1, 1.1 and 2.3 %.  Where few would be left, all in motion count: with 31 of 48 nothing followed the speed."""
SLOWEST_OWN = 2 * EDGE + LEAST_SAMPLES * REGRESSORS / PER_PERIOD
"""Periods in the recording: the lowest end of its own band, which fixes the least number of samples.  With four periods
nine samples were left of a robot's joint that turned slowly for 16 s at 30 Hz, and Coulomb friction was not significant
(p = 0.12, now 0.001)."""
SLOWEST_DISTURBED = 40.0
"""The same of a joint that its neighbours move: its steps at reversals are faster than the motion.  With 13.6 periods
25 samples were left of such a wrist, and no friction was significant; with 40 and 60 its Coulomb friction is 0.24 and
0.30 N m (p = 0.006)."""
SEGMENT = 1024
"""Samples of a segment of the power density."""
COLUMNS = ("position", "displacement", "accel")
"""What may be measured of a moving part, the most direct first."""


@dataclass(frozen=True, eq=False)
class Signals:
    """time [s], position [rad or m], velocity, acceleration and torque [N m or N], each (N,) on the recording's grid,
    filtered; band_hz: the end of the band; position_density: power density of the angle's noise [rad²/Hz];
    torque_noise: root mean square of the torque's noise within the band [N m]; column: what was measured."""

    experiment: Experiment
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    band_hz: float
    position_density: float
    torque_noise: float
    column: str = "position"
    counts_settled: bool = False
    """Whether samples within the response of the filter to a rest or a reversal do not count: of a torque, but for a
    joint that its neighbours move, whose friction is known by the reversals alone."""

    @classmethod
    def of(
        cls, experiment: Experiment, is_force: bool = True, most_hz: float = math.inf, is_disturbed: bool = False
    ) -> Signals:
        """Of an experiment with one moving part.  is_force: the input is a torque or force; without it the part moves
        freely and there is no torque.  most_hz: the highest end of the band (channel.py); is_disturbed: whether its
        neighbours move it."""
        column = next(name for name in COLUMNS if name in experiment.measured)
        seen = ~np.isnan(experiment.measured[column])
        measured, at = experiment.measured[column][seen], experiment.time[seen]
        step = float(np.median(np.diff(at)))
        time = np.arange(at[0], at[-1] + step / 2, step)
        position = np.interp(time, at, measured)
        if column == "accel":
            slowest = SLOWEST / (position.size * step)
            if experiment.drive is None:
                slowest = max(slowest, RINGS * max(spectral_lines(position, 1 / step)[:1], default=0.0))
            position = _integrated_twice(position, step, slowest)
        drive = experiment.drive if is_force else None
        torque = np.asarray(drive.position(np.clip(time, at[0], at[-1]))) if drive else np.zeros_like(time)
        band, density = _band(position, 1 / step)
        band = min(band, max(most_hz, SLOWEST / (time.size * step)))
        if is_disturbed:
            band = min(max(band, SLOWEST_DISTURBED / (time.size * step)), FASTEST / step)
        whole = min(WHOLE * band, FASTEST / step)
        smooth = lowpass(position, whole * step)
        spline = make_interp_spline(time, smooth, k=SPLINE)
        velocity, acceleration = (np.asarray(spline.derivative(order)(time)) for order in (1, 2))
        noise = _torque_noise(torque, 1 / step, band)
        return cls(
            experiment, time, smooth, velocity, acceleration, lowpass(torque, whole * step), band, density, noise,
            column, drive is not None and not is_disturbed,
        )  # fmt: skip

    @cached_property
    def kept(self) -> NDArray[np.intp]:
        """The samples that are compared (M,): none near the ends, where the filter has a transient, and none at rest,
        where dry friction may have any value up to its largest, or so near to it that the filter mixes it in."""
        edge = min(round(EDGE * self._rate / self.band_hz), self.time.size // 4)
        found = np.arange(edge, self.time.size - edge, self._every)
        moving = found[np.abs(self.velocity[found]) > self._rest_speed]
        if moving.size < LEAST_SAMPLES * REGRESSORS:
            return found
        settled = moving[self._since_rest(moving) > SETTLED * self._rate / self.band_hz]
        is_enough = settled.size >= max(2 * LEAST_SAMPLES * REGRESSORS, moving.size / 2)
        return settled if self.counts_settled and is_enough else moving

    def _since_rest(self, samples: NDArray[np.intp]) -> NDArray[np.intp]:
        """The number of samples to the next one at rest, or the next reversal, before or after each of these (K,)."""
        slow = np.abs(self.velocity) <= self._rest_speed
        slow[1:] |= np.diff(np.sign(self.velocity)) != 0
        rests = np.concatenate([[-self.time.size], np.flatnonzero(slow), [2 * self.time.size]])
        after = np.searchsorted(rests, samples)
        return np.asarray(np.minimum(samples - rests[after - 1], rests[after] - samples))

    @cached_property
    def is_next(self) -> NDArray[np.bool_]:
        """Whether each sample that is compared but the first follows the one before without a gap (M - 1,)."""
        return np.asarray(np.diff(self.kept) == self._every)

    def until_moved(self, share: float) -> float:
        """The time until which the part has made this share of its motion [s]: samples at rest do not count.  The last
        third of a recording of one step was all at rest, and friction was judged by the noise of its acceleration."""
        moving = np.flatnonzero(np.abs(self.velocity) >= self._rest_speed)
        return float(self.time[moving[int(share * (moving.size - 1))]])

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Where a free motion has not ended (N,)."""
        return is_moving(self.velocity)

    def delayed(self, by_s: float) -> Signals:
        """With a torque that acts so much later [s]."""
        at = np.clip(self.time - by_s, *self.time[[0, -1]])
        return replace(self, torque=np.asarray(make_interp_spline(self.time, self.torque, k=3)(at)))

    @property
    def grid(self) -> NDArray[np.intp]:
        """The samples that are compared, and those between and beside them, evenly spaced (K,)."""
        return np.arange(self.kept[0] % self._every, self.time.size, self._every)

    @property
    def _every(self) -> int:
        """The decimation factor that the band allows."""
        return max(round(self._rate / self.band_hz / PER_PERIOD), 1)

    @property
    def _rest_speed(self) -> float:
        """Below it the sign of the speed is unknown [rad/s]."""
        usual = float(np.sqrt(np.mean(self.velocity**2)))
        noise = self._derivative_noise(min(WHOLE * self.band_hz, FASTEST * self._rate), 1)
        return min(max(policy.SURE_SPEED * noise, policy.UNSURE_SPEED * usual), policy.SLOW_SPEED * usual)

    @property
    def _rate(self) -> float:
        return float(1 / (self.time[1] - self.time[0]))

    def filtered(self, signals: FloatArray) -> FloatArray:
        """Signals (..., N) through the filter, at the samples that are compared (..., M)."""
        return self.smooth(signals)[..., self.kept]

    def smooth(self, signals: FloatArray) -> FloatArray:
        """Signals (..., N) through the filter with the cutoff at the end of the band."""
        return lowpass(signals, self.band_hz / self._rate)

    @cached_property
    def lines(self) -> tuple[float, ...]:
        """Frequencies of the largest lines in the spectrum of what was measured [Hz], the largest first."""
        return spectral_lines(self.experiment.measured[self.column], self.experiment.rate_hz)

    @property
    def driving(self) -> FloatArray:
        """The recorded input (N,); zeros where there is none."""
        drive = self.experiment.drive
        if drive is None:
            return np.zeros_like(self.time)
        return np.asarray(drive.position(np.clip(self.time, *self.experiment.time[[0, -1]])))

    @property
    def counts_from_start(self) -> bool:
        """Whether the angle is exactly zero at the first sample: that of an incremental encoder, or an angle that was
        integrated from a speed."""
        if self.column != "position" or self.experiment.is_linear or self.experiment.drive is None:
            return False
        position = self.experiment.measured["position"]
        return bool(position[~np.isnan(position)][0] == 0.0)

    def shifted(self, zero: float) -> Signals:
        """With another zero angle [rad] of the measured and the filtered position."""
        measured = {**self.experiment.measured, self.column: self.experiment.measured[self.column] + zero}
        return replace(self, experiment=replace(self.experiment, measured=measured), position=self.position + zero)

    @property
    def position_noise(self) -> float:
        """Root mean square of the angle's noise [rad], if it is white."""
        return float(np.sqrt(self.position_density * self._rate / 2))

    @property
    def acceleration_noise(self) -> float:
        """Root mean square of the acceleration's error within the band [rad/s²] due to the angle's noise."""
        return self._derivative_noise(self.band_hz, 2)

    def _derivative_noise(self, end_hz: float, order: int) -> float:
        """Root mean square of the error of the angle's derivative up to this frequency: the square root of the integral
        of (2 pi f)^(2 order) times the noise's density."""
        power = 2 * order + 1
        return float(np.sqrt(self.position_density * (2 * np.pi) ** (2 * order) * end_hz**power / power))


def is_moving(velocity: FloatArray) -> NDArray[np.bool_]:
    """Where the speed is above ``policy.RESTS`` of that below which half of the way is made (N,)."""
    speed = np.abs(velocity)
    ordered = np.sort(speed)
    way = np.cumsum(ordered)
    return np.asarray(speed > policy.RESTS * ordered[np.searchsorted(way, way[-1] / 2)])


def _integrated_twice(acceleration: FloatArray, step: float, slowest_hz: float) -> FloatArray:
    """Position without frequencies below this, where an accelerometer's offset exceeds the motion."""
    frequency = np.fft.rfftfreq(acceleration.size, step)
    spectrum = np.fft.rfft(acceleration - acceleration.mean())
    slow = frequency < slowest_hz
    spectrum[~slow] /= -((2 * np.pi * frequency[~slow]) ** 2)
    spectrum[slow] = 0.0
    return np.asarray(np.fft.irfft(spectrum, acceleration.size))


def _density(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and one-sided power density."""
    from scipy.signal import welch

    length = min(values.size, SEGMENT)
    found: tuple[FloatArray, FloatArray] = welch(  # type: ignore[call-overload]  # the stubs lack detrend="linear"
        values, rate, "blackmanharris", length, detrend="linear"
    )
    return found


def _band(position: FloatArray, rate: float) -> tuple[float, float]:
    """The frequency [Hz] at which the angle's density falls to that of its noise, and this density, from the upper
    quarter of frequencies.

    Only power above the noise counts as motion: at high frequencies the noise of a speed exceeds the speed.
    """
    frequency, power = _density(position, rate)
    noise = float(np.median(power[3 * power.size // 4 :]))
    is_clear = power > policy.BAND_CLEAR * noise
    moving = np.cumsum(np.where(is_clear, power * frequency**2, 0.0))
    lost = np.flatnonzero(~is_clear & (moving >= policy.BAND_MOTION * moving[-1]))
    end = float(frequency[lost[0]]) if lost.size else float(frequency[-1])
    return min(max(end, SLOWEST_OWN * rate / position.size), FASTEST * rate), noise


def _torque_noise(torque: FloatArray, rate: float, band: float) -> float:
    """Root mean square of the torque's own noise within the band [N m]: its density above the band, where there is no
    motion, taken as white."""
    frequency, power = _density(torque, rate)
    above = power[frequency > 2 * band]
    floor = float(np.median(above)) if above.size >= 3 else float(power.min())
    return float(np.sqrt(floor * band))
