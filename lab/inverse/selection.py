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

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from lostmotion.lab.inverse.candidates import candidates, fitted_with, softened
from lostmotion.lab.inverse.regression import FOLDS, Data, Problem, Regression, blocks_of, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.swing import Swings
from lostmotion.lab.simpler import without
from lostmotion.model import Model

__all__ = ["LIMIT", "Judged", "Selection", "selected"]

LIMIT = 0.05
"""Chance of a false name in one step of the search."""
LEAST_GAIN = 0.01
"""Share of the squared error that an effect has to take, however sure it is: less is not worth a name."""
ALIKE = 0.05
"""p-value above which two candidates explain alike."""
HORIZONS = (0.2, 0.5)
"""Shares of a free swing that are fitted before the whole: a frequency that is 2 % off is out of phase after ten
swings, and a fit to all of them ends in another minimum."""
MOST = 6
"""Effects that are added at most."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """inverse: the fit to the torque; judged: the fit whose predictions count, the same where a torque was measured,
    and that to the simulated angle where the joint swings freely."""

    inverse: Regression
    judged: Regression

    @classmethod
    def of(cls, inverse: Regression, is_free: bool) -> Fitted:
        """Beginning with a fit to the torque."""
        if not is_free:
            return cls(inverse, inverse)
        swings, model = Swings.of(inverse.data.signals, inverse.model), inverse.model
        for share in HORIZONS:
            model = regressed(model, swings.first(share)).model
        return cls(inverse, regressed(model, swings))

    @property
    def model(self) -> Model:
        """The model of the fit that counts."""
        return self.judged.model


@dataclass(frozen=True, eq=False)
class Judged:
    """A candidate: the fit with it, the share of the squared error of unseen samples that it takes, the p-value."""

    effect: str
    fitted: Fitted
    gain: float
    p_value: float

    @property
    def fit(self) -> Regression:
        """The fit that counts."""
        return self.fitted.judged


@dataclass(frozen=True, eq=False)
class Step:
    """What was tried at one step, best first; confusable: the effects that explain as much as the first."""

    judged: tuple[Judged, ...]
    confusable: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """fits: the base's, then one with each effect that was added; steps: what was tried at each, the last one without
    success; complete: False where time ran out first."""

    fits: tuple[Fitted, ...]
    added: tuple[str, ...]
    steps: tuple[Step, ...]
    complete: bool


def selected(
    model: Model, signals: Sequence[Signals], is_free: bool, until: float, progress: Callable[[str, float], None]
) -> Selection:
    """Adds effects as long as one is significant and time.monotonic() is below ``until`` [s].

    is_free: no torque acts.
    """
    measured = Data(tuple(signals), tuple(one.torque for one in signals))
    now = Fitted.of(_with_load(softened(model, measured), measured), is_free)
    fits, added, steps, complete = [now], list[str](), list[Step](), True
    while len(added) < MOST:
        progress("looking for more" if added else "looking for what is missing", 0.15 + 0.12 * len(added))
        step = _step(now, tuple(added), is_free)
        steps.append(step)
        if not step.judged or not _is_significant(step.judged[0]):
            break
        best = step.judged[0]
        now = Fitted(_with_load(best.fit.model, now.inverse.data), best.fit)
        now = now if is_free else Fitted(now.inverse, now.inverse)
        added = [effect for effect in added if effect in now.model.effects] + [best.effect]
        fits.append(now)
        if time.monotonic() > until:
            complete = False
            break
    return _eliminated(fits, added, steps, complete, is_free)


def _step(now: Fitted, added: tuple[str, ...], is_free: bool) -> Step:
    """All candidates, judged against the present fit; of those alike, the one with the fewest parameters first."""
    wide = list(candidates(now.model, added, now.inverse.data))
    inverse = [(name, fit) for name, model in wide if (fit := fitted_with(name, model, now.inverse))]
    fits = [(name, Fitted.of(fit, is_free)) for name, fit in inverse]
    judged = sorted((_judged(name, fit, now, len(wide)) for name, fit in fits), key=lambda one: -one.gain)
    good = [one for one in judged if _is_significant(one)]
    if not good:
        return Step(tuple(sorted(judged, key=lambda one: one.p_value)))
    alike = [one for one in good if one is good[0] or _p(one.fit, good[0].fit) > ALIKE]
    first = min(alike, key=lambda one: (one.fit.count, *_preferred(one, now.inverse), one.fit.rms))
    rest = [one for one in judged if one is not first]
    return Step((first, *rest), tuple(one.effect for one in alike if one is not first))


def _preferred(one: Judged, now: Regression) -> tuple[bool]:
    """Of two effects of the same shape, that which repeats every turn of a shaft comes first where the motion covers
    several turns, as no arm does."""
    turns = max(float(np.ptp(signals.position)) for signals in now.data.signals) / (2 * np.pi)
    repeats = f"{one.effect}.N" in one.fit.model.parameters
    return ((repeats and turns < 2) or (not repeats and turns >= 2),)


def _is_significant(one: Judged) -> bool:
    return one.p_value < LIMIT and one.gain > LEAST_GAIN


def _judged(name: str, found: Fitted, now: Fitted, tried: int) -> Judged:
    fold = blocks_of(found.judged) % FOLDS
    before, after = (np.mean(one.predicted(fold) ** 2) for one in (now.judged, found.judged))
    return Judged(name, found, float(1 - after / before), min(tried * _p(now.judged, found.judged), 1.0))


def _p(one: Regression, other: Regression) -> float:
    """The chance of predictions of ``other`` this much better than those of ``one``, if both were as good.

    The blocks are those of the residual of ``other``: if it explains nothing that is the one before.
    """
    block = blocks_of(other)
    before, after = (np.bincount(block, fit.predicted(block % FOLDS) ** 2) for fit in (one, other))
    ratio = 0.5 * np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    spread = float(ratio.std(ddof=1)) / np.sqrt(ratio.size)
    return float(student.sf(ratio.mean() / max(spread, 1e-12), ratio.size - 1))


def _with_load(model: Model, data: Problem) -> Regression:
    """The model fitted to the torque, then again with the transmitted torque that it says itself."""
    once = regressed(model, data)
    return regressed(once.model, Data.of(data.signals, once.model))


def _eliminated(fits: list[Fitted], added: list[str], steps: list[Step], complete: bool, is_free: bool) -> Selection:
    """Without those effects that the later ones have made superfluous."""
    for effect in list(added):
        if len(added) < 2:
            break
        now = fits[-1]
        less = Fitted.of(regressed(without(now.model, effect), now.inverse.data), is_free)
        if _p(less.judged, now.judged) > LIMIT:
            at = added.index(effect)
            added.remove(effect)
            fits.pop(at + 1)
            fits[-1] = less
    return Selection(tuple(fits), tuple(added), tuple(steps), complete)
