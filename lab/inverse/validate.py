"""Cross-validation of a candidate: how well it predicts unseen samples, and whether that is significant.  No search
here.

A candidate is judged by the squared error of predictions: each of three folds of blocks is predicted by a fit to the
other two, and another recording, where there are few, by the fit to all three.  The logarithms of the ratio of two
models' errors, block by block, are nearly independent, and their mean is that of the log-likelihood ratio if every
block has its own noise variance, as recordings differ in theirs.  Student's t-test asks whether the mean is above zero,
and the p-value is multiplied by the number of candidates that were tried (Bonferroni), so that it is the probability of
a false name in the whole step.  The test compares predictions; it does not assume that either model is true (Diebold
and Mariano 1995; Hansen, Lunde and Nason 2011, "The model confidence set").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import chance, floored
from lostmotion.lab.deadline import within
from lostmotion.lab.fitting.identifiability import held
from lostmotion.lab.inverse.candidates import are_consistent, turns_of
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import Data
from lostmotion.lab.inverse.regression import Regression, blocks_of, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import SHAFT_TURNS
from lostmotion.model.motion import FloatArray

__all__ = [
    "Fitted", "Judged", "Method", "amplitudes", "are_alike", "continued", "error_on", "fit_on",
    "is_noise", "is_sized", "judged", "named", "p_of", "preferred", "prior_odds", "shapes_tried",
]  # fmt: skip

HORIZONS = (0.2, 0.5)
"""Shares of a free swing that are fitted before the whole: a frequency error of 2 % is out of phase after ten swings,
and a fit to the whole would end in a local minimum."""


class Method(Enum):
    """The error that is minimised: of the torque of a controlled joint; of a free motion, with candidates selected by
    the acceleration; of a motion with an input that follows no disturbance."""

    TORQUE = "torque"
    FREE = "free"
    MOTION = "motion"


@dataclass(frozen=True, eq=False)
class Fitted:
    """inverse: the fit to select candidates with; judged: the fit for predictions, the same one except where a joint
    swings freely."""

    inverse: Regression
    judged: Regression

    @classmethod
    def of(cls, inverse: Regression, method: Method) -> Fitted:
        """Beginning with the fit to select candidates with."""
        if method is not Method.FREE:
            return cls(inverse, inverse)
        return cls(inverse, continued(inverse.model, OutputError.of(inverse.data.signals, inverse.model)))

    @property
    def model(self) -> Model:
        """The model of the fit for predictions."""
        return self.judged.model


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate: the fit with it, the share of the squared error of unseen samples that it takes, the p-value, and
    whether it is identified: the interval of its size excludes zero, and the estimates agree with its definition."""

    effect: str
    fitted: Fitted
    gain: float
    p_value: float
    is_identified: bool = True

    @property
    def fit(self) -> Regression:
        """The fit for predictions."""
        return self.fitted.judged

    @property
    def is_significant(self) -> bool:
        """Whether it may be named."""
        return self.p_value < policy.FALSE_NAME and self.gain > policy.LEAST_GAIN and self.is_identified


def continued(model: Model, swings: OutputError) -> Regression:
    """The fit of a free motion on a growing horizon (homotopy); where that ends with a larger error than no motion, as
    for a pendulum that goes over the top, the fit of the whole motion at once if it is better."""
    start = model
    for share in HORIZONS:
        model = regressed(model, swings.first(share)).model
    found = regressed(model, swings)
    if found.rms <= swings.usual(model):
        return found
    return min(found, regressed(start, swings), key=lambda one: one.rms)


def named(alike: Sequence[Judged], now: Regression, unseen: Signals | None) -> Judged:
    """Chooses one of several effects that explain the data equally well: by the number of parameters of the one with
    the least BIC, then by the prediction of all unseen samples, of the folds and of another recording, then by
    ``preferred``. The initial values of a mode count as parameters.

    Equally well means that the blocks are too few for significance.  The likelihood counts each block as one sample, so
    that with twelve a parameter costs a fifth of the squared error: gravity of a pendulum, with two, took 71 % where
    Coulomb friction took 38 %.  First of all, an effect gives way to a far more common one of its kind that explains a
    little less.
    """
    blocks = max(int(blocks_of(one.fit).max()) + 1 for one in alike)
    costs = {one.effect: (1 - one.gain) * blocks ** (_count(one) / blocks) for one in alike}
    alike = [one for one in alike if not _is_rarer(one.effect, costs, blocks)]
    few = _count(min(alike, key=lambda one: costs[one.effect]))
    simple = [one for one in alike if _count(one) == few]
    if len(simple) == 1:
        return simple[0]
    left = [_unseen_error(one.fit, simple[0].fit, unseen) for one in simple]
    best = [one for one, error in zip(simple, left, strict=True) if error * (1 - policy.LEAST_GAIN) <= min(left)]
    return min(best, key=lambda one: (*preferred(one, now), one.fit.rms))


def _unseen_error(fit: Regression, other: Regression, unseen: Signals | None) -> float:
    """The geometric mean over blocks, those of another fit, of the squared error of all unseen samples; infinite where
    the other recording cannot be simulated."""
    if unseen and fit_on(fit, unseen) is None:
        return math.inf
    error, usual, block = _errors(fit, other, unseen)
    return math.exp(float(np.mean(np.log(floored(error, usual, block)))))


def _count(one: Judged) -> int:
    """The number of fitted parameters."""
    return one.fit.count + one.fit.nuisance.size


def _is_rarer(effect: str, costs: dict[str, float], blocks: int) -> bool:
    """Whether a likelier effect of its kind has the larger posterior probability: exp(-BIC/2) times the prior one, to
    the power of 2 over the number of blocks."""
    own = get_effect(effect)
    return bool(costs.get(own.likelier, math.inf) <= costs[effect] * own.odds ** (2 / blocks))


def error_on(fit: Regression, unseen: Signals) -> float:
    """Root mean square error of a fit on an unseen recording [N m or rad], infinite where its motion cannot be
    simulated there."""
    there = fit_on(fit, unseen)
    return there.rms if there else math.inf


@lru_cache(maxsize=64)  # each candidate is compared with several others
def fit_on(fit: Regression, unseen: Signals) -> Regression | None:
    """The fit's model on an unseen recording, None where its motion cannot be simulated there: only the nuisance
    parameters (initial state, zero angle) are fitted."""
    known = held(fit.model, fit.unknowns.names)
    with suppress(ModelError), within(math.inf):  # two numbers: a fit cut short would be reported as the effect's error
        if isinstance(fit.data, OutputError):
            return regressed(known, OutputError.of([unseen], known).no_finer(fit.data))
        return regressed(known, replace(Data.of([unseen], known), is_anchored=fit.nuisance.size == 0))
    return None


def is_noise(residual: FloatArray, floor: float) -> bool:
    """Whether a residual (M,) is no larger than the noise that the sensors leave within the band."""
    return _least_spread(residual) < policy.STRUCTURED * floor


def _least_spread(residual: FloatArray) -> float:
    """Lower end of a 95 % interval of the standard deviation, by the median absolute deviation: its relative standard
    error is 1.17 / sqrt(N) for N independent normal values (asymptotic efficiency 37 %), and it is robust to transients
    of the filter at the ends of a recording."""
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return spread / (1 + 1.645 * 1.17 / math.sqrt(residual.size))


def preferred(one: Judged, now: Regression) -> tuple[bool, bool]:
    """Sort key for effects of the same shape: periodic ones first where a shaft turns, then the more likely one of a
    kind."""
    is_shaft = turns_of(now.data) >= SHAFT_TURNS
    repeats = f"{one.effect}.N" in one.fit.model.parameters
    return repeats != is_shaft, bool(get_effect(one.effect).likelier)


def are_alike(one: Judged, best: Judged, tried: float, choosing: Signals | None) -> bool:
    """Whether the best of so many does not predict significantly and substantially better than another."""
    left, least = 1 - one.gain, 1 - best.gain
    return left * (1 - policy.LEAST_GAIN) <= least or tried * p_of(one.fit, best.fit, choosing) > policy.FALSE_NAME


def judged(name: str, found: Fitted, now: Fitted, tried: float, choosing: Signals | None) -> Judged:
    """Tests a candidate of so many (one over its prior probability) against the present fit; choosing: see ``p_of``."""
    before, after, block = _errors(now.judged, found.judged, choosing)
    p_value = min(tried * shapes_tried(name, found.model) * chance(before, after, block), 1.0)
    is_identified = is_sized(name, found.judged) and are_consistent(found.model, [name])
    return Judged(name, found, float(1 - after.sum() / before.sum()), p_value, is_identified)


def prior_odds(effects: Sequence[str], own: Sequence[str]) -> dict[str, float]:
    """Prior odds of candidates: one, or less where a likelier effect of the kind is a candidate, too, or in the model.
    They are the weights of the correction for multiple tests (weighted Bonferroni): a rare effect needs more evidence,
    and costs the others little."""
    known = {*effects, *own}
    found = {name: get_effect(name) for name in effects}
    return {name: 1 / one.odds if one.likelier in known else 1.0 for name, one in found.items()}


def shapes_tried(effect: str, model: Model) -> float:
    """The number of shapes among which that of the effect was chosen, for the p-value: a whole number is not fitted to
    the folds, but chosen with all samples.

    Small numbers are likelier in a machine than large ones, so that N counts as N (N + 1) shapes: the weights 1/(N (N +
    1)) of all N add up to one (weighted Bonferroni: Genovese, Roeder and Wasserman 2006).
    """
    whole = [p.value for p in model.own(effect).values() if p.domain.is_whole]
    return math.prod(n * (n + 1) for n in whole)


def is_sized(effect: str, fit: Regression) -> bool:
    """Whether the interval of an amplitude of the effect excludes zero.  A curve that is nearly a sum of others can
    overfit a motion, and extrapolates badly.  The base's positive parameters are taken as given: all torques of a servo
    share a scale that its motion does not identify."""
    names, block = amplitudes(effect, fit), blocks_of(fit)
    if not names:
        return _is_shaped(effect, fit, block)
    given = [item.name for item in fit.unknowns.items if item.logarithmic and "." not in item.name]
    limits = -stdtrit(int(block.max()), (1 - policy.CONFIDENCE) / 2) * fit.deviations(block, given)
    sizes = {name: abs(fit.model.parameters[name].value) for name in names}
    return any(sizes[name] > limit for name, limit in zip(fit.unknowns.names, limits, strict=True) if name in sizes)


def _is_shaped(effect: str, fit: Regression, block: NDArray[np.intp]) -> bool:
    """Whether an effect without a fitted size has an identified parameter, or none at all.  A mode with free initial
    values must have an identified frequency: to a mass on a spring with friction, one of 0.001 to 1e6 Hz was fitted."""
    own = [at for at, name in enumerate(fit.unknowns.names) if name.startswith(f"{effect}.")]
    deviation = np.sqrt(np.maximum(np.diag(fit.covariance(block)), 0.0))
    return not own or any(fit.unknowns.items[at].is_identified(fit.z[at], deviation[at]) for at in own)


def amplitudes(effect: str, fit: Regression) -> list[str]:
    """The free parameters without which the effect vanishes, by their full names."""
    names = (f"{effect}.{part}" for part in get_effect(effect).amplitudes)
    return [name for name in names if name in fit.unknowns.names]


def p_of(one: Regression, other: Regression, choosing: Signals | None) -> float:
    """The p-value of the predictions of ``other`` being better than those of ``one``.

    choosing: a recording that is not fitted, but predicted like a fold.  The folds have the speeds and amplitudes of
    the fit: an effect that overfits these by a difference of large terms extrapolates badly.
    """
    return chance(*_errors(one, other, choosing))


def _errors(
    one: Regression, other: Regression, choosing: Signals | None
) -> tuple[FloatArray, FloatArray, NDArray[np.intp]]:
    """Squared errors of both fits at unseen samples (M,) each, and the block of each sample, from the residual of
    ``other``."""
    before, after, block = one.predicted**2, other.predicted**2, blocks_of(other)
    if choosing is None:
        return before, after, block
    without, there = fit_on(one, choosing), fit_on(other, choosing)
    if without is None or there is None:
        return before, after, block
    return (
        np.concatenate([before, without.residual**2]),
        np.concatenate([after, there.residual**2]),
        np.concatenate([block, block.max() + 1 + blocks_of(there)]),
    )
