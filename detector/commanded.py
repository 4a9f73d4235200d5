"""The commands around a segment of acceleration as one smooth, differentiable motion.  No accelerometer here.

The prior of the motion is white jerk of unknown strength q (a smoothing spline of degree five); commands carry white
noise of unknown variance s², at least that of their quantisation.  Both come from the marginal likelihood of the
commands themselves (Wahba 1985, generalised maximum likelihood), so a slow sway is smoothed more than a move of 10 Hz.
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
"""Time before the reversal in which the contact with the first flank is observed [s]."""
COVERED = 0.7
"""Share of the segment that commands must cover; the part after the last command is left out."""
FASTEST_HZ = 25.0
"""Polynomials follow a motion up to 2 / pi of this in their middle, faster ones near their ends.  Commands in steps of
5 mrad at 100 Hz determine white jerk up to some 13 Hz.  With 25 and with 35, 78 % of the windows above 30 dB gave a
size, 95.4 and 94.9 % of the intervals held (every third of the seeds 7000 to 7119 of ``bench.outside``); with 15 60 and
96 % (all of them).  Windows were not pooled then."""
LEAST_COMMANDS = 20
ORDERS = (3, 5)
"""The derivative that is white: jerk, for profiles whose acceleration jumps, or a higher one for smooth motions."""
FREE = 0.2
"""Prior standard deviation of the polynomial's unpenalised part [rad]."""
SMOOTHNESS = 10.0 ** np.arange(-16.0, 3.0, 0.5)
"""Values of s² / q, in units of the segment's half length, that are tried."""
EXACT = 1e-7
"""Noise of commands that are not quantised [rad]."""
WHOLE = 0.02
"""Commands are quantised where all their changes are whole multiples of the smallest, to this share of it."""
RIDGE = 1e-9
"""Ridge, as a share of the weight of all commands: commands in bunches leave some coefficients undetermined."""


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """theta_1 as a polynomial: coefficients and their covariance, over times mapped to -1..1.

    order and roughness: the derivative that is white and its strength [rad² / s^(2 order - 1)]; ``rest`` is the
    covariance of the part that is too fast for the polynomial.
    """

    middle: float
    half: float
    coefficients: FloatArray
    covariance: FloatArray
    order: int = 3
    roughness: float = 0.0

    @property
    def start(self) -> float:
        """The earliest time at which it is known [s]."""
        return self.middle - self.half

    @property
    def end(self) -> float:
        """The latest time at which it is known [s]."""
        return self.middle + self.half

    def basis(self, time: FloatArray) -> FloatArray:
        """Legendre's polynomials at times [s], shape (N, degree + 1)."""
        return legendre.values((time - self.middle) / self.half, len(self.coefficients) - 1)

    def rest(self, count: int, step: float) -> FloatArray:
        """Covariance [rad²] of the motion too fast for the polynomial, (count, count), at times ``step`` [s] apart."""
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
        """The response of a servo: the mean over the candidate responses, and their covariance."""
        candidates = np.flatnonzero(servo.odds)
        if candidates.tolist() == [0]:
            return self
        odds, degree = servo.odds[candidates], len(self.coefficients) - 1
        basis, inverse = _grid(max(round(2 * self.half / GRID_S) + 1, degree + 1), degree)
        each = delayed(basis @ self.coefficients, candidates) @ inverse.T
        mean, matrix = odds @ each, inverse @ (smoothing(len(basis), odds, candidates) @ basis)
        deviation = each - mean
        covariance = matrix @ self.covariance @ matrix.T + (deviation.T * odds) @ deviation
        return replace(self, coefficients=mean, covariance=covariance)

    def acceleration(self, time: FloatArray) -> FloatArray:
        """theta_1'' [rad/s²] at times [s]."""
        return self.derivative(self.basis(time), 2)


def smoothed(times: FloatArray, commands: FloatArray, segment: Window) -> Commanded | None:
    """The commands around the segment as one polynomial, in seconds from its start; None when they do not cover it."""
    local, angle = _near(times, commands, segment)
    length = float(segment.time[-1] - segment.time[0])
    if local.size < LEAST_COMMANDS or local[0] > 0.05 * length or local[-1] < COVERED * length:
        return None
    middle, half = (local[-1] + local[0]) / 2, (local[-1] - local[0]) / 2
    basis = legendre.values((local - middle) / half, _degree(half, local.size))
    return Commanded(middle, half, *_fitted(basis, angle, half))


def _near(times: FloatArray, commands: FloatArray, segment: Window) -> tuple[FloatArray, FloatArray]:
    """Times from the segment's start [s] and angles of the commands around it."""
    first, last = float(segment.time[0]), float(segment.time[-1])
    near = (times >= first - BEFORE_S) & (times <= last + BEFORE_S / 4)
    return times[near] - first, commands[near]


def _degree(half: float, count: int) -> int:
    """Degree of polynomials that follow motions of FASTEST_HZ over 2 ``half`` seconds."""
    return min(math.ceil(4 * FASTEST_HZ * half) + 5, count - 4)


def _fitted(basis: FloatArray, angle: FloatArray, half: float) -> tuple[FloatArray, FloatArray, int, float]:
    """Coefficients, their covariance at the most likely smoothness and noise, and the white derivative's order and
    strength."""
    weight, least = _weights(angle)
    centre = float(angle.mean())
    away = angle - centre
    gram, product = _gram(basis, weight), basis.T @ (weight * away)
    power = float(weight @ away**2)
    _, order, stiff, noise = min(_smoothest(gram, product, power, order, angle.size, least) for order in ORDERS)
    scale = _scale(product.size - 1, order)
    white = np.repeat([0.0, stiff], [order, product.size - order])
    inverse = scale @ np.linalg.inv(scale.T @ gram @ scale + np.diag(white)) @ scale.T
    coefficients = inverse @ product
    coefficients[0] += centre
    return coefficients, np.asarray(inverse * noise), order, noise / stiff / half ** (2 * order - 1)


def _gram(basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Gram matrix of the polynomials at the commands, with a ridge so that it is not singular."""
    return np.asarray((basis.T * weight) @ basis + RIDGE * weight.size * np.eye(basis.shape[1]))


def _smoothest(
    gram: FloatArray, product: FloatArray, power: float, order: int, count: int, least: float
) -> tuple[float, int, float, float]:
    """-2 ln of the marginal likelihood at the best smoothness if the derivative of that order is white, with the order,
    that smoothness and the noise's variance.

    The modes are of the white derivative, whose prior is isotropic: a mode's information from the commands is exact
    where it is large and rounds to zero where it is small.  (Modes of the polynomials by their roughness, up to 1e24,
    lost the smoothest ones to rounding, and with them 350 nats in every second window.)
    """
    scale = _scale(product.size - 1, order)
    gram, product = scale.T @ gram @ scale, scale.T @ product
    free = np.linalg.inv(gram[:order, :order]) @ np.column_stack([gram[:order, order:], product[:order]])
    mode, turned = np.linalg.eigh(gram[order:, order:] - gram[order:, :order] @ free[:, :-1])
    mode = np.maximum(mode, 0.0)
    seen = turned.T @ (product[order:] - gram[order:, :order] @ free[:, -1])
    stiff = SMOOTHNESS[:, None]
    misfit = np.maximum(power - product[:order] @ free[:, -1] - np.sum(seen**2 / (mode + stiff), axis=1), 0.0)
    noise = np.maximum(misfit / (count - order), least**2)
    cost = count * np.log(noise) + misfit / noise + np.sum(np.log1p(mode / stiff), axis=1)
    cost += order * np.log(FREE**2 * count / noise)
    best = int(np.argmin(cost))
    return float(cost[best]), order, float(SMOOTHNESS[best]), float(noise[best])


def _weights(angle: FloatArray) -> tuple[FloatArray, float]:
    """The weight of each command, and the least noise [rad].

    All commands on one level together count as one command: their quantisation error is the same.
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
    """Polynomials on an even grid, shape (count, degree + 1), and their pseudo-inverse."""
    basis = legendre.values(np.linspace(-1, 1, count), degree)
    return basis, np.asarray(np.linalg.pinv(basis))


@lru_cache(maxsize=16)
def _scale(degree: int, order: int) -> FloatArray:
    """Matrix to a polynomial's coefficients from its first ``order`` ones and those of its derivative of that order in
    orthonormal polynomials; shape (degree + 1, degree + 1)."""
    scale = np.eye(degree + 1)
    norms = np.sqrt(2 / (2 * np.arange(degree + 1 - order) + 1))
    scale[order:, order:] = np.linalg.inv(norms[:, None] * legendre.derivative(degree, order)[:, order:])
    return scale


@lru_cache(maxsize=16)
def _beyond(count: int, step: float, order: int) -> FloatArray:
    """Integral of cos(w t) / w^(2 order) over w > 1 at t = 0, step, ..., shape (count,)."""
    period = (np.arange(400) + 0.5) / 400  # 1 / w
    return np.asarray(np.cos(step * np.arange(count)[:, None] / period) @ period ** (2 * order - 2) / period.size)
