"""Backward elimination: the effects of a search that are superfluous once all of them are in the model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from lostmotion.lab import policy
from lostmotion.lab.deadline import is_over
from lostmotion.lab.selection.evidence import Fit, are_consistent
from lostmotion.lab.selection.nesting import reduced, simplified
from lostmotion.lab.selection.search import Likelihood, Selection
from lostmotion.model import Model

__all__ = ["eliminated", "relabelled"]

F = TypeVar("F", bound=Fit)


def eliminated(found: Selection[F], likelihood: Likelihood[F], own: Sequence[F]) -> Selection[F]:
    """Eliminates effects that later ones have made superfluous, that only led a fit out of another minimum, whose size
    is no longer identified, or with which the last recording is predicted worse, as long as the estimates of the others
    agree with their definitions.  A law gives way to its simpler part where that predicts as well, or where the data do
    not identify what the law has beyond it.

    Of several that are superfluous the one is eliminated without which unseen samples are predicted best, as the others
    may be needed then: Coulomb friction had taken the place of viscous friction that leaves two thirds of its error, as
    the last recording is predicted worse with both than with either.  own: fits of this search.  Of one with the same
    effects and the fit that begins without the effect the better one counts, as the latter may end in another minimum.
    """
    first, now, added = found.fits[0].model, found.fits[-1], list(found.added)
    lacking = dict[str, F]()

    def refitted(model: Model) -> F:
        return min([likelihood.refitted(model, now), *_alike(own, model)], key=lambda one: one.rms)

    while added and not is_over():
        lacking = {effect: refitted(reduced(now.model, effect, first)) for effect in added if not is_over()}
        least = _least_needed(lacking, added, first, now, likelihood)
        part = None if least or is_over() else _simpler(now, added, first, likelihood, refitted)
        if is_over() or not (least or part):
            break  # fits that were cut short decide nothing
        if part:
            now, added, lacking = part, relabelled(added, first.effects, part.model.effects), {}
        else:
            now, added, lacking = lacking[least], [name for name in added if name != least], {}
    if is_over() and (kept := _without_last(now, added, first, own, likelihood))[1] != added:
        (now, added), lacking = kept, {}
    path = _path(found.fits, now, added, refitted)
    return replace(found, fits=path, added=tuple(added), lacking=lacking)


def _without_last(
    now: F, added: list[str], first: Model, own: Sequence[F], likelihood: Likelihood[F]
) -> tuple[F, list[str]]:
    """The fit and the added effects without the last ones that are not needed, as far as the fits without them are
    known: there is no time for others."""
    while added and (known := _alike(own, reduced(now.model, added[-1], first))):
        less = min(known, key=lambda one: one.rms)
        if not _is_enough(less, now, likelihood):
            break
        now, added = less, added[:-1]
    return now, added


def _least_needed(
    lacking: Mapping[str, F], added: Sequence[str], first: Model, now: F, likelihood: Likelihood[F]
) -> str:
    """The effect without which unseen samples are predicted best, of those that are not needed; "" where all are.

    An effect is not needed if the fit without it is enough, else if its size is not identified, unless a simpler law
    may take its place.  The second is asked where the first holds of none, as for gears it takes a refined fit: 18 s of
    processor time for a shaft compliance that was eliminated."""
    apt = {
        effect: less
        for effect, less in lacking.items()
        if are_consistent(less.model, [name for name in added if name != effect])
    }
    superfluous = [effect for effect, less in apt.items() if _is_enough(less, now, likelihood)]
    whole = [effect for effect in apt if not simplified(now.model, effect, first)]
    superfluous = superfluous or [effect for effect in whole if not likelihood.is_sized(effect, now)]
    errors = {effect: likelihood.predictions(apt[effect], now, of_all=True).usual for effect in superfluous}
    return min(errors, key=lambda effect: errors[effect], default="")


def _simpler(
    now: F, added: Sequence[str], first: Model, likelihood: Likelihood[F], refitted: Callable[[Model], F]
) -> F | None:
    """The fit with the simpler part of one of the added laws, where that is enough, or where the data do not identify
    what the law has beyond it; None where there is no such law."""
    for effect in added:
        simple = simplified(now.model, effect, first)
        if not simple or is_over():
            continue
        part = refitted(simple)
        if not are_consistent(part.model, relabelled(added, first.effects, part.model.effects)):
            continue
        is_near = part.rms <= policy.BEHIND * now.rms
        if _is_enough(part, now, likelihood) or (is_near and not likelihood.is_sized(effect, now)):
            return part
    return None


def _alike(fits: Iterable[F], model: Model) -> list[F]:
    """The fits with the effects of a model."""
    return [one for one in fits if {*one.model.effects} == {*model.effects}]


def _path(fits: Sequence[F], now: F, added: Sequence[str], refitted: Callable[[Model], F]) -> tuple[F, ...]:
    """The fits with none of the added effects, with the first, the first two, …: those of the search that have no other
    effects, else new ones, or what the search had there where the time is up before they end."""
    path, model = [now], now.model
    for count in reversed(range(1, len(added))):
        model = reduced(model, added[count], fits[0].model)
        known = _alike(fits, model)
        if not known and not is_over():
            new = refitted(model)
            known = [] if is_over() else [new]
        path.append(min(known, key=lambda one: one.rms, default=fits[count]))
    return (fits[0], *reversed(path)) if added else (now,)


def _is_enough(less: F, now: F, likelihood: Likelihood[F]) -> bool:
    """Whether a fit with less predicts as well.  The last recording decides where it prefers one of both significantly,
    else the folds do.

    The folds have the motions of the fit, to which a curve of a wrong shape can be bent: a cubic spring took a third of
    the error of two recordings of a mass on a spring, and raised that of the third from 16 to 27 mm (p = 0.01).  Of
    another mass, on a cart, six blocks of the folds did not show Coulomb friction (p = 0.053), which 15 % of the error
    of the last recording did (p = 0.0005).
    """
    last = likelihood.on_last(less, now)
    if last is not None and last.reverse.is_preferred:
        return True
    if last is not None and last.is_preferred:
        return False
    return not _is_worse(less, now, likelihood)


def _is_worse(less: F, now: F, likelihood: Likelihood[F]) -> bool:
    """Whether a fit with less predicts significantly worse.  Where it falls far behind, its predictions, which take
    time, are not computed."""
    if less.rms > policy.BEHIND * now.rms:
        return True
    return likelihood.predictions(less, now, is_last=True).p_value < policy.FALSE_NAME


def relabelled(added: Sequence[str], own: Sequence[str], effects: Sequence[str]) -> list[str]:
    """The effects that the steps added; in the place of one that is no longer in the model is the effect that replaced
    it, one without a step of its own or the last one."""
    new = (effect for effect in effects if effect not in own and effect not in added)
    place = [effect if effect in effects else next(new, added[-1]) for effect in added]
    return list(dict.fromkeys(place))
