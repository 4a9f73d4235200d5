"""What a search asks of a likelihood, and what it finds: candidates of a step, and the fits with the added effects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from lostmotion.lab.selection.evidence import Candidate, Fit, Predictions
from lostmotion.model import Model

__all__ = ["Likelihood", "Proposals", "Selection", "Step"]

F = TypeVar("F", bound=Fit)


@dataclass(frozen=True, eq=False)
class Proposals(Generic[F]):
    """The candidates of a step."""

    fits: Sequence[tuple[str, F]]
    """Fits with one more effect each, with the name of that."""
    untried: tuple[str, ...] = ()
    """The effects that were not fitted as the time was up."""
    rejected: tuple[str, ...] = ()
    """The effects that the data of the fit do not show.  They count as tried."""
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    """By effect, the name of a parameter and its value from which on these data would have shown the effect."""
    begin: tuple[str, F] | None = None
    """An effect, and a fit with it, with which a pair may begin where no fit follows the data well enough to choose."""
    has_more: bool = False
    """Whether another batch follows where none of these is accepted."""


class Likelihood(Protocol[F]):
    """What the search needs: fits, and predictions of samples that they have not seen."""

    @property
    def pool(self) -> Executor | None:
        """For predictions, in parallel."""

    @property
    def turns(self) -> float:
        """The number of turns of the motion."""

    @property
    def is_held_out(self) -> bool:
        """Whether the predicted samples are of recordings that no fit has used, not of folds."""

    @property
    def first(self) -> F:
        """The fit of the model as it is."""

    def proposals(self, now: F, added: tuple[str, ...], only: Sequence[str] = ()) -> Iterable[Proposals[F]]:
        """Fits with one more effect, in batches: a later one is asked for only where none before is accepted.  only:
        the effects that are asked for, all for ()."""

    def tries_pairs(self, added: tuple[str, ...]) -> bool:
        """Whether a pair is tried where no single effect is accepted."""

    def damping_pair(self, now: F) -> Sequence[str]:
        """Two effects that are tried as a pair wherever neither is accepted alone, () for none: see
        ``nesting.damping_pair``."""

    def accepted(self, fit: F, now: F, *, is_first: bool = False) -> F:
        """The fit with an effect that was accepted, from which the search goes on; is_first: with the first effect of a
        pair, whose second one is looked for."""

    def refitted(self, model: Model, fit: F) -> F:
        """The fit of a model with less than that of a fit, from its values."""

    def predictions(self, one: F, other: F, *, of_all: bool = False, is_last: bool = False) -> Predictions:
        """The squared errors of two fits at unseen samples.  of_all: also at those of the last recording, where the
        others are enough for the test; is_last: in blocks that are as long as those of the reported intervals, for the
        tests after the search."""

    def on_last(self, one: F, other: F) -> Predictions | None:
        """Errors of two fits on the last recording; None where they cannot be compared there, and where ``predictions``
        are of that recording."""

    def least_gain(self, fit: F, now: F) -> float:
        """The share of the squared error that an effect must take to be named."""

    def is_sized(self, effect: str, fit: F) -> bool:
        """Whether the size of an effect differs from zero."""


@dataclass(frozen=True, eq=False)
class Step(Generic[F]):
    """One step of the search; untried, rejected, detectable, begin, has_more: see ``Proposals``."""

    judged: tuple[Candidate[F], ...]
    """The candidates, best first."""
    confusable: tuple[str, ...] = ()
    """The effects that explain as much as the first candidate."""
    untried: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    begin: tuple[str, F] | None = None
    has_more: bool = False

    @property
    def is_accepted(self) -> bool:
        """Whether the first effect is significant."""
        return bool(self.judged) and self.judged[0].is_significant


@dataclass(frozen=True, eq=False)
class Selection(Generic[F]):
    """The result of a search."""

    fits: tuple[F, ...]
    """The fits without the added effects, with the first of them, with the first two, …"""
    added: tuple[str, ...]
    """The effects that the search found, in this order."""
    steps: tuple[Step[F], ...]
    """The steps; nothing was accepted in the last one, unless the time was up."""
    untried: tuple[str, ...] = ()
    """The effects that were not tried beside the added ones, as the time was up."""
    lacking: Mapping[str, F] = field(default_factory=dict)
    """By added effect, the fit with all others, where the elimination made one."""
    distinct: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """By added effect, those that explained as much in its step, and predict worse in its place in the last fit."""

    @property
    def confusable(self) -> tuple[tuple[str, ...], ...]:
        """Each added effect with those that explained as much and were not added: two effects that are both needed are
        not confusable, nor are those that the effects beside them distinguish."""
        tried = [(step.judged[0].effect, step.confusable) for step in self.steps if step.judged]
        groups = [
            (name, *(one for one in alike if one not in (*self.added, *self.distinct.get(name, ()))))
            for name, alike in tried
        ]
        return tuple(group for group in groups if len(group) > 1 and group[0] in self.added)
