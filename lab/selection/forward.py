"""Forward selection of effects, and backward elimination: one search for every likelihood.

A likelihood fits models and predicts unseen samples; what is a candidate, and what decides, stands here and in
evidence.py.  Effects are added as long as one predicts unseen samples better, significantly for all candidates and by
enough; those that later ones have made superfluous are eliminated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Generic, Protocol, TypeVar

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over, remaining_s, within
from lostmotion.lab.parallel import each
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
from lostmotion.lab.selection.nesting import reduced, simplified
from lostmotion.model import Model
from lostmotion.model.effects.base import SHAFT_TURNS

__all__ = ["Likelihood", "Proposals", "Selection", "Step", "named", "selected", "step"]

F = TypeVar("F", bound=Fit)


@dataclass(frozen=True, eq=False)
class Proposals(Generic[F]):
    """Fits with one more effect each; untried: effects that were not fitted because the time was up; rejected: those
    that the data of the fit do not show, which count as tried; detectable: the size at which they would have, with the
    parameter's name."""

    fits: Sequence[tuple[str, F]]
    untried: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)


class Likelihood(Protocol[F]):
    """What the search needs: fits, and predictions of samples that they have not seen.

    pool: for predictions, in parallel; turns: of the motion;
    is_held_out: whether the predicted samples are of recordings that no fit has used, not of folds.
    """

    @property
    def pool(self) -> Executor | None: ...
    @property
    def turns(self) -> float: ...
    @property
    def is_held_out(self) -> bool: ...
    @property
    def first(self) -> F:
        """The fit of the model as it is."""

    def proposals(self, now: F, added: tuple[str, ...], only: Sequence[str] = ()) -> Iterable[Proposals[F]]:
        """Fits with one more effect, in batches: a later one is asked for only where none before is accepted.  only:
        the effects that are asked for, all for ()."""

    def tries_pairs(self, added: tuple[str, ...]) -> bool:
        """Whether a pair is tried where no single effect is accepted."""

    def opposed(self, now: F) -> Sequence[str]:
        """Two effects that are tried as a pair, () for none: see ``nesting.around``."""

    def accepted(self, fit: F, now: F) -> F:
        """The fit with an effect that was accepted, from which the search goes on."""

    def refitted(self, model: Model, fit: F) -> F:
        """The fit of a model with less than that of a fit, from its values."""

    def predictions(self, one: F, other: F, *, of_all: bool = False, is_last: bool = False) -> Predictions:
        """Errors of two fits at unseen samples; of_all: also of the last recording where the others suffice; is_last:
        in the blocks of the reported interval, as in the last fits of the search."""

    def on_last(self, one: F, other: F) -> Predictions | None:
        """Errors of two fits on the last recording; None where they cannot be compared there, and where ``predictions``
        are of that recording."""

    def least_gain(self, fit: F, now: F) -> float:
        """The share of the squared error that an effect must take to be named."""

    def is_sized(self, effect: str, fit: F) -> bool:
        """Whether the size of an effect differs from zero."""


@dataclass(frozen=True, eq=False)
class Step(Generic[F]):
    """The candidates of one step, best first; confusable: the effects that explain as much as the first; untried,
    rejected, detectable: see ``Proposals``."""

    judged: tuple[Candidate[F], ...]
    confusable: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)

    @property
    def is_accepted(self) -> bool:
        """Whether the first effect is significant."""
        return bool(self.judged) and self.judged[0].is_significant


@dataclass(frozen=True, eq=False)
class Selection(Generic[F]):
    """added: the effects, in the order in which the search found them; fits: of the model without them, with the first,
    with the first two, …; lacking: for each of them the fit with all others, if the elimination made one; steps: the
    candidates of each step, the last one without success; untried: effects that were not tried beside those that were
    added, because time ran out."""

    fits: tuple[F, ...]
    added: tuple[str, ...]
    steps: tuple[Step[F], ...]
    untried: tuple[str, ...] = ()
    lacking: Mapping[str, F] = field(default_factory=dict)

    @property
    def confusable(self) -> tuple[tuple[str, ...], ...]:
        """Each added effect with those that explained as much and were not added: two effects that are both needed are
        not confusable."""
        tried = [step for step in self.steps if step.judged]
        groups = [(one.judged[0].effect, *(e for e in one.confusable if e not in self.added)) for one in tried]
        return tuple(group for group in groups if len(group) > 1 and group[0] in self.added)


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
            found = step(now, tuple(added), likelihood)
            several = [found] if found.is_accepted else _pair(found, now, tuple(added), likelihood)
            steps += several or [found]
            for one in several:
                now = likelihood.accepted(one.judged[0].fit, now)
                fits.append(now)
                added = _relabelled([*added, one.judged[0].effect], fits[0].model.effects, now.model.effects)
            untried = found.untried
            if is_over():  # the fits of the last step, which added nothing or other effects, are incomplete
                cut_short = steps[-1].judged[1:] if several else steps[-1].judged
                untried = tuple(dict.fromkeys([*(one.effect for one in cut_short), *untried]))
            if not several or is_over():
                break
    own = fits[len(begun.fits) if begun else 0 :]
    return _eliminated(Selection(tuple(fits), tuple(added), tuple(steps), untried), likelihood, own)


def _relabelled(added: Sequence[str], own: Sequence[str], effects: Sequence[str]) -> list[str]:
    """The effects that the steps added; in the place of one that is no longer in the model is the effect that replaced
    it, one without a step of its own or the last one."""
    new = (effect for effect in effects if effect not in own and effect not in added)
    place = [effect if effect in effects else next(new, added[-1]) for effect in added]
    return list(dict.fromkeys(place))


def step(now: F, added: tuple[str, ...], likelihood: Likelihood[F], only: Sequence[str] = ()) -> Step[F]:
    """Judges the candidates against the present fit; only: see ``proposals``."""
    found, ranked = list[tuple[str, F]](), Step[F](())
    for batch in likelihood.proposals(now, added, only):
        found += batch.fits
        ranked = replace(
            _ranked(found, batch.rejected, now, likelihood),
            untried=batch.untried, rejected=batch.rejected, detectable=batch.detectable,
        )  # fmt: skip
        if ranked.is_accepted:
            break
    return ranked


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
        is_worth_a_name = predictions.gain > least
        is_identified = not is_worth_a_name or (
            likelihood.is_sized(effect, fit) and are_consistent(fit.model, [effect])
        )
        blocks = int(predictions.block.max()) + 1
        return Candidate(effect, fit, predictions.gain, min(p_value, 1.0), blocks, is_identified, least)

    best = dict[str, Candidate[F]]()
    for one in sorted((one for _, one in each(pool, judged, predicted, first=1)), key=lambda one: -one.gain):
        best.setdefault(one.effect, one)  # two fits of one effect may have been proposed
    found = list(best.values())
    good = [one for one in found if one.is_significant]
    if not good:
        return Step(tuple(sorted(found, key=lambda one: one.p_value)))
    alike = [one for one in good if are_alike(one, good[0], tried, likelihood.predictions(one.fit, good[0].fit))]
    first = named(alike, likelihood)
    rest = [one for one in found if one is not first]
    return Step(
        (first, *rest), tuple(one.effect for one in rest if one in alike and _is_confusable(one, first, likelihood))
    )


def named(alike: Sequence[Candidate[F]], likelihood: Likelihood[F]) -> Candidate[F]:
    """Chooses one of several effects that explain the data equally well: of those that predict all unseen samples best
    a simple one, then one that ``_is_preferred``."""
    if len(alike) == 1:
        return alike[0]
    left = [likelihood.predictions(one.fit, alike[0].fit, of_all=True).usual for one in alike]
    best = [one for one, error in zip(alike, left, strict=True) if error * (1 - policy.LEAST_GAIN) <= min(left)]
    return min(simplest(best), key=lambda one: (not _is_preferred(one, likelihood.turns), one.fit.rms))


def _is_confusable(one: Candidate[F], first: Candidate[F], likelihood: Likelihood[F]) -> bool:
    """Whether the last recording does not distinguish an effect from the one that was chosen of those that are alike in
    the folds: beside the friction of a pendulum viscous friction left 2.5° of it, drag 0.23."""
    last = likelihood.on_last(one.fit, first.fit)
    return last is None or not last.is_better()


def _is_preferred(one: Candidate[F], turns: float) -> bool:
    """Whether an effect is periodic where a shaft turns, and not periodic elsewhere."""
    return (f"{one.effect}.N" in one.fit.model.parameters) == (turns >= SHAFT_TURNS)


def _pair(step_alone: Step[F], now: F, added: tuple[str, ...], likelihood: Likelihood[F]) -> list[Step[F]]:
    """The steps of a pair of effects, where neither is significant alone; none where no pair is.

    A pair is tested against neither effect, corrected for all pairs, and against each effect alone.  Its first effect
    is the one that explains most of what proposes candidates, of equals one that ``_is_preferred``: gravity without
    damping is out of phase after some swings, and predicts nothing.  Where none explains more than the present fit, it
    is the best one that only takes too little to be named.  The other pair is that of ``opposed``.
    """
    alone = {one.effect: one for one in step_alone.judged}
    pairs = len(alone) * (len(alone) - 1) / 2
    less = math.sqrt(1 - policy.LEAST_GAIN)
    best = min((one.fit.screened for one in alone.values()), default=math.inf)
    promising = [one for one in alone.values() if less * one.fit.screened <= best < less * now.screened]
    promising = promising or [one for one in alone.values() if one.takes_too_little][:1]
    found: list[list[Step[F]]] = []
    tries: list[tuple[Candidate[F], Sequence[str]]] = []
    if promising and likelihood.tries_pairs(added):
        leading = min(promising, key=lambda one: (not _is_preferred(one, likelihood.turns), one.fit.screened))
        tries.append((leading, ()))
    if alone.keys() >= {*(opposed := likelihood.opposed(now))} and opposed:
        tries.append((alone[opposed[0]], opposed[1:]))
    for begun, only in tries:
        first = replace(begun, fit=likelihood.accepted(begun.fit, now))
        second = step(first.fit, (*added, first.effect), likelihood, only)
        if not second.is_accepted:
            continue
        both = second.judged[0]
        others = (now, *(alone[name].fit for name in (both.effect,) if name in alone))
        p_value = max(pairs * likelihood.predictions(one, both.fit).p_value for one in others)
        if p_value < policy.FALSE_NAME:
            first, both = replace(first, p_value=p_value), replace(both, p_value=p_value)
            rest = (one for one in step_alone.judged if one.effect != first.effect)
            alone_first = Step((first, *rest), untried=step_alone.untried)
            found.append([alone_first, replace(second, judged=(both, *second.judged[1:]))])
    return min(found, key=lambda two: two[1].judged[0].fit.rms, default=[])


def _eliminated(found: Selection[F], likelihood: Likelihood[F], own: Sequence[F]) -> Selection[F]:
    """Eliminates effects that later ones have made superfluous, that only led a fit out of another minimum, whose size
    is no longer identified, or with which the last recording is predicted worse, as long as the estimates of the others
    agree with their definitions.  A law gives way to its simpler part where that predicts as well.

    Where one is eliminated, those that were needed beside it are asked again.  own: fits of this search.  Of one with
    the same effects and the fit that begins without the effect the better one counts, as the latter may end in another
    minimum.
    """
    first, now, added = found.fits[0].model, found.fits[-1], list(found.added)
    left, lacking = [*added], dict[str, F]()

    def refitted(model: Model) -> F:
        return min([likelihood.refitted(model, now), *_alike(own, model)], key=lambda one: one.rms)

    while left and not is_over():
        effect = left.pop(0)
        less, others = refitted(reduced(now.model, effect, first)), [name for name in added if name != effect]
        if not _is_needed(effect, less, now, likelihood) and are_consistent(less.model, others):
            now, added = less, others
            left, lacking = [*left, *lacking], {}
        elif (simple := simplified(now.model, effect, first)) and _is_enough(part := refitted(simple), now, likelihood):
            now, added = part, _relabelled(added, first.effects, part.model.effects)
        else:
            lacking[effect] = less
    path = _path(found.fits, now, added, refitted)
    return replace(found, fits=path, added=tuple(added), lacking=lacking)


def _alike(fits: Iterable[F], model: Model) -> list[F]:
    """The fits with the effects of a model."""
    return [one for one in fits if {*one.model.effects} == {*model.effects}]


def _path(fits: Sequence[F], now: F, added: Sequence[str], refitted: Callable[[Model], F]) -> tuple[F, ...]:
    """The fits with none of the added effects, with the first, the first two, …: those of the search that have no other
    effects, else new ones.  When the time is up those of the search count as they are."""
    path, model = [now], now.model
    for count in reversed(range(1, len(added))):
        model = reduced(model, added[count], fits[0].model)
        known = _alike(fits, model)
        path.append(min(known, key=lambda one: one.rms) if known else fits[count] if is_over() else refitted(model))
    return (fits[0], *reversed(path)) if added else (now,)


def _is_needed(effect: str, less: F, now: F, likelihood: Likelihood[F]) -> bool:
    """Whether a fit without an effect is not enough, and the size of the effect is identified."""
    return likelihood.is_sized(effect, now) and not _is_enough(less, now, likelihood)


def _is_enough(less: F, now: F, likelihood: Likelihood[F]) -> bool:
    """Whether a fit with less predicts as well.  The last recording decides where it prefers one of both significantly,
    else the folds do.

    The folds have the motions of the fit, to which a curve of a wrong shape can be bent: a cubic spring took a third of
    the error of two recordings of a mass on a spring, and raised that of the third from 16 to 27 mm (p = 0.01).  Of
    another mass, on a cart, six blocks of the folds did not show Coulomb friction (p = 0.053), which 15 % of the error
    of the last recording did (p = 0.0005).
    """
    worse, better = likelihood.on_last(less, now), likelihood.on_last(now, less)
    if better is not None and better.p_value < policy.FALSE_NAME:
        return True
    if worse is not None and worse.p_value < policy.FALSE_NAME:
        return False
    return not _is_worse(less, now, likelihood)


def _is_worse(less: F, now: F, likelihood: Likelihood[F]) -> bool:
    """Whether a fit with less predicts significantly worse.  Where it falls far behind, its predictions, which take
    time, are not computed."""
    if less.rms > policy.BEHIND * now.rms:
        return True
    return likelihood.predictions(less, now, is_last=True).p_value < policy.FALSE_NAME
