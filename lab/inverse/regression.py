"""Least squares of the torque or the motion, confidence intervals, and cross-validated residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import correlation, numbered
from lostmotion.lab.inverse.free_parameters import FitEndsError, jacobian_of, prior_of, scaled
from lostmotion.lab.inverse.problem import Data, Problem, by_recording
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import coarse_substep
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray

__all__ = ["MOST_STEPS", "Regression", "blocks_of", "can_run", "generalised", "regressed"]

MOST_STEPS = 60
"""Largest number of steps of a fit."""
REFITS, LEAST_DAMPING, CONVERGED = 8, 1e-6, 1e-7
"""Steps of a fit to some of the samples, which begins at the fit to all, their damping, and the share of the error by
which the last step of any fit lowers it: with 1e-6 a pendulum's bare swing was off by 17 % more on unseen data, with
1e-8 real servos and oscillators took a tenth to a third longer and named the same."""


@dataclass(frozen=True, eq=False)
class Regression:
    """A model fitted to the torque or the angle of some recordings.

    unknowns, z: its free parameters, (P,); residual: measured less modelled (M,) [N m or rad]; jacobian: its
    derivatives by z and by the nuisance parameters (M, P + E).
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
        """Root mean square of the residual [N m]."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @cached_property
    def misfit(self) -> FloatArray:
        """The residual (M,) before it was whitened [N m or rad]."""
        return self.data.misfit(self.model, self.nuisance)

    @property
    def error(self) -> float:
        """Root mean square of the misfit [N m or rad]."""
        return float(np.sqrt(np.mean(self.misfit**2)))

    @property
    def count(self) -> int:
        """P, the number of free parameters."""
        return len(self.unknowns.items)

    @cached_property
    def predicted(self) -> FloatArray:
        """The misfit of each sample (M,) of a fit to the samples of the other folds."""
        counts = self.data.counts
        length = sum(counts) / policy.LEAST_BLOCKS
        if self._refits_nuisance:  # all folds have samples that identify it
            length = min(length, min(counts) / policy.FOLDS)
        fold = numbered(counts, length) % policy.FOLDS
        found = np.empty_like(self.residual)
        for k in range(policy.FOLDS):
            found[fold == k] = self._refitted(fold != k)[fold == k]
        return found

    def _refitted(self, inside: NDArray[np.bool_]) -> FloatArray:
        """The misfit (M,) with parameters fitted to these samples, by Levenberg-Marquardt steps with the Jacobian of
        all; each parameter stays within about a factor e, or its scale, of its value, so that one that the samples do
        not identify stays unchanged.  Initial states stay unchanged, too: the samples that identify them may all be
        outside."""
        slopes, variance = self.jacobian[inside, : self._here.size], self.rms**2
        curvature = slopes.T @ slopes + variance * np.eye(self._here.size)
        change, residual, damping = np.zeros(self._here.size), self.residual, LEAST_DAMPING
        cost = float(np.sum(residual[inside] ** 2))
        for _ in range(REFITS):
            damped = curvature + damping * np.diag(np.diag(curvature))
            trial = self._bounded(damped, slopes.T @ residual[inside] + variance * change, change)
            error = self._at(self._here + trial)
            with np.errstate(over="ignore"):  # a trial step may be far off
                price = float(np.sum(error[inside] ** 2) + variance * trial @ trial)
            if price < cost:
                gained, change, residual, cost = cost - price, trial, error, price
                damping = max(damping / 10, LEAST_DAMPING)
                if gained < CONVERGED * cost:
                    break
            else:
                damping *= 10
        return self.data.misfit(*self._values(self._here + change))

    @property
    def _refits_nuisance(self) -> bool:
        return isinstance(self.data, Data) and self.nuisance.size > 0

    @cached_property
    def _here(self) -> FloatArray:
        """The values that a refit changes, (P,) or (P + E,)."""
        return np.concatenate([self.z, self.nuisance]) if self._refits_nuisance else self.z

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """The bounds of the values that a refit changes."""
        low, high = self.unknowns.bounds
        if not self._refits_nuisance:
            return low, high
        least, most = _nuisance_bounds(self.data)
        return np.concatenate([low, least]), np.concatenate([high, most])

    def _bounded(self, curvature: FloatArray, slope: FloatArray, change: FloatArray) -> FloatArray:
        """The changes after a Newton step; those that would leave the bounds are clipped, and the others are solved for
        again."""
        low, high = self._bounds
        held, fixed, step = np.zeros(change.size, dtype=bool), np.zeros(change.size), np.zeros(change.size)
        for _ in range(change.size):
            step, free = fixed.copy(), ~held
            right = -slope[free] - curvature[np.ix_(free, held)] @ fixed[held]
            step[free] = np.linalg.solve(curvature[np.ix_(free, free)], right)
            at = self._here + change + step
            outside = free & ((at < low) | (at > high))
            if not outside.any():
                break
            fixed[outside] = (np.clip(at, low, high) - self._here - change)[outside]
            held |= outside
        return np.asarray(change + step)

    def _at(self, values: FloatArray) -> FloatArray:
        """The residual (M,) of other parameters."""
        return self.data.residual(*self._values(values))

    def _values(self, values: FloatArray) -> tuple[Model, FloatArray]:
        """The model and the nuisance parameters of other parameters, within their bounds."""
        low, high = self._bounds
        values = np.clip(values, low, high)
        nuisance = values[self.count :] if self._refits_nuisance else self.nuisance
        return self.unknowns.put(self.model, values[: self.count]), nuisance

    def covariance(self, block: NDArray[np.intp], given: Sequence[str] = ()) -> FloatArray:
        """Covariance of z (P, P), robust to correlation within blocks of samples (cluster-robust; Liang and Zeger
        1986); zero for parameters that are given."""
        known = np.isin(np.arange(self.jacobian.shape[1]), [self.unknowns.names.index(name) for name in given])
        jacobian = np.where(known, 0.0, self.jacobian)
        size = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-100)
        scaled = jacobian / size
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=1e-9, hermitian=True)
        numbers, at = np.unique(block, return_inverse=True)
        scores = np.zeros((numbers.size, size.size))
        np.add.at(scores, at, scaled * self.residual[:, None])
        spread = numbers.size / max(numbers.size - 1, 1) * (scores.T @ scores)
        whole = (inverse @ spread @ inverse) / np.outer(size, size)
        return np.asarray(whole[: self.count, : self.count])

    def deviations(self, block: NDArray[np.intp], given: Sequence[str] = ()) -> FloatArray:
        """Standard deviations (P,) of the parameters in their own units; see ``covariance``."""
        variance = np.maximum(np.diag(self.covariance(block, given)), 0.0)
        return np.asarray(np.abs(self.unknowns.slopes(self.z)) * np.sqrt(variance))

    def deviations_within_bounds(self, block: NDArray[np.intp], given: Sequence[str] = ()) -> FloatArray:
        """Standard deviations of z (P,), in which a parameter that ended at a bound is given for all others."""
        bound = self.unknowns.at_bound(self.z)
        own, inside = (np.diag(self.covariance(block, known)) for known in (given, (*given, *bound)))
        return np.sqrt(np.maximum(np.where(np.isin(self.unknowns.names, bound), own, inside), 0.0))


def regressed(model: Model, data: Problem, nuisance: FloatArray | None = None, steps: int = MOST_STEPS) -> Regression:
    """The model with its free parameters fitted, within their bounds, in so many steps at most, or as far as the time
    allows.  nuisance: initial values of the nuisance parameters.  Raises ModelError where the first values cannot be
    simulated."""
    unknowns = scaled(Unknowns.of(model), model, data)
    count, first = len(unknowns.items), np.clip(unknowns.z(model), *unknowns.bounds)
    beside = np.clip(data.nuisance if nuisance is None else nuisance, *_nuisance_bounds(data))
    z = np.concatenate([first, beside])
    if not z.size:
        return Regression(model, data, unknowns, z, data.residual(model, z), np.empty((sum(data.counts), 0)), z)
    most, near = prior_of(unknowns, data.centre)
    weight = _followed(most, data.residual(unknowns.put(model, first), z[count:]), data, model) if most.any() else most
    once = _minimised(model, data, unknowns, z, weight, near, steps)
    fitted = _followed(most, once.residual, data, model)
    if steps >= MOST_STEPS and (2 * fitted < weight).any():
        return _minimised(model, data, unknowns, np.concatenate([once.z, once.nuisance]), fitted, near, steps)
    unidentified = _unidentified(once) if data.centre is None else np.zeros(count, dtype=bool)
    if not unidentified.any():
        return once
    near = np.where(unidentified, np.maximum(first, _unnoticed(once, first, unidentified)), first)
    weight = np.asarray(unidentified * once.rms / _usual(data, model))
    return _minimised(model, data, unknowns, z, weight, near, steps)


def _followed(most: FloatArray, residual: FloatArray, data: Problem, model: Model) -> FloatArray:
    """The weights of the prior (P,), at most these, where a fit has this residual (M,)."""
    misfit = float(np.sqrt(np.mean(residual**2))) if np.isfinite(residual).all() else math.inf
    return np.minimum(most, misfit / _usual(data, model))


def generalised(fit: Regression) -> Regression:
    """The fit by generalised least squares: again, with a residual whitened by the colour of its misfit.

    A joint that its neighbours move has a misfit of their slow torques, larger than its friction, which is known by its
    steps at the reversals.
    """
    assert isinstance(fit.data, Data)
    return regressed(fit.model, fit.data.coloured(fit.misfit), fit.nuisance)


def _minimised(
    model: Model, data: Problem, unknowns: Unknowns, z: FloatArray, weight: FloatArray, near: FloatArray, steps: int
) -> Regression:
    """The fit that begins at parameters and nuisance z (P + E,); weight, near: (P,), weights and centres of the
    prior."""
    count, size, usual = len(unknowns.items), sum(data.counts), _usual(data, model)
    low, high = (np.concatenate(pair) for pair in zip(unknowns.bounds, _nuisance_bounds(data), strict=True))

    latest: list[tuple[FloatArray, FloatArray]] = []

    def residual(at: FloatArray) -> FloatArray:  # a step is evaluated to be judged, and again for its derivatives
        if not latest or not np.array_equal(latest[0][0], at):
            error = data.residual(unknowns.put(model, at[:count]), at[count:]) / usual
            latest[:] = [(at.copy(), np.concatenate([error, weight * (at[:count] - near)]))]
        return latest[0][1]

    known: list[tuple[FloatArray, FloatArray]] = []

    def jacobian(at: FloatArray) -> FloatArray:  # it is evaluated at the first values and after each step
        slopes = jacobian_of(residual, at, high, data, may_end=bool(known))
        if not np.isfinite(slopes).all():  # beside these values the motion cannot be simulated
            if known:
                raise FitEndsError
            raise ModelError("the motion cannot be simulated near the first values of the parameters")
        known[:] = [(at.copy(), slopes)]
        return slopes

    if not np.isfinite(residual(z)).all():
        raise ModelError("the motion cannot be simulated with the first values of the parameters")
    try:
        with np.errstate(over="ignore"):  # a trial step may be far off: its error is compared, no more
            found = least_squares(residual, z, jacobian, (low, high), x_scale="jac", max_nfev=steps, ftol=CONVERGED)
        x, error, slopes = found.x, found.fun, np.asarray(found.jac)
    except FitEndsError:
        x, slopes = known[0]
        error = residual(x)
    values = unknowns.put(model, x[:count])
    return Regression(values, data, unknowns, x[:count], error[:size] * usual, slopes[:size] * usual, x[count:])


def _usual(data: Problem, model: Model) -> float:
    """The unit of errors, above zero."""
    return max(data.usual(model), 1e-300)


def _nuisance_bounds(data: Problem) -> tuple[FloatArray, FloatArray]:
    """The bounds of the nuisance parameters, (E,) each."""
    return data.nuisance - data.freedom, data.nuisance + data.freedom


def can_run(model: Model, signals: Sequence[Signals]) -> bool:
    """Whether the motion can be simulated; not where friction has reduced the inertia to zero."""
    try:
        coarse_substep(model, [one.experiment for one in signals])
    except ModelError:
        return False
    return True


def _unidentified(fit: Regression) -> NDArray[np.bool_]:
    """Which positive parameters of the base (P,) change the residual insignificantly over a factor e, such as an
    inertia that hardly accelerates; a fit takes them to zero or anywhere."""
    noticed = np.linalg.norm(fit.jacobian[:, : fit.count], axis=0) > fit.rms
    own = [item.logarithmic and "." not in item.name for item in fit.unknowns.items]
    return np.asarray(np.array(own, dtype=bool) & ~noticed)


def _unnoticed(fit: Regression, z: FloatArray, unidentified: NDArray[np.bool_]) -> FloatArray:
    """The largest values (P,) of these positive parameters of the base with an insignificant change of the residual;
    see ``_unidentified``.

    The torque is proportional to an inertia, so that its derivative by the logarithm at z is what a doubling adds;
    where a fit ended at nearly zero, the Jacobian is rounding.  Smaller values explain the samples as well, but a joint
    whose friction is large for its inertia is slow to simulate.
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


def blocks_of(regression: Regression) -> NDArray[np.intp]:
    """The block number of each sample (M,); blocks are about four correlation times of the residual long."""
    counts, parts = regression.data.counts, by_recording(regression.residual, regression.data)
    length = policy.BLOCK_CORRELATIONS * max(correlation(part) for part in parts)
    return numbered(counts, min(max(length, 1.0), sum(counts) / policy.LEAST_BLOCKS))
