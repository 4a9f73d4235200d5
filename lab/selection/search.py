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
    """Fits with one more effect each; untried: effects that were not fitted because the time was up; rejected: those
    that the data of the fit do not show, which count as tried; detectable: the size at which they would have, with the
    parameter's name; begin: an effect with which a pair may begin, and a fit with it, where the fits follow too little
    to show which."""

    fits: Sequence[tuple[str, F]]
    untried: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    begin: tuple[str, F] | None = None


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
    rejected, detectable, begin: see ``Proposals``."""

    judged: tuple[Candidate[F], ...]
    confusable: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()
    rejected: tuple[str, ...] = ()
    detectable: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    begin: tuple[str, F] | None = None

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
