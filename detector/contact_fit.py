"""Contacts of a joint with its flanks during one segment, and play, start and speed by generalised least squares.

Selection of contacts and fit alternate (``play_size`` has the equations).  A play that is crossed late, always in the
same sense, looks like a lag of the servo, so the estimated lag is uncertain by a share of the play; the contacts of
each window show how much of it is the servo's.  No samples and no commands here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.contacts import Contacts
from lostmotion.detector.flank import CONTACT_ACCEL, SOFTNESS, SizeEstimate
from lostmotion.detector.pooling import PlaySize, unknown
from lostmotion.detector.relative_motion import RelativeMotion
from lostmotion.detector.servo import LagInformation
from lostmotion.detector.window import FloatArray

__all__ = ["Solved", "lag_information", "likelier_otherwise", "size_estimate", "solve"]

LEAST_CONTACTS = 3
FLANK, POINT, GRAIN = 0.03, 0.02, 5e-5
"""Standard deviations of the place of a contact on a flank: of a whole rest and of each point, as shares of half the
play, and the least [rad]."""
TIMING = 0.15
"""An impact's place is uncertain by so many steps of the grid times its impulse."""
YIELD = 0.35e-3
"""Standard deviation of the flanks' compression by an impact over its impulse [s], common to all impacts of a window:
0.8 to 0.1 ms for stops of 200 to 800 Hz; the grid also rounds the peak.  With a correction by a tenth of a step times
the impulse instead, 93.0 instead of 94.6 % of the intervals held, 88.2 instead of 93.8 % below 1 mrad, and plays were
10 instead of 0 % too large (120 joints of ``bench.outside``, seeds 7000 to 7119)."""
LATE, CROSSING = 0.003, 0.35
"""Standard deviation of the servo's delay [s] in addition to that of its estimate, and that of the angle by which a
play that is crossed late was mistaken for a delay, as a share of the play: estimated from angles alone, delays of 19
joints with 10 to 90 mrad were wrong by 0.35 plays over the gear's speed (root mean squares; ``bench.outside``, seeds
7000 to 7059).  With 0.25, 0.35, 0.5 and 1 times the play 95.4, 95.5, 95.5 and 95.1 % of the intervals hold, 85 % of the
windows above 30 dB give a size (60 joints of seeds 7000 to 7119 that lag or have more than 10 mrad); without it 95.3
and 85 %."""
LEAST_SHAPE, LEAST_SPEED = 1e-7, 1e-3
"""Least standard deviation of the second coefficient of a servo's lag [s²], and least speed of a gear [rad/s]."""
FIRST_TIMING = 0.3
"""The same before the fit has found which of three steps comes closest to the flank."""
BETWEEN, BOUND, RESTING = 14, 3.0, 0.85
"""Every BETWEEN steps without a contact, D is constrained to lie between the flanks, with a standard deviation of
BOUND halves of the play: a joint rests on a flank most of the time, so points are not independent.  It is expected at
0 in flight, and at RESTING halves on the flank where the joint may rest: means and standard deviations were -0.08
and 0.74 of half the play before arrival, 0.84 and 0.23 after it (20 joints of ``bench.outside``, seeds 7000 to
7118).  With an expectation of 0 everywhere plays were up to 28 % too small; 90.9, 93.7 and 95.7 % of the intervals
then held with a BOUND of 1.5, 2 and 3, and 94.6 % without these points (52 joints, seeds 3000 to 3059)."""
THIN = 3
"""Of rests every third step is used; the others add no information."""
ROUNDS = 8
AWAY = 0.25
"""A contact farther from the flank than this share of the play and three standard deviations is rejected."""
BESIDE = 0.12
"""The same for the ends of rests, with two standard deviations."""
LEAST_DRIVE = 1.0
"""A rest ends where the commanded acceleration is less [rad/s²]."""
REBOUND = 1.7
"""Impulse of an impact over its speed of approach."""
BEYOND = 0.1
"""Largest share of the segment in which the joint may seem to be beyond a flank; above it model and data do not fit."""
LEAST_PLAY, MOST_PLAY = 1e-4, 0.1
"""Play that scales the flanks' error [rad]."""
LOST = 2 * math.pi
"""Standard deviation of D from which the motion is unknown [rad]: commands with gaps and jumps reach 10⁴, and the
weights of contacts, to ``GRAIN``, are then rounding errors."""
NEIGHBOURS = np.array([[-1], [0], [1]])
"""The three steps of the grid in which an impact's place is looked for, from its own."""
SIDES = (0.0, 1.0, -1.0)
"""The middle and both flanks, indexed by the sign of a place."""

Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class _Touch:
    """Contacts: their places on the grid, the flank (+1 where D is + phi/2) and the impact's impulse [rad/s], 0 in
    rests.  For points without contact, flank is the expected D in halves of the play."""

    at: Places
    flank: FloatArray
    impulse: FloatArray

    @property
    def enough(self) -> bool:
        return self.at.size >= LEAST_CONTACTS and float(np.ptp(self.flank)) > 0


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """start, speed and play, their covariance, and the contacts' places, weights and residuals."""

    values: FloatArray
    covariance: FloatArray
    weight: FloatArray
    observed: FloatArray
    left: FloatArray
    play: float


@dataclass(frozen=True, slots=True, eq=False)
class Solved:
    """Consistent contacts and points between them, the play that scales the flanks' error [rad], the fit of both, and
    the commanded acceleration on the grid [rad/s²]."""

    touch: _Touch
    play: float
    fit: _Fit
    push: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """D at all times without a + b t [rad], (K,), and the standard deviations of its distance from the middle and from
    either flank [rad], (3, K) in the order of SIDES."""

    angle: FloatArray
    deviations: FloatArray

    def deviation(self, side: FloatArray) -> FloatArray:
        """Standard deviation of the distance from the flank on each one's side, (K,)."""
        return np.asarray(self.deviations[side.astype(np.intp), np.arange(side.size)])


def solve(relative: RelativeMotion, found: Contacts) -> Solved | PlaySize:
    """Fit and selection of contacts in turn."""
    if np.max(np.diag(relative.covariance)[relative.known], initial=0.0) > LOST**2:
        return unknown("the commands do not fit together")
    play, step = _range(relative), float(relative.time[1] - relative.time[0])
    flank = np.where(found.hard, -np.sign(found.impulse), -np.sign(found.push))
    impulse = np.where(found.hard, np.abs(found.impulse), 0.0)
    arrived = _arrived(found, impulse * flank, 0.0, step)
    touch = _touching(found.rests & arrived, flank, impulse)
    if not touch.enough:
        return unknown("the teeth did not touch both flanks clearly")
    for turn in range(ROUNDS):
        points = _bounded(relative, found, touch, play)
        fit = _fit(relative, points, play, TIMING if turn else FIRST_TIMING)
        play = fit.play
        place = _between(relative, points, fit)
        chosen = _chosen(found, place, fit, step, grown=turn > 0)
        if not chosen.enough:
            return unknown("contacts and command do not fit together")
        if turn > 2 and np.array_equal(chosen.at, touch.at) and np.array_equal(chosen.flank, touch.flank):
            break
        touch = chosen
    beyond, deviation = np.abs(place.angle) - play / 2, place.deviation(np.sign(place.angle))
    outside = (beyond > np.maximum(0.15 * play, 3 * deviation)) & relative.known
    if np.mean(outside) > BEYOND:
        return unknown("contacts and command do not fit together")
    points = _bounded(relative, found, touch, play)
    return Solved(points, play, _fit(relative, points, play, TIMING), found.push)


def _range(relative: RelativeMotion) -> float:
    """Range of D about its mean line [rad]."""
    time, angle = relative.time[relative.known], relative.angle[relative.known]
    along = time - time.mean()
    return float(np.ptp(angle - along * (along @ angle) / (along @ along)))


def _touching(rests: NDArray[np.bool_], flank: FloatArray, impulse: FloatArray) -> _Touch:
    """Impacts, and every third step of rests, by step of the grid."""
    at = np.flatnonzero((rests & (np.arange(rests.size) % THIN == 0)) | (impulse > 0))
    return _Touch(at, flank[at], impulse[at])


def _bounded(relative: RelativeMotion, found: Contacts, touch: _Touch, play: float) -> _Touch:
    """The contacts, and points of D between them, which are not certainly on a flank."""
    count = relative.time.size
    free = relative.known & (np.arange(count) % BETWEEN == 0)
    free[touch.at] = False
    flank, impulse = np.zeros(count), np.zeros(count)
    flank[touch.at], impulse[touch.at] = touch.flank, touch.impulse
    arrived = _arrived(found, impulse * flank, play, float(relative.time[1] - relative.time[0]))
    flank[free] = -RESTING * (np.sign(found.push) * arrived)[free]
    free[touch.at] = True
    at = np.flatnonzero(free)
    return _Touch(at, flank[at], impulse[at])


def _fit(relative: RelativeMotion, touch: _Touch, play: float, timing: float) -> _Fit:
    """Generalised least squares of a, b and phi, the flanks' error in proportion to ``play`` [rad]."""
    step = float(relative.time[1] - relative.time[0])
    half = min(max(play, LEAST_PLAY), MOST_PLAY) / 2
    run = np.cumsum(np.concatenate([[True], (np.diff(touch.at) > THIN + 1) | (np.diff(touch.flank) != 0)]))
    lag = relative.lag[touch.at]
    noise = relative.covariance[np.ix_(touch.at, touch.at)] + lag * _lag_variance(relative, play) @ lag.T
    noise += (run[:, None] == run) * (FLANK * half) ** 2
    own = np.where(np.abs(touch.flank) < 1, BOUND, POINT) * half
    pressed = YIELD * touch.flank * touch.impulse
    noise += pressed[:, None] * pressed
    noise[np.diag_indices_from(noise)] += own**2 + GRAIN**2 + (timing * step * touch.impulse) ** 2
    weight = np.asarray(np.linalg.inv(noise), np.float64)
    observed = relative.angle[touch.at]
    values, covariance, left = _least(_design(relative, touch), weight, observed)
    # A play below its uncertainty must not narrow the search for contacts.
    return _Fit(values, covariance, weight, observed, left,
                max(float(values[2]), 2 * math.sqrt(covariance[2, 2]), LEAST_PLAY))  # fmt: skip


def _lag_variance(relative: RelativeMotion, play: float) -> FloatArray:
    """Variances of the errors of the lag's delay [s²] and second coefficient [s^4], (2,), for that play [rad]."""
    return np.array([LATE**2 + _crossing(relative, play) ** 2, max(relative.shape, LEAST_SHAPE) ** 2])


def _crossing(relative: RelativeMotion, play: float) -> float:
    """Standard deviation of the delay [s] for which crossings of the play were mistaken."""
    return CROSSING * play / max(relative.speed, LEAST_SPEED) if relative.servo_is_learnt else 0.0


def lag_information(relative: RelativeMotion, solution: Solved) -> LagInformation:
    """The contacts' information on the errors of the servo's lag, weighted by how much of them may be play."""
    touch, fit = solution.touch, solution.fit
    lag = relative.lag[touch.at]
    weighted = lag.T @ fit.weight
    line = weighted @ _design(relative, touch)
    crossing = _crossing(relative, solution.play) ** 2
    return LagInformation(
        weighted @ fit.left,
        weighted @ lag - line @ fit.covariance @ line.T,
        _lag_variance(relative, solution.play),
        crossing / (crossing + LATE**2),
    )


def _design(relative: RelativeMotion, touch: _Touch) -> FloatArray:
    return np.column_stack([np.ones(touch.at.size), relative.time[touch.at], touch.flank / 2])


def _least(design: FloatArray, weight: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients, their covariance and the residuals, of one design (K, 3) or of several (S, K, 3)."""
    weighted = np.swapaxes(design, -1, -2) @ weight
    covariance = np.asarray(np.linalg.inv(weighted @ design), np.float64)
    values = (covariance @ (weighted @ observed)[..., None])[..., 0]
    return values, covariance, observed - (design @ values[..., None])[..., 0]


def _between(relative: RelativeMotion, touch: _Touch, fit: _Fit) -> _Place:
    """D at all times given the contacts (kriging)."""
    lag = relative.lag * _lag_variance(relative, fit.play)
    shared = relative.covariance[touch.at]  # rows: columns of this symmetric matrix lie far apart
    shared += relative.lag[touch.at] @ lag.T
    gain = fit.weight @ shared
    angle = relative.angle - fit.values[0] - fit.values[1] * relative.time - fit.left @ gain
    variance = np.diag(relative.covariance) + np.sum(lag * relative.lag, axis=1) - np.einsum("cn,cn->n", gain, shared)
    rows = np.column_stack([np.ones(angle.size), relative.time, np.zeros(angle.size)])
    rows -= gain.T @ _design(relative, touch)
    variance = variance + np.sum((rows @ fit.covariance) * rows, axis=1)
    sides = np.array(SIDES)[:, None]
    variance = variance + sides * (rows @ fit.covariance[:, 2]) + sides**2 * (fit.covariance[2, 2] / 4)
    return _Place(angle, np.sqrt(np.maximum(variance, 0.0) + GRAIN**2))


def _chosen(found: Contacts, place: _Place, fit: _Fit, step: float, grown: bool) -> _Touch:
    """The contacts that agree with the place between the flanks; grown: rests last while the command accelerates."""
    play, half, pushed = fit.play, max(float(fit.values[2]), 0.0) / 2, -np.sign(found.push)
    side = np.where(np.abs(place.angle) > 2 * place.deviations[0], np.sign(place.angle), pushed)
    off, deviation = np.abs(side * place.angle - half), place.deviation(side)
    near = np.maximum(AWAY * play, 3 * deviation)
    rests = found.rests & (off < near) & (side == pushed)
    if grown:
        loose = found.loose & (off < np.maximum(BESIDE * play, 2 * deviation))
        for flank in (-1.0, 1.0):
            core = rests & (side == flank)
            row = core | (loose & (side == flank) & (-flank * found.push > LEAST_DRIVE))
            label = np.cumsum(np.concatenate([[True], row[1:] != row[:-1]]))
            rests = rests | (row & (np.bincount(label, core)[label] > 0))
    impulse, impacts = np.zeros(side.size), np.flatnonzero(found.impacts)
    struck, size = -np.sign(found.impulse[impacts]), np.abs(found.impulse[impacts])
    closest = impacts - 1 + np.argmax(struck * place.angle[impacts + NEIGHBOURS], axis=0)
    fits = np.abs(struck * place.angle[closest] - half) < np.maximum(near[closest], 0.5 * step * size + 0.1 * play)
    impulse[closest[fits]], side[closest[fits]] = size[fits], struck[fits]
    return _touching(rests & _arrived(found, impulse * side, play, step), side, impulse)


def _arrived(found: Contacts, impulses: FloatArray, play: float, step: float) -> NDArray[np.bool_]:
    """Where the joint may rest on the flank to which the command pushes it: since its impact there, or, without an
    impact, since a joint in free flight would have crossed that play [rad].

    impulses: [rad/s] by step of the grid, with the sign of the flank.

    Averaged over a period of the bar, flight and impact together accelerate like a rest.
    """
    sign = np.sign(found.push)
    turn = np.cumsum(np.concatenate([[0], sign[1:] != sign[:-1]]))
    first = np.searchsorted(turn, np.arange(turn[-1] + 1))[turn]
    strikes = impulses * sign < 0
    speed = np.cumsum(np.abs(found.push)) * step
    way = np.cumsum(speed - speed[first]) * step
    hit = np.full(turn[-1] + 1, turn.size)
    np.minimum.at(hit, turn[strikes], np.flatnonzero(strikes))
    first_strike = hit[turn]
    flown = way - way[first] >= play
    return np.asarray(np.where(first_strike < turn.size, np.arange(turn.size) >= first_strike, flown))


def likelier_otherwise(relative: RelativeMotion, solution: Solved) -> float:
    """Nats by which the contacts are likelier under the other prior of the command's corners than under the one used,
    by the restricted likelihood (Patterson, Thompson 1971); 0 where there is no other."""
    if relative.alternative is None:
        return 0.0
    touch, fit = solution.touch, solution.fit
    design, noise = _design(relative, touch), np.asarray(np.linalg.inv(fit.weight), np.float64)
    other = noise - relative.command.covariance(touch.at) + relative.alternative.covariance(touch.at)
    observed = fit.observed + relative.command.angle(touch.at) - relative.alternative.angle(touch.at)
    return (_deviance(noise, design, fit.observed) - _deviance(other, design, observed)) / 2


def _deviance(noise: FloatArray, design: FloatArray, observed: FloatArray) -> float:
    """-2 ln of the restricted likelihood of a covariance of the observations, without its constant."""
    weight = np.asarray(np.linalg.inv(noise), np.float64)
    _, covariance, left = _least(design, weight, observed)
    return float(np.linalg.slogdet(noise)[1] - np.linalg.slogdet(covariance)[1] + left @ weight @ left)


def size_estimate(relative: RelativeMotion, solution: Solved) -> SizeEstimate:
    """The play for each softness of the flanks, all with the same weights so that they can be compared."""
    touch, fit = solution.touch, solution.fit
    step = float(relative.time[1] - relative.time[0])
    pushed = np.maximum(np.abs(solution.push[touch.at]), 1.0)
    softness, size = SOFTNESS[:, None], np.full((SOFTNESS.size, 1), fit.play)
    design = np.repeat(_design(relative, touch)[None], SOFTNESS.size, axis=0)
    yielded = design[0, :, 2].copy()
    for _ in range(2):
        # An impact's force lasts as long as it takes to stop on the flank, (n + 1) v² / (X phi) of eq. 1, and at its
        # peak is at least that of half a sine of three steps, pi / 2 of its mean.
        load_of_impact = np.maximum(
            touch.impulse / (2 * step), (touch.impulse / REBOUND) ** 2 / (np.maximum(softness, 0.01) * size)
        )
        load = np.where(touch.impulse > 0, load_of_impact, pushed)
        design[:, :, 2] = yielded * (load / CONTACT_ACCEL) ** softness
        values, covariance, left = _least(design, fit.weight, fit.observed)
        deviation = np.sqrt(covariance[:, 2, 2])
        size = np.maximum(np.maximum(values[:, 2], deviation), LEAST_PLAY)[:, None]
    return SizeEstimate(values[:, 2], deviation, -np.sum((left @ fit.weight) * left, axis=1) / 2)
