"""Forward selection of effects: one search for every likelihood.

A likelihood fits models and predicts unseen samples; what is a candidate, and what decides, stands here and in
evidence.py.  Effects are added as long as one predicts unseen samples better, significantly for all candidates and by
enough; those that later ones have made superfluous are eliminated (backward.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over, remaining_s, within
from lostmotion.lab.parallel import each
from lostmotion.lab.selection.backward import eliminated, relabelled
from lostmotion.lab.selection.evidence import (
    Candidate,
    Fit,
    Predictions,
    are_alike,
    are_consistent,
    in_common,
    in_turn,
    prior_odds,
    shapes_tried,
    simplest,
)
from lostmotion.lab.selection.search import Likelihood, Selection, Step
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS

__all__ = ["batches", "distinguished", "named", "selected", "until_accepted"]

F = TypeVar("F", bound=Fit)


def selected(
    likelihood: Likelihood[F], progress: Callable[[str, float], None], begun: Selection[F] | None = None
) -> Selection[F]:
    """Adds effects as long as one is significant and there is time, then eliminates those that have become
    superfluous.  begun: a search by another likelihood, which this one goes on with."""
    now = likelihood.accepted(begun.fits[-1], begun.fits[-1]) if begun else likelihood.first
    fits = [*begun.fits[:-1], now] if begun else [now]
    added, steps, untried = (list(begun.added), list(begun.steps), begun.untried) if begun else ([], [], ())
    with within(policy.STAGE_SHARE * remaining_s()):
        while len(added) < policy.MOST_EFFECTS:
            progress("looking for more" if added else "looking for what is missing", 0.15 + 0.12 * len(added))
            found, several = _advanced(now, tuple(added), likelihood)
            steps += several or [found]
            for one in several:
                now = likelihood.accepted(one.judged[0].fit, now)
                fits.append(now)
                added = relabelled([*added, one.judged[0].effect], fits[0].model.effects, now.model.effects)
            untried = found.untried
            if is_over():  # the fits of the last step, which added nothing or other effects, are incomplete
                cut_short = steps[-1].judged[1:] if several else steps[-1].judged
                untried = tuple(dict.fromkeys([*(one.effect for one in cut_short), *untried]))
            if not several or is_over():
                break
    own = fits[len(begun.fits) if begun else 0 :]
    return eliminated(Selection(tuple(fits), tuple(added), tuple(steps), untried), likelihood, own)


def distinguished(found: Selection[F], likelihood: Likelihood[F]) -> Selection[F]:
    """The result of a search with what ``Selection.distinct`` is, as far as the time allows.

    Two effects may explain as much while another one is missing: the weight of a robot's arm and drag were not
    distinguished, but beside its viscous friction, which was found next, drag leaves four times the error.
    """
    distinct: dict[str, list[str]] = {}
    if likelihood.is_held_out or len(found.added) < 2:
        return found
    for name, *alike in found.confusable:
        for other in alike if name in found.lacking else ():
            best = min(_with(other, found.lacking[name], likelihood), key=lambda one: one.rms, default=None)
            if best and not is_over() and likelihood.predictions(best, found.fits[-1], of_all=True).is_better():
                distinct.setdefault(name, []).append(other)
    return replace(found, distinct=distinct)


def _with(effect: str, now: F, likelihood: Likelihood[F]) -> list[F]:
    """The fits of the present model with this effect."""
    return [fit for batch in likelihood.proposals(now, (), [effect]) for _, fit in batch.fits]


def until_accepted(steps: Iterable[Step[F]]) -> Step[F]:
    """The first of these in which a candidate is accepted, else the last one."""
    found = Step[F](())
    for found in steps:
        if found.is_accepted:
            break
    return found


def batches(now: F, added: tuple[str, ...], likelihood: Likelihood[F], only: Sequence[str] = ()) -> Iterator[Step[F]]:
    """The candidates beside the present fit, judged after each batch of proposals: those of all batches so far; only:
    see ``proposals``."""
    found, ranked = list[tuple[str, F]](), Step[F](())
    for batch in likelihood.proposals(now, added, only):
        found += batch.fits
        ranked = replace(
            _ranked(found, batch.rejected, now, likelihood) if batch.fits else ranked,
            untried=batch.untried, rejected=batch.rejected, detectable=batch.detectable, begin=batch.begin,
            has_more=batch.has_more,
        )  # fmt: skip
        yield ranked


def _advanced(now: F, added: tuple[str, ...], likelihood: Likelihood[F]) -> tuple[Step[F], list[Step[F]]]:
    """The candidates of a step, and the steps of what is accepted: of one effect, of a pair, or none.

    After each batch without success a pair is tried that begins with the leading candidate, before the search goes on
    with the next batch; its second effect is of the first batch.
    """
    found, pairs = Step[F](()), dict[str, _Pair[F]]()
    for found in batches(now, added, likelihood):
        if found.is_accepted:
            return found, [found]
        leading = _leading(found, now, likelihood) if found.has_more and likelihood.tries_pairs(added) else None
        if leading and leading.effect not in pairs and leading.fit.screened < policy.MISSED:
            pairs[leading.effect] = pair = _pair_with(leading, (), now, added, likelihood)
            pair.second = next(pair.rest, pair.second)
            if steps := _steps_of(pair, found, now, likelihood):
                return found, steps
    return found, _pair(found, now, added, likelihood, pairs)


def _leading(found: Step[F], now: F, likelihood: Likelihood[F]) -> Candidate[F] | None:
    """The candidate that explains most of what proposes candidates, of equals one that ``_is_preferred``; None where
    none explains more than the present fit."""
    best = min((one.fit.screened for one in found.judged), default=math.inf)
    promising = [one for one in found.judged if not policy.is_less(best, one.fit.screened)]
    if not policy.is_less(best, now.screened):
        return None
    return min(promising, key=lambda one: (not _is_preferred(one, likelihood.turns), one.fit.screened), default=None)


def _ranked(
    fits: Sequence[tuple[str, F]], rejected: Sequence[str], now: F, likelihood: Likelihood[F]
) -> Step[F]:  # fmt: skip
    """The candidates, best first; of those that explain the data equally well the one that is ``named``."""
    prior = prior_odds([*(effect for effect, _ in fits), *rejected], now.model.effects)
    tried = sum(prior.values())
    counts = in_turn(fits) if likelihood.is_held_out else {name: tried / odds for name, odds in prior.items()}
    pool = likelihood.pool
    predicted = each(pool, lambda one: likelihood.predictions(now, one[1]), fits, first=1)
    common = in_common([(effect, predictions) for (effect, _), predictions in predicted], counts)

    def judged(one: tuple[tuple[str, F], Predictions]) -> Candidate[F]:
        (effect, fit), predictions = one
        p_value = common * counts[effect] * shapes_tried(effect, fit.model) * predictions.p_value
        least = likelihood.least_gain(fit, now)
        may_be_named = p_value < policy.FALSE_NAME and predictions.gain > least
        is_identified = not may_be_named or (likelihood.is_sized(effect, fit) and are_consistent(fit.model, [effect]))
        blocks = int(predictions.block.max()) + 1
        return Candidate(effect, fit, predictions.gain, min(p_value, 1.0), blocks, is_identified, least)

    best = dict[str, Candidate[F]]()
    for one in sorted((one for _, one in each(pool, judged, predicted, first=1)), key=lambda one: -one.gain):
        best.setdefault(one.effect, one)  # two fits of one effect may have been proposed
    found = [one for one in best.values() if not one.is_significant or _exceeds(one, now, likelihood)]
    good = [one for one in found if one.is_significant]
    if not good:
        return Step(tuple(sorted(found, key=lambda one: one.p_value)))
    alike = [one for one in good if are_alike(one, good[0], tried, likelihood.predictions(one.fit, good[0].fit))]
    first = named(alike, likelihood)
    rest = [one for one in found if one is not first]
    return Step(
        (first, *rest), tuple(one.effect for one in rest if one in alike and _is_confusable(one, first, likelihood))
    )


def _exceeds(one: Candidate[F], now: F, likelihood: Likelihood[F]) -> bool:
    """Whether an effect predicts significantly better than its rivals, by ``policy.RIVAL_GAIN`` of their error; not
    where the time was not enough to fit them."""
    rivals = get_effect(one.effect).rivals
    if {*rivals} <= {*now.model.effects}:
        return True
    found = [likelihood.predictions(fit, one.fit) for fit in _with(rivals[-1], now, likelihood)]
    return bool(found) and all(each.gain > policy.RIVAL_GAIN and each.p_value < policy.FALSE_NAME for each in found)


def named(alike: Sequence[Candidate[F]], likelihood: Likelihood[F]) -> Candidate[F]:
    """Chooses one of several effects that explain the data equally well: of those that predict all unseen samples best
    a simple one, then one that ``_is_preferred``."""
    if len(alike) == 1:
        return alike[0]
    left = [math.sqrt(likelihood.predictions(one.fit, alike[0].fit, of_all=True).usual) for one in alike]
    least = min(left)
    best = [one for one, error in zip(alike, left, strict=True) if not policy.is_less(least, error)]
    return min(simplest(best), key=lambda one: (not _is_preferred(one, likelihood.turns), one.fit.rms))


def _is_confusable(one: Candidate[F], first: Candidate[F], likelihood: Likelihood[F]) -> bool:
    """Whether the last recording does not distinguish an effect from the one that was chosen of those that are alike in
    the folds: beside the friction of a pendulum viscous friction left 2.5° of it, drag 0.23."""
    last = likelihood.on_last(one.fit, first.fit)
    return last is None or not last.is_better()


def _is_preferred(one: Candidate[F], turns: float) -> bool:
    """Whether an effect is periodic where a shaft turns, and not periodic elsewhere."""
    return (f"{one.effect}.N" in one.fit.model.parameters) == (turns >= SHAFT_TURNS)


@dataclass(eq=False)
class _Pair(Generic[F]):
    """A pair that begins with a candidate, and its second effect as far as that was searched."""

    begun: Candidate[F]
    first: Candidate[F]
    """The candidate with the fit from which the second effect is searched."""
    rest: Iterator[Step[F]]
    """The batches of the second effect that were not tried."""
    second: Step[F] = field(default_factory=lambda: Step(()))


def _pair_with(
    begun: Candidate[F], only: Sequence[str], now: F, added: tuple[str, ...], likelihood: Likelihood[F]
) -> _Pair[F]:  # fmt: skip
    """The pair that begins with a candidate; only: see ``proposals``."""
    first = replace(begun, fit=likelihood.accepted(begun.fit, now, is_first=True))
    return _Pair(begun, first, batches(first.fit, (*added, first.effect), likelihood, only))


def _pair(
    step_alone: Step[F], now: F, added: tuple[str, ...], likelihood: Likelihood[F], tried: Mapping[str, _Pair[F]]
) -> list[Step[F]]:  # fmt: skip
    """The steps of a pair of effects, where neither is significant alone; none where no pair is.

    A pair is tested against neither effect, corrected for all pairs, and against each effect alone.  Its first effect
    is the one that explains most of what proposes candidates, of equals one that ``_is_preferred``: gravity without
    damping is out of phase after some swings, and predicts nothing.  Where none explains more than the present fit, it
    is the best one that only takes too little to be named.  Another pair is the ``damping_pair``.  Where neither is
    significant, a pair begins with the ``begin`` of the step.  tried: the pairs whose first batch was tried, by their
    first effect; the search goes on with the next one.
    """
    alone = {one.effect: one for one in step_alone.judged}

    def steps(begun: Candidate[F], only: Sequence[str]) -> list[Step[F]]:
        pair = None if only else tried.get(begun.effect)
        if pair is None or pair.begun.fit is not begun.fit:
            pair = _pair_with(begun, only, now, added, likelihood)
        if not pair.second.is_accepted:
            pair.second = until_accepted(pair.rest)
        return _steps_of(pair, step_alone, now, likelihood)

    leading = _leading(step_alone, now, likelihood)
    leading = leading or next((one for one in step_alone.judged if one.takes_too_little), None)
    tries: list[tuple[Candidate[F], Sequence[str]]] = []
    if leading and likelihood.tries_pairs(added):
        tries.append((leading, ()))
    if (dampings := likelihood.damping_pair(now)) and alone.keys() >= {*dampings}:
        tries.append((alone[dampings[0]], dampings[1:]))
    found = [pair for one in tries if (pair := steps(*one))]
    if step_alone.begin and not found:
        effect, fit = step_alone.begin
        known = alone.get(effect, Candidate(effect, fit, gain=0.0, p_value=1.0, blocks=1))
        return steps(replace(known, fit=fit), ())
    return min(found, key=lambda two: two[1].judged[0].fit.rms, default=[])


def _steps_of(pair: _Pair[F], step_alone: Step[F], now: F, likelihood: Likelihood[F]) -> list[Step[F]]:
    """The steps of a pair, none where it is not significant."""
    alone, first, second = {one.effect: one for one in step_alone.judged}, pair.first, pair.second
    if not second.is_accepted:
        return []
    both = second.judged[0]
    others = (now, *(alone[name].fit for name in (both.effect,) if name in alone))
    pairs = len(alone) * (len(alone) - 1) / 2
    p_value = max(pairs * likelihood.predictions(one, both.fit).p_value for one in others)
    if p_value >= policy.FALSE_NAME:
        return []
    first, both = replace(first, p_value=p_value), replace(both, p_value=p_value)
    rest = (one for one in step_alone.judged if one.effect != first.effect)
    alone_first = Step((first, *rest), untried=step_alone.untried)
    return [alone_first, replace(second, judged=(both, *second.judged[1:]))]
