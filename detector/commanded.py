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

__all__ = ["BEFORE_S", "Commanded", "smoothed"]

BEFORE_S = 0.2
"""The flank that is left is heard so long before the reversal [s]."""
COVERED = 0.7
"""Share of the stretch that commands must cover; what lies behind them is left out."""
FASTEST_HZ = 25.0
"""Polynomials follow a motion up to 2 / pi of this in their middle, faster ones near their ends.  Commands in steps of
5 mrad at 100 Hz tell white jerk up to some 13 Hz.  With 25 and with 35 78 % of the windows above 30 dB told a size,
95.4 and 94.9 % of the intervals held (every third of the seeds 7000 to 7119 of ``bench.outside``); with 15 60 and 96 %
(all of them).  Each window told by itself then."""
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
RIDGE = 1e-9
"""Share of a coefficient's weight that is known to be 0: commands may come in bunches, which leave some unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """theta_1 as a polynomial: coefficients and their covariance, over times mapped to -1..1.

    order and roughness: the derivative that is white and its strength [rad² / s^(2 order - 1)], whose part that is too
    fast for the polynomial remains unknown (``rest``).
    """

    middle: float
    half: float
    coefficients: FloatArray
    covariance: FloatArray
    order: int = 3
    roughness: float = 0.0

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
        return legendre.values((time - self.middle) / self.half, len(self.coefficients) - 1)

    def rest(self, count: int, step: float) -> FloatArray:
        """Covariance [rad²] of what is too fast for the polynomial, (count, count), at times ``step`` [s] apart."""
        strength = self.roughness / math.pi * self.fastest ** (1 - 2 * self.order)
        row, index = strength * _beyond(count, round(step * self.fastest, 2), self.order), np.arange(count)
        return np.asarray(row[np.abs(index[:, None] - index)])

    @property
    def fastest(self) -> float:
        """Angular frequency [rad/s] that the polynomial follows in its middle."""
        return (len(self.coefficients) - 1) / self.half

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
    basis = legendre.values((local - middle) / half, _degree(half, local.size))
    return Commanded(middle, half, *_fitted(basis, angle, half))


def _near(times: FloatArray, commands: FloatArray, stretch: Window) -> tuple[FloatArray, FloatArray]:
    """Times from the stretch's start [s] and angles of the commands around it."""
    first, last = float(stretch.time[0]), float(stretch.time[-1])
    near = (times >= first - BEFORE_S) & (times <= last + BEFORE_S / 4)
    return times[near] - first, commands[near]


def _degree(half: float, count: int) -> int:
    """Of polynomials that follow motions of FASTEST_HZ over 2 ``half`` seconds."""
    return min(math.ceil(4 * FASTEST_HZ * half) + 5, count - 4)


def _fitted(basis: FloatArray, angle: FloatArray, half: float) -> tuple[FloatArray, FloatArray, int, float]:
    """Coefficients and their covariance at the most likely smoothness and noise; the white derivative's order and
    strength."""
    weight, least = _weights(angle)
    centre = float(angle.mean())
    away = angle - centre
    gram, told = _gram(basis, weight), basis.T @ (weight * away)
    power = float(weight @ away**2)
    _, order, stiff, noise = min(_smoothest(gram, told, power, order, angle.size, least) for order in ORDERS)
    scale = _scale(told.size - 1, order)
    white = np.repeat([0.0, stiff], [order, told.size - order])
    inverse = scale @ np.linalg.inv(scale.T @ gram @ scale + np.diag(white)) @ scale.T
    coefficients = inverse @ told
    coefficients[0] += centre
    return coefficients, np.asarray(inverse * noise), order, noise / stiff / half ** (2 * order - 1)


def _gram(basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Products of the polynomials at the commands, and a ridge that keeps them apart."""
    return np.asarray((basis.T * weight) @ basis + RIDGE * weight.size * np.eye(basis.shape[1]))


def _smoothest(
    gram: FloatArray, told: FloatArray, power: float, order: int, count: int, least: float
) -> tuple[float, int, float, float]:
    """-2 ln of the marginal likelihood at the best smoothness if the derivative of that order is white, with the order,
    that smoothness and the noise's variance.

    The modes are of the white derivative, whose prior is the same in all directions: what commands tell of a mode is
    exact where it is much and rounds to nothing where it is little.  (Modes of the polynomials by their roughness, up
    to 1e24, lost the smoothest ones to rounding, and with them 350 nats in every second window.)
    """
    scale = _scale(told.size - 1, order)
    gram, told = scale.T @ gram @ scale, scale.T @ told
    free = np.linalg.inv(gram[:order, :order]) @ np.column_stack([gram[:order, order:], told[:order]])
    mode, turned = np.linalg.eigh(gram[order:, order:] - gram[order:, :order] @ free[:, :-1])
    mode = np.maximum(mode, 0.0)
    seen = turned.T @ (told[order:] - gram[order:, :order] @ free[:, -1])
    stiff = SMOOTHNESS[:, None]
    misfit = np.maximum(power - told[:order] @ free[:, -1] - np.sum(seen**2 / (mode + stiff), axis=1), 0.0)
    noise = np.maximum(misfit / (count - order), least**2)
    cost = count * np.log(noise) + misfit / noise + np.sum(np.log1p(mode / stiff), axis=1)
    cost += order * np.log(FREE**2 * count / noise)
    best = int(np.argmin(cost))
    return float(cost[best]), order, float(SMOOTHNESS[best]), float(noise[best])


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
    basis = legendre.values(np.linspace(-1, 1, count), degree)
    return basis, np.asarray(np.linalg.pinv(basis))


@lru_cache(maxsize=16)
def _scale(degree: int, order: int) -> FloatArray:
    """What makes a polynomial's coefficients of the first ``order`` of them and of those of its derivative of that
    order, in orthonormal polynomials; shape (degree + 1, degree + 1)."""
    scale = np.eye(degree + 1)
    norms = np.sqrt(2 / (2 * np.arange(degree + 1 - order) + 1))
    scale[order:, order:] = np.linalg.inv(norms[:, None] * legendre.derivative(degree, order)[:, order:])
    return scale


@lru_cache(maxsize=16)
def _beyond(count: int, step: float, order: int) -> FloatArray:
    """Integral of cos(w t) / w^(2 order) over w > 1 at t = 0, step, ..., shape (count,)."""
    period = (np.arange(400) + 0.5) / 400  # 1 / w
    return np.asarray(np.cos(step * np.arange(count)[:, None] / period) @ period ** (2 * order - 2) / period.size)
