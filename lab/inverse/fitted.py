"""A fit of the search, the same model on another recording, and what is left of both."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.deadline import within
from lostmotion.lab.inverse.candidates import tried
from lostmotion.lab.inverse.effect_sizes import disagree, uncertainty
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.parameters import held
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["Fitted", "error_on", "fit_on", "followed", "interval", "is_disturbed", "is_noise"]


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model of the search with its fits."""

    ordinary: Regression
    """The least-squares fit, by which candidates are proposed."""
    generalised: Regression
    """The fit that predicts unseen samples: the generalised least-squares fit where the misfit of a torque is whitened,
    else the ordinary one."""
    screened_rms: float | None = None
    """See ``screened``; None for the error of the ordinary fit."""

    @property
    def surest(self) -> Regression:
        """The fit to report: of the least-squares and the generalised least-squares fit of a torque the one with the
        smaller relative deviations of its effects.  Whitening gives more weight to high frequencies, where the noise of
        an angle dominates its speed.  Where the estimates of an effect disagree, the model is not right in the whole
        band (Hausman, Econometrica 46, 1978, 1251-1271), and least squares approximate what is measured best: 419 N of
        dry friction in a damper left 314 N of a recording, and 164 N by generalised least squares left 358 N.  The
        other way round, where neighbours move a joint, none of 32 pairs of fits disagree."""
        if self.generalised is self.ordinary or disagree(self.ordinary, self.generalised):
            return self.ordinary
        return min(self.ordinary, self.generalised, key=uncertainty)

    @property
    def model(self) -> Model:
        """The model of the fit for predictions."""
        return self.generalised.model

    @property
    def rms(self) -> float:
        """Root mean square error of the fit for predictions."""
        return self.generalised.rms

    @property
    def screened(self) -> float:
        """Root mean square error of the fit to select candidates with.  For a candidate of a free motion this is the
        error of the present model times the ratio of their errors of the acceleration, as a swing with its weight but
        without its damping is out of phase."""
        return self.ordinary.rms if self.screened_rms is None else self.screened_rms

    @property
    def count(self) -> int:
        """The number of fitted parameters; the initial values of a mode count."""
        return self.generalised.count + self.generalised.nuisance.size


def error_on(fit: Regression, unseen: Signals) -> float:
    """Root mean square error of a fitted model on an unseen recording, in the unit of the problem; infinite where the
    motion cannot be simulated."""
    there = fit_on(fit, unseen)
    return there.error if there else math.inf


@lru_cache(maxsize=64)  # each candidate is compared with several others
def fit_on(fit: Regression, unseen: Signals) -> Regression | None:
    """The fitted model on an unseen recording, on which only the nuisance parameters (initial state, zero angle) are
    fitted; None where the motion cannot be simulated.  A later part of a fitted recording has the zero of that one."""
    known = held(fit.model, fit.unknowns.names)
    with suppress(ModelError), within(math.inf):  # a fit that is cut short would be reported as the effect's error
        if isinstance(fit.data, OutputError):
            is_part = unseen.experiment.name in {one.experiment.name for one in fit.data.signals}
            data = replace(OutputError.of([unseen], known, fit.data.substep_s), is_anchored=is_part)
            return followed(known, data)
        colour = fit.data.colour if isinstance(fit.data, InverseModel) else 0.0
        return regressed(
            known, replace(InverseModel.of([unseen], known), is_anchored=fit.nuisance.size == 0, colour=colour)
        )
    return None


def followed(known: Model, data: OutputError) -> Regression | None:
    """The best fit of the nuisance parameters alone, from each of their first values, a free motion on a growing
    horizon; None where the motion cannot be simulated.  known: a model without free parameters."""
    fits = [found for begin in data.begins if (found := tried(known, data.horizons, begin))]
    return min(fits, key=lambda one: one.rms, default=None)


def is_disturbed(fit: Regression) -> bool:
    """Whether the misfit of a measured torque is a larger share of its variance than an effect has to take
    (``policy.LEAST_GAIN``), as where the neighbours of a joint move it: for two joints of arms the share is 0.36 and
    0.9, for six other joints and motors at most 0.02."""
    if not isinstance(fit.data, InverseModel):
        return False
    torque = np.concatenate([one.filtered(one.torque) for one in fit.data.signals])
    return fit.error**2 > policy.LEAST_GAIN * float(torque.var())


def interval(fit: Regression, floor: float) -> tuple[FloatArray, int]:
    """``Regression.interval``: disturbances last where a simulated motion leaves more than noise; floor: root mean
    square of the noise of the sensors within the band."""
    return fit.interval(is_lasting=isinstance(fit.data, OutputError) and not is_noise(fit.misfit, floor))


def is_noise(residual: FloatArray, floor: float) -> bool:
    """Whether a residual (M,) is no larger than the noise of the sensors within the band; floor: its root mean square.

    The lower end of a 95 % interval of its standard deviation is compared with ``policy.STRUCTURED`` times the noise.
    The deviation is that around the median, estimated by the median absolute deviation, as that is robust to transients
    of the filter at the ends of a recording, and the median itself: the residual of a motor at a steady speed is
    constant.  Its relative standard error is 1.17 / sqrt(N) for N independent normal values.
    """
    middle = float(np.median(residual))
    spread = math.hypot(middle, 1.4826 * float(np.median(np.abs(residual - middle))))
    return spread / (1 + 1.645 * 1.17 / math.sqrt(residual.size)) < policy.STRUCTURED * floor
