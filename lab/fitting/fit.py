"""Fits by multiple shooting as results: the search for the minimum, the last refinement, and confidence intervals.

The search (strategy.py) uses a coarse integration step, robust weights, and values near those of the model file.  The
refinement uses a fine step, squares, and the bounds of the file.  Confidence intervals take the correlation of the
residual into account: with J the Jacobian, H = J'J, and Gamma the autocovariance of the residual from an
autoregression, the covariance is H^-1 J' Gamma J H^-1 (Huber's sandwich), which is wider for coloured noise.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.special import stdtrit

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import fit_autoregression
from lostmotion.lab.data.clipping import with_range
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.data.rounded_input import drawn_again
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import Progress
from lostmotion.lab.fitting.strategy import best_fit, grown, repaired_fit
from lostmotion.lab.results import Fit
from lostmotion.lab.shooting.continuation import Level, fitted, followed_segments
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import FINE_STEP, Segment
from lostmotion.lab.shooting.task import Task, fine_substep
from lostmotion.model import Model, Sampled
from lostmotion.model.motion import FloatArray

__all__ = ["by_column", "fit_of", "fit_segments", "refined_fit", "rms_by_column"]

log = logging.getLogger(__name__)

PROMISED = 1e-4
"""Least standard deviation of z: the accuracy of the solver and of the interpolated input.  Where impacts amplify every
change, noise alone would give intervals of 1e-7, narrower than these errors."""
DRAWS = 3
"""Number of fits with other inputs."""
MOST_LAGS = 4096
"""Largest lag of the residual's autocovariance [samples]."""


def fit_segments(
    model: Model, experiments: Sequence[Experiment], pool: Executor, progress: Progress = lambda what, part: None
) -> Fit:
    """Fits the free parameters of a model to all experiments together, by multiple shooting.

    progress: called with what is being done and the share that is done, 0 to 1.  After Ctrl-C (KeyboardInterrupt) in
    the growing horizon or the refinement the best fit so far is returned, with ``stopped_early``.
    """
    task = Task.of(model, experiments, noise_of(experiments))
    progress("looking for the right valley", 0.0)
    level = best_fit(model, task, pool)
    try:
        progress("longer segments", 0.4)
        level = grown(level, task)
        progress("refining", 0.8)
        refined = _refined_level(level, task)
        followed = _followed(refined, task)
        if lost := len(refined.segments) - len(followed):
            log.warning(
                "%d of %d segments of %.2g s are not followed, and left out of the error",
                lost, len(refined.segments), refined.horizon_s,
            )  # fmt: skip
        return _result(refined, task, followed, _from_rounding(refined, task))
    except KeyboardInterrupt:
        return replace(fit_of(level, task), stopped_early=True)
    finally:
        progress("done", 1.0)


@lru_cache(maxsize=8)  # whether the size of each effect is identified is asked of one level
def refined_fit(level: Level, task: Task) -> Fit:
    """The result of a level after the last refinement."""
    refined = _refined_level(level, task)
    return _result(refined, task, _followed(refined, task), _from_rounding(refined, task))


def _from_rounding(level: Level, task: Task) -> FloatArray | float:
    """The covariance of z (P, P) that comes from the rounding of the input: the mean square difference of ``DRAWS``
    fits with other inputs that the readings tell as well, with the quantile of Student's t for so few.  It includes
    their bias, which an error of the input causes (regression dilution)."""
    inputs = {one.name: (one.drive, one.drive_step) for one in task.experiments if isinstance(one.drive, Sampled)}
    if not any(step for _, step in inputs.values()):
        return 0.0
    rng, near, moved = np.random.default_rng(0), Unknowns.of(level.model, level.model), []
    for _ in range(DRAWS):
        drives = {name: drawn_again(drive, step, rng) for name, (drive, step) in inputs.items()}
        segments = [
            replace(one, experiment=replace(one.experiment, drive=drives[one.experiment.name]))
            for one in level.segments
        ]
        moved.append(repaired_fit(level.model, near, segments, task).z - level.z)
    off = np.array(moved) * float(stdtrit(DRAWS, 0.975)) / policy.HALF_WIDTH
    return np.asarray(off.T @ off / DRAWS)


def _refined_level(level: Level, task: Task) -> Level:
    """The level fitted again with a fine integration step, least squares, and the bounds of the file only."""
    substep = fine_substep(level.model, task.experiments)
    model = with_range(level.model, task.experiments)
    unknowns = Unknowns.of(model)
    once = fitted(model, unknowns, level.segments, substep)
    return fitted(once.model, unknowns, once.segments, substep, quadratic=True)


def fit_of(level: Level, task: Task) -> Fit:
    """The result of a level: estimates with intervals and correlations, errors by column on the segments that the
    model follows; those that it has lost would be the error of an impact at the wrong time."""
    return _result(level, task, _followed(level, task))


def _followed(level: Level, task: Task) -> list[Segment]:
    """The segments that the model follows with a fine integration step."""
    return followed_segments(level, fine_substep(level.model, task.experiments))


def _result(level: Level, task: Task, followed: list[Segment], also: FloatArray | float = 0.0) -> Fit:
    """The result of a level; also: covariance of z (P, P) beside that of the noise."""
    substep = fine_substep(level.model, task.experiments)
    covariance = _covariance(level, followed, substep) + also
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    told = followed or level.segments
    left = rms_by_column([(s, s.residual(s.experiment.model(level.model), s.start, substep)) for s in told])
    column = next(iter(left))
    return Fit(
        model=level.model,
        experiments=tuple(segment.experiment for segment in level.segments),
        starts=tuple(segment.start for segment in level.segments),
        estimates=level.unknowns.estimates(level.model, level.z, deviation, policy.HALF_WIDTH),
        correlation=np.asarray(correlation),
        noise=task.noise,
        rms=left,
        substep_s=substep,
        complete=left[column] <= policy.GOOD * task.noise[column],
    )


def rms_by_column(segments: Sequence[tuple[Segment, FloatArray]]) -> dict[str, float]:
    """Root mean square of the residual of each column, in its unit; segments: each with its residual (M,) in units of
    the noise."""
    residuals: dict[str, list[FloatArray]] = {}
    for segment, r in segments:
        for name, part in by_column(segment, r).items():
            residuals.setdefault(name, []).append(part * segment.noise[name])
    return {name: rms(*parts) for name, parts in residuals.items()}


def by_column(segment: Segment, r: FloatArray) -> dict[str, FloatArray]:
    """The residual (M,) of a segment, in units of the noise, in the parts of its columns."""
    counts = [int(np.sum(~np.isnan(values))) for values in segment.experiment.measured.values()]
    return dict(zip(segment.experiment.measured, np.split(r, np.cumsum(counts)[:-1]), strict=True))


def _covariance(level: Level, good: Sequence[Segment], substep_s: float) -> FloatArray:
    """Covariance of z (P, P) with the initial states eliminated, from the segments that the model does not miss."""
    H = np.diag(1 / level.unknowns.prior**2)
    G = H.copy()  # unidentified parameters keep their prior variance
    blocks = [segment.linearised(level.model, level.unknowns, level.z, substep_s, FINE_STEP) for segment in good]
    blocks = [block for block in blocks if block.finite]
    if not blocks:
        return np.diag(level.unknowns.prior**2)
    noise = fit_autoregression([block.r for block in blocks])
    gamma = noise.autocovariance(MOST_LAGS)
    for block in blocks:
        J = projected_off(block.B, block.A)
        H += J.T @ J
        G += J.T @ matmul_toeplitz(np.pad(gamma, (0, len(J)))[: len(J)], J)
    inverse = np.linalg.pinv(H, hermitian=True)
    covariance = inverse @ G @ inverse
    return np.asarray((covariance + covariance.T) / 2 + PROMISED**2 * np.eye(level.z.size))
