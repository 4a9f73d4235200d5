"""How large the play is, from one reversal: the bar's ring tells how the joint moved, the command how the gear did.

The accelerometer at the bar's tip knows every impulse that the joint gets: eq. 7 turned round, which holds whatever
pushes the joint, the bar's own reaction too.  Impulses integrated twice are the joint's angle theta_2, up to a constant
speed and angle, so D = theta_2 - theta_1 is known but for a + b t and with the covariance of impulses and command.
Where the joint touches a flank (``contacts``: it is struck, or pushed along) and is accelerated in the direction s,

    D(t_k) = a + b t_k - s_k X_k phi / 2,    X = (|theta_2''| / A)^(1/n),

of which a, b and the play phi are found by generalised least squares; elsewhere D is between the flanks.  The fit says
where D was meanwhile; contacts that it contradicts go, and rests grow to where the command's acceleration ends, until
nothing changes.  X is eq. 1's, see ``flank``.  Friction, restitution and the order of bounces play no part.
docs/decisions/0007-play-size.md has the measurements.  No trigger, no trend.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.commanded import BEFORE_S, Commanded, cornered, smoothed
from lostmotion.detector.contacts import Contacts
from lostmotion.detector.corners import CORNERS_UNKNOWN, SMOOTH, CornerLaw
from lostmotion.detector.flank import CONTACT_ACCEL, SOFTNESS, FlankLaw, Sized, law_of
from lostmotion.detector.offset import OFFSET_UNKNOWN, OffsetLaw
from lostmotion.detector.pooling import PlaySize, Z, unknown
from lostmotion.detector.relative_motion import RelativeMotion, relative_motion
from lostmotion.detector.servo import AT_ONCE, ServoLaw
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut, last_part

__all__ = ["HISTORY_S", "SizeLaw", "learnt_play", "near_part", "play_size", "stretch_of", "with_play"]

HISTORY_S = 0.6
"""A stretch begins so long before the reversal [s], so that it holds several crossings of the gap: with 0.2 s of the
windows above 30 dB 65 % told a size, with 0.4 s 76 %, with 0.6 s 81 %; 95.6, 94.4 and 94.1 % of the intervals held (52
joints of ``bench.outside``, seeds 3000 to 3059)."""
LEAST_RATE = 8.0
"""Samples a period of the bar: with fewer, impulses cannot be told from each other."""
LEAST_CONTACTS = 3
FLANK, POINT, GRAIN = 0.03, 0.02, 5e-5
"""Where on a flank a contact is: standard deviation of a whole rest and of each point, as shares of half the play, and
least [rad]."""
TIMING, ROUNDED = 0.15, 0.1
"""An impact's place is uncertain by, and is rounded off by, so many steps of the grid times its impulse."""
FIRST_TIMING = 0.3
"""The same before the fit says which of three steps comes closest to the flank."""
LEARNT = 0.015
"""Standard deviation of the servo's delay [s] above which nothing is told: after some five windows it is less."""
BETWEEN, BOUND = 14, 3.0
"""Every so many steps without a contact D is known to be between the flanks: 0, with a standard deviation of so many
halves of the play.  A joint rests on a flank most of the time, so points are not independent and their mean is not 0:
with 1.5 of the intervals 90.9 % held, with 2 93.7 %, with 3 95.7 %, without 94.6 %; of plays below 1 mrad 91.7 % with 3
and 83.3 % without (52 joints of ``bench.outside``, seeds 3000 to 3059)."""
THIN = 3
"""Of rests every third step is used; the others say the same."""
ROUNDS = 8
AWAY = 0.25
"""A contact that is farther from the flank than this share of the play and three standard deviations is none."""
BESIDE = 0.12
"""The same for the ends of rests, with two standard deviations."""
LEAST_DRIVE = 1.0
"""A rest ends where the command pushes less [rad/s²]."""
REBOUND = 1.7
"""Impulse of an impact over its speed of approach."""
BEYOND = 0.1
"""Share of the stretch in which the joint may seem to be beyond a flank: more, and model and data do not fit."""
LEAST_PLAY, MOST_PLAY = 1e-4, 0.1
"""Play that scales the flanks' error [rad]."""
SIDES = (0.0, 1.0, -1.0)
"""The middle and both flanks, by the index that the sign of a place is."""

Places = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class SizeLaw:
    """What a joint's earlier windows told of its sensor's offset and of its commanded motion."""

    offset: OffsetLaw = OFFSET_UNKNOWN
    corners: CornerLaw = CORNERS_UNKNOWN


@dataclass(frozen=True, slots=True, eq=False)
class _Touch:
    """Contacts: their places on the grid, the flank (+1 where D is + phi/2, 0 where it is between the flanks) and the
    impact's impulse [rad/s], 0 in rests."""

    at: Places
    flank: FloatArray
    impulse: FloatArray

    @property
    def enough(self) -> bool:
        return self.at.size >= LEAST_CONTACTS and float(np.ptp(self.flank)) > 0


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """Contacts that fit together, the play that scales the flanks' error [rad], and the commanded acceleration on the
    grid [rad/s²]."""

    touch: _Touch
    play: float
    push: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """start, speed and play, their covariance, what contacts tell (their place, weights and residuals)."""

    values: FloatArray
    covariance: FloatArray
    weight: FloatArray
    observed: FloatArray
    left: FloatArray
    play: float


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """D at all times without a + b t [rad], (K,), and the standard deviations of its distance from the middle and from
    either flank [rad], (3, K) in the order of SIDES."""

    angle: FloatArray
    deviations: FloatArray

    def deviation(self, side: FloatArray) -> FloatArray:
        """That from the flank on whose side each one is, (K,)."""
        return np.asarray(self.deviations[side.astype(np.intp), np.arange(side.size)])


SMOOTH_MOTION = SizeLaw(corners=SMOOTH)
"""Nothing but that the commanded motion is smooth."""


def play_size(
    stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw | None = None, servo: ServoLaw = AT_ONCE,
) -> PlaySize:  # fmt: skip
    """The play that one stretch of tip acceleration shows, from some time before a reversal to the window's end.

    servo_times [s] and commands [rad], shape (M,): what was commanded during the stretch and somewhat before; stretch:
    none of its samples missing; law: what earlier windows told of the joint's flanks, servo: of how its servo follows
    the commands.
    """
    told, _ = _told(stretch, np.asarray(servo_times), np.asarray(commands), settings, servo, SMOOTH_MOTION)
    return told if isinstance(told, PlaySize) else _under(told, law or law_of(settings))


def stretch_of(score: Score, times: FloatArray, accel: FloatArray, rate_hz: float) -> Window:
    """The stretch that tells the play of a score's window, from a stream of tip acceleration that holds it."""
    return cut(score.joint, times, accel, score.time - HISTORY_S, score.duration + HISTORY_S, rate_hz)


def near_part(score: Score, stretch: Window) -> Window:
    """Of a stretch that which tells the severity: from ``BEFORE_S`` before the reversal on."""
    return last_part(stretch, score.duration + BEFORE_S)


def with_play(
    score: Score, stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings,
) -> Score:  # fmt: skip
    """The score with the play that its stretch alone shows, or the reason why it cannot be told."""
    return learnt_play(score, stretch, servo_times, commands, settings, law_of(settings))[0]


def learnt_play(
    score: Score, stretch: Window, servo_times: Sequence[float] | FloatArray, commands: Sequence[float] | FloatArray,
    settings: DetectorSettings, law: FlankLaw, servo: ServoLaw = AT_ONCE, known: SizeLaw = SMOOTH_MOTION,
) -> tuple[Score, FlankLaw, SizeLaw]:  # fmt: skip
    """The score with the play that its stretch shows to one who knows the law of the flanks, how the servo follows,
    what the sensor reads beside motion and whether the motion has corners; what is known after this window."""
    if not settings.play_size or not score.impact or "clipped" in score.quality:
        reason = "not asked for" if not settings.play_size else "clipped" if score.impact else "no impact"
        return replace(score, play_reason=reason), law, known
    times = np.asarray(servo_times)
    if not np.isfinite(stretch.accel).all() or not times.size or times[0] > stretch.start:
        stretch = near_part(score, stretch)
    told, known = _told(stretch, times, np.asarray(commands), settings, servo, known)
    if isinstance(told, Sized):
        law = law.updated(told)
        told = _under(told, law)
    score = replace(score, play=told.value, play_low=told.low, play_high=told.high, play_reason=told.reason)
    return score, law, known


def _under(told: Sized, law: FlankLaw) -> PlaySize:
    """The play under a law of the flanks; none where its interval reaches zero."""
    value, low, high = law.interval(told, Z)
    if low <= 0:
        return unknown("the play is lost in its own uncertainty")
    return PlaySize(value, low, high)


def _told(
    stretch: Window, times: FloatArray, commands: FloatArray, settings: DetectorSettings, servo: ServoLaw,
    known: SizeLaw,
) -> tuple[Sized | PlaySize, SizeLaw]:  # fmt: skip
    """What one stretch tells, or why it tells nothing; and what is known after it."""
    if stretch.rate_hz < LEAST_RATE * settings.f_res_hz:
        return unknown(f"the sensor is too slow: {LEAST_RATE:g} samples a period of the bar are needed"), known
    if not np.isfinite(stretch.accel).all():
        return unknown("samples are missing"), known
    if servo.delay[1] > LEARNT:
        return unknown("how the servo follows is not known yet"), known
    smooth = smoothed(times, commands, stretch)
    if smooth is None:
        return unknown("too few commands during the stretch"), known
    tried = {True: smooth} if known.corners.none or known.corners.asks_both else {}
    if not known.corners.none or known.corners.asks_both:
        tried[False] = cornered(times, commands, stretch, smooth)
    return _of_priors(stretch, tried, settings, servo, known)


def _of_priors(
    stretch: Window, tried: Mapping[bool, Commanded], settings: DetectorSettings, servo: ServoLaw, known: SizeLaw
) -> tuple[Sized | PlaySize, SizeLaw]:
    """What a stretch tells by the prior of the command that earlier windows make likely, and which it makes likely.

    tried: the motion if it is smooth (True), and if it has corners.
    """
    corners, offset, found = known.corners, known.offset, {}
    for is_smooth, command in tried.items():
        apart, touched, offset = relative_motion(stretch, command, settings, servo, known.offset)
        found[is_smooth] = apart, _solved(apart, touched)
    if len(found) == 2 and isinstance(solved := found[False][1], _Solved):
        corners = corners.updated(_evidence(found[True][0], solved) - _evidence(found[False][0], solved))
    else:
        corners = corners.updated(math.nan)
    apart, solution = found.get(corners.none) or found[not corners.none]
    return _sized(apart, solution) if isinstance(solution, _Solved) else solution, SizeLaw(offset, corners)


def _evidence(apart: RelativeMotion, solved: _Solved) -> float:
    """Log-likelihood of D at the contacts, whatever a, b and the play are."""
    fit = _fit(apart, _bounded(apart, solved.touch), solved.play, TIMING)
    size = np.linalg.slogdet(fit.weight)[1] + np.linalg.slogdet(fit.covariance)[1]
    return float(size - fit.left @ fit.weight @ fit.left) / 2


def _solved(apart: RelativeMotion, found: Contacts) -> _Solved | PlaySize:
    """Fits and chooses contacts in turn."""
    flank = np.where(found.hard, -np.sign(found.impulse), -np.sign(found.push))
    sure = found.hard | (found.rests & _thinned(found.rests.size))
    touch = _Touch(np.flatnonzero(sure), flank[sure], np.where(found.hard, np.abs(found.impulse), 0.0)[sure])
    if not touch.enough:
        return unknown("the teeth did not touch both flanks clearly")
    play, step = _range(apart), float(apart.time[1] - apart.time[0])
    for turn in range(ROUNDS):
        shown = _bounded(apart, touch)
        fit = _fit(apart, shown, play, TIMING if turn else FIRST_TIMING)
        play = fit.play
        place = _between(apart, shown, fit)
        chosen = _chosen(found, place, fit, step, grown=turn > 0)
        if not chosen.enough:
            return unknown("contacts and command do not fit together")
        if turn > 2 and np.array_equal(chosen.at, touch.at) and np.array_equal(chosen.flank, touch.flank):
            break
        touch = chosen
    beyond, doubt = np.abs(place.angle) - play / 2, place.deviation(np.sign(place.angle))
    outside = (beyond > np.maximum(0.15 * play, 3 * doubt)) & apart.known
    if np.mean(outside) > BEYOND:
        return unknown("contacts and command do not fit together")
    return _Solved(touch, play, found.push)


def _range(apart: RelativeMotion) -> float:
    """How far D goes beside its mean line [rad]."""
    time, angle = apart.time[apart.known], apart.angle[apart.known]
    along = time - time.mean()
    return float(np.ptp(angle - along * (along @ angle) / (along @ along)))


def _bounded(apart: RelativeMotion, touch: _Touch) -> _Touch:
    """The contacts, and points of D between them, which tell no flank."""
    free = apart.known & (np.arange(apart.time.size) % BETWEEN == 0)
    free[touch.at] = False
    at = np.concatenate([touch.at, np.flatnonzero(free)])
    order, none = np.argsort(at), np.zeros(at.size - touch.at.size)
    return _Touch(at[order], np.concatenate([touch.flank, none])[order], np.concatenate([touch.impulse, none])[order])


def _thinned(count: int) -> NDArray[np.bool_]:
    return np.asarray(np.arange(count) % THIN == 0)


def _fit(apart: RelativeMotion, touch: _Touch, play: float, timing: float) -> _Fit:
    """Generalised least squares of a, b and phi, the flanks' error in proportion to ``play`` [rad]."""
    step = float(apart.time[1] - apart.time[0])
    half = min(max(play, LEAST_PLAY), MOST_PLAY) / 2
    run = np.cumsum(np.concatenate([[True], (np.diff(touch.at) > THIN + 1) | (np.diff(touch.flank) != 0)]))
    noise = apart.covariance[np.ix_(touch.at, touch.at)] + (run[:, None] == run) * (FLANK * half) ** 2
    own = np.where(touch.flank == 0, BOUND, POINT) * half
    noise[np.diag_indices_from(noise)] += own**2 + GRAIN**2 + (timing * step * touch.impulse) ** 2
    weight = np.linalg.inv(noise)
    observed = apart.angle[touch.at] + touch.flank * ROUNDED * step * touch.impulse
    values, covariance, left = _least(_design(apart, touch), weight, observed)
    # A play that is lost in its uncertainty must not make the search for contacts narrow.
    return _Fit(values, covariance, weight, observed, left,
                max(float(values[2]), 2 * math.sqrt(covariance[2, 2]), LEAST_PLAY))  # fmt: skip


def _design(apart: RelativeMotion, touch: _Touch) -> FloatArray:
    return np.column_stack([np.ones(touch.at.size), apart.time[touch.at], touch.flank / 2])


def _least(design: FloatArray, weight: FloatArray, observed: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients, their covariance and the residuals, of one design (K, 3) or of several (S, K, 3)."""
    weighted = np.swapaxes(design, -1, -2) @ weight
    covariance = np.asarray(np.linalg.inv(weighted @ design), np.float64)
    values = (covariance @ (weighted @ observed)[..., None])[..., 0]
    return values, covariance, observed - (design @ values[..., None])[..., 0]


def _between(apart: RelativeMotion, touch: _Touch, fit: _Fit) -> _Place:
    """D at all times given the contacts (kriging)."""
    shared = apart.covariance[:, touch.at]
    gain = shared @ fit.weight
    angle = apart.angle - fit.values[0] - fit.values[1] * apart.time - gain @ fit.left
    variance = np.diag(apart.covariance) - np.sum(gain * shared, axis=1)
    rows = np.column_stack([np.ones(angle.size), apart.time, np.zeros(angle.size)]) - gain @ _design(apart, touch)
    variance = variance + np.sum((rows @ fit.covariance) * rows, axis=1)
    sides = np.array(SIDES)[:, None]
    variance = variance + sides * (rows @ fit.covariance[:, 2]) + sides**2 * (fit.covariance[2, 2] / 4)
    return _Place(angle, np.sqrt(np.maximum(variance, 0.0) + GRAIN**2))


def _chosen(found: Contacts, place: _Place, fit: _Fit, step: float, grown: bool) -> _Touch:
    """The contacts that a place between the flanks allows; grown: rests reach as far as the command pushes."""
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
    rests &= _thinned(side.size)
    impulse = np.zeros(side.size)
    for impact in np.flatnonzero(found.impacts):
        flank, size = -float(np.sign(found.impulse[impact])), abs(float(found.impulse[impact]))
        closest = impact - 1 + int(np.argmax(flank * place.angle[impact - 1 : impact + 2]))
        allowed = max(near[closest], 0.5 * step * size + 0.1 * play)
        if abs(flank * place.angle[closest] - half) < allowed:
            impulse[closest], side[closest], rests[closest] = size, flank, True
    at = np.flatnonzero(rests)
    return _Touch(at, side[at], impulse[at])


def _sized(apart: RelativeMotion, solved: _Solved) -> Sized:
    """The play for each softness of the flanks, all with the same weights so that they can be compared."""
    touch = _bounded(apart, solved.touch)
    fit = _fit(apart, touch, solved.play, TIMING)
    step = float(apart.time[1] - apart.time[0])
    pushed = np.maximum(np.abs(solved.push[touch.at]), 1.0)
    softness, size = SOFTNESS[:, None], np.full((SOFTNESS.size, 1), fit.play)
    design = np.repeat(_design(apart, touch)[None], SOFTNESS.size, axis=0)
    yielded = design[0, :, 2].copy()
    for _ in range(2):
        # An impact's force lasts as long as it takes to stop on the flank: (n + 1) v² / (X phi) of eq. 1.
        struck = np.maximum(
            touch.impulse / (2 * step), (touch.impulse / REBOUND) ** 2 / (np.maximum(softness, 0.01) * size)
        )
        load = np.where(touch.impulse > 0, struck, pushed)
        design[:, :, 2] = yielded * (load / CONTACT_ACCEL) ** softness
        values, covariance, left = _least(design, fit.weight, fit.observed)
        deviation = np.sqrt(covariance[:, 2, 2])
        size = np.maximum(np.maximum(values[:, 2], deviation), LEAST_PLAY)[:, None]
    return Sized(values[:, 2], deviation, -np.sum((left @ fit.weight) * left, axis=1) / 2)
