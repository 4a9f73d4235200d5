"""The joint's angle relative to its gear during one segment, D = theta_2 - theta_1 except for a + b t, and its
covariance.

theta_2 is the second integral of the impulses from the accelerometer (``deconvolution``) without offset and gravity
(``offset``); theta_1 is the servo's response (``servo``) to the commanded motion (``commanded``).  The covariance
includes errors of the lever, the resonance, the servo's response and the offset.  No flanks, no play.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.commanded import Commanded
from lostmotion.detector.contacts import Contacts, contacts
from lostmotion.detector.deconvolution import Inverse, integrated, inverse, mistuned, noise_of
from lostmotion.detector.offset import OWN, OffsetLaw, averaged
from lostmotion.detector.servo import USUAL, ServoLaw
from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["Path", "RelativeMotion", "relative_motion"]

LENGTH, MISTUNED = 0.02, 0.005
"""Relative standard deviations of length or sensitivity, and of the resonance."""
OTHERWISE, SHAPE = 0.15, 0.15
"""Standard deviations of the error of the servo's response, as a share of response minus goal, and of the second
coefficient of its lag over the delay's square, which is 0.5 of a pure delay, 1 of the first order, 0.3 to 0.8 of a
second order damped by 0.6 to 1.2."""


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """theta_1 at times (K,): polynomials, (K, D), their coefficients [rad] and the covariance of these [rad²]."""

    basis: FloatArray
    coefficients: FloatArray
    polynomial_covariance: FloatArray

    def angle(self, at: NDArray[np.intp] | slice) -> FloatArray:
        """theta_1 [rad] at some of the times."""
        return np.asarray(self.basis[at] @ self.coefficients)

    def covariance(self, at: NDArray[np.intp] | slice) -> FloatArray:
        """The covariance of these angles [rad²]."""
        return np.asarray(self.basis[at] @ self.polynomial_covariance @ self.basis[at].T)


@dataclass(frozen=True, slots=True, eq=False)
class RelativeMotion:
    """The joint's angle relative to the gear except for a + b t, where it is known, and its covariance, at times (K,).

    command: theta_1 as it is used; alternative: under the other prior of its corners, None where there is none.

    lag (K, 2): change of the angle by a delay that is 1 s too long, and by a second coefficient that is 1 s² too small;
    shape: standard deviation of that coefficient [s²]; speed: that of the gear's lagging speed [rad/s].  Neither error
    is in the covariance; nor is the one that a play causes in the estimated lag of a servo.
    """

    time: FloatArray
    angle: FloatArray
    covariance: FloatArray
    command: Path
    alternative: Path | None
    known: NDArray[np.bool_]
    lag: FloatArray
    shape: float
    speed: float
    servo_is_learnt: bool


def relative_motion(
    segment: Window, command: Commanded, other: Commanded, settings: DetectorSettings, servo: ServoLaw,
    offset: OffsetLaw,
) -> tuple[RelativeMotion, Contacts, OffsetLaw]:  # fmt: skip
    """D, possible contacts of joint and gear, and the estimate of the sensor's offset after this segment.

    other: the commands under the other prior of their corners; the same object where there is only one.
    """
    followed = command.followed(servo)
    noise = noise_of(segment.accel, settings)
    inverted = inverse(segment.accel.size, segment.rate_hz, noise, settings)
    until = np.minimum(inverted.times, command.end)  # after its end it stands
    basis = command.basis(until)
    accel, deviations, offset = _without_offset(segment, followed, inverted.times, basis, settings, offset)
    impulses = inverted.impulses(accel)
    wrong = mistuned(accel.size, segment.rate_hz, noise, settings, MISTUNED) @ accel.astype(np.float32)
    uncertain = (basis @ command.coefficients, wrong.astype(np.float64))
    path = _path(followed, basis)
    alternative = _path(other.followed(servo), other.basis(until)) if other is not command else None
    motion = _relative_motion(inverted, impulses, followed, (path, alternative), uncertain, deviations, servo, settings)
    return motion, contacts(inverted, impulses, followed.derivative(basis, 2), motion.known), offset


def _without_offset(
    segment: Window, command: Commanded, times: FloatArray, basis: FloatArray, settings: DetectorSettings,
    offset: OffsetLaw,
) -> tuple[FloatArray, tuple[float, float], OffsetLaw]:  # fmt: skip
    """Accelerations without offset and gravity, the standard deviations of what may remain of offset [m/s²] and gravity
    [m/s² per rad], and the estimate of both after this window.

    basis: of the command at times from the segment's start [s].  This window's own reading corrects the offset by its
    share of the information, with the deviation OWN caused by its play.
    """
    local = segment.time - segment.time[0]
    angle = np.interp(local, times, basis @ command.coefficients)
    driven = np.interp(local, times, command.derivative(basis, 2))
    known = local <= command.end
    reading = segment.accel[known] - settings.length_m * driven[known]
    offset = offset.updated(averaged(angle[known]), averaged(reading))
    read, level, slope = offset.read(angle)
    share = level**2 / (level**2 + OWN**2)
    accel = segment.accel - read - share * averaged(reading - read[known])
    return accel, (OWN * math.sqrt(share), slope), offset


def _relative_motion(
    inverted: Inverse, impulses: FloatArray, command: Commanded, paths: tuple[Path, Path | None],
    uncertain: tuple[FloatArray, FloatArray], deviations: tuple[float, float], servo: ServoLaw,
    settings: DetectorSettings,
) -> RelativeMotion:  # fmt: skip
    """D and its covariance; paths: of the command, and under the other prior of its corners; uncertain: the goal [rad],
    for errors of the servo's response, and the angles [rad] added by an error of the resonance.
    """
    (path, alternative), (goal, astray), time = paths, uncertain, inverted.times
    angle = path.angle(slice(None))
    driven, speed, accel = angle, *(command.derivative(path.basis, order) for order in (1, 2))
    driven, speed, accel = driven - driven.mean(), speed - speed.mean(), accel - accel.mean()
    step = inverted.step
    columns = np.column_stack([
        (time - time.mean()) ** 2 * (deviations[0] / settings.length_m / 2),
        integrated(driven, step) * step * (deviations[1] / settings.length_m),
        LENGTH * driven,
        OTHERWISE * (goal - goal.mean() - driven),
        astray,
    ])  # fmt: skip
    covariance = np.hstack([path.basis @ path.polynomial_covariance, columns]) @ np.hstack([path.basis, columns]).T
    covariance += inverted.angle_covariance  # in place: each of these matrices takes a megabyte
    motion = integrated(impulses, step) - angle
    lag = np.column_stack([2 * USUAL * servo.delay[0] * accel - speed, accel])
    shape = SHAPE * servo.delay[0] ** 2
    known = time <= command.end
    varied = float(np.std(lag[known, 0]))
    return RelativeMotion(time, motion, covariance, path, alternative, known, lag, shape, varied, servo.is_learnt)


def _path(command: Commanded, basis: FloatArray) -> Path:
    """theta_1 at the times of a basis."""
    return Path(basis, command.coefficients, command.covariance)
