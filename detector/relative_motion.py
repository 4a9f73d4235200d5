"""How far a joint is from its gear during one stretch: D = theta_2 - theta_1, but for a + b t, and how uncertain it is.

theta_2 is twice the integral of the impulses that the accelerometer tells (``deconvolution``), less what it reads
beside motion (``offset``); theta_1 is the commanded motion (``commanded``) as a servo follows it (``servo``).  Errors
of the lever, the resonance, the servo's ways and the offset are in the covariance.  No flanks, no play.
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

__all__ = ["RelativeMotion", "relative_motion"]

LENGTH, MISTUNED = 0.02, 0.005
"""Standard deviations of the shares by which length or sensitivity, and the resonance, are wrong."""
OTHERWISE, SHAPE = 0.15, 0.15
"""Standard deviations of the share of what following changes by which a servo follows otherwise, and of the second
coefficient of its lag over the delay's square, which is 0.5 of a pure delay, 1 of the first order, 0.3 to 0.8 of a
second order damped by 0.6 to 1.2."""


@dataclass(frozen=True, slots=True, eq=False)
class RelativeMotion:
    """The joint's angle against the gear, but for a + b t, where that is known, and its covariance, at times (K,).

    lag (K, 2): what a delay that is 1 s too long, and a second coefficient that is 1 s² too small, add to the angle;
    shape: standard deviation of that coefficient [s²].  Neither is in the covariance; nor is what a play has made
    one believe of a servo that is learnt.
    """

    time: FloatArray
    angle: FloatArray
    covariance: FloatArray
    known: NDArray[np.bool_]
    lag: FloatArray
    shape: float
    servo_is_learnt: bool


def relative_motion(
    stretch: Window, command: Commanded, settings: DetectorSettings, servo: ServoLaw, offset: OffsetLaw
) -> tuple[RelativeMotion, Contacts, OffsetLaw]:
    """D, where the joint may touch its gear, and what is known of the sensor's offset after this stretch."""
    followed = command.followed(servo)
    noise = noise_of(stretch.accel, settings)
    undone = inverse(stretch.accel.size, stretch.rate_hz, noise, settings)
    basis = command.basis(np.minimum(undone.times, command.end))
    accel, doubt, offset = _levelled(stretch, followed, undone.times, basis, settings, offset)
    impulses = undone.impulses(accel)
    wrong = mistuned(accel.size, stretch.rate_hz, noise, settings, MISTUNED) @ accel.astype(np.float32)
    otherwise = (basis @ command.coefficients, wrong.astype(np.float64))
    apart = _apart(undone, impulses, followed, basis, otherwise, doubt, servo, settings)
    return apart, contacts(undone, impulses, followed.derivative(basis, 2), apart.known), offset


def _levelled(
    stretch: Window, command: Commanded, times: FloatArray, basis: FloatArray, settings: DetectorSettings,
    offset: OffsetLaw,
) -> tuple[FloatArray, tuple[float, float], OffsetLaw]:  # fmt: skip
    """Accelerations without what the sensor reads beside motion, the standard deviations of what may remain of offset
    [m/s²] and gravity [m/s² per rad], and what is known of them after this window.

    basis: of the command at times from the stretch's start [s].  Of the offset this window tells as much as it does for
    all of them, with the deviation OWN that its play leaves.
    """
    local = stretch.time - stretch.time[0]
    angle = np.interp(local, times, basis @ command.coefficients)
    driven = np.interp(local, times, command.derivative(basis, 2))
    known = local <= command.end
    reading = stretch.accel[known] - settings.length_m * driven[known]
    offset = offset.updated(averaged(angle[known]), averaged(reading))
    read, level, slope = offset.read(angle)
    share = level**2 / (level**2 + OWN**2)
    accel = stretch.accel - read - share * averaged(reading - read[known])
    return accel, (OWN * math.sqrt(share), slope), offset


def _apart(
    undone: Inverse, impulses: FloatArray, command: Commanded, basis: FloatArray,
    uncertain: tuple[FloatArray, FloatArray], doubt: tuple[float, float], servo: ServoLaw, settings: DetectorSettings,
) -> RelativeMotion:  # fmt: skip
    """D and what is uncertain about it: a servo that follows otherwise is nearer to its goal [rad], or later; a wrong
    resonance adds angles [rad].

    basis: of the command at the times of the impulses.
    """
    goal, astray = uncertain
    time = undone.times
    driven, speed, accel = basis @ command.coefficients, *(command.derivative(basis, order) for order in (1, 2))
    driven, speed, accel = driven - driven.mean(), speed - speed.mean(), accel - accel.mean()
    step = undone.step
    columns = np.column_stack([
        (time - time.mean()) ** 2 * (doubt[0] / settings.length_m / 2),
        integrated(driven, step) * step * (doubt[1] / settings.length_m),
        LENGTH * driven,
        OTHERWISE * (goal - goal.mean() - driven),
        astray,
    ])  # fmt: skip
    covariance = undone.doubt + basis @ command.covariance @ basis.T + columns @ columns.T
    covariance += command.rest(time.size, step) * servo.passed(command.fastest)
    apart = integrated(impulses, step) - basis @ command.coefficients
    lag = np.column_stack([2 * USUAL * servo.delay[0] * accel - speed, accel])
    shape = SHAPE * servo.delay[0] ** 2
    return RelativeMotion(time, apart, covariance, time <= command.end, lag, shape, servo.is_learnt)
