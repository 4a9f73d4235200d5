"""Motion and torque of a recording within the band in which its angle exceeds the noise.  Nothing is fitted here.

All signals of a regression pass the same zero-phase low-pass filter, which preserves the linear relations between them
(parallel filtering), and are then sampled at the rate that the band needs.  ``Signals`` is the form in which the
likelihood of predictable motions gets its recordings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.special import gammaincinv

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import spectral_lines
from lostmotion.lab.data.series import rms
from lostmotion.lab.inverse.zero_phase import lowpass
from lostmotion.model.motion import FloatArray

__all__ = ["COLUMNS", "LEAST_SAMPLES", "Signals", "is_moving"]

FASTEST = 0.2
"""Highest end of a band, as a share of the sampling rate: the second derivative of the spline is accurate to 1 %
there."""
CUTOFF = 2.0
"""Cutoff of the filter that smooths the motion, times the end of the band: its gain at the end of the band is 99.6 %.
Dry friction needs the true speed; with a cutoff at the end of the band, a fast sine near it reduced a damper's friction
from 50 N to 23 N."""
LEAST_SAMPLES, REGRESSORS = 4, 6
"""Least number of samples for each regressor of the usual joint (channel.py), and the number of regressors.  With fewer
samples in motion, those at rest are compared as well.  They contain no information on friction, and 125 of them
outvoted 70 in motion."""
SPLINE = 5
"""Degree of the spline that is differentiated.  Central differences are 3 % too small at a twentieth of the rate."""
SLOWEST = 4.0
"""Lowest end of a band, in periods within the recording, where the band is prescribed by other recordings; and lowest
frequency of an accelerometer."""
RINGS = 0.25
"""Share of the frequency of a ring-down below which the readings of an accelerometer are drift."""
PER_PERIOD = 2.5
"""Samples that are compared per period of the end of the band."""
EDGE = 2.0
"""Periods of the end of the band that are left out at both ends of a recording."""
SETTLED = 0.15
"""Time from a rest or a reversal within which samples are not compared, in periods of the end of the band: while a part
sticks, its friction has any value between its limits, and the filter spreads that.  Of 96 intervals of 32
simulated joints that stick 57 held without it, 77 with 0.15, 67 with 0.25 and 46 with 0.4; Coulomb friction was off by
2.2, 1.1, 1.1 and 2.3 %.  Where few would be left, all samples in motion are compared: with 31 of 48 no friction was
found."""
SLOWEST_OWN = 2 * EDGE + LEAST_SAMPLES * REGRESSORS / PER_PERIOD
"""Lowest end of a band that follows from the recording itself, in periods within the recording; it fixes the least
number of samples.  With four periods nine samples were left of a robot's joint that turned slowly for 16 s at 30 Hz,
and Coulomb friction was not significant (p = 0.12, now 0.001)."""
SLOWEST_DISTURBED = 40.0
"""The same for a joint that its neighbours move, whose torque has steps at reversals that are faster than the motion.
With 13.6 periods 25 samples were left of such a wrist, and no friction was significant; with 40 and 60 its Coulomb
friction is 0.24 and 0.30 N m (p = 0.006)."""
SEGMENT = 1024
"""Samples of a segment of the power density."""
COLUMNS = ("position", "displacement", "accel")
"""The columns that may hold the measured motion, the most direct one first."""


@dataclass(frozen=True, eq=False)
class Signals:
    """The filtered signals of a recording, each (N,) at evenly spaced times.

    time [s], position [rad or m], velocity, acceleration, torque [N m or N]; band_hz: the end of the band;
    position_density: power density of the noise of the position, its median over the upper quarter of frequencies
    [rad²/Hz]; torque_noise: root mean square of the noise of the torque within the band [N m]; column: the measured
    one.
    """

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
    """Whether only samples farther than ``SETTLED`` from a rest or a reversal are compared: where there is a torque,
    unless neighbours move the joint, so that its friction is known by the reversals alone."""
    is_delayed: bool = False
    """Whether a delay between torque and angle was estimated and removed."""

    @classmethod
    def of(
        cls, experiment: Experiment, is_force: bool = True, most_hz: float = math.inf, is_disturbed: bool = False
    ) -> Signals:
        """The signals of an experiment with one moving part.

        is_force: whether the input is a torque or force, else the torque is zero; most_hz: the highest end of the band
        (channel.py); is_disturbed: whether neighbours move the part.  An acceleration is integrated twice.
        """
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
        whole = min(CUTOFF * band, FASTEST / step)
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
        """The indices of the samples that are compared (M,).  Samples near the ends, where the filter has a transient,
        are not, nor are those at rest, where dry friction has any value up to its largest, and those so near to a rest
        that the filter mixes both."""
        edge = min(round(EDGE * self._rate / self.band_hz), self.time.size // 4)
        found = np.arange(edge, self.time.size - edge, self._every)
        moving = found[np.abs(self.velocity[found]) > self.rest_speed]
        if moving.size < LEAST_SAMPLES * REGRESSORS:
            return found
        settled = moving[self._since_rest(moving) > SETTLED * self._rate / self.band_hz]
        is_enough = settled.size >= max(2 * LEAST_SAMPLES * REGRESSORS, moving.size / 2)
        return settled if self.counts_settled and is_enough else moving

    def _since_rest(self, samples: NDArray[np.intp]) -> NDArray[np.intp]:
        """The number of samples to the next one at rest, or the next reversal, before or after each of these (K,)."""
        slow = np.abs(self.velocity) <= self.rest_speed
        slow[1:] |= np.diff(np.sign(self.velocity)) != 0
        rests = np.concatenate([[-self.time.size], np.flatnonzero(slow), [2 * self.time.size]])
        after = np.searchsorted(rests, samples)
        return np.asarray(np.minimum(samples - rests[after - 1], rests[after] - samples))

    @cached_property
    def is_next(self) -> NDArray[np.bool_]:
        """Whether each sample that is compared but the first follows the one before without a gap (M - 1,)."""
        return np.asarray(np.diff(self.kept) == self._every)

    def until_moved(self, share: float) -> float:
        """The time until which the part has made this share of its motion [s]: samples at rest do not count."""
        moving = np.flatnonzero(np.abs(self.velocity) >= self.rest_speed)
        return float(self.time[moving[int(share * (moving.size - 1))]])

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """Whether a free motion has not yet come to rest, at each sample (N,)."""
        return is_moving(self.velocity)

    def delayed(self, by_s: float) -> Signals:
        """The signals with a torque that acts ``by_s`` [s] later."""
        at = np.clip(self.time - by_s, *self.time[[0, -1]])
        return replace(self, torque=np.asarray(make_interp_spline(self.time, self.torque, k=3)(at)))

    @property
    def torque_by_delay(self) -> FloatArray:
        """The derivative of the filtered torque by a delay of it [N m/s], at the samples that are compared (M,), from
        a delay of one sample."""
        return self.filtered(self.delayed(self.step_s).torque - self.torque) / self.step_s

    @property
    def grid(self) -> NDArray[np.intp]:
        """The indices of all samples on the grid of those that are compared, also at rest and near the ends (K,)."""
        return np.arange(self.kept[0] % self._every, self.time.size, self._every)

    @property
    def _every(self) -> int:
        """The decimation factor, ``PER_PERIOD`` samples being left in a period of the end of the band."""
        return max(round(self._rate / self.band_hz / PER_PERIOD), 1)

    @property
    def rest_speed(self) -> float:
        """The speed below which a sample counts as at rest, as the sign of its speed is unknown [rad/s]."""
        return policy.UNSURE_SPEED * rms(self.velocity)

    @property
    def step_s(self) -> float:
        """The spacing of the samples [s]."""
        return float(self.time[1] - self.time[0])

    @property
    def _rate(self) -> float:
        return 1 / self.step_s

    def filtered(self, signals: FloatArray) -> FloatArray:
        """Signals (..., N) after the filter, at the samples that are compared (..., M)."""
        return self.smooth(signals)[..., self.kept]

    def smooth(self, signals: FloatArray) -> FloatArray:
        """Signals (..., N) after the filter, whose cutoff is the end of the band."""
        return lowpass(signals, self.band_hz / self._rate)

    @property
    def driving(self) -> FloatArray:
        """The recorded input (N,); zeros where there is none."""
        drive = self.experiment.drive
        if drive is None:
            return np.zeros_like(self.time)
        return np.asarray(drive.position(np.clip(self.time, *self.experiment.time[[0, -1]])))

    @property
    def counts_from_start(self) -> bool:
        """Whether the measured angle is relative to that at the start, as it is exactly zero at the first sample: that
        of an incremental encoder, or one integrated from a speed."""
        if self.column != "position" or self.experiment.is_linear or self.experiment.drive is None:
            return False
        position = self.experiment.measured["position"]
        return bool(position[~np.isnan(position)][0] == 0.0)

    def shifted(self, zero: float) -> Signals:
        """The signals with a zero [rad, m or m/s²] added to the readings and, of an angle or a place, to the filtered
        position."""
        measured = {**self.experiment.measured, self.column: self.experiment.measured[self.column] + zero}
        position = self.position if self.column == "accel" else self.position + zero
        return replace(self, experiment=replace(self.experiment, measured=measured), position=position)

    @property
    def position_noise(self) -> float:
        """Root mean square of the angle's noise [rad], if it is white.

        The density is the median of a spectrum of K segments, whose values have a gamma distribution of shape K: of one
        segment the median is 0.69 of the mean.  Without this the noise of 36 servos, recorded for 8 s, was 0.62 to 1.14
        of the true one, in the mean 0.86, and is 0.74 to 1.25, in the mean 0.99.
        """
        segments = max(2 * self.time.size // SEGMENT - 1, 1)
        mean = self.position_density * segments / gammaincinv(segments, 0.5)
        return float(np.sqrt(mean * self._rate / 2))

    @property
    def acceleration_noise(self) -> float:
        """Root mean square of the error of the acceleration within the band that the noise of the angle causes
        [rad/s²]: the square root of the integral of (2 pi f)^4 S, S being the power density of the noise."""
        return float(np.sqrt(self.position_density * (2 * np.pi) ** 4 * self.band_hz**5 / 5))


def is_moving(velocity: FloatArray) -> NDArray[np.bool_]:
    """At which samples (N,) the speed is above ``policy.RESTS`` of the speed below which half of the distance is
    covered."""
    speed = np.abs(velocity)
    ordered = np.sort(speed)
    way = np.cumsum(ordered)
    return np.asarray(speed > policy.RESTS * ordered[np.searchsorted(way, way[-1] / 2)])


def _integrated_twice(acceleration: FloatArray, step: float, slowest_hz: float) -> FloatArray:
    """The position (N,) of an acceleration (N,), without frequencies below ``slowest_hz``, where the offset of an
    accelerometer exceeds the motion; step: between samples [s]."""
    frequency = np.fft.rfftfreq(acceleration.size, step)
    spectrum = np.fft.rfft(acceleration - acceleration.mean())
    slow = frequency < slowest_hz
    spectrum[~slow] /= -((2 * np.pi * frequency[~slow]) ** 2)
    spectrum[slow] = 0.0
    return np.asarray(np.fft.irfft(spectrum, acceleration.size))


def _density(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies [Hz] and one-sided power density of values (N,) by Welch's method."""
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
