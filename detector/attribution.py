"""Which of several joints has play, from the impulses of all of them at one accelerometer or several.

A joint without play transmits its acceleration smoothly, one with play in impulses: its teeth separate where the
acceleration a(t) changes direction, cross the gap freely, strike the other flank and may rebound.  So a joint's
impulses have the direction of its a(t), and an accelerometer whose lever arm to the joint's axis is l measures l times
their speed v [rad/s].  Teeth with the gap phi strike at a rate [1/s] and with usual speeds m of two kinds,

    first strike:  d/dt Phi(ln(x(t) / phi) / FLIGHT),   m = x'(t),   x(t) the distance crossed since a changed direction
    rebounds:      c |a(t)| / m,                         m = sqrt(2 |a(t)| phi),

Phi the normal distribution, c the share of the motion that rebounds carry, speeds distributed as g(v / m) / m with g(z)
= 4 z exp(-2 z).  Impulses from other causes come at a rate b in either direction.  The log-likelihood of the impulses
(t_k, v_k) of a window under a set of joints with play is that of a Poisson process: the sum over k of the logarithm of
the rate of such an impulse, all of the set's joints and b together, minus the expected number of impulses that are
large enough to be detected.  It is averaged over c and b of each window, and over phi of all windows together.  An
impulse and its rebounds are not independent, so the likelihood of a window is raised to the power TRUST; and any window
may be an outlier.

A joint that is carried by another one turns with it: both accelerations act on its teeth.  Joints with longer lever
arms may carry those with shorter ones; both cases are averaged.  Several accelerometers: a joint's impulse lies along
its vector of lever arms, to within LEVER of its size.  docs/decisions/0008-attribution.md has the measurements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.commanded import smoothed
from lostmotion.detector.deconvolution import edges, noise_of
from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["Attribution", "Evidence", "Mover", "attribute", "evidence"]

SHARES, PLAYS, STRAY_HZ = (0.1, 0.3, 0.8, 1.5), (2e-4, 1e-3, 5e-3, 2e-2), (0.3, 3.0, 20.0)
"""Grids of c [-], phi [rad] and b [1/s]."""
STRAY_ACCEL = 10.0
"""Impulses from other causes are as large as those of a joint with this acceleration [rad/s²]."""
SLACK = 2.0
"""Uncertainty of a commanded acceleration [rad/s²]; around zero it has either direction."""
LEVER = 0.15
"""Relative error of the lever arms."""
TRUST, ODD = 0.4, 0.05
"""Power of a window's likelihood; share of windows that are outliers."""
SIGNIFICANT, LEAST_IMPULSE = 6.0, 0.02
"""Least impulse, in standard deviations and at the settings' length [rad/s]."""
PRESSED = 1.2
"""Least ratio of an impulse to the change of a smooth motion when teeth separate, or come to rest on a flank."""
FLIGHT, GRAIN = 0.8, 1e-5
"""Standard deviation of the logarithm of the distance at the first strike over phi; the least distance [rad]."""
MOST = 6
"""Up to so many joints that share accelerometers, any of them may have play at once."""
LEAST_S, LEAST_PERIODS = 0.04, 6.0
"""Least remainder of a window [s], and least length of a segment in periods of the bar."""


@dataclass(frozen=True, slots=True, eq=False)
class Mover:
    """A joint: its commands [rad] at times [s], shape (M,), and its lever arm at each accelerometer [m]: signed, 0 at
    one that it does not move."""

    times: FloatArray
    commands: FloatArray
    levers: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The evidence of one window: the log-likelihood of each size of the play and set of joints that have it, shape (P,
    M); until: the end of the time evaluated [s]."""

    until: float
    likelihood: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Attribution:
    """Probability of each set of joints with play, shape (M,), which joints are in it, (M, J), after so many windows.

    Of up to MOST joints every set; of more those of at most two joints, as sets double with every joint.
    """

    sets: FloatArray
    members: FloatArray
    windows: int

    @property
    def joints(self) -> FloatArray:
        """Probability that a joint has play, shape (J,)."""
        return np.asarray(self.sets @ self.members)


def attribute(windows: Iterable[Evidence], prior: Sequence[float]) -> Attribution:
    """The attribution by all windows; prior: probability of play of each joint before them, shape (J,)."""
    members = _members(len(prior))
    total = np.log(np.where(members > 0, prior, 1 - np.asarray(prior)).prod(axis=1)) + np.zeros((len(PLAYS), 1))
    logs = np.array([window.likelihood for window in windows]).reshape(-1, *total.shape)
    share = np.exp(TRUST * (logs - logs.max(axis=(1, 2), keepdims=True)))
    total += np.log((1 - ODD) * share + ODD * share.mean(axis=(1, 2), keepdims=True)).sum(axis=0)
    sets = np.exp(total - total.max()).sum(axis=0)
    return Attribution(sets / sets.sum(), members, len(logs))


def evidence(
    segments: Sequence[Window], movers: Sequence[Mover], settings: Sequence[DetectorSettings], since: float
) -> Evidence | None:
    """The evidence of the impulses after ``since`` [s]; None where there is none, such as for a resonance above half of
    the rate.

    segments: tip acceleration at each accelerometer from ``BEFORE_S`` before a reversal to the window's end, none of
    its samples missing; settings: of each, with its bar and the length [m] at which LEAST_IMPULSE counts; movers: all
    joints that move them.
    """
    start = float(segments[0].time[0])
    usable = all(
        one.duration * chosen.f_res_hz >= LEAST_PERIODS and one.rate_hz > 2 * chosen.f_res_hz
        and np.isfinite(one.accel).all()
        for one, chosen in zip(segments, settings, strict=True)
    )  # fmt: skip
    tip = _tip_impulses(segments, settings) if usable else None
    if tip is None or tip.times.size <= 4 * tip.width or tip.last - max(since - start, tip.first) < LEAST_S - tip.step:
        return None
    commanded = [smoothed(mover.times, mover.commands, segments[0]) for mover in movers]
    known = [command for command in commanded if command is not None]
    if len(known) < len(commanded):
        return None
    end = min(tip.last, *(command.end for command in known))
    observed = (tip.times >= max(since - start, tip.first)) & (tip.times <= end)
    if np.count_nonzero(observed) * tip.step < LEAST_S:
        return None
    accel = np.array([command.acceleration(tip.times) for command in known])
    levers = np.array([mover.levers for mover in movers])
    # Teeth that separate, or come to rest, change the tip's motion by no more than their joint's own acceleration.
    least = np.maximum(tip.least, PRESSED * tip.width * tip.step * np.abs(levers).T @ np.abs(accel))
    clarity = np.max(np.abs(tip.impulses) / least, axis=0)
    highest = np.lib.stride_tricks.sliding_window_view(np.pad(clarity, tip.width), 2 * tip.width + 1).max(axis=1)
    where = np.flatnonzero((clarity == highest) & (clarity > 1) & observed)
    each = [_likelihood(tip, drive, levers, least, where, observed) for drive in _drives(accel, levers)]
    return Evidence(start + end, _mean_of_logs(np.concatenate(each, axis=1), axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class _TipImpulses:
    """Impulses of the tip [m/s] at each accelerometer beyond the smooth motion of all joints, their standard deviation
    and the least that is used, shape (S, K), at times [s] from the first segment's start; width: of an impulse."""

    times: FloatArray
    impulses: FloatArray
    deviation: FloatArray
    least: FloatArray
    width: int

    @property
    def step(self) -> float:
        return float(self.times[1] - self.times[0])

    @property
    def first(self) -> float:
        """The earliest time at which impulses are separated from smooth motion [s]."""
        return float(self.times[2 * self.width])

    @property
    def last(self) -> float:
        """The latest such time [s]."""
        return float(self.times[-2 * self.width])


def _tip_impulses(segments: Sequence[Window], settings: Sequence[DetectorSettings]) -> _TipImpulses:
    """The impulses of all segments on the grid of the first."""
    start, rows, times, width = segments[0].time[0], [], np.empty(0), 0
    for segment, chosen in zip(segments, settings, strict=True):
        edge = edges(segment.accel.size, segment.rate_hz, noise_of(segment.accel, chosen), chosen)
        own = edge.times + segment.time[0] - start
        times = times if times.size else own
        width = max(width, edge.width)
        sharp = edge.impulses(segment.accel - segment.accel.mean())
        deviation = np.interp(times, own, edge.deviation)
        least = np.maximum(SIGNIFICANT * deviation, LEAST_IMPULSE)
        reach = abs(chosen.length_m)
        rows.append((np.interp(times, own, sharp) * chosen.length_m, deviation * reach, least * reach))
    impulses, deviations, leasts = (np.array(row) for row in zip(*rows, strict=True))
    return _TipImpulses(times, impulses, deviations, leasts, width)


def _drives(accel: FloatArray, levers: FloatArray) -> list[FloatArray]:
    """Accelerations that may act on each joint's teeth [rad/s²], (J, K): its own, or also those of joints that carry
    it."""
    reach = levers[np.arange(len(levers)), np.abs(levers).argmax(axis=1)]
    carries = np.where(np.abs(reach) > np.abs(reach)[:, None], np.sign(reach) * np.sign(reach)[:, None], 0.0)
    return [accel, accel + carries @ accel] if carries.any() else [accel]


def _likelihood(
    tip: _TipImpulses, drive: FloatArray, levers: FloatArray, least: FloatArray, where: NDArray[np.intp],
    observed: NDArray[np.bool_],
) -> FloatArray:  # fmt: skip
    """Log-likelihood of each set for each phi and each choice of c and b, shape (P, G, M), of the impulses at
    ``where``.

    drive: accelerations of the joints, shape (J, K); least: the tip's speed [m/s] from which an impulse is detected,
    (S, K).
    """
    play, share, stray = (
        np.array(PLAYS)[:, None, None],
        np.array(SHARES)[:, None, None],
        np.array(STRAY_HZ)[:, None, None],
    )
    members = _members(len(levers))
    with np.errstate(divide="ignore"):
        slowest = (least / np.abs(levers)[:, :, None]).min(axis=1)[:, observed]
    impulses = tip.impulses[:, where]
    speed, density = _sources(impulses, tip.deviation[:, where], levers)
    rates, counts = [], []  # of first strikes and of rebounds, for each phi and joint
    for rate, usual in _strikes(drive, play, tip.step):
        relative = np.abs(speed) / usual[..., where]
        rates.append(rate[..., where] * 4 * relative * np.exp(-2 * relative) / usual[..., where])
        unseen = 2 * slowest / usual[..., observed]
        counts.append(np.sum(rate[..., observed] * (1 + unseen) * np.exp(-unseen), axis=-1) * tip.step)
    toward = (1 + np.sign(speed) * drive[:, where] / np.hypot(drive[:, where], SLACK)) / 2
    arms = np.array([np.abs(column[column != 0]).mean() for column in levers.T])
    scale = np.sqrt(2 * STRAY_ACCEL * play) * arms[:, None]
    strays = stray * np.prod(np.exp(-np.abs(impulses) / scale) / (2 * scale), axis=1)[:, None, None, None]
    rates_of_sets = members @ ((rates[0][:, None] + share * rates[1][:, None]) * toward * density)
    expected = (counts[0][:, None] + share[..., 0] * counts[1][:, None]) @ members.T
    log_rates = np.log(rates_of_sets[:, :, None] + strays).sum(axis=-1)
    expected_count = expected[:, :, None] + stray[..., 0] * np.count_nonzero(observed) * tip.step
    return np.asarray(log_rates - expected_count).reshape(len(PLAYS), -1, len(members))


def _strikes(
    drive: FloatArray, play: FloatArray, step: float
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Rates [1/s] and usual speeds [rad/s] of first strikes, and of rebounds at c = 1, at each time; shapes (P, J, K),
    or (J, K) where independent of phi."""
    speed = np.cumsum(np.abs(drive), axis=1) * step
    way = np.cumsum(speed, axis=1) * step
    index = np.arange(drive.shape[1])
    turns = np.diff(np.sign(drive), axis=1, prepend=np.sign(drive[:, :1])) != 0
    begin = np.maximum.accumulate(np.where(turns, index, 0), axis=1)
    since = np.take_along_axis(speed, begin, axis=1)
    gained = np.maximum(speed - since, GRAIN / step)
    flown = np.maximum(way - np.take_along_axis(way, begin, axis=1) - since * (index - begin) * step, GRAIN)
    normal = np.exp(-0.5 * (np.log(flown / play) / FLIGHT) ** 2) / (FLIGHT * math.sqrt(2 * math.pi))
    size = np.hypot(drive, SLACK)
    rebound = np.sqrt(2 * size * play)
    return (gained / flown * normal, gained), (size / rebound, rebound)


def _sources(impulses: FloatArray, deviation: FloatArray, levers: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Speed v [rad/s] of impulses (S, E) if they are a joint's, and the density of the accelerometers' residuals
    (integrated over v, so that rate(t, v) times this is per m/s of each accelerometer); shape (J, E) both."""
    variance = deviation**2
    if len(impulses) > 1:
        variance = variance + LEVER**2 * np.sum(impulses**2, axis=0)
    arms = levers[:, :, None]
    precision = np.sum(arms**2 / variance, axis=1)
    speed = np.sum(arms * impulses / variance, axis=1) / precision
    misfit = np.sum((impulses - arms * speed[:, None]) ** 2 / variance, axis=1)
    spread = np.log(variance).sum(axis=0) + np.log(precision) + (len(impulses) - 1) * math.log(2 * math.pi)
    return speed, np.exp(-(misfit + spread) / 2)


@cache
def _members(joints: int) -> FloatArray:
    """Which joints are in each set, shape (M, J); of up to MOST joints, joint j is in set i if bit j of i is 1."""
    if joints <= MOST:
        return np.array(list(product((0.0, 1.0), repeat=joints)))[:, ::-1]
    few = [(), *combinations(range(joints), 1), *combinations(range(joints), 2)]
    return np.array([[float(joint in one) for joint in range(joints)] for one in few])


def _mean_of_logs(logs: FloatArray, axis: int) -> FloatArray:
    """Logarithm of the mean of exponentials over an axis."""
    top = logs.max(axis=axis, keepdims=True)
    return np.asarray(np.squeeze(top, axis) + np.log(np.exp(logs - top).mean(axis=axis)))
