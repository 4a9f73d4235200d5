"""How often the search names an effect of gears from which nothing is missing, counted over many draws of the noise.

Near the noise the fits are linear: what effects and initial states do to a segment is computed once from the gears'
motion, and each fit is a regression.  The search, the score test and the test of predictions are the lab's.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import pytest

from lostmotion.lab import policy
from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.gears import likelihood, score_test
from lostmotion.lab.gears.likelihood import SegmentFit, ShortSegments
from lostmotion.lab.gears.trials import Trial
from lostmotion.lab.gears.unseen import Unseen, Validation
from lostmotion.lab.observer.global_search import Optimum
from lostmotion.lab.selection.forward import selected
from lostmotion.lab.selection.nesting import others
from lostmotion.lab.selection.search import Selection
from lostmotion.lab.shooting.continuation import Level, tiles
from lostmotion.lab.shooting.initial_guess import faint, scales_of
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Linearised, Segment, start_with, state_scales
from lostmotion.lab.shooting.task import Task
from lostmotion.model import HandWaved, Model, build_model
from lostmotion.model.motion import FloatArray
from tests.lab.simulated_gears import GEARS

MODEL = build_model("play", values=GEARS)
NOISE = NoiseModel(np.array([0.5]), 1.0)
LENGTH_S, RATE_HZ, SUBSTEP_S = 1.0, 800.0, 5e-4


def moved(seed: int) -> Experiment:
    """The model's own motion by a hand."""
    time = np.arange(round(LENGTH_S * RATE_HZ)) / RATE_HZ
    drive = HandWaved(seed)
    run = MODEL.simulate(drive, time, substep_s=SUBSTEP_S)
    return Experiment(f"{seed}", drive, time, {"accel": run["accel"]})


@dataclass(frozen=True, eq=False)
class Piece:
    """A segment, and the derivatives of its residual by initial state (M, n), parameters (M, P), and each effect."""

    segment: Segment
    by_state: FloatArray
    by_parameter: FloatArray
    by_effect: dict[str, FloatArray]

    def columns(self, effect: str) -> FloatArray:
        """By the parameters (M, P) or, with an effect, (M, P + 1)."""
        own = [self.by_effect[effect][:, None]] if effect else []
        return np.hstack([self.by_parameter, *own])


def pieces(experiment: Experiment, halvings: int) -> list[Piece]:
    """The segments of an experiment in 0.2 m/s² of noise, linearised at the true motion."""
    run = MODEL.simulate(experiment.drive, experiment.time, substep_s=SUBSTEP_S)
    segments = [
        Segment(one, {"accel": 0.2}, state_scales(MODEL, one),
                run.states[int(np.searchsorted(experiment.time, one.time[0]))])
        for one in tiles(experiment, halvings)
    ]  # fmt: skip
    unknowns = Unknowns.of(MODEL)
    size = scales_of(MODEL, segments, SUBSTEP_S)
    effects = {name: faint(MODEL, name, size)[0] for name in others(MODEL)}
    found = []
    for one in segments:
        block = one.linearised(MODEL, unknowns, unknowns.z(MODEL), SUBSTEP_S)
        columns = {
            name: one.residual(model, start_with(model, one, MODEL.state_names), SUBSTEP_S) - block.r
            for name, model in effects.items()
        }
        found.append(Piece(one, block.B, block.A, {n: c for n, c in columns.items() if np.isfinite(c).all()}))
    return found


@dataclass(frozen=True, eq=False)
class Motion:
    """Segments that are fitted, and those that are predicted."""

    fitted: list[Piece]
    unseen: list[Piece]

    @cached_property
    def effects(self) -> list[str]:
        """Those that every segment can be simulated with."""
        return [name for name in others(MODEL) if all(name in one.by_effect for one in (*self.fitted, *self.unseen))]

    @cached_property
    def solved(self) -> dict[str, tuple[FloatArray, FloatArray, FloatArray]]:
        """Without and with each effect: the pseudo-inverse of the columns that are fitted, these, and those to predict
        with; initial states are projected off in each segment."""
        found = {}
        for name in ("", *self.effects):
            old, new = (
                np.concatenate([projected_off(one.by_state, one.columns(name)) for one in every])
                for every in (self.fitted, self.unseen)
            )
            size = np.linalg.norm(old, axis=0)
            found[name] = np.linalg.pinv(old / size), old / size, new / size
        return found


@dataclass(frozen=True, eq=False)
class Draw:
    """The noise of one search (M_i,) of each segment; stands in for what simulates and fits."""

    motion: Motion
    fitted: list[FloatArray]
    unseen: list[FloatArray]

    @classmethod
    def of(cls, motion: Motion, seed: int) -> Draw:
        """From this seed."""
        rng = np.random.default_rng([4100, seed])
        fitted, unseen = (
            [NOISE.simulate(rng, len(one.by_state)) / NOISE.rms for one in every]
            for every in (motion.fitted, motion.unseen)
        )
        return cls(motion, fitted, unseen)

    def linearised(self, segment: Segment, **rest: object) -> Linearised:
        """The noise, with the derivatives of a segment that is fitted."""
        at = next(i for i, one in enumerate(self.motion.fitted) if one.segment is segment)
        own = self.motion.fitted[at]
        return Linearised(self.fitted[at], own.by_parameter, own.by_state)

    def by_effect(self, model: Model, **rest: object) -> list[FloatArray] | None:
        """What the effect of a model changes in each segment."""
        (effect,) = model.effects
        return [one.by_effect[effect] for one in self.motion.fitted] if effect in self.motion.effects else None

    def solved(self, model: Model) -> tuple[FloatArray, FloatArray]:
        """What a linear fit of a model with one effect or none leaves of fitted and unseen segments."""
        inverse, fitted, unseen = self.motion.solved["".join(model.effects)]
        old, new = (
            np.concatenate([projected_off(one.by_state, r) for one, r in zip(every, noise, strict=True)])
            for every, noise in ((self.motion.fitted, self.fitted), (self.motion.unseen, self.unseen))
        )
        return old - fitted @ (inverse @ old), new - unseen @ (inverse @ old)

    def judged(self, model: Model) -> Validation:
        """Predictions of such a fit."""
        ends = np.cumsum([r.size for r in self.unseen])[:-1]
        return Validation(model, tuple(np.split(self.solved(model)[1], ends)))

    def tried(self, level: Level, asked: Sequence[score_test.Direction], *rest: object) -> list[Trial]:
        """Fits with each of these effects."""
        return [
            Trial(one.effect, replace(level, model=one.model, typical=float(np.std(self.solved(one.model)[0]))))
            for one in asked
        ]

    def observed(self, base: Level, found: Sequence[Optimum], *rest: object) -> list[list[Trial]]:
        """Fits with those effects that leave the least, as a perfect search would find them, in two batches."""
        fits = [replace(base, model=one.model, typical=float(np.std(self.solved(one.model)[0]))) for one in found]
        best = sorted(fits, key=lambda fit: fit.typical)[: policy.FINISHED]
        trials, half = [Trial(fit.model.effects[-1], fit) for fit in best], (len(best) + 1) // 2
        return [part for part in (trials[:half], trials[half:]) if part]


@dataclass(frozen=True, eq=False)
class LinearUnseen(Unseen):
    """Unseen segments of a draw."""

    draw: Draw | None = None

    def validate_each(self, models: Sequence[Model], *others: Validation) -> list[Validation]:
        """Predictions of linear fits."""
        assert self.draw
        return [self.draw.judged(model) for model in models]


@dataclass(frozen=True, eq=False)
class Linear(ShortSegments):
    """The likelihood of gears with linear fits to one draw of the noise; what it proposes and tests is the lab's."""

    @property
    def first(self) -> SegmentFit:
        """Without any effect."""
        (judged,) = self.unseen.validate_each([MODEL])
        return SegmentFit(self.short, self.short, judged, 1.0)

    def _longer(self, trials: Sequence[Trial]) -> list[Trial]:
        """As they are."""
        return list(trials)

    def accepted(self, fit: SegmentFit, now: SegmentFit, *, is_first: bool = False) -> SegmentFit:
        """As it is."""
        return replace(fit, floor=1.0)

    def without(self, effect: str, fit: SegmentFit) -> SegmentFit:
        """The fit without the only effect."""
        return self.first

    def is_sized(self, effect: str, fit: SegmentFit) -> bool:
        """Always: none that the test allows is taken back."""
        return True


@pytest.fixture
def motion(monkeypatch: pytest.MonkeyPatch) -> Motion:
    """Two seconds that are fitted, one that is predicted; what every search computes anew of the motion is computed
    once."""
    found = Motion([*pieces(moved(1), 2), *pieces(moved(2), 2)], pieces(moved(3), 1))
    segments = [one.segment for one in found.fitted]
    size = scales_of(MODEL, segments, SUBSTEP_S)
    weak = {name: faint(MODEL, name, size)[:1] for name in found.effects}
    monkeypatch.setattr(score_test, "scales_of", lambda *rest: size)
    monkeypatch.setattr(score_test, "faint", lambda model, effect, *rest: weak.get(effect, []))
    monkeypatch.setattr(score_test, "followed_segments", lambda level, *rest: segments)
    return found


def search(motion: Motion, seed: int, monkeypatch: pytest.MonkeyPatch) -> Selection[SegmentFit]:
    """A search in noise of its own."""
    draw = Draw.of(motion, seed)
    monkeypatch.setattr(Segment, "linearised", draw.linearised)
    monkeypatch.setattr(score_test, "_columns", draw.by_effect)
    monkeypatch.setattr(likelihood, "near_trials", draw.tried)
    unknowns = Unknowns.of(MODEL)
    level = Level(MODEL, unknowns, unknowns.z(MODEL), tuple(one.segment for one in motion.fitted), 1.0, 1.0)
    optima = [Optimum(MODEL.with_effect(effect), 1.0, effect) for effect in motion.effects]
    monkeypatch.setattr(
        likelihood, "search_effects", lambda base, effects, *_: [o for o in optima if o.effect in effects]
    )
    monkeypatch.setattr(likelihood, "observer_trials", partial(draw.observed, level))
    task = Task(MODEL, tuple(one.segment.experiment for one in motion.fitted), {"accel": 0.2}, SUBSTEP_S, 0)
    with ThreadPoolExecutor(1) as pool:
        unseen = LinearUnseen(motion.unseen[0].segment.experiment, task, 0.5, pool, draw)
        return selected(Linear(level, unseen), lambda what, part: None)


@pytest.mark.slow
def test_one_search_in_twenty_proposes_an_effect_and_hardly_any_names_it(
    motion: Motion, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 200 searches in coloured noise the score test proposes an effect in 3 to 7.5 % (its level is 5 %; at 10 % it
    does in 10 %), and unseen segments contradict it: none is named."""
    found = [search(motion, seed, monkeypatch) for seed in range(200)]
    assert 0.03 <= np.mean([bool(one.steps[0].judged) for one in found]) <= 0.075
    assert sum(bool(one.added) for one in found) <= 1
