"""The likelihood of predictable motions, which the search of selection/forward.py asks for fits and predictions.

A fit minimises the error of the torque or of the whole simulated motion.  Predictions are cross-validated: the blocks
of samples form three folds, and each fold is predicted by a fit to the other two.  Where there are few recordings,
another recording is predicted by the fit to all of them as one more fold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import is_over, remaining_s, within
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.fitting.identifiability import with_free_states
from lostmotion.lab.inverse.candidates import (
    SHORT,
    candidates,
    equation_error_fit,
    equation_error_fit_with,
    fitted_with,
    refined,
    resolved,
    settled,
)
from lostmotion.lab.inverse.effect_sizes import chance_of_zero, exceeds_noise, is_sized
from lostmotion.lab.inverse.first_fits import first_fits
from lostmotion.lab.inverse.first_values import turns_of
from lostmotion.lab.inverse.fitted import Fitted, fit_on
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression, generalised, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import can_invert, softened
from lostmotion.lab.parallel import each, fair_share
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.selection.nesting import damping_pair, without
from lostmotion.lab.selection.search import Proposals
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["Method", "WholeMotion"]


class Method(Enum):
    """The error that is minimised.  TORQUE: of the measured torque of a joint.  MOTION: of the simulated motion, of a
    servo, an oscillator, or a joint that swings freely.  SEGMENTS: of short segments of the motion of gears with play,
    as impacts make the whole motion unpredictable."""

    TORQUE = "torque"
    MOTION = "motion"
    SEGMENTS = "segments"

    @classmethod
    def of(cls, model: Model, experiments: Sequence[Experiment]) -> Method:
        """The method for a model and experiments.  Raises ExperimentError for a joint that is driven in some of the
        recordings only."""
        if model.base == "play":
            return cls.SEGMENTS
        if not can_invert(model):
            return cls.MOTION
        driven = {one.is_driven: one.name for one in experiments}
        if len(driven) > 1:
            raise ExperimentError(
                f"found a torque in {driven[True]} and none in {driven[False]}, expected one in all recordings or in "
                "none: ask what moves freely apart from what is driven"
            )
        return cls.TORQUE if True in driven else cls.MOTION


@dataclass(frozen=True, eq=False)
class WholeMotion:
    """The ``Likelihood`` of recordings that are fitted as a whole.

    method: the error that is minimised; model: the model as it is; signals: the recordings of the fit; unseen: a
    recording that is not fitted and that decides between effects that predict the others equally well; is_fold: whether
    it is also one more fold of every prediction; pool: executor for fits, if any; is_whitened: whether the misfit of a
    torque is whitened; is_held_out: false, as folds are predicted.
    """

    method: Method
    model: Model
    signals: Sequence[Signals]
    unseen: Signals | None = None
    is_fold: bool = False
    pool: Executor | None = None
    is_whitened: bool = False
    is_held_out = False

    def tries_pairs(self, added: tuple[str, ...]) -> bool:
        """Whether no motion is simulated, or no effect was added, as fits to a simulated motion take seconds."""
        return self.method is Method.TORQUE or not added

    @property
    def turns(self) -> float:
        """The largest number of turns that the motion of a recording covers."""
        return turns_of(self.signals)

    @property
    def is_driven(self) -> bool:
        """Whether an input drives the motion."""
        return any(one.experiment.is_driven for one in self.signals)

    @cached_property
    def first(self) -> Fitted:
        """The fit of the model as it is."""
        if self.method is Method.MOTION:
            fits = first_fits(self.model, self.signals)
            if not fits:
                raise ModelError("the motion cannot be simulated with the first values of the parameters")
            best = refined(min(fits, key=lambda one: one.rms))
            return Fitted(best, best)
        return self._fitted(_with_load(softened(self.model, self.signals), self.signals))

    def damping_pair(self, now: Fitted) -> Sequence[str]:
        """That of ``nesting.damping_pair`` for a motion that dies away; none for a motion that an input drives, which
        distinguishes the two."""
        return () if self.is_driven else damping_pair(now.model)

    def proposals(self, now: Fitted, added: tuple[str, ...], only: Sequence[str] = ()) -> Iterator[Proposals[Fitted]]:
        """Fits with each of the candidates in one batch, as far as the time allows.

        Fits to a simulated motion are made in the order of the errors of their fits to the acceleration, which need no
        simulation.  They take a few steps; the best of them are continued to the end.
        """
        known = candidates(now.ordinary.model, added, now.ordinary.data)
        wide = [one for one in known if (one[0] in only if only else get_effect(one[0]).is_searched)]
        with within(policy.STAGE_SHARE * remaining_s()):
            begun, screened = self._by_equation_error(wide, now) if self.method is Method.MOTION else ({}, {})
            wide.sort(key=lambda one: fit.rms if (fit := begun.get(one[0])) else math.inf)
            share = fair_share(self.pool, len(wide))
            fitted = partial(_fitted_in_time, now=now.ordinary, begun=begun, rough=self.model, share=share)
            tried = each(self.pool, fitted, wide)
            failed = () if is_over() else tuple(name for (name, _), fit in tried if fit is None)
            fits = [(name, fit) for (name, _), fit in tried if fit]
            fits = self._finished(fits, now) if self.method is Method.MOTION else fits
        judged = each(self.pool, lambda one: self._fitted(one[1]), fits, first=1)
        found = [(name, replace(fit, screened_rms=screened.get(name))) for (name, _), fit in judged]
        done = {*(effect for effect, _ in found), *failed}
        yield Proposals(found, tuple(name for name, _ in wide if name not in done), failed)

    def _by_equation_error(
        self, wide: Sequence[tuple[str, Model]], now: Fitted
    ) -> tuple[dict[str, Regression], dict[str, float]]:
        """The fits of the candidates to the acceleration, by name, where it follows from the measured motion; and for a
        free motion what ``Fitted.screened`` is."""
        present = equation_error_fit(now.model, now.ordinary.data.signals)
        if not present:
            return {}, {}
        tried = each(self.pool, partial(equation_error_fit_with, now=present), wide)
        begun = {name: fit for (name, _), fit in tried if fit}
        is_known = not self.is_driven and present.rms > 0
        return begun, {name: now.rms * fit.rms / present.rms for name, fit in begun.items()} if is_known else {}

    def _finished(self, fits: list[tuple[str, Regression]], now: Fitted) -> list[tuple[str, Regression]]:
        """The fits of a few steps, about in the order of their errors.  Those that take enough of the error for a name
        already are continued until their errors hardly fall, and those that are not behind the best of these then, to
        the end."""
        fits = sorted(fits, key=lambda one: one[1].rms)
        many = min(sum(policy.is_less(fit.rms, now.rms) for _, fit in fits), policy.FINISHED)
        begun = sorted(self._continued(settled, fits[:many]), key=lambda one: one[1].rms)
        many = sum(fit.rms < policy.BEHIND * begun[0][1].rms for _, fit in begun)
        ended = self._continued(refined, begun[:many])
        return [*ended, *begun[len(ended) :], *fits[len(begun) :]]

    def _continued(
        self, work: Callable[[Regression], Regression], fits: Sequence[tuple[str, Regression]]
    ) -> list[tuple[str, Regression]]:
        """These fits after more steps, as far as the time allows."""
        return [(name, fit) for (name, _), fit in each(self.pool, lambda one: work(one[1]), fits)]

    def accepted(self, fit: Fitted, now: Fitted, *, is_first: bool = False) -> Fitted:
        """The fit of the model with the accepted effect, with an integration step that is short enough for it, or with
        the transmitted torque that the model needs with it."""
        if self.method is Method.MOTION:
            found = resolved(fit.generalised)
            return Fitted(found, found)
        return self._fitted(_with_load(fit.model, self.signals, fit.ordinary.nuisance))

    def refitted(self, model: Model, fit: Fitted) -> Fitted:
        """The fit of a model with less than another one, from its values."""
        data, nuisance = fit.ordinary.data, fit.ordinary.nuisance
        if not isinstance(data, OutputError):
            return self._fitted(_with_load(model, self.signals, nuisance))
        gone = (get_effect(name) for name in fit.model.effects if name not in model.effects)
        if not self.is_driven and any(effect.rests_by for effect in gone):  # the constant torque may stand for it
            model = with_free_states(model.replace({"bias": self.model.parameters["bias"]}))
        data, nuisance = data.trimmed(model, nuisance)
        less = regressed(model, data, nuisance, SHORT)
        return self._fitted(less if less.rms > policy.BEHIND * fit.rms else refined(less))

    def _fitted(self, ordinary: Regression) -> Fitted:
        """The least-squares fit of a model with its fit for predictions."""
        return Fitted(ordinary, generalised(ordinary) if self.is_whitened else ordinary)

    def predictions(self, one: Fitted, other: Fitted, *, of_all: bool = False, is_last: bool = False) -> Predictions:
        """The squared cross-validated errors of two fits in blocks of the residual of ``other``, and those on the
        unseen recording where it is a fold or with ``of_all``.

        The folds have the speeds and amplitudes of the fit, the unseen recording has others.  An effect with which its
        motion cannot be simulated gains nothing.  is_last: in the blocks of ``Regression.interval``, as disturbances of
        a motion may last.  In a search they would be too few: what the effects that are not yet found leave lasts, too.
        """
        white = other.generalised.data.whitened
        block = other.generalised.blocks(is_last and exceeds_noise(other.generalised))
        folds = Predictions(
            _of_new(one.generalised, block) * white(one.generalised.predicted) ** 2,
            _of_new(other.generalised, block) * white(other.generalised.predicted) ** 2,
            block,
            chance_of_zero(one.model, other.generalised) if self.is_whitened else None,
        )  # fmt: skip
        if self.unseen is None or not (self.is_fold or of_all):
            return folds
        less, there = fit_on(one.generalised, self.unseen), fit_on(other.generalised, self.unseen)
        if less is None and of_all:
            return replace(folds, before=np.full(folds.before.size, np.inf))
        if less is None or there is None:
            return replace(folds, after=folds.before) if there is None else folds
        last = _compared(less, there)
        return replace(
            folds,
            before=np.concatenate([folds.before, last.before]),
            after=np.concatenate([folds.after, last.after]),
            block=np.concatenate([folds.block, folds.block.max() + 1 + last.block]),
        )

    def on_last(self, one: Fitted, other: Fitted) -> Predictions | None:
        """The squared errors of two fits on the unseen recording; None where there is none, or where one of them cannot
        be simulated there.

        Fits of ordinary least squares: a whitened misfit counts slow torques little, which a person reads.
        """
        if self.unseen is None:
            return None
        less, there = fit_on(one.ordinary, self.unseen), fit_on(other.ordinary, self.unseen)
        return _compared(less, there) if less and there else None

    def least_gain(self, fit: Fitted, now: Fitted) -> float:
        """``policy.LEAST_GAIN``, and of a torque at least ``policy.LEAST_SHARE`` of the squared error of the first
        model; or 1, so that nothing is named, where the error of the motion is one of integration.

        A torque that has this share itself, but takes less beside another one that resembles it, only needs to take
        more than it leaves.  Dry friction of 2 % of the voltage of a motor's back EMF took 70 % of what was left beside
        it, but 5e-5 of the first model's squared error."""
        data = now.generalised.data
        if isinstance(data, OutputError):
            return 1.0 if now.rms < data.accuracy else policy.LEAST_GAIN
        least = policy.LEAST_SHARE * (self.first.rms / max(now.rms, 1e-300)) ** 2
        if least > (most := 1 / 2):
            share = (_added(fit.ordinary, now.model) / max(self.first.ordinary.error, 1e-300)) ** 2
            least = most if share > policy.LEAST_SHARE else least
        return max(policy.LEAST_GAIN, least)

    def is_sized(self, effect: str, fit: Fitted) -> bool:
        """Whether the size of an effect differs from zero; see ``effect_sizes.is_sized``."""
        return is_sized(effect, fit.generalised)


def _added(fit: Regression, fewer: Model) -> float:
    """Root mean square of the torque of the effects that a fit has and a model with fewer of them has not."""
    model = fit.model
    for effect in model.effects:
        model = model if effect in fewer.effects else without(model, effect)
    return rms(fit.data.misfit(model, fit.nuisance) - fit.misfit)


def _fitted_in_time(
    wide: tuple[str, Model], now: Regression, begun: Mapping[str, Regression], rough: Model, share: float
) -> Regression | None:
    """``fitted_with`` in a share of the remaining time.  On a pendulum that was filmed for 330 s the fits with a weight
    and a spring took 0.3 s each, and that with Coulomb friction 48 of 54 s, as it needs short steps: no time was left
    to compare the weight with the spring, which was named."""
    with within(share * remaining_s()):
        return fitted_with(wide, now, begun, rough)


def _compared(less: Regression, there: Regression) -> Predictions:
    """The squared errors of two fits on the unseen recording, in blocks of the residual of the second one."""
    block = there.block
    return Predictions(
        _of_new(less, block) * there.data.whitened(less.misfit) ** 2, _of_new(there, block) * there.residual**2, block
    )


def _of_new(fit: Regression, block: NDArray[np.intp]) -> float:
    """The expected ratio of the squared error of new samples to that of samples to which E initial values of a motion
    were fitted, (N + E)/(N - E) for N effectively independent samples (final prediction error; Akaike 1969).  The
    initial values of a second mode are its amplitude, and no fold leaves them out."""
    own = fit.nuisance.size if isinstance(fit.data, OutputError) else 0
    many = max(min(policy.BLOCK_CORRELATIONS * (int(block.max()) + 1), block.size), own + 1)
    return (many + own) / (many - own)


def _with_load(model: Model, signals: Sequence[Signals], nuisance: FloatArray | None = None) -> Regression:
    """The fit of a model to the torque, repeated once with the transmitted torque that its first fit needs."""
    once = regressed(model, InverseModel.of(signals, model, nuisance), nuisance)
    return regressed(once.model, InverseModel.of(signals, once.model, once.nuisance), once.nuisance)
