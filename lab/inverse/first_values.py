"""The first values of a fit with one more effect: its amplitude and all other parameters, to first order.

A candidate explains as much of the present residual as its change by the effect, projected off the fitted parameters,
explains linearly.  Nothing is fitted here, and nothing selected.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over
from lostmotion.lab.inverse.free_parameters import largest_moving
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel, Problem
from lostmotion.lab.inverse.regression import Regression
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray

__all__ = ["Guess", "guesses", "initial_point", "scant_guesses", "turns_of"]

ANGLES = 6
"""Zero angles of an encoder that are tried in a period of an effect: one of them is at most 30 degrees of phase off."""
ROUNDING = 1e-6
"""An effect that changes the residual by less than this share of it acts on a sensor that was not recorded."""
SMALL = 1e-4
"""Part of an effect by which the change of a simulated motion is computed to first order.  The motion with all of it
may be out of phase: drag of 1e-7 N m s² is, after a hundred swings of a pendulum, and was then not found beside Coulomb
friction.  With 1e-3 and 1e-5 that search ends with the same effects."""
POSSIBLE = 10.0
"""Largest first value of a torque, in those of the inertia.  The secant of a friction that holds a part at rest knows
no size: a friction of 19 N m, where the motion has 1e-3, was simulated for 35 s in steps of its change of sign."""
SHARES = (1.0, 1 / 4, 1 / 16)
"""Shares of the first-order step that are tried, by the secant and by the tangent of the effect.  Of 32 fits of a
Silverbox, a servo that drops and a pendulum on film the best of 1, 1/2, 1/4 … was 1 in eight, 1/2 to 1/16 in nine, and
1/32, which is nearly the present fit, in 13; the other parameters unchanged were better in two.  Seven points are
simulated side by side: with six shares of each a film of 330 s, with friction in short steps, took twice as long."""


@dataclass(frozen=True, eq=False)
class Guess:
    """First values of a fit with one more effect; nuisance: the initial nuisance parameters (E,).

    gain: the decrease of the squared residual to first order; change, tangent: that of the residual by the effect with
    these values (M,), the other parameters being those of the present fit: with all of it, and to first order.
    """

    gain: float
    model: Model
    nuisance: FloatArray
    change: FloatArray
    tangent: FloatArray


@np.errstate(over="ignore", invalid="ignore")  # of motions that diverge
def guesses(
    name: str, shapes: Sequence[Model], now: Regression, data: Problem, periods: float = policy.LEAST_PERIODS
) -> list[Guess]:
    """The guesses for an effect of these shapes, that with the largest gain first.  Shapes that the motion does not
    cover, or that do not change the residual, are left out, and also those for which the time is over.  periods: the
    least number of them, of what repeats."""
    names = get_effect(name).amplitude_names
    left = [shape for shape in shapes if _covers(name, shape, now.data, periods)]
    found: list[Guess] = []
    while left and not is_over():
        part, left = left[:LANES], left[LANES:]
        points = [(shape, _zeros(name, shape, now, data)) for shape in part]
        changes = data.residuals(points) - now.residual
        is_beside = isinstance(data, OutputError) and data.most_beside > 1
        tangents = _tangents(points, names, now, data) if is_beside and names else changes
        for (shape, nuisance), change, tangent in zip(points, changes, tangents, strict=True):
            guess = _guess(names, shape, nuisance, change, tangent, now)
            found += [guess] if guess else []
    return sorted(found, key=lambda guess: -guess.gain)


def scant_guesses(name: str, shapes: Sequence[Model], now: Regression, data: Problem) -> list[Guess]:
    """The guesses for what repeats N times a turn, of which the motion covers a quarter of ``policy.LEAST_PERIODS`` and
    more, but not all.

    Such a wave can imitate much of any slow torque, but only the right one leaves no more than noise, where more is
    left without it.  Simulated joints that cover 0.84 and 1.4 periods (seeds 9710, 9720 of ``bench.driven_motions``)
    got a weight and a spring, with 70 times the noise left; of nine servos five did not have their ripple.
    """
    if all("N" not in one.own(name) for one in shapes):
        return []
    found = guesses(name, shapes, now, data, policy.LEAST_PERIODS / 4)
    return [one for one in found if not _covers(name, one.model, now.data)]


def _tangents(
    points: Sequence[tuple[Model, FloatArray]], names: Sequence[str], now: Regression, data: Problem
) -> FloatArray:
    """The changes of the residual (K, M) by the effect of these shapes, to first order."""
    small = [
        (shape.replace({full: SMALL * shape.parameters[full].value for full in names}), at) for shape, at in points
    ]
    return (data.residuals(small) - now.residual) / SMALL


def _guess(
    names: Sequence[str], shape: Model, nuisance: FloatArray, change: FloatArray, tangent: FloatArray, now: Regression
) -> Guess | None:
    """The guess with the best amplitude to first order; names: the amplitudes; change, tangent: see ``Guess``, of the
    shape."""
    if not np.isfinite(change).all() or change @ change <= ROUNDING**2 * (now.residual @ now.residual):
        return None
    own = projected_off(now.jacobian, change)
    power = float(own @ own)
    if power <= 1e-12 * float(change @ change):
        return None
    tangent = tangent if np.isfinite(tangent).all() else change
    factor = -float(own @ now.residual) / power
    signed = all(shape.parameters[full].low < 0 for full in names)
    if names and not (factor > 0 or signed):
        return Guess(0.0, shape, nuisance, change, tangent)
    sizes = {full: p.clipped(factor * p.value) for full in names for p in (shape.parameters[full],)}
    gain, factor = factor**2 * power, factor if names else 1.0
    return Guess(gain, shape.replace(sizes), nuisance, factor * change, factor * tangent)


@np.errstate(over="ignore", invalid="ignore")  # of motions that diverge
def initial_point(name: str, guess: Guess, now: Regression, data: Problem) -> tuple[Model, FloatArray]:
    """The model and the nuisance parameters (E,) from which the fit with one more effect begins: where nothing is
    simulated those of the guess.

    The step from the present fit is that of ``_first_order``: all other parameters change as well.  Of ``SHARES`` of it
    that with the least error is taken.  As no share is the present fit, the error decreases with a small one.  With the
    other parameters unchanged, 110 of 1743 fits of the search ended with a larger error than without the effect, and
    some at a thousand times its square: drag takes the place of a viscous friction only if that becomes smaller.
    Servos, whose models are simulated one after the other, begin at the guess: with this step the search of an STS3215
    took over 84 s of processor time instead of 35.
    """
    if not isinstance(data, OutputError) or data.most_beside == 1:
        return guess.model, guess.nuisance
    names = get_effect(name).amplitude_names
    (low, high), points = now.unknowns.bounds, [(guess.model, guess.nuisance)]
    for change in [guess.change, *([guess.tangent] if names else [])]:  # the same where there is no amplitude
        amplitude, step = _first_order(guess, change, now, names)
        own = step[now.count :].reshape(len(data.signals), -1)
        states = np.pad(own, ((0, 0), (0, guess.nuisance.size // len(own) - own.shape[1]))).ravel()
        for share in SHARES:
            sizes = {full: share * amplitude * guess.model.parameters[full].value for full in names}
            z = np.clip(now.z + share * step[: now.count], low, high)
            with suppress(ModelError):
                points.append((now.unknowns.put(guess.model.replace(sizes), z), guess.nuisance + share * states))
    points = _possible(points, names, data) or points[:1]
    many = data.most_beside
    parts = [data.residuals(points[at : at + many]) for at in range(0, len(points), many)]
    errors = np.sum(np.concatenate(parts) ** 2, axis=1)
    return points[int(np.argmin(np.where(np.isnan(errors), np.inf, errors)))]


def _possible(
    points: list[tuple[Model, FloatArray]], names: Sequence[str], data: Problem
) -> list[tuple[Model, FloatArray]]:
    """The points with torques (forces) of an effect, by their amplitudes, of at most ``POSSIBLE`` times the largest one
    that the inertia has in a motion that no input drives."""
    if data.is_driven:
        return points
    torques = [full for full in names if points[0][0].parameters[full].unit in ("N m", "N")]
    return [
        (model, nuisance)
        for model, nuisance in points
        if all(abs(model.parameters[full].value) <= POSSIBLE * largest_moving(model, data) for full in torques)
    ]


def _first_order(guess: Guess, change: FloatArray, now: Regression, names: Sequence[str]) -> tuple[float, FloatArray]:
    """The amplitude a of an effect, relative to that of its guess, and the step d of all other parameters and nuisance
    parameters (P + E,) that minimise |r + J d + c a| within the bounds of the parameters: r is the residual of the
    present fit, J its Jacobian, and c the change by the effect (M,).  names: the amplitudes; a is 1 where there are
    none.

    A friction that the present fit has at zero cannot become smaller.  Where the step without bounds was clipped
    there, what the other parameters did to make up for it was left: fits with dry friction and drag in the place of the
    viscous friction of a pendulum began, and ended, with a larger error than without them.
    """
    columns = np.column_stack([now.jacobian, *([change] if names else [])])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, triangle = np.linalg.qr(columns / size)
    low, high = np.full((2, columns.shape[1]), [[-np.inf], [np.inf]])
    low[: now.count] = np.minimum(now.unknowns.bounds[0] - now.z, 0.0)
    high[: now.count] = np.maximum(now.unknowns.bounds[1] - now.z, 0.0)
    if names and any(guess.model.parameters[full].low >= 0 for full in names):
        low[-1] = 0.0
    left = now.residual if names else now.residual + change
    found = lsq_linear(triangle, -(basis.T @ left), (low * size, high * size), method="bvls").x / size
    return (float(found[-1]), found[:-1]) if names else (1.0, found)


def _zeros(name: str, start: Model, now: Regression, data: Problem) -> FloatArray:
    """The initial nuisance parameters of a fit with one more effect (E,).

    They are those of the present fit, completed by the initial values of free states that reduce the residual most.
    Zero angles on which the present fit does not depend are those with which the effect explains most of the residual
    of each recording.
    """
    if isinstance(data, OutputError):
        return data.begun(start, now.nuisance)
    if not isinstance(data, InverseModel) or not now.nuisance.size or now.jacobian[:, now.count :].any():
        return now.nuisance
    grid = np.arange(ANGLES) / ANGLES * math.tau / getattr(start.parameters.get(f"{name}.N"), "value", 1.0)
    changes = data.residuals([(start, zero + now.nuisance) for zero in grid]) - now.residual
    alike = [_explained_shares(change, now) for change in changes]
    found = grid[np.argmax(alike, axis=0)]
    return np.asarray(np.where(data.nuisance_range < math.tau, now.nuisance, found))


def _explained_shares(column: FloatArray, now: Regression) -> list[float]:
    """The decrease of the norm of each recording's residual by this change of it (M,), projected off the fitted
    parameters; negative where the change has the wrong sign."""
    split = now.data.by_recording
    parts = zip(split(projected_off(now.jacobian, column)), split(now.residual), strict=True)
    return [-float(own @ residual) / max(float(np.linalg.norm(own)), 1e-100) for own, residual in parts]


def _covers(name: str, model: Model, data: Problem, periods: float = policy.LEAST_PERIODS) -> bool:
    """Whether the motion covers so many periods of an effect that repeats N times a turn, at speeds at which its
    frequency is within the band, and crosses a play ``policy.LASTING_BLOCKS`` times; true for other effects.

    At higher speeds the effect shows only at the start and the end of a motion, where it can imitate any function; so
    can friction behind a play that is crossed less often (motors that turn one way, a joint that moves a radian).  N =
    1 is the law of a weight: it is tried on shafts only, and reported as confusable with the weight there.
    """
    turns, play = (model.parameters.get(f"{name}.{part}") for part in ("N", "e"))
    if play is not None and get_effect(name).along:
        return sum(_crossings(one.position, play.value) for one in data.signals) >= policy.LASTING_BLOCKS
    if turns is None:
        return True
    if turns.value == 1:
        return turns_of(data.signals) >= SHAFT_TURNS
    period = math.tau / turns.value
    return max(_travel(one, period * one.band_hz) for one in data.signals) > periods * period


def _crossings(position: FloatArray, play: float) -> int:
    """How often a position (N,) leads across a play: onward by its size from where it was farthest the other way."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(position)))) + 1
    count, way, farthest = 0, 0, float(position[0])
    for place in (*position[turns], position[-1]):
        step = float(place) - farthest
        if abs(step) > play and np.sign(step) != way:
            count, way, farthest = count + 1, int(np.sign(step)), float(place)
        elif np.sign(step) == way:
            farthest = float(place)
    return count


def _travel(signals: Signals, fastest: float) -> float:
    """The range of a motion [rad] at speeds up to ``fastest`` [rad/s]: the range of its angle, but at most the distance
    travelled, and for a motion that dies away the range of a sine with the same standard deviation."""
    slow = np.abs(signals.velocity) < fastest
    if not slow.any():
        return 0.0
    way = float(np.abs(signals.velocity[slow]).sum() * signals.step_s)
    dying = math.inf if signals.experiment.is_driven else math.sqrt(8) * float(signals.position.std())
    return min(float(np.ptp(signals.position[slow])), dying, way)


def turns_of(signals: Sequence[Signals]) -> float:
    """The largest number of turns that the motion of a recording covers."""
    return max(float(np.ptp(one.position)) for one in signals) / math.tau
