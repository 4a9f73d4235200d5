"""The evidence for an effect, the same for every likelihood: predictions of samples that the fit has not seen.

The logarithms of the ratio of two models' squared errors, block by block, are nearly independent, and their mean is
that of the log-likelihood ratio if every block has its own noise variance.  Student's t-test asks whether the mean is
above zero.  The p-value is multiplied by the number of candidates, or by their order in the data of the fit where the
predicted samples are of other recordings (weighted Bonferroni), and by a factor for what similar candidates have in
common (min-p of Westfall and Young), so that it is the probability of a false name in the whole step.  The test
compares predictions; it does not assume that either model is true (Diebold and Mariano
1995; Hansen, Lunde and Nason 2011, "The model confidence set").  Nothing is fitted here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import chance, family_wise, floored
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = [
    "Candidate",
    "Fit",
    "Predictions",
    "are_alike",
    "are_consistent",
    "in_common",
    "in_turn",
    "prior_odds",
    "shapes_tried",
    "simplest",
]


class Fit(Protocol):
    """A model fitted by one of the likelihoods."""

    @property
    def model(self) -> Model:
        """The model with its fitted values."""

    @property
    def rms(self) -> float:
        """Root mean square error, by which fits are compared."""

    @property
    def screened(self) -> float:
        """Root mean square error of the data by which candidates are proposed."""

    @property
    def count(self) -> int:
        """The number of fitted parameters."""


F = TypeVar("F", bound=Fit)


@dataclass(frozen=True, eq=False)
class Predictions:
    """The squared errors of two fits at M unseen samples."""

    before: FloatArray
    """Of the first fit (M,)."""
    after: FloatArray
    """Of the second fit (M,)."""
    block: NDArray[np.intp]
    """The number of the block of each sample (M,)."""
    of_zero: float | None = None
    """The p-value of the effects of the second fit being zero (Wald's test), where it takes the place of the t-test."""

    @property
    def reverse(self) -> Predictions:
        """The same errors, of the second fit before those of the first."""
        return Predictions(self.after, self.before, self.block)

    @property
    def gain(self) -> float:
        """The share of the squared error that the second fit takes."""
        return float(1 - self.after.sum() / self.before.sum())

    @property
    def usual(self) -> float:
        """The geometric mean over blocks of the squared error of the first fit, each with the weight of its samples.
        Where a wrong effect is left in the last recording, its blocks are long: a delay left 3.6° of it, and the lag of
        an actuator 0.025°, in 12 of 726 blocks."""
        counts = np.bincount(self.block)
        squares = floored(self.before, self.after, self.block) / counts
        return math.exp(float(np.average(np.log(squares), weights=counts)))

    @cached_property
    def p_value(self) -> float:
        """Of the second fit predicting no better than the first."""
        return self.of_zero if self.of_zero is not None else chance(self.before, self.after, self.block)

    @property
    def is_preferred(self) -> bool:
        """Whether the second fit predicts significantly better, both in the sum of the squared errors and in most
        blocks.  With dry friction most blocks of a damper were a little worse, and the sum was 21 % less."""
        return self.gain > 0 and self.p_value < policy.FALSE_NAME

    def is_better(self, tried: float = 1.0) -> bool:
        """Whether the second fit predicts substantially and significantly better; tried: the number of fits of which it
        is one."""
        return self.gain > policy.LEAST_GAIN and tried * self.p_value < policy.FALSE_NAME


@dataclass(frozen=True, eq=False)
class Candidate(Generic[F]):
    """A fit with one more effect, and how it predicts."""

    effect: str
    fit: F
    gain: float
    """The share of the squared error of unseen samples that it takes."""
    p_value: float
    """Of its gain being chance, for all candidates of the step together."""
    blocks: int
    """The number of independent blocks of unseen samples."""
    is_identified: bool = True
    """Whether the interval of its size excludes zero, and its estimates agree with its definition; True where it
    is not named in any case, as its gain is too small or may be chance."""
    least_gain: float = policy.LEAST_GAIN
    """The gain from which on it may be named."""

    @property
    def is_significant(self) -> bool:
        """Whether it may be named."""
        return self.p_value < policy.FALSE_NAME and self.gain > self.least_gain and self.is_identified

    @property
    def takes_too_little(self) -> bool:
        """Whether it predicts better, significantly, and is not named only as far from the noise it has to take more:
        one of two effects may take little without the other."""
        return self.p_value < policy.FALSE_NAME and policy.LEAST_GAIN < self.gain <= self.least_gain


def prior_odds(effects: Sequence[str], own: Sequence[str]) -> dict[str, float]:
    """Prior odds of candidates: one, or less where a likelier effect of the kind is a candidate, too, or in the model.
    They are the weights of the correction for multiple tests (weighted Bonferroni): a rare effect needs more evidence,
    and costs the others little."""
    known = {*effects, *own}
    found = {name: get_effect(name) for name in effects}
    return {name: 1 / one.odds if one.likelier in known else 1.0 for name, one in found.items()}


def in_turn(fits: Sequence[tuple[str, F]]) -> dict[str, float]:
    """For each effect what its p-value is multiplied by where the predicted samples know nothing of the fits: their
    errors on what was fitted order the effects, and the n-th counts as n (n + 1) effects, as in ``shapes_tried``."""
    best_first = dict.fromkeys(effect for effect, _ in sorted(fits, key=lambda one: one[1].screened))
    return {effect: n * (n + 1.0) for n, effect in enumerate(best_first, 1)}


def in_common(predicted: Sequence[tuple[str, Predictions]], counts: Mapping[str, float]) -> float:
    """The factor for p-values of the candidates of a step that were multiplied by ``counts``, as many candidates are
    alike: kinds of friction differ in few blocks.  Candidates that are not compared in the same samples as that with
    the fewest blocks, and those without predictions, count as independent of all others; so do all where the p-value is
    that of the effect being zero."""
    if not predicted or any(one.of_zero is not None for _, one in predicted):
        return 1.0
    block = min((one.block for _, one in predicted), key=lambda block: int(block.max()))
    alike = {name: (one.before, one.after) for name, one in predicted if one.before.size == block.size}
    rest = sum(1 / count for name, count in counts.items() if name not in alike)
    own = [counts[name] for name in alike]
    return min(family_wise([*alike.values()], own, block, policy.FALSE_NAME) + rest, 1.0)


def shapes_tried(effect: str, model: Model) -> float:
    """The number of shapes among which that of the effect was chosen, for the p-value: a whole number is chosen with
    all samples.

    Small numbers are likelier in a machine than large ones, so that N counts as N (N + 1) shapes: the weights 1/(N (N +
    1)) of all N add up to one (weighted Bonferroni: Genovese, Roeder and Wasserman 2006).
    """
    whole = [p.value for p in model.own(effect).values() if p.domain.is_whole]
    return math.prod(n * (n + 1) for n in whole)


def are_consistent(model: Model, effects: Sequence[str]) -> bool:
    """Whether the model's values agree with the definition of each of these effects."""
    base = {name: p.value for name, p in model.parameters.items() if "." not in name}
    own = {name: {part: p.value for part, p in model.own(name).items()} for name in effects}
    return all(get_effect(name).is_apt({**base, **values}) for name, values in own.items())


def are_alike(one: Candidate[F], best: Candidate[F], tried: float, predictions: Predictions) -> bool:
    """Whether the best of so many does not predict significantly and substantially better than another; predictions:
    those of the other, then of the best."""
    left, least = math.sqrt(1 - one.gain), math.sqrt(1 - best.gain)
    return not policy.is_less(least, left) or tried * predictions.p_value > policy.FALSE_NAME


def simplest(alike: Sequence[Candidate[F]]) -> list[Candidate[F]]:
    """Of effects that explain the data equally well those with as many parameters as the one of least BIC; an effect
    gives way to a far more common one of its kind that explains a little less.

    Equally well means that the blocks are too few for significance.  The likelihood counts each block as one sample, so
    that with twelve a parameter costs a fifth of the squared error.
    """
    blocks = max(one.blocks for one in alike)
    costs = {one.effect: (1 - one.gain) * blocks ** (one.fit.count / blocks) for one in alike}
    alike = [one for one in alike if not _is_rarer(one.effect, costs, blocks)]
    few = min(alike, key=lambda one: costs[one.effect]).fit.count
    return [one for one in alike if one.fit.count == few]


def _is_rarer(effect: str, costs: dict[str, float], blocks: int) -> bool:
    """Whether a likelier effect of its kind has the larger posterior probability: exp(-BIC/2) times the prior one, to
    the power of 2 over the number of blocks."""
    own = get_effect(effect)
    return bool(costs.get(own.likelier, math.inf) <= costs[effect] * own.odds ** (2 / blocks))
