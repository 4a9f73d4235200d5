"""The commands around a stretch of acceleration as one smooth motion that can be differentiated.  Knows no sensor.

The prior of the motion is white jerk of unknown strength q (a smoothing spline of degree five); commands carry white
noise of unknown variance s², at least that of their quantisation.  Both come from the marginal likelihood of the
commands themselves (Wahba 1985, generalised maximum likelihood), so a slow sway is smoothed far and a move of 10 Hz
little.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lostmotion.detector import legendre
from lostmotion.detector.servo import GRID_S, ServoLaw, delayed, smoothing
from lostmotion.detector.window import FloatArray, Window

__all__ = ["BEFORE_S", "Commanded", "cornered", "smoothed"]

BEFORE_S = 0.2
"""The flank that is left is heard so long before the reversal [s]."""
COVERED = 0.7
"""Share of the stretch that commands must cover; what lies behind them is left out."""
FASTEST_HZ = 15.0
"""Polynomials follow a motion up to this; the prior of the jerk decides how much of it is believed."""
SHARPEST_HZ, CORNER_S = 40.0, 0.005
"""The same of motions with corners, and how soon the acceleration may jump again [s].  With 25 Hz and 14 ms, all that
commands in steps of 5 mrad at 100 Hz tell, corners of 30 rad/s² remained 1.5 mrad wrong: of hard stops of 0.5 to 2 mrad
under trapezoids 63 of 105 intervals lay above the truth, with these 10 of 60 (recordings of seeds 8610 to 8612)."""
MOST_DEGREE = 95
"""What SHARPEST_HZ asks for in a stretch of 0.85 s.  With 60, of hard stops of 1 mrad 48 % of the windows told a play
that was too large, with 95 11 % (recordings of seeds 8600 and 8601)."""
LEAST_COMMANDS = 20
ORDERS = (3, 5)
"""The derivative that is white: jerk, for profiles whose acceleration jumps, or a higher one for smooth motions."""
FREE = 0.2
"""Usual size of the polynomial's part that is free [rad]."""
SMOOTHNESS = 10.0 ** np.arange(-16.0, 3.0, 0.5)
"""Values of s² / q, in units of the stretch's half length, that are tried."""
EXACT = 1e-7
"""Noise of commands that are not quantised [rad]."""
WHOLE = 0.02
"""Commands are quantised where all their changes are whole multiples of the smallest, to this share of it."""
MOST_POWERS = 20
"""Up to this degree powers serve, in a tenth of the time of the recursion; they lose six digits of sixteen there."""
RIDGE = 1e-9
"""Share of a coefficient's weight that is known to be 0: commands may come in bunches, which leave some unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """theta_1 as a polynomial: coefficients and their covariance, over times mapped to -1..1."""

    middle: float
    half: float
    coefficients: FloatArray
    covariance: FloatArray

    @property
    def start(self) -> float:
        """From here on it is known [s]."""
        return self.middle - self.half

    @property
    def end(self) -> float:
        """Up to here it is known [s]."""
        return self.middle + self.half

    def basis(self, time: FloatArray) -> FloatArray:
        """Legendre's polynomials at times [s], shape (N, degree + 1)."""
        return _basis((time - self.middle) / self.half, len(self.coefficients) - 1)

    def derivative(self, basis: FloatArray, order: int) -> FloatArray:
        """The derivative of theta_1 of that order [rad/s^order] at the times of a basis, shape (N,)."""
        degree = len(self.coefficients) - 1
        derived = legendre.derivative(degree, order) @ self.coefficients / self.half**order
        return np.asarray(basis[:, : degree + 1 - order] @ derived)

    def followed(self, servo: ServoLaw) -> Commanded:
        """The motion of a servo of which that is known: the mean over the ways in which it may follow, and their
        covariance."""
        ways = np.flatnonzero(servo.odds)
        if ways.tolist() == [0]:
            return self
        odds, degree = servo.odds[ways], len(self.coefficients) - 1
        basis, inverse = _grid(max(round(2 * self.half / GRID_S) + 1, degree + 1), degree)
        each = delayed(basis @ self.coefficients, ways) @ inverse.T
        mean, matrix = odds @ each, inverse @ (smoothing(len(basis), odds, ways) @ basis)
        apart = each - mean
        covariance = matrix @ self.covariance @ matrix.T + (apart.T * odds) @ apart
        return replace(self, coefficients=mean, covariance=covariance)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """theta_1'' [rad/s²] at times [s]."""
        return self.derivative(self.basis(time), 2)


def smoothed(times: FloatArray, commands: FloatArray, stretch: Window) -> Commanded | None:
    """The commands around the stretch as one polynomial, in seconds from its start; None when they do not cover it."""
    local, angle = _near(times, commands, stretch)
    length = float(stretch.time[-1] - stretch.time[0])
    if local.size < LEAST_COMMANDS or local[0] > 0.05 * length or local[-1] < COVERED * length:
        return None
    middle, half = (local[-1] + local[0]) / 2, (local[-1] - local[0]) / 2
    basis = _basis((local - middle) / half, _degree(FASTEST_HZ, half, local.size))
    return Commanded(middle, half, *_fitted(basis, angle))


def cornered(times: FloatArray, commands: FloatArray, stretch: Window, smooth: Commanded) -> Commanded:
    """The same if the acceleration may jump anywhere by the largest that ``smooth`` has: white jerk as strong as that
    of one such corner within CORNER_S, which leaves nearly what each command tells by itself."""
    local, angle = _near(times, commands, stretch)
    middle, half = smooth.middle, smooth.half
    basis = _basis((local - middle) / half, _degree(SHARPEST_HZ, half, local.size))
    weight, noise = _weights(angle)
    degree = basis.shape[1] - 1
    jump = float(np.max(np.abs(smooth.acceleration(local[local >= 0]))))
    stiff = noise**2 * CORNER_S / max(jump**2 * half**5, 1e-12)
    inverse = np.linalg.inv(_gram(basis, weight) + stiff * _penalty(degree, ORDERS[0]))
    coefficients = inverse @ (basis.T @ (weight * (angle - angle.mean())))
    coefficients[0] += angle.mean()
    return Commanded(middle, half, coefficients, np.asarray(inverse * noise**2))


def _near(times: FloatArray, commands: FloatArray, stretch: Window) -> tuple[FloatArray, FloatArray]:
    """Times from the stretch's start [s] and angles of the commands around it."""
    first, last = float(stretch.time[0]), float(stretch.time[-1])
    near = (times >= first - BEFORE_S) & (times <= last + BEFORE_S / 4)
    return times[near] - first, commands[near]


def _degree(fastest_hz: float, half: float, count: int) -> int:
    """Of polynomials that follow motions of that frequency over 2 ``half`` seconds."""
    return min(math.ceil(4 * fastest_hz * half) + 5, MOST_DEGREE, count - 4)


def _fitted(basis: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Coefficients and their covariance at the most likely smoothness and noise."""
    weight, least = _weights(angle)
    centre = float(angle.mean())
    away = angle - centre
    whitening = np.linalg.inv(np.linalg.cholesky(_gram(basis, weight)))
    plain = whitening @ (basis.T @ (weight * away))
    power = float(weight @ away**2)
    told = [_smoothest(plain, whitening, order, power, angle.size, least) for order in ORDERS]
    _, noise, kept, mixed = min(told, key=lambda one: one[0])
    coefficients = mixed.T @ (kept * (mixed @ (basis.T @ (weight * away))))
    coefficients[0] += centre
    return coefficients, np.asarray((mixed.T * kept) @ mixed * noise)


def _gram(basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Products of the polynomials at the commands, and a ridge that keeps them apart."""
    return np.asarray((basis.T * weight) @ basis + RIDGE * weight.size * np.eye(basis.shape[1]))


def _smoothest(
    plain: FloatArray, whitening: FloatArray, order: int, power: float, count: int, least: float
) -> tuple[float, float, FloatArray, FloatArray]:
    """-2 ln of the marginal likelihood at the best smoothness, with the noise's variance, the share of each eigenmode
    that is believed and the modes."""
    rough, turned = np.linalg.eigh(whitening @ _penalty(plain.size - 1, order) @ whitening.T)
    told = turned.T @ plain
    stiff = SMOOTHNESS[:, None] * np.maximum(rough[order:], 0.0)
    shrink = stiff / (1 + stiff)
    misfit = max(power - float(told @ told), 0.0) + shrink @ told[order:] ** 2
    noise = np.maximum(misfit / (count - order), least**2)
    cost = count * np.log(noise) + misfit / noise - np.sum(np.log(np.maximum(shrink, 1e-300)), axis=1)
    cost += order * np.log(FREE**2 * count / noise)
    best = int(np.argmin(cost))
    return (
        float(cost[best]),
        float(noise[best]),
        np.concatenate([np.ones(order), 1 - shrink[best]]),
        turned.T @ whitening,
    )


def _weights(angle: FloatArray) -> tuple[FloatArray, float]:
    """The weight of each command, and the least noise [rad].

    A goal that stays on one level tells as much as one command on it: the error of quantisation stays the same.
    """
    change = np.abs(np.diff(angle))
    moved = change[change > EXACT]
    step = float(moved.min()) if moved.size else EXACT
    if np.max(np.abs(moved / step - np.round(moved / step)), initial=0.0) > WHOLE:
        step = EXACT
    run = np.cumsum(np.concatenate([[0], change > EXACT]))
    return 1.0 / np.bincount(run)[run], max(step / math.sqrt(12), EXACT)


@lru_cache(maxsize=8)
def _grid(count: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Polynomials on an even grid, shape (count, degree + 1), and what makes coefficients of values there."""
    basis = _basis(np.linspace(-1, 1, count), degree)
    return basis, np.asarray(np.linalg.pinv(basis))


@lru_cache(maxsize=16)
def _penalty(degree: int, order: int) -> FloatArray:
    """Integral over -1..1 of the square of a polynomial's derivative, as a matrix of its coefficients."""
    derived = legendre.derivative(degree, order)
    return np.asarray(derived.T * (2 / (2 * np.arange(degree + 1 - order) + 1)) @ derived)


def _basis(place: FloatArray, degree: int) -> FloatArray:
    """Legendre's polynomials up to a degree at places -1..1, shape (N, degree + 1)."""
    if degree > MOST_POWERS:
        return legendre.values(place, degree)
    return np.asarray(np.vander(place, degree + 1, increasing=True) @ _powers(degree))


@lru_cache(maxsize=16)
def _powers(degree: int) -> FloatArray:
    """Legendre's polynomials by powers, a column each, shape (degree + 1, degree + 1)."""
    return np.ascontiguousarray(legendre.powers(degree).T)
