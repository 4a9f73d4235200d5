"""Nonlinear least squares of a residual (problem.py, output_error.py), with covariances and cross-validated residuals.

Every fit of the search for missing effects is a ``Regression``, apart from those of gears.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import correlation, numbered
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import FitEndsError
from lostmotion.lab.inverse.free_parameters import Objective, possible, prior_of, scaled
from lostmotion.lab.inverse.problem import InverseModel, Problem
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["MOST_STEPS", "Regression", "can_run", "generalised", "regressed"]

MOST_STEPS = 60
"""Largest number of steps of a fit."""
BEGINNING, SHORTEST_S = 10, 1e-7
"""So many samples, with no shorter steps [s], show whether a model can be simulated: one with a rate above 3e7 1/s
diverges."""
REFITS, CONVERGED = 8, 1e-7
"""Largest number of steps of a fit to some of the samples, which begins at the fit to all of them; and the relative
decrease of the error below which any fit ends.  With 1e-6 the swing of a pendulum was off
by 17 % more on unseen data; with 1e-8 real servos and oscillators took a tenth to a third longer and named the same."""

UNIDENTIFIED = 1e-9
"""Share of the largest eigenvalue of the information, below which a combination of parameters is not identified."""
LEAST_OUTSIDE = 0.05
"""Least share of the information on a combination of parameters that the other blocks have, when one is left out: what
a single block identifies, such as an initial state, is not zero without it.  With 0.01 and 0.2 the intervals of eight
disturbed swings and eight driven masses (``bench.intervals``, seed 60) hold the same 37 of 40 sizes."""


@dataclass(frozen=True, eq=False)
class Regression:
    """A model fitted to some recordings by least squares.

    data: the residual that was minimised; unknowns, z: the P free parameters, and the vector (P,) of their values, see
    ``Unknowns``; residual: at the minimum (M,), in the unit of the problem; jacobian: its derivatives by z and by the
    nuisance parameters (M, P + E).
    """

    model: Model
    data: Problem
    unknowns: Unknowns
    z: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    nuisance: FloatArray
    """(E,) the nuisance parameters."""

    @property
    def rms(self) -> float:
        """Root mean square of the residual."""
        return rms(self.residual)

    @cached_property
    def misfit(self) -> FloatArray:
        """The residual before it was whitened (M,)."""
        return self.data.misfit(self.model, self.nuisance)

    @property
    def error(self) -> float:
        """Root mean square of the misfit."""
        return rms(self.misfit)

    @property
    def count(self) -> int:
        """P, the number of free parameters."""
        return len(self.unknowns.items)

    @cached_property
    def predicted(self) -> FloatArray:
        """The cross-validated misfit (M,): that of each sample after a fit to the samples of the other folds."""
        counts = self.data.counts
        length = sum(counts) / policy.LEAST_BLOCKS
        if isinstance(self.data, InverseModel) and self.nuisance.size:  # all folds have samples that identify it
            length = min(length, min(counts) / policy.FOLDS)
        fold = numbered(counts, length) % policy.FOLDS
        found = np.empty_like(self.residual)
        for k in range(policy.FOLDS):
            found[fold == k] = self._refitted(fold != k)[fold == k]
        return found

    def _refitted(self, inside: NDArray[np.bool_]) -> FloatArray:
        """The misfit of all samples (M,) after a fit to some of them; inside: (M,) which ones.

        The fit begins at the fit to all samples, and uses its Jacobian.  A prior of a factor e, or of the scale of a
        parameter, keeps parameters unchanged that these samples do not identify.  Initial states are not fitted again,
        as the samples that identify them may all be outside.
        """
        every = np.concatenate([self.z, self.nuisance])
        many = every.size if isinstance(self.data, InverseModel) else self.count
        here, weight = every[:many], max(self.rms, 1e-300)
        slopes = np.concatenate([self.jacobian[inside, :many], weight * np.eye(many)])

        known = {here.tobytes(): self.misfit}

        def misfit(there: FloatArray) -> FloatArray:
            key = there.tobytes()
            if key not in known:
                z, nuisance = np.split(np.concatenate([there, every[many:]]), [self.count])
                known[key] = self.data.misfit(self.unknowns.put(self.model, z), nuisance)
            return known[key]

        def errors(there: FloatArray) -> FloatArray:
            return np.concatenate([self.data.whitened(misfit(there))[inside], weight * (there - here)])

        def jacobian(_: FloatArray) -> FloatArray:
            return slopes

        if not many:
            return self.misfit
        low, high = (bound[:many] for bound in _bounds(self.unknowns, self.data))
        with np.errstate(all="ignore"):  # a trial step may be far off
            fit = least_squares(errors, here, jacobian, (low, high), x_scale="jac", max_nfev=REFITS, ftol=CONVERGED)
        return misfit(fit.x)

    @cached_property
    def block(self) -> NDArray[np.intp]:
        """The number of the block of each sample (M,).  Blocks are about four correlation times of the residual long,
        and there are at least ``policy.LEAST_BLOCKS``."""
        counts = self.data.counts
        length = policy.BLOCK_CORRELATIONS * max(correlation(part) for part in self.data.by_recording(self.residual))
        return numbered(counts, min(max(length, 1.0), sum(counts) / policy.LEAST_BLOCKS))

    def blocks(self, is_lasting: bool) -> NDArray[np.intp]:
        """The number of the block of each sample (M,), of which there are ``policy.LASTING_BLOCKS`` where the response
        to a disturbance lasts."""
        counts = self.data.counts
        return numbered(counts, sum(counts) / policy.LASTING_BLOCKS) if is_lasting else self.block

    @property
    def freedom(self) -> int:
        """The degrees of freedom of a test: the number of blocks less one."""
        return int(self.block.max())

    def covariance(self, given: Sequence[str] = ()) -> FloatArray:
        """Covariance of z (P, P), robust to correlation of the residual within blocks of samples (cluster-robust: Liang
        and Zeger 1986).  given: the names of parameters that are taken as known, whose rows and columns are zero."""
        jacobian, size = self._scaled_jacobian(given)
        inverse = np.linalg.pinv(jacobian.T @ jacobian, rcond=UNIDENTIFIED, hermitian=True)
        scores = np.zeros((self.freedom + 1, size.size))
        np.add.at(scores, self.block, jacobian * self.residual[:, None])
        spread = (self.freedom + 1) / max(self.freedom, 1) * (scores.T @ scores)
        whole = (inverse @ spread @ inverse) / np.outer(size, size)
        return np.asarray(whole[: self.count, : self.count])

    def interval(self, is_lasting: bool, given: Sequence[str] = ()) -> tuple[FloatArray, int]:
        """Standard deviations of z (P,) for intervals, and their degrees of freedom G - 1, from the estimates without
        one of G blocks of samples each (delete-a-group jackknife: CR3 of Bell and McCaffrey 2002).

        V = (G - 1)/G sum_g d_g d_g', with d_g = -(A - A_g)^-1 J_g' r_g, A = sum_g A_g, A_g = J_g' J_g.  is_lasting:
        whether disturbances acted on a simulated motion.  Its response lasts longer than the correlation time of the
        residual: that of a swing crosses zero after a quarter of a period, but amplitude and phase remain off.  There
        are ``policy.LASTING_BLOCKS`` then, else the blocks are those of the tests.  A parameter that ended at a
        bound is given for all others, and what was estimated before the fit counts as fitted.  Errors: d_g is of
        first order.
        """
        blocks = self.blocks(is_lasting)
        return self._within_bounds(partial(self._jackknifed, blocks), given), max(int(blocks.max()), 1)

    def _jackknifed(self, blocks: NDArray[np.intp], given: Sequence[str]) -> FloatArray:
        """The covariance CR3 of z (P, P) for these blocks (M,); see ``interval``.  The variance of a parameter that is
        part of a combination which is not identified is infinite: the pseudo-inverse, in which it is zero, gave Coulomb
        friction of 0.578 N m of a servo an interval of 13.505 to 13.520 mN m."""
        jacobian, size = self._scaled_jacobian(given, self.data.estimated_before)
        values, vectors = np.linalg.eigh(jacobian.T @ jacobian)
        known = values > UNIDENTIFIED * values.max(initial=0.0)
        root = vectors[:, known] / np.sqrt(values[known])
        columns, many, spread = jacobian @ root, int(blocks.max()) + 1, np.zeros((known.sum(), known.sum()))
        for g in range(many):
            inside = blocks == g
            share, axes = np.linalg.eigh(columns[inside].T @ columns[inside])
            score = axes.T @ (columns[inside].T @ self.residual[inside])
            change = axes @ (score / np.maximum(1 - share, LEAST_OUTSIDE))
            spread += np.outer(change, change)
        whole = (many - 1) / many * (root @ spread @ root.T) / np.outer(size, size)
        own = np.isin(self.unknowns.names, given, invert=True)
        unknown = np.sum(vectors[: self.count, ~known] ** 2, axis=1) > math.sqrt(UNIDENTIFIED)
        at = np.flatnonzero(unknown & own)
        whole[at, at] = math.inf
        return np.asarray(whole[: self.count, : self.count])

    def _scaled_jacobian(self, given: Sequence[str], *beside: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The Jacobian and other derivatives (M, P + E + B) with columns of length one, zero for the given parameters,
        and their lengths."""
        jacobian = np.concatenate([self.jacobian, *beside], axis=1)
        known = np.isin(np.arange(jacobian.shape[1]), [self.unknowns.names.index(name) for name in given])
        jacobian = np.where(known, 0.0, jacobian)
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-100)
        return jacobian / size, size

    @cached_property
    def deviations(self) -> dict[str, float]:
        """Standard deviations of the parameters in their own units, by name; see ``covariance``."""
        deviations = np.abs(self.unknowns.slopes(self.z)) * np.sqrt(np.maximum(np.diag(self.covariance()), 0.0))
        return dict(zip(self.unknowns.names, deviations.tolist(), strict=True))

    def deviations_within_bounds(self, given: Sequence[str] = ()) -> FloatArray:
        """Standard deviations of z (P,), in which a parameter that ended at a bound is given for all others."""
        return self._within_bounds(self.covariance, given)

    def _within_bounds(
        self, covariance: Callable[[Sequence[str]], FloatArray], given: Sequence[str] = ()
    ) -> FloatArray:
        """The same by this covariance, a function of the given parameters."""
        bound = self.unknowns.at_bound(self.z)
        own = np.diag(covariance(given))
        inside = np.diag(covariance((*given, *bound))) if bound else own
        return np.sqrt(np.maximum(np.where(np.isin(self.unknowns.names, bound), own, inside), 0.0))


def regressed(model: Model, data: Problem, nuisance: FloatArray | None = None, steps: int = MOST_STEPS) -> Regression:
    """Fits the free parameters of a model within their bounds, from its values, by nonlinear least squares.

    nuisance: initial values of the nuisance parameters (E,), by default those of the problem; steps: largest number of
    steps, which may be fewer where the time of the search is up.  Positive parameters of the base have a prior: around
    ``data.prior_centre``, or, where they turn out not to be identified, around their initial values.  Raises ModelError
    where the model cannot be run with its initial values.
    """
    unknowns = scaled(Unknowns.of(model), model, data)
    count, nuisance = len(unknowns.items), data.nuisance if nuisance is None else nuisance
    z = np.clip(np.concatenate([unknowns.z(model), nuisance]), *_bounds(unknowns, data))
    first = z[:count]
    if not z.size:
        return Regression(model, data, unknowns, z, data.residual(model, z), np.empty((sum(data.counts), 0)), z)
    if data.prior_centre and count:
        misfit = rms(data.residual(unknowns.put(model, first), z[count:])) / _signal_rms(data, model)
        weight, near = prior_of(unknowns, data.prior_centre, misfit)
        once = _minimised(model, data, unknowns, z, weight, near, steps)
        less, _ = prior_of(unknowns, data.prior_centre, once.rms / _signal_rms(data, model))
        if steps < MOST_STEPS or not (2 * less < weight).any():
            return once
        return _minimised(model, data, unknowns, np.concatenate([once.z, once.nuisance]), less, near, steps)
    once = _minimised(model, data, unknowns, z, np.zeros(count), first, steps)
    unidentified = _unidentified(once)
    if not unidentified.any():
        return once
    near = np.where(unidentified, np.maximum(first, _unnoticed(once, first, unidentified)), first)
    weight = np.asarray(unidentified * once.rms / _signal_rms(data, model))
    return _minimised(model, data, unknowns, z, weight, near, steps)


def generalised(fit: Regression) -> Regression:
    """The fit repeated with a residual that is whitened by the colour of its misfit (generalised least squares).

    Where neighbours move a joint, their slow torques are a misfit larger than its friction.  The friction is then known
    by its steps at the reversals.
    """
    assert isinstance(fit.data, InverseModel)
    return regressed(fit.model, fit.data.coloured(fit.misfit), fit.nuisance)


def _minimised(
    model: Model, data: Problem, unknowns: Unknowns, z: FloatArray, weight: FloatArray, near: FloatArray, steps: int
) -> Regression:
    """The least-squares fit from z (P + E,), the parameters and the nuisance parameters; weight, near: (P,), weights
    and centres of the prior."""
    count, size, usual = len(unknowns.items), sum(data.counts), _signal_rms(data, model)
    bounds = _bounds(unknowns, data)
    most = possible(unknowns, model, data)
    objective = Objective(model, data, unknowns, usual, weight, near, bounds[1], most)
    if not np.isfinite(objective.residual(z)).all():
        raise ModelError("the motion cannot be simulated with the first values of the parameters")
    with np.errstate(all="ignore"), suppress(FitEndsError):  # a trial step may be far off: its error is compared
        least_squares(objective.residual, z, objective.jacobian, bounds, x_scale="jac", max_nfev=steps, ftol=CONVERGED)
    assert objective.known  # at the last step that was taken
    x, error, slopes = objective.known
    values = unknowns.put(model, x[:count])
    return Regression(values, data, unknowns, x[:count], error[:size] * usual, slopes[:size] * usual, x[count:])


def _signal_rms(data: Problem, model: Model) -> float:
    """The root mean square of the signal as a unit of errors, above zero."""
    return max(data.signal_rms(model), 1e-300)


def _bounds(unknowns: Unknowns, data: Problem) -> tuple[FloatArray, FloatArray]:
    """The lowest and highest parameters and nuisance parameters, (P + E,) each."""
    (low, high), near, off = unknowns.bounds, data.nuisance, data.nuisance_range
    return np.concatenate([low, near - off]), np.concatenate([high, near + off])


def can_run(model: Model, signals: Sequence[Signals]) -> bool:
    """Whether the model can be simulated, which it cannot where a fit has reduced its inertia to zero.  The beginnings
    show it: of friction behind a play of 40 µrad a whole second takes half a minute."""
    try:
        for whole in (one.experiment for one in signals):
            begun = whole.between(whole.time[0], whole.time[:BEGINNING][-1])
            begun.model(model).simulate(begun.drive, begun.time, shortest_s=SHORTEST_S)
    except ModelError:
        return False
    return True


def _unidentified(fit: Regression) -> NDArray[np.bool_]:
    """Which positive parameters of the base (P,) change the residual insignificantly over a factor e, such as the
    inertia of a joint that hardly accelerates.  Least squares leaves them at zero or at any value."""
    noticed = np.linalg.norm(fit.jacobian[:, : fit.count], axis=0) > fit.rms
    own = [item.logarithmic and "." not in item.name for item in fit.unknowns.items]
    return np.asarray(np.array(own, dtype=bool) & ~noticed)


def _unnoticed(fit: Regression, z: FloatArray, unidentified: NDArray[np.bool_]) -> FloatArray:
    """The largest z (P,) of unidentified parameters at which they change the residual insignificantly; see
    ``_unidentified``.

    The torque is proportional to an inertia, so that its derivative by the logarithm is what a doubling adds.  The
    Jacobian is not used, as it is rounding where a fit ended at nearly zero.  Smaller values explain the samples as
    well, but a joint whose friction is large for its inertia is slow to simulate.
    """
    found = z.copy()
    for at in np.flatnonzero(unidentified):
        once, twice = (
            fit.data.residual(
                fit.unknowns.put(fit.model, np.where(np.arange(z.size) == at, value, fit.z)), fit.nuisance
            )
            for value in (z[at], z[at] + math.log(2.0))
        )
        noticed = max(float(np.linalg.norm(twice - once)), 1e-300)
        found[at] = z[at] + math.log(max(fit.rms, 1e-300) / noticed)
    return found
