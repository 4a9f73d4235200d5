"""The commands around a segment of acceleration as one smooth, differentiable motion.  No accelerometer here.

The prior of the motion is white jerk of unknown strength q (a smoothing spline of degree five); commands carry white
noise of unknown variance s², at least that of their quantisation.  Both come from the marginal likelihood of the
commands themselves (Wahba 1985, generalised maximum likelihood), so a slow sway is smoothed more than a move of 10 Hz.

The jerk of a profile with corners is a few impulses, closer together than commands resolve.  With the second prior it
is stronger where its estimate is (an adaptive smoothing spline; Pintore, Speckman, Holmes 2006): each lobe of the
estimated jerk, from one change of its sign to the next, may be one impulse in its middle.  The commands cannot tell the
two apart, the contacts of many windows can (``SmoothnessEvidence``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lostmotion.detector import legendre
from lostmotion.detector.servo import GRID_S, ServoLaw, delayed, smoothing
from lostmotion.detector.window import FloatArray, Window

__all__ = ["BEFORE_S", "NO_CONTACTS", "Commanded", "SmoothnessEvidence", "alternatives", "smoothed"]

BEFORE_S = 0.2
"""Time before the reversal in which the contact with the first flank is observed [s]."""
COVERED = 0.7
"""Share of the segment that commands must cover; the part after the last command is left out."""
FASTEST_HZ = 25.0
"""Polynomials follow a motion up to 2 / pi of this in their middle, faster ones near their ends.  Commands in steps
of 5 mrad at 100 Hz determine white jerk up to some 13 Hz.  With 25 and with 35 Hz 78 % of the windows above 30 dB
gave a size, and 95.4 and 94.9 % of the intervals held (every third of the seeds 7000 to 7119 of ``bench.outside``);
with 15 Hz 60 % gave a size, and 96 % held (all of these seeds; single windows, not pooled)."""
CORNERS_HZ = 60.0
"""The same where the motion may have corners."""
BIN_S, WIDE = 0.006, 3
"""Bins in which the jerk's strength is constant [s], and how many of them a lobe's impulse may lie in."""
RIDGE_OF_JERK = 1e-4
"""Ridge, as a share of the information of white jerk: even bins do not determine fast polynomials at the ends."""
LEAST_COMMANDS = 20
ORDERS = (3, 5)
"""The derivative that is white: jerk, for profiles whose acceleration jumps, or a higher one for smooth motions."""
CORNERED = 3
"""Order of the derivative that is impulses where the motion has corners: the jerk."""
CLEAR, DOUBT, MOST_GAIN, MEMORY = 4.0, 2.0, 30.0, 0.95
"""Nats a window by which contacts must be likelier without corners, in the mean of the windows so far and DOUBT more
that are undecided; the most that counts of one window; the weight of earlier windows after each window."""
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


@dataclass(frozen=True, slots=True)
class SmoothnessEvidence:
    """Log Bayes factor of commands without corners against those with corners, from the contacts in a joint's windows
    so far, and the number of these windows."""

    gain: float = 0.0
    windows: float = 0.0

    @property
    def is_smooth(self) -> bool:
        """Whether the joint's commands have no corners."""
        return self.gain > CLEAR * (self.windows + DOUBT)

    def updated(self, gain: float) -> SmoothnessEvidence:
        """The evidence after one more window, whose contacts are likelier by that many nats without corners."""
        most = MOST_GAIN
        return SmoothnessEvidence(MEMORY * self.gain + min(max(gain, -most), most), MEMORY * self.windows + 1)


NO_CONTACTS = SmoothnessEvidence()
"""Before the first window."""


@dataclass(frozen=True, slots=True, eq=False)
class Commanded:
    """theta_1 as a polynomial: coefficients and their covariance, over times mapped to -1..1; order: the derivative
    that is white."""

    middle: float
    half: float
    coefficients: FloatArray
    covariance: FloatArray
    order: int = 3

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
    data = _Moments.of(times, commands, segment, FASTEST_HZ)
    return None if data is None else data.smooth(data.likeliest())


def alternatives(times: FloatArray, commands: FloatArray, segment: Window) -> tuple[Commanded, Commanded] | None:
    """The same without and with corners; both are one where a higher derivative than the jerk is white."""
    data = _Moments.of(times, commands, segment, CORNERS_HZ)
    if data is None:
        return None
    slow = data.up_to(FASTEST_HZ)
    likeliest = slow.likeliest()
    smooth = slow.smooth(likeliest)
    return smooth, data.with_corners(likeliest, smooth) if likeliest.order == CORNERED else smooth


def _near(times: FloatArray, commands: FloatArray, segment: Window) -> tuple[FloatArray, FloatArray]:
    """Times from the segment's start [s] and angles of the commands around it."""
    first, last = float(segment.time[0]), float(segment.time[-1])
    near = (times >= first - BEFORE_S) & (times <= last + BEFORE_S / 4)
    return times[near] - first, commands[near]


def _degree(hz: float, half: float, count: int) -> int:
    """Degree of polynomials that follow motions of that frequency over 2 ``half`` seconds."""
    return min(math.ceil(4 * hz * half) + 5, count - 4)


@dataclass(frozen=True, slots=True)
class _Likeliest:
    """-2 ln of the marginal likelihood, the white derivative's order, s² / q and the noise's variance s²."""

    cost: float
    order: int
    stiff: float
    noise: float


@dataclass(frozen=True, slots=True, eq=False)
class _Moments:
    """Sums over the commands: gram (D, D) of the polynomials, product (D,) with the angles about their mean ``centre``,
    and power of these; least: the least noise [rad]."""

    middle: float
    half: float
    count: int
    centre: float
    least: float
    gram: FloatArray
    product: FloatArray
    power: float

    @classmethod
    def of(cls, times: FloatArray, commands: FloatArray, segment: Window, hz: float) -> _Moments | None:
        """Of polynomials that follow motions of that frequency; None when the commands do not cover the segment."""
        local, angle = _near(times, commands, segment)
        length = float(segment.time[-1] - segment.time[0])
        if local.size < LEAST_COMMANDS or local[0] > 0.05 * length or local[-1] < COVERED * length:
            return None
        middle, half = float(local[-1] + local[0]) / 2, float(local[-1] - local[0]) / 2
        basis = legendre.values((local - middle) / half, _degree(hz, half, local.size))
        weight, least = _weights(angle)
        centre = float(angle.mean())
        away = angle - centre
        return cls(middle, half, angle.size, centre, least, _gram(basis, weight), basis.T @ (weight * away),
                   float(weight @ away**2))  # fmt: skip

    def up_to(self, hz: float) -> _Moments:
        """The same of the polynomials that follow motions of that frequency only."""
        size = _degree(hz, self.half, self.count) + 1
        return replace(self, gram=self.gram[:size, :size], product=self.product[:size])

    def likeliest(self) -> _Likeliest:
        """The most likely white derivative, smoothness and noise."""
        each = (_smoothest(self.gram, self.product, self.power, order, self.count, self.least) for order in ORDERS)
        return min(each, key=lambda one: one.cost)

    def smooth(self, prior: _Likeliest) -> Commanded:
        """The motion whose white derivative is everywhere as strong."""
        white = np.repeat([0.0, prior.stiff / prior.noise], [prior.order, self.product.size - prior.order])
        return self._solved(prior, np.diag(white))

    def with_corners(self, prior: _Likeliest, smooth: Commanded) -> Commanded:
        """The motion whose jerk is stronger in the lobes of its smooth estimate."""
        degree = self.product.size - 1
        bins = max(round(2 * self.half / BIN_S), degree)
        place = _bins(bins)
        lower = smooth.coefficients.size - 1
        jerk = legendre.values(place, lower - CORNERED) @ legendre.derivative(lower, CORNERED) @ smooth.coefficients
        strength = prior.noise / prior.stiff + _lobes(jerk, 2 / bins)
        shape = _orthonormal(bins, degree - CORNERED)
        information = np.zeros_like(self.gram)
        information[CORNERED:, CORNERED:] = (shape.T * (2 / bins / strength)) @ shape
        information[np.diag_indices_from(information)] += RIDGE_OF_JERK * prior.stiff / prior.noise
        return self._solved(prior, information)

    def _solved(self, prior: _Likeliest, information: FloatArray) -> Commanded:
        """information: of the prior on the coordinates of ``_scale``."""
        scale = _scale(self.product.size - 1, prior.order)
        whole = scale.T @ self.gram @ scale / prior.noise + information
        covariance = scale @ np.linalg.inv(whole) @ scale.T
        coefficients = covariance @ self.product / prior.noise
        coefficients[0] += self.centre
        return Commanded(self.middle, self.half, coefficients, covariance, prior.order)


def _lobes(jerk: FloatArray, width: float) -> FloatArray:
    """Strength of a jerk, (B,), whose lobes are impulses in their middle, from its estimate in bins of that width."""
    sign = np.sign(jerk)
    lobe = np.cumsum(np.concatenate([[0], sign[1:] != sign[:-1]]))
    size = np.maximum(np.bincount(lobe, np.abs(jerk)), np.finfo(float).tiny)
    middle = np.bincount(lobe, np.abs(jerk) * np.arange(jerk.size)) / size
    at = np.clip(np.round(middle).astype(np.intp)[:, None] + np.arange(WIDE) - WIDE // 2, 0, jerk.size - 1)
    strength = np.zeros(jerk.size)
    np.add.at(strength, at, ((size * width) ** 2 / (WIDE * width))[:, None])
    return strength


def _bins(count: int) -> FloatArray:
    """The middles of so many bins of -1..1."""
    return np.asarray((np.arange(count) + 0.5) * (2 / count) - 1, np.float64)


def _orthonormal(bins: int, degree: int) -> FloatArray:
    """Orthonormal polynomials in the middles of bins, shape (bins, degree + 1)."""
    return np.asarray(legendre.scaled_values(_bins(bins), degree) / math.sqrt(2))


def _gram(basis: FloatArray, weight: FloatArray) -> FloatArray:
    """Gram matrix of the polynomials at the commands, with a ridge so that it is not singular."""
    return np.asarray((basis.T * weight) @ basis + RIDGE * weight.size * np.eye(basis.shape[1]))


def _smoothest(gram: FloatArray, product: FloatArray, power: float, order: int, count: int, least: float) -> _Likeliest:
    """The best smoothness if the derivative of that order is white.

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
    return _Likeliest(float(cost[best]), order, float(SMOOTHNESS[best]), float(noise[best]))


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


def _grid(count: int, degree: int) -> tuple[FloatArray, FloatArray]:
    """Polynomials on an even grid, shape (count, degree + 1), and their pseudo-inverse.  Not cached: of 418 windows of
    README's arm 66 could use one of the last eight, which took a megabyte."""
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
