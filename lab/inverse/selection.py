"""Forward selection of effects, each validated on unseen samples, and backward elimination."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from itertools import compress
from typing import TypeVar

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over, remaining_s, within
from lostmotion.lab.fitting.identifiability import is_driven
from lostmotion.lab.inverse.candidates import (
    are_consistent,
    by_acceleration,
    candidates,
    fitted_beside,
    fitted_by_acceleration,
    fitted_with,
    refined,
    starts,
)
from lostmotion.lab.inverse.dry_friction import softened
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import Data, Problem
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.validate import (
    Fitted,
    Judged,
    Method,
    are_alike,
    continued,
    is_sized,
    judged,
    named,
    p_of,
    preferred,
    prior_odds,
)
from lostmotion.lab.selection.nesting import without
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Search", "Selection", "Step", "first_fit", "selected"]

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Search:
    """method: the error that is minimised; unseen: a recording that is not fitted, and decides between effects that
    explain the others equally well; is_fold: whether it also serves as one more fold, as there are few others; pool:
    threads, if any."""

    method: Method
    unseen: Signals | None = None
    is_fold: bool = False
    pool: Executor | None = None

    @property
    def choosing(self) -> Signals | None:
        """The recording that serves as one more fold."""
        return self.unseen if self.is_fold else None

    def each(self, work: Callable[[T], R], items: Sequence[T], first: int = 0) -> list[R]:
        """The results of ``work`` in the order of the items; items are skipped when the time is up, except the first so
        many."""

        def begun(numbered: tuple[int, T]) -> list[R]:
            number, item = numbered
            return [] if is_over() and number >= first else [work(item)]

        numbered = list(enumerate(items))
        found = self.pool.map(begun, numbered) if isinstance(self.pool, ThreadPoolExecutor) else map(begun, numbered)
        return [one for each in found for one in each]


@dataclass(frozen=True, eq=False)
class Step:
    """The candidates of one step, best first; confusable: the effects that explain as much as the first; untried: those
    skipped because the time was up."""

    judged: tuple[Judged, ...]
    confusable: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()

    @property
    def is_accepted(self) -> bool:
        """Whether the first effect is significant."""
        return bool(self.judged) and self.judged[0].is_significant


@dataclass(frozen=True, eq=False)
class Selection:
    """fits: the base's, then one after each step; labels: the effect that each step added, or both where a general one
    replaced a simpler one; steps: the candidates of each, the last one without success; untried: effects that were not
    tried beside those that were added, because time ran out."""

    fits: tuple[Fitted, ...]
    labels: tuple[str, ...]
    steps: tuple[Step, ...]
    untried: tuple[str, ...]

    @property
    def added(self) -> tuple[str, ...]:
        """The effects, in the order in which they were added."""
        return tuple(dict.fromkeys(self.labels))


def selected(
    model: Model, signals: Sequence[Signals], search: Search, progress: Callable[[str, float], None]
) -> Selection:
    """Adds effects as long as one is significant and there is time, then eliminates those that have become
    superfluous."""
    with within(policy.STAGE_SHARE * remaining_s()):
        found = _added(model, signals, search, progress)
    return _eliminated(*found, search)


def _added(
    model: Model, signals: Sequence[Signals], search: Search, progress: Callable[[str, float], None]
) -> tuple[list[Fitted], list[str], list[Step], tuple[str, ...]]:
    """The fields of a selection before the elimination."""
    now = first_fit(model, signals, search)
    fits, added, steps = [now], list[str](), list[Step]()
    untried: tuple[str, ...] = ()
    while len(added) < policy.MOST_EFFECTS:
        progress("looking for more" if added else "looking for what is missing", 0.15 + 0.12 * len(added))
        found = _step(now, tuple(added), search)
        if better := _better_without(found, now, search.method):
            now = fits[-1] = better
            continue
        several = [found] if found.is_accepted else _two(found, now, tuple(added), search)
        several = [] if several and _is_slight(several[-1], now, fits[0]) else several
        steps += several or [found]
        for step in several:
            best = step.judged[0]
            now = _with(best, now, search.method)
            fits.append(now)
            added.append(best.effect)
            held = now.model.effects  # a general effect replaces a simpler one, with the share that it explained
            added = [effect if effect in held else best.effect for effect in added]
        untried = found.untried
        if is_over():  # the fits of the last step, which added nothing or other effects, are incomplete
            cut_short = steps[-1].judged[1:] if several else steps[-1].judged
            untried = tuple(dict.fromkeys([*(one.effect for one in cut_short), *untried]))
        if not several or is_over():
            break
    return fits, added, steps, untried


def _better_without(step: Step, now: Fitted, method: Method) -> Fitted | None:
    """The present model, refitted from its values in the fit with the new effect; None where that is no better.  A fit
    of a motion may have ended in a local minimum, out of which any effect would lead."""
    if method is not Method.MOTION or not step.is_accepted or is_over():
        return None
    best = step.judged[0]
    if set(best.fit.model.effects) != {*now.model.effects, best.effect}:
        return None
    less = _without(best.effect, best.fitted, method)
    return less if less.judged.rms < math.sqrt(1 - policy.LEAST_GAIN) * now.judged.rms else None


def _is_slight(step: Step, now: Fitted, first: Fitted) -> bool:
    """Whether an accepted step reduces the error of the first model only slightly, however significant it is."""
    taken = now.judged.rms**2 - step.judged[0].fit.rms ** 2
    return taken < policy.LEAST_SHARE * first.judged.rms**2


def _rms(fit: Regression) -> float:
    return fit.rms


def _two(step: Step, now: Fitted, added: tuple[str, ...], search: Search) -> list[Step]:
    """The steps of a pair of effects, where neither is significant alone; none where no pair is.

    With gravity, viscous and Coulomb friction the first one added leaves the other two confounded (UR10e, joint 4).  A
    pair is tested against neither effect, corrected for all pairs, and against each effect alone.  Gravity without
    damping is out of phase after some swings, and predicts nothing: what explains the acceleration comes first.  Pairs
    are not tried for simulated motions: each fit takes seconds.
    """
    if search.method is Method.MOTION:
        return []
    alone = {one.effect: one for one in step.judged}
    pairs = len(alone) * (len(alone) - 1) / 2
    least = math.sqrt(1 - policy.LEAST_GAIN) * now.inverse.rms
    promising = [one for one in step.judged if one.fitted.inverse.rms < least]
    promising.sort(key=lambda one: one.fitted.inverse.rms)
    found: list[list[Step]] = []
    for first in promising[: policy.FIRSTS]:
        second = _step(_with(first, now, search.method), (*added, first.effect), search)
        if not second.is_accepted:
            continue
        both = second.judged[0]
        others = (now.judged, *(alone[name].fit for name in (both.effect,) if name in alone))
        if all(pairs * p_of(one, both.fit, search.choosing) < policy.FALSE_NAME for one in others):
            found.append([Step((first, *(one for one in step.judged if one is not first))), second])
    least = min((two[1].judged[0].fit.rms for two in found), default=0.0)
    alike = [two for two in found if two[1].judged[0].fit.rms ** 2 * (1 - policy.LEAST_GAIN) <= least**2]
    best = min(alike, key=lambda two: preferred(two[0].judged[0], now.inverse), default=[])
    return _stronger_first(best, alone) if best else []


def _stronger_first(two: Sequence[Step], alone: Mapping[str, Judged]) -> list[Step]:
    """The two steps, ordered so that the effect with the smaller error alone comes first."""
    first, both = two[0].judged[0], two[1].judged[0]
    other = alone.get(both.effect)
    if other is None or other.fit.rms >= first.fit.rms:
        return list(two)
    rest = [one for one in two[0].judged if one.effect != other.effect]
    swapped = replace(both, effect=first.effect)
    return [Step((other, *rest), untried=two[0].untried), replace(two[1], judged=(swapped, *two[1].judged[1:]))]


def first_fit(model: Model, signals: Sequence[Signals], search: Search) -> Fitted:
    """Fits the model without further effects."""
    if search.method is Method.MOTION:
        is_moved = any(is_driven(one.experiment) for one in signals)
        fit = regressed if is_moved else continued
        begun = [(start, OutputError.of(signals, start)) for start in starts(model, signals)]
        best = min((fit(*entry) for entry in _promising(begun)), key=_rms)
        return Fitted(best, best)
    data = Data.of(signals, model)
    return Fitted.of(_with_load(softened(model, signals), data), search.method)


def _promising(begun: list[tuple[Model, OutputError]]) -> list[tuple[Model, OutputError]]:
    """The starts with a smaller error than no motion, or all where there are none: a bar of 58 Hz in the file had 110 s
    of a pendulum simulated in steps of 0.4 ms, which took all of the time."""
    near = [
        (start, data) for start, data in begun
        if np.mean(data.residual(start, data.nuisance) ** 2) < data.error_at_rest**2
    ]  # fmt: skip
    return near or begun


def _with(best: Judged, now: Fitted, method: Method) -> Fitted:
    """The fit with the added effect."""
    if method is Method.MOTION:
        return best.fitted
    inverse = _with_load(best.fit.model, now.inverse.data, best.fitted.inverse.nuisance)
    return Fitted(inverse, best.fit if method is Method.FREE else inverse)


def _step(now: Fitted, added: tuple[str, ...], search: Search) -> Step:
    """Judges all candidates against the present fit."""
    wide = list(candidates(now.inverse.model, added, now.inverse.data))
    with within(policy.STAGE_SHARE * remaining_s()):
        fits, failed = _fitted_each(wide, now.inverse, search)
    prior = prior_odds([name for name, _ in wide], now.inverse.model.effects)
    tried = sum(prior.values())

    def work(one: tuple[str, Regression]) -> Judged:
        fitted = _as_judged(*one, now, search.method)
        return judged(one[0], fitted, now, tried / prior[one[0]], search.choosing)

    found = search.each(work, fits, first=1)
    found.sort(key=lambda one: -one.gain)
    untried = tuple(name for name, _ in wide if name not in {*(one.effect for one in found), *failed})
    good = [one for one in found if one.is_significant]
    if not good:
        return Step(tuple(sorted(found, key=lambda one: one.p_value)), untried=untried)
    alike = [one for one in good if are_alike(one, good[0], tried, search.choosing)]
    first = named(alike, now.inverse, search.unseen)
    rest = [one for one in found if one is not first]
    return Step((first, *rest), tuple(one.effect for one in alike if one is not first), untried)


def _as_judged(name: str, inverse: Regression, now: Fitted, method: Method) -> Fitted:
    """The fit that is judged.  For a free motion it begins with the estimates from the acceleration, or with the
    present ones where these explain nothing: the acceleration does not show a small damping."""
    found = Fitted.of(inverse, method)
    if method is not Method.FREE or found.judged.rms < math.sqrt(1 - policy.LEAST_GAIN) * now.judged.rms:
        return found
    other = fitted_beside(name, inverse.model, now.judged)
    return Fitted(inverse, other) if other and other.rms < found.judged.rms else found


def _fitted_each(
    wide: Sequence[tuple[str, Model]], now: Regression, search: Search
) -> tuple[list[tuple[str, Regression]], list[str]]:
    """The candidates with their fits, as far as the time allowed, and those that cannot be fitted.

    Fits to a simulated motion are ordered by how well they explain the acceleration, which needs no simulation, and the
    best of them are finished.
    """
    is_simulated = search.method is Method.MOTION
    inverse = by_acceleration(now.model, now.data.signals) if is_simulated else None
    begun = dict(search.each(lambda one: (one[0], fitted_by_acceleration(*one, inverse)), wide if inverse else []))
    wide = sorted(wide, key=lambda one: fit.rms if (fit := begun.get(one[0])) else math.inf)
    tried = search.each(lambda one: (one[0], fitted_with(*one, now, begun.get(one[0]))), wide)
    found = [(name, fit) for name, fit in tried if fit]
    failed = [] if is_over() else [name for name, fit in tried if fit is None]
    if not is_simulated:
        return found, failed
    found.sort(key=lambda one: one[1].rms)
    least = math.sqrt(1 - policy.LEAST_PROMISE) * now.rms
    many = min(sum(fit.rms < least for _, fit in found), policy.FINISHED)
    finished = search.each(lambda one: (one[0], refined(one[1])), found[:many])
    return [*finished, *found[len(finished) :]], failed


def _with_load(model: Model, data: Problem, nuisance: FloatArray | None = None) -> Regression:
    """The model fitted to the torque, then again with the transmitted torque of that fit."""
    once = regressed(model, data, nuisance)
    return regressed(once.model, Data.of(data.signals, once.model, once.nuisance), once.nuisance)


def _without(effect: str, now: Fitted, method: Method) -> Fitted:
    """The fit without an effect; a motion is refitted from the present values."""
    model, nuisance = without(now.model, effect), now.inverse.nuisance
    if method is Method.MOTION:
        data = now.inverse.data
        if isinstance(data, OutputError):
            data, nuisance = data.trimmed(model, nuisance)
        return Fitted.of(regressed(model, data, nuisance), method)
    inverse = _with_load(model, Data.of(now.inverse.data.signals, model, nuisance), nuisance)
    judged = regressed(model, now.judged.data, now.judged.nuisance) if method is Method.FREE else inverse
    return Fitted(inverse, judged)


def _eliminated(
    fits: list[Fitted], added: list[str], steps: list[Step], untried: tuple[str, ...], search: Search
) -> Selection:
    """Eliminates effects that later ones have made superfluous, or with a size that is no longer identified, as long as
    the estimates of the others agree with their definitions."""
    for effect in dict.fromkeys(added):
        if len(set(added)) < 2 or is_over():
            break
        now = fits[-1]
        less = _without(effect, now, search.method)
        others = [name for name in added if name != effect]
        is_needed = p_of(less.judged, now.judged, search.choosing) < policy.FALSE_NAME and is_sized(effect, now.judged)
        if not is_needed and are_consistent(less.model, others):
            kept = [name != effect for name in added]
            fits = [fits[0], *compress(fits[1:], kept)]
            added = list(compress(added, kept))
            fits[-1] = less
    return Selection(tuple(fits), tuple(added), tuple(steps), untried)
