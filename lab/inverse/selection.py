"""Forward selection of effects, each judged by samples that its fit has not seen, and backward elimination.

A candidate is judged by the squared error of predictions: each of three folds of blocks is predicted by a fit to the
other two.  The logarithms of the ratio of two models' errors, block by block, are nearly independent, and their mean is
that of the log-likelihood ratio when each block has noise of its own size: recordings differ in theirs.  Student's
t-test asks whether the mean is above zero, and the p-value is multiplied by the number of candidates that were tried
(Bonferroni), so that it is the chance of a false name in the whole step.  A model need not be true for that, only
better: the test compares predictions (Diebold and Mariano 1995; Hansen, Lunde and Nason 2011, "The model confidence
set").
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from enum import Enum
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from lostmotion.lab.inverse.candidates import are_apt, candidates, fitted_with, refined, softened, starts
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Data, Problem, Regression, blocks_of, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.nesting import without
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["LIMIT", "Judged", "Method", "Selection", "amplitudes", "error_on", "selected"]

LIMIT = 0.05
"""Chance of a false name in one step of the search."""
LEAST_GAIN = 0.01
"""Share of the squared error that an effect has to take, however sure it is: less is not worth a name."""
HORIZONS = (0.2, 0.5)
"""Shares of a free swing that are fitted before the whole: a frequency that is 2 % off is out of phase after ten
swings, and a fit to all of them ends in another minimum."""
FINISHED = 5
"""Effects whose fit to a simulated motion is finished after all have had a few steps (successive halving)."""
LEAST_PROMISE = 1e-3
"""Share of the squared error that an effect has to take in these few steps to be finished: those that went on to a name
had taken 30 % at least (servos and oscillators of ``bench.real``), those that stayed at zero less than 3e-4."""
FIRSTS = 3
"""Effects that are tried as the first of two, those that explain most alone."""
MOST = 6
"""Effects that are added at most."""


class Method(Enum):
    """Whose error is judged: that of the torque, which a controller made; that of a free motion, whose effects are
    looked for in the acceleration; that of a motion whose input follows no disturbance."""

    TORQUE = "torque"
    FREE = "free"
    MOTION = "motion"


@dataclass(frozen=True, eq=False)
class Fitted:
    """inverse: the fit in which effects are looked for; judged: the fit whose predictions count, the same one except
    where a joint swings freely."""

    inverse: Regression
    judged: Regression

    @classmethod
    def of(cls, inverse: Regression, method: Method) -> Fitted:
        """Beginning with the fit in which effects are looked for."""
        if method is not Method.FREE:
            return cls(inverse, inverse)
        swings, model = OutputError.of(inverse.data.signals, inverse.model), inverse.model
        for share in HORIZONS:
            model = regressed(model, swings.first(share)).model
        return cls(inverse, regressed(model, swings))

    @property
    def model(self) -> Model:
        """The model of the fit that counts."""
        return self.judged.model


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate: the fit with it, the share of the squared error of unseen samples that it takes, the p-value,
    whether its size is told: that its interval does not hold zero; and whether the unseen recording contradicts it."""

    effect: str
    fitted: Fitted
    gain: float
    p_value: float
    is_sized: bool = True
    is_refuted: bool = False

    @property
    def fit(self) -> Regression:
        """The fit that counts."""
        return self.fitted.judged


@dataclass(frozen=True, eq=False)
class Step:
    """What was tried at one step, best first; confusable: the effects that explain as much as the first."""

    judged: tuple[Judged, ...]
    confusable: tuple[str, ...] = ()

    @property
    def is_accepted(self) -> bool:
        """Whether the first effect is significant."""
        return bool(self.judged) and _is_significant(self.judged[0])


@dataclass(frozen=True, eq=False)
class Selection:
    """fits: the base's, then one with each effect that was added; steps: what was tried at each, the last one without
    success; complete: False where time ran out first."""

    fits: tuple[Fitted, ...]
    added: tuple[str, ...]
    steps: tuple[Step, ...]
    complete: bool


def selected(
    model: Model, signals: Sequence[Signals], unseen: Signals, method: Method, until: float,
    progress: Callable[[str, float], None], pool: Executor | None = None,
) -> Selection:  # fmt: skip
    """Adds effects as long as one is significant and time.monotonic() is below ``until`` [s].

    unseen: a recording that no parameter is fitted to; of effects that explain alike, the one that predicts it best is
    named, and none with which it is predicted worse than without.
    """
    now = _first(model, signals, method)
    fits, added, steps, complete = [now], list[str](), list[Step](), True
    while len(added) < MOST:
        progress("looking for more" if added else "looking for what is missing", 0.15 + 0.12 * len(added))
        found = _step(now, tuple(added), unseen, method, pool)
        several = [found] if found.is_accepted else _two(found, now, tuple(added), unseen, method, pool)
        steps += several or [found]
        for step in several:
            best = step.judged[0]
            now = _with(best, now, method)
            still = [effect in now.model.effects for effect in added]  # a wider effect takes a simpler one's place
            fits = [fits[0], *compress(fits[1:], still), now]
            added = [*compress(added, still), best.effect]
        if not several:
            break
        if time.monotonic() > until:
            complete = False
            break
    return _eliminated(fits, added, steps, complete, method)


def _two(
    step: Step, now: Fitted, added: tuple[str, ...], unseen: Signals, method: Method, pool: Executor | None
) -> list[Step]:
    """The steps of two effects at once, where neither is significant alone; none where no two are.

    Of a weight, viscous and Coulomb friction the first that is added leaves the other two mixed (UR10e, joint 4).  The
    two are tested against neither, among all pairs, and each against the other one alone.  Not for simulated motions,
    whose fits take seconds each.
    """
    if method is Method.MOTION:
        return []
    alone = {one.effect: one.fit for one in step.judged}
    pairs = len(alone) * (len(alone) - 1) / 2
    promising = sorted((one for one in step.judged if one.gain > LEAST_GAIN), key=lambda one: -one.gain)
    found: list[list[Step]] = []
    for first in promising[:FIRSTS]:
        second = _step(_with(first, now, method), (*added, first.effect), unseen, method, pool)
        if not second.is_accepted:
            continue
        both = second.judged[0]
        others = (now.judged, *(alone[name] for name in (both.effect,) if name in alone))
        if all(pairs * _p(one, both.fit) < LIMIT for one in others):
            found.append([Step((first, *(one for one in step.judged if one is not first))), second])
    least = min((two[1].judged[0].fit.rms for two in found), default=0.0)
    alike = [two for two in found if two[1].judged[0].fit.rms ** 2 * (1 - LEAST_GAIN) <= least**2]
    return min(alike, key=lambda two: _preferred(two[0].judged[0], now.inverse), default=[])


def _first(model: Model, signals: Sequence[Signals], method: Method) -> Fitted:
    """The fit of the model as it is."""
    if method is Method.MOTION:
        fits = [regressed(start, OutputError.of(signals, start)) for start in starts(model, signals)]
        best = min(fits, key=lambda fit: fit.rms)
        return Fitted(best, best)
    data = Data.of(signals, model)
    return Fitted.of(_with_load(softened(model, data), data), method)


def _with(best: Judged, now: Fitted, method: Method) -> Fitted:
    """The fit with what was added."""
    if method is Method.MOTION:
        return best.fitted
    inverse = _with_load(best.fit.model, now.inverse.data, best.fitted.inverse.nuisance)
    return Fitted(inverse, best.fit if method is Method.FREE else inverse)


def _step(now: Fitted, added: tuple[str, ...], unseen: Signals, method: Method, pool: Executor | None) -> Step:
    """All candidates, judged against the present fit."""
    wide = list(candidates(now.inverse.model, added, now.inverse.data))
    each = pool.map if isinstance(pool, ThreadPoolExecutor) else map
    found = each(lambda one: fitted_with(one[0], one[1], now.inverse), wide)
    inverse = [(name, fit) for (name, _), fit in zip(wide, found, strict=True) if fit]
    if method is Method.MOTION:
        inverse.sort(key=lambda one: one[1].rms)
        least = math.sqrt(1 - LEAST_PROMISE) * now.inverse.rms
        many = min(sum(fit.rms < least for _, fit in inverse), FINISHED)
        finished = each(lambda one: (one[0], refined(one[1])), inverse[:many])
        inverse = [*finished, *inverse[many:]]
    judged = list(each(lambda one: _judged(one[0], Fitted.of(one[1], method), now, len(wide)), inverse))
    judged.sort(key=lambda one: -one.gain)
    good = [one for one in judged if _is_significant(one)]
    while good:
        alike = [one for one in good if _are_alike(one, good[0], len(wide))]
        first = _named(alike, now.inverse, unseen)
        if not _is_refuted(first.fit, now.judged, unseen):
            rest = [one for one in judged if one is not first]
            return Step((first, *rest), tuple(one.effect for one in alike if one is not first))
        good.remove(first)
        judged = [replace(one, is_refuted=True) if one is first else one for one in judged]
    return Step(tuple(sorted(judged, key=lambda one: (one.is_refuted, one.p_value))))


def _named(alike: Sequence[Judged], now: Regression, unseen: Signals) -> Judged:
    """Of effects that explain alike: that with the fewest parameters, then the one that best predicts the recording
    that no fit has seen, then the one whose shape suits the motion."""
    few = min(one.fit.count for one in alike)
    simple = [one for one in alike if one.fit.count == few]
    if len(simple) == 1:
        return simple[0]
    errors = [error_on(one.fit, unseen) ** 2 for one in simple]
    best = [one for one, error in zip(simple, errors, strict=True) if error * (1 - LEAST_GAIN) <= min(errors)]
    return min(best, key=lambda one: (*_preferred(one, now), one.fit.rms))


def error_on(fit: Regression, unseen: Signals) -> float:
    """Root mean square of what a fit lacks in a recording that it has not seen [N m or rad], infinite where its motion
    has no end there."""
    there = _on(fit, unseen)
    return there.rms if there else math.inf


def _on(fit: Regression, unseen: Signals) -> Regression | None:
    """The fit's model on a recording that it has not seen, None where its motion has no end there: only the initial
    state of a motion, or the zero of an angle, is fitted."""
    known = fit.model.replace({name: replace(fit.model.parameters[name], fixed=True) for name in fit.unknowns.names})
    try:
        if isinstance(fit.data, OutputError):
            return regressed(known, OutputError.of([unseen], known))
        data = replace(Data.of([unseen], known), is_anchored=fit.nuisance.size == 0)
        return regressed(known, data)
    except ModelError:
        return None


def _is_refuted(fit: Regression, now: Regression, unseen: Signals) -> bool:
    """Whether the recording that no fit has seen is predicted worse with an effect than without, significantly and by
    what is worth a name.

    Folds of the other recordings have the same speeds and amplitudes.  An effect that bends itself to these by a
    difference of large terms, as a Stribeck friction beside a drag, is wild a little outside of them: a damper's 80 N
    became 254 N where the folds' error fell by 12 %.
    """
    without, there = _on(now, unseen), _on(fit, unseen)
    if without is None or there is None:
        return there is None and without is not None
    worse = there.residual @ there.residual * (1 - LEAST_GAIN) > without.residual @ without.residual
    return bool(worse) and _chance(there.residual**2, without.residual**2, blocks_of(without)) < LIMIT


def _preferred(one: Judged, now: Regression) -> tuple[bool]:
    """Of two effects of the same shape, that which repeats every turn of a shaft comes first where the motion covers
    several turns, as no arm does."""
    turns = max(float(np.ptp(signals.position)) for signals in now.data.signals) / (2 * np.pi)
    repeats = f"{one.effect}.N" in one.fit.model.parameters
    return ((repeats and turns < 2) or (not repeats and turns >= 2),)


def _is_significant(one: Judged) -> bool:
    return one.p_value < LIMIT and one.gain > LEAST_GAIN and one.is_sized and not one.is_refuted


def _are_alike(one: Judged, best: Judged, tried: int) -> bool:
    """Whether the best of so many predicts no better than another, significantly and by what is worth a name."""
    left, least = 1 - one.gain, 1 - best.gain
    return left * (1 - LEAST_GAIN) <= least or tried * _p(one.fit, best.fit) > LIMIT


def _judged(name: str, found: Fitted, now: Fitted, tried: int) -> Judged:
    before, after, block = _errors(now.judged, found.judged)
    p_value = min(tried * _chance(before, after, block), 1.0)
    return Judged(name, found, float(1 - after.sum() / before.sum()), p_value, _is_sized(name, found.judged))


def _is_sized(effect: str, fit: Regression) -> bool:
    """Whether the interval of an amplitude of the effect does not hold zero.  A curve that is nearly a sum of others
    bends itself to a motion better than they do, and is wild outside of it.  The base's positive parameters are taken
    as given: all torques of a servo share a scale that its motion does not tell."""
    names = amplitudes(effect, fit)
    if not names:
        return True
    block = blocks_of(fit)
    given = [item.name for item in fit.unknowns.items if item.logarithmic and "." not in item.name]
    limits = student.isf(LIMIT / 2, int(block.max())) * fit.deviations(block, given)
    sizes = {name: abs(fit.model.parameters[name].value) for name in names}
    return any(sizes[name] > limit for name, limit in zip(fit.unknowns.names, limits, strict=True) if name in sizes)


def amplitudes(effect: str, fit: Regression) -> list[str]:
    """The free parameters without which the effect vanishes, by their full names."""
    names = (f"{effect}.{part}" for part in get_effect(effect).amplitudes)
    return [name for name in names if name in fit.unknowns.names]


def _p(one: Regression, other: Regression) -> float:
    """The chance of predictions of ``other`` this much better than those of ``one``, if both were as good."""
    return _chance(*_errors(one, other))


def _errors(one: Regression, other: Regression) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Squared errors of both fits at samples that they have not seen (M,) each, and the block of each sample: those of
    the residual of ``other``, which if it explains nothing is the one before."""
    block = blocks_of(other)
    return one.predicted**2, other.predicted**2, block


def _chance(before: FloatArray, after: FloatArray, block: NDArray[np.intp]) -> float:
    """Of a mean of the blocks' logarithms this far above zero, if it is zero."""
    sums = [np.maximum(np.bincount(block, each), 1e-300) for each in (before, after)]
    ratio = 0.5 * np.log(sums[0] / sums[1])
    spread = float(ratio.std(ddof=1)) / np.sqrt(ratio.size)
    return float(student.sf(ratio.mean() / max(spread, 1e-12), ratio.size - 1))


def _with_load(model: Model, data: Problem, nuisance: FloatArray | None = None) -> Regression:
    """The model fitted to the torque, then again with the transmitted torque that it says itself."""
    once = regressed(model, data, nuisance)
    return regressed(once.model, Data.of(data.signals, once.model, once.nuisance), once.nuisance)


def _without(effect: str, now: Fitted, method: Method) -> Fitted:
    """The fit without an effect."""
    model, nuisance = without(now.model, effect), now.inverse.nuisance
    if method is Method.MOTION:
        return Fitted.of(regressed(model, now.inverse.data, nuisance), method)
    return Fitted.of(_with_load(model, Data.of(now.inverse.data.signals, model, nuisance), nuisance), method)


def _eliminated(fits: list[Fitted], added: list[str], steps: list[Step], complete: bool, method: Method) -> Selection:
    """Without those effects that the later ones have made superfluous, as long as the others remain what their names
    say."""
    for effect in list(added):
        if len(added) < 2:
            break
        now = fits[-1]
        less = _without(effect, now, method)
        others = [name for name in added if name != effect]
        if _p(less.judged, now.judged) > LIMIT and are_apt(less.model, others):
            at = added.index(effect)
            added.remove(effect)
            fits.pop(at + 1)
            fits[-1] = less
    return Selection(tuple(fits), tuple(added), tuple(steps), complete)
