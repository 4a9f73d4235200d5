"""The score test (Lagrange multiplier test) of whether an effect of small amplitude explains part of a residual.

Near the noise the model is linear in small changes: r = A dz + B dx + c a + noise, with the derivatives A by the fitted
parameters, B by the initial states, and c by the amplitude a of an effect at zero.  With r and c projected off A and B,
and Gamma the covariance of the noise, the statistic is T = (c'r)²/(c' Gamma c).  It is compared with the largest T of
the whole catalogue for noise of the same colour (a parametric bootstrap of the search, not of one effect), which
corrects for the number of effects.  Nothing is fitted here.  The likelihood of gears selects its candidates by this
test.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import fit_autoregression
from lostmotion.lab.shooting.continuation import Level, followed_segments
from lostmotion.lab.shooting.initial_guess import faint, scales_of
from lostmotion.lab.shooting.segment import Linearised, Segment, residuals, start_with
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["Direction", "Scores", "score_test"]

DRAWS = 400
"""Number of draws of the noise."""


@dataclass(frozen=True, eq=False)
class Direction:
    """The test of one shape of an effect.

    model: with the effect at a small amplitude; statistic: T, chi-squared with one degree of freedom for noise;
    amplitude: estimate of the amplitude, in units of that of ``model``.
    """

    effect: str
    model: Model
    statistic: float
    amplitude: float

    @property
    def possible(self) -> bool:
        """Whether the bounds of the amplitudes allow the sign of the estimate."""
        names = get_effect(self.effect).amplitude_names
        return self.amplitude > 0 or all(self.model.parameters[name].low < 0 for name in names)


@dataclass(frozen=True, eq=False)
class Scores:
    """The result of a score test.  directions: the best shape of each effect, largest statistic first; null: the
    largest statistic of the whole search in each draw of noise (DRAWS,)."""

    directions: tuple[Direction, ...] = ()
    null: FloatArray = field(default_factory=lambda: np.zeros(1))

    @property
    def limit(self) -> float:
        """The quantile 1 - ``policy.FALSE_NAME`` of the largest statistic for noise."""
        return float(np.quantile(self.null, 1 - policy.FALSE_NAME))

    @property
    def significant(self) -> tuple[Direction, ...]:
        """The directions whose statistic exceeds the limit."""
        return tuple(one for one in self.directions if one.statistic > self.limit)

    @property
    def detectable(self) -> dict[str, tuple[str, float]]:
        """By effect, the name of its first amplitude and the value of it at which the statistic exceeds the limit with
        probability 1/2."""
        sizes = {}
        for d in self.directions:
            if (names := get_effect(d.effect).amplitudes) and d.statistic > 0:
                value = d.model.parameters[f"{d.effect}.{names[0]}"].value
                sizes[d.effect] = (names[0], abs(value * d.amplitude) * math.sqrt(self.limit / d.statistic))
        return sizes


def score_test(
    level: Level, effects: Sequence[str], substep_s: float, pool: Executor, rng: np.random.Generator
) -> Scores:
    """Tests effects on the residual of a fit, on the segments that its model does not miss; rng: for the draws of
    noise."""
    segments = followed_segments(level, substep_s)
    linearised = partial(Segment.linearised, model=level.model, unknowns=level.unknowns, z=level.z, substep_s=substep_s)
    every = list(pool.map(linearised, segments))
    segments = [segment for segment, block in zip(segments, every, strict=True) if block.finite]
    blocks = [block for block in every if block.finite]
    if not blocks:
        return Scores()
    project = _Projection(blocks)
    here = [block.r for block in blocks]
    noise, r = fit_autoregression(here), project(here)
    size = scales_of(level.model, segments, substep_s)
    models = [(effect, model) for effect in effects for model in faint(level.model, effect, size)]
    before = partial(_columns, before=level.model, segments=segments, known=here, substep_s=substep_s)
    columns = pool.map(before, [model for _, model in models])
    usable = [(e, m, project(c)) for (e, m), c in zip(models, columns, strict=True) if c is not None]
    usable = [entry for entry in usable if entry[2] @ entry[2] > 1e-12]
    if not usable:
        return Scores()
    C = np.array([column / np.linalg.norm(column) for *_, column in usable])
    counts = [part.size for part in here]
    series = noise.simulate(rng, DRAWS, sum(counts)).T
    null = (C @ project(np.split(series, np.cumsum(counts)[:-1]))).T
    spread = np.maximum(null.std(axis=0), 1e-9)
    statistic = (C @ r / spread) ** 2
    found: dict[str, Direction] = {}
    for (effect, model, column), T in zip(usable, statistic, strict=True):
        amplitude = -float(column @ r) / float(column @ column)
        direction = Direction(effect, model, float(T), amplitude)
        found[effect] = max(found.get(effect, direction), direction, key=lambda d: (d.possible, d.statistic))
    ordered = tuple(sorted(found.values(), key=lambda direction: -direction.statistic))
    return Scores(ordered, np.max((null / spread) ** 2, axis=1))


def _columns(
    model: Model, before: Model, segments: Sequence[Segment], known: Sequence[FloatArray], substep_s: float
) -> list[FloatArray] | None:
    """The change of the residual of each segment (M_i,) by an effect of small amplitude; model, before: with and
    without it; known: the residuals without it.  None where the motion cannot be simulated."""
    there = [
        segment.starting(start_with(segment.experiment.model(model), segment, before.state_names))
        for segment in segments
    ]
    changes = [new - r for new, r in zip(residuals(model, there, substep_s), known, strict=True)]
    return changes if all(np.isfinite(change).all() for change in changes) else None


class _Projection:
    """The projection off the derivatives by the shared parameters and by the initial states of all segments."""

    def __init__(self, blocks: Sequence[Linearised]) -> None:
        self._starts = [np.linalg.qr(block.B)[0] for block in blocks]
        A = np.concatenate([self._off(q, b.A) for q, b in zip(self._starts, blocks, strict=True)])
        self._parameters = np.linalg.qr(A)[0]

    def __call__(self, parts: Sequence[FloatArray]) -> FloatArray:
        """The projection (M,) or (M, K) of the residuals of all segments, (M_i,) or (M_i, K) each, in one array."""
        whole = np.concatenate([self._off(q, part) for q, part in zip(self._starts, parts, strict=True)])
        return np.asarray(whole - self._parameters @ (self._parameters.T @ whole))

    @staticmethod
    def _off(q: FloatArray, part: FloatArray) -> FloatArray:
        return np.asarray(part - q @ (q.T @ part))
