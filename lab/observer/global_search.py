"""Global search for parameters and effects of gears by the prediction error of observers.

The error of a free simulation of gears has a local minimum for every way in which impacts can be confused; the
prediction error of an observer has hardly any.  It is a smooth function of play, damping and effects, and is minimised
by differential evolution (Storn and Price 1997), first with a medium gain and then with a low one.  The best effects
are minimised further by Levenberg-Marquardt steps (descent.py): two populations of a compliant shaft, which has three
parameters, ended at costs of 1.15 and 1.54, and these steps at 0.75 and 1.43 (a pair of seed 6100).  Fits on short
segments begin at the minima (fitting/strategy.py, gears/trials.py).  No selection here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import ACCEL
from lostmotion.lab.deadline import is_over
from lostmotion.lab.observer.descent import Descent
from lostmotion.lab.observer.filter import STRONG, WEAK, can_follow
from lostmotion.lab.observer.objective import Follower
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.initial_guess import initial_guesses, scales_of
from lostmotion.lab.shooting.parameters import Unknowns, held
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.guesses import MotionScales
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray

__all__ = ["FARTHEST", "SEEDS", "Optimum", "search_effects", "search_parameters"]

E = TypeVar("E", "_Population", "Optimum")

FIRST, EACH, MOST_EACH, POPULATION = 72, 9, 240, 24
"""Least size of the first population; its size for each initial guess of an effect with many of them, and its largest
size; size of the later populations, a multiple of ``VECTOR``."""
BASE_GENERATIONS, EFFECT_GENERATIONS, FINAL_GENERATIONS = 8, 5, 8
"""Generations of a search for parameters, of an effect with the medium gain, and of either with the low gain."""
WIDTH = {"d": 0.22, "alpha": 0.3, "k": 0.01, "b": 0.25, "l": 0.03}
"""Standard deviations of the logarithms of parameters in a first population."""
BIAS_WIDTH = 0.05  # m/s²
EFFECT_WIDTH = 0.4
"""The same for parameters of effects."""
SURE = 0.2
"""Share of these widths for members around fitted values."""
LARGER = 4.0
"""Initial guesses of an effect are also those at a torque that is so many times as large."""
DIFFERENTIAL_WEIGHT, CROSSOVER = 0.6, 0.9
"""Weight of the difference from one of the best members, and the probability that a value changes."""
MUTATED, FARTHEST = 0.5, 3
"""Share of the trials whose whole numbers change, and the largest change."""
SEEDS = 2
"""Searches with other random numbers: for the first fit, and for effects until one is accepted.  That of a finite
actuator, which has three parameters, comes to its minimum in three of eight (a pair of seed 7200)."""
NICHES, NICHES_LEFT = 4, 2
"""Number of subpopulations (niches) over the range of a whole number; number of those that are evolved to the end."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """A model from the search, its cost (see ``_cost``), and the effect that it has beyond the model of the file."""

    model: Model
    cost: float
    effect: str = ""


def search_parameters(model: Model, task: Task, seed: int = 0) -> Model:
    """The model with those values of its free parameters that minimise the prediction error of observers; seed: of the
    differential evolution."""
    model = _with_bias(model, task)
    follower = Follower.of(task, model)
    found = _Population(follower, [model], seed)
    found.evolve(BASE_GENERATIONS)
    found.evolve_low_gain()
    return found.best().model


def search_effects(base: Level, effects: Sequence[str], task: Task, pool: Executor, seed: int = 0) -> list[Optimum]:
    """The effects with the least prediction errors of observers, with their models, best first.

    Each effect comes to the local minimum near the best member of its first generations, those with the least cost to
    that of the low gain.  Those with the least cost there are followed by the one with the least cost of the high gain,
    which a hum misleads less.  base: the fit without them, with whose values, and those of the file, the initial
    guesses of the effects are combined; seed: of the differential evolution.  An effect with a whole number may occur
    twice, as its local minima are far from each other.  Returns none where the time is up or no bar was measured.
    """
    if is_over() or not can_follow(task.rough, *task.experiments):
        return []
    follower, size = _follower(base.model, task), scales_of(base.model, base.segments, task.substep_s)
    begin = partial(_begun, base=base.model, follower=follower.with_more_noise(), size=size, seed=seed)
    begun = [population for niches in pool.map(begin, effects) for population in niches]
    polished = [*pool.map(partial(_polished, follower=follower), _leading(begun, len(effects), NICHES_LEFT))]
    finished = [*pool.map(_finished, _leading(polished, 2 * policy.FINISHED, NICHES_LEFT))]  # in the order of high gain
    best = _leading(finished, policy.FINISHED, NICHES_LEFT)
    known = {one.effect for one in best}
    return best + [one for one in finished if one.effect == finished[0].effect and one.effect not in known]


def _cost(follower: Follower, model: Model) -> float:
    """The geometric mean of the costs of observers with the medium and the low gain.  With the low gain alone the right
    model may diverge where a wrong one happens not to."""
    return math.sqrt(follower.cost(model, STRONG) * follower.cost(model, WEAK))


def _follower(model: Model, task: Task) -> Follower:
    """The objective around a model, with the values of the file for the parameters of the base."""
    given = {name: p.value for name, p in task.rough.parameters.items()}
    return Follower.of(task, _with_bias(model.replace(given), task))


def _with_bias(model: Model, task: Task) -> Model:
    """The model with the bias of the sensor set to the mean reading, where it is free."""
    bias = model.parameters["bias"]
    if bias.fixed:
        return model
    mean = float(np.mean([np.nanmean(e.measured[ACCEL]) for e in task.experiments]))
    return model.replace({"bias": bias.clipped(mean)})


class _Population:
    """A population of differential evolution (current-to-pbest/1; Zhang and Sanderson 2009): models and their costs.

    Whole numbers are taken from one of the best members, and mutated by small steps.  sure: for each initial model,
    whether its values are those of a fit; effect: the one that they have beyond the model of the file.
    """

    def __init__(
        self, follower: Follower, models: Sequence[Model], seed: int, sure: Sequence[bool] = (), effect: str = ""
    ) -> None:
        self.effect = effect
        self.follower, self._coupling, self._random = follower, STRONG, np.random.default_rng(seed)
        self._unknowns = Unknowns.of(_with_time(models[0], effect) if effect else models[0], follower.rough)
        self._whole = [name for name, p in models[0].parameters.items() if p.domain.is_whole and "." in name]
        many = max(FIRST, len(models), min(EACH * len(models), MOST_EACH))
        kept = [models[i % len(models)] for i in range(many)]
        z, spread = np.array([self._unknowns.z(model) for model in kept]), self._spread() * np.ones((many, 1))
        spread[: len(sure)] *= np.where(sure[:many], SURE, 1.0)[:, None]
        z = np.clip(z + spread * self._random.standard_normal(z.shape), *self._unknowns.bounds)
        costs = self._first_costs(kept, z)
        order = np.argsort(costs)[:POPULATION]
        self._models, self._z, self.costs = [kept[i] for i in order], z[order], costs[order]

    def _first_costs(self, models: Sequence[Model], z: FloatArray) -> FloatArray:
        """The costs of a first population (K,), exact for its best members, which will be kept; so many as go side by
        side are evaluated at once."""
        costs = np.empty(0)
        for first in range(0, len(models), LANES):
            most = np.sort(costs)[POPULATION - 1] if costs.size >= POPULATION else math.inf
            part = slice(first, first + LANES)
            costs = np.append(costs, self._costs(models[part], z[part], most))
        return costs

    @property
    def cost(self) -> float:
        """The least cost of a member."""
        return float(self.costs.min())

    def best(self) -> Optimum:
        """The member with the least cost."""
        best = int(np.argmin(self.costs))
        model = self._unknowns.put(self._models[best], self._z[best])
        return Optimum(model, _cost(self.follower, model), self.effect)

    def evolve_low_gain(self) -> None:
        """Evaluates the population with the low gain, and evolves it by some more generations."""
        self.judge_by(self.follower, WEAK)
        self.evolve(FINAL_GENERATIONS)

    def judge_by(self, follower: Follower, coupling: float = STRONG) -> None:
        """Sets the objective and the gain, and evaluates the population."""
        self.follower, self._coupling = follower, coupling
        self.costs = self._costs(self._models, self._z)

    def evolve(self, generations: int) -> None:
        """Evolves the population by so many generations, or until the time is up.  The members of a generation are
        evaluated side by side."""
        for _ in range(generations):
            if is_over():
                break
            models, trials = self._offspring()
            costs = self._costs(models, trials, self.costs)
            for i in np.flatnonzero(costs < self.costs):
                self._models[i], self._z[i], self.costs[i] = models[i], trials[i], costs[i]

    def polish(self) -> None:
        """Replaces the worst member by the local minimum near the best one, if that costs less."""
        best, worst = int(np.argmin(self.costs)), int(np.argmax(self.costs))
        model = self._unknowns.put(self._models[best], self._z[best])
        z = np.clip(self._unknowns.z(Descent.of(model, self.follower, self._coupling).model), *self._unknowns.bounds)
        (cost,) = self._costs([model], z[None])
        if cost < self.costs[best]:
            self._models[worst], self._z[worst], self.costs[worst] = model, z, cost

    def _offspring(self) -> tuple[list[Model], FloatArray]:
        """A trial for each member: models with whole numbers, and vectors (K, P)."""
        random, z, size = self._random, self._z, len(self._z)
        top, models, trials = np.argsort(self.costs)[: max(3, size // 5)], [], np.empty_like(z)
        for i in range(size):
            (a, b), lead = random.choice(size, 2, replace=False), int(random.choice(top))
            step = DIFFERENTIAL_WEIGHT * (z[lead] - z[i]) + random.uniform(0.3, 0.9) * (z[a] - z[b])
            trials[i] = z[i] + np.where(random.random(step.size) < CROSSOVER, step, 0.0)
            models.append(self._mutated(self._models[lead]))
        return models, np.clip(trials, *self._unknowns.bounds)

    def _mutated(self, model: Model) -> Model:
        """The model, in half of the calls with its whole numbers changed by at most ``FARTHEST``."""
        if not self._whole or self._random.random() > MUTATED:
            return model
        values = {name: model.parameters[name] for name in self._whole}
        steps = self._random.integers(-FARTHEST, FARTHEST + 1, len(values))
        changed = zip(values.items(), steps, strict=True)
        return model.replace({name: p.clipped(p.value + step) for (name, p), step in changed})

    def _costs(self, models: Sequence[Model], z: FloatArray, most: FloatArray | float = math.inf) -> FloatArray:
        """The costs of models with these values (K,); see ``Follower.costs``."""
        put = [self._unknowns.put(model, one) for model, one in zip(models, z, strict=True)]
        return self.follower.costs(put, self._coupling, most)

    def _spread(self) -> FloatArray:
        """Standard deviations of z in a first population (P,): ``WIDTH`` for the base, ``EFFECT_WIDTH`` for effects."""
        items = self._unknowns.items
        return np.array([BIAS_WIDTH / i.scale if i.name == "bias" else WIDTH.get(i.name, EFFECT_WIDTH) for i in items])


def _with_time(model: Model, effect: str) -> Model:
    """The model with the parameters of its other effects than this one fixed that shift or stretch the time of the
    input or of the readings.  A population keeps their fitted values: runs that differ in them cannot be computed side
    by side, which takes four times as long (35.7 s and 7.9 s of processor time in the second step of a pair)."""
    shifting = [one for name in model.effects if name != effect and ((one := get_effect(name)).delay or one.clock_rate)]
    return held(model, [f"{one.id}.{name}" for one in shifting for name in model.own(one.id)])


def _begun(effect: str, base: Model, follower: Follower, size: MotionScales, seed: int) -> list[_Population]:
    """Populations of a model with one more effect after some generations, one for each niche."""
    models = [base.with_effect(effect), follower.rough.with_effect(effect)]
    found = _values(models[0], effect, [size, replace(size, torque=LARGER * size.torque)])
    populations = []
    for part in _niches(models[0], found):
        every = [model.replace(values) for values in part for model in models]
        populations.append(_Population(follower, every, seed, [True, False] * len(part), effect))
        populations[-1].evolve(EFFECT_GENERATIONS)
    return populations


def _values(model: Model, effect: str, wide: Sequence[MotionScales]) -> list[dict[str, float]]:
    """Initial guesses of the effect at each of these scales, with either sign; wide: the scales."""
    found: list[dict[str, float]] = []
    for one in wide:
        found += [values for values in initial_guesses(model, effect, one) if values not in found]
    return found + [{**v, **opposite} for v in found if (opposite := _opposite(model, v))]


def _niches(model: Model, found: list[dict[str, float]]) -> list[list[dict[str, float]]]:
    """The guesses in niches of neighbouring whole numbers, or in one niche where there is no whole number."""
    whole = [name for name in found[0] if model.parameters[name].domain.is_whole]
    if not whole:
        return [found]
    ordered = sorted(found, key=lambda values: values[whole[0]])
    edges = np.linspace(0, len(ordered), NICHES + 1).astype(int)
    return [ordered[a:b] for a, b in itertools.pairwise(edges) if b > a]


def _opposite(model: Model, values: dict[str, float]) -> dict[str, float]:
    """Those values of an effect, with the opposite sign, whose bounds allow it; none of angles."""
    may = {name for name in values if -values[name] >= model.parameters[name].low and values[name] > 0}
    return {name: -values[name] for name in may if "." in name and not name.endswith(".phi")}


def _leading(found: Sequence[E], effects: int, niches: int) -> list[E]:
    """The best niches of the best ``effects`` effects, at most ``niches`` of each, best first."""
    of_effect: dict[str, list[E]] = {}
    for one in sorted(found, key=lambda one: one.cost):
        of_effect.setdefault(one.effect, []).append(one)
    return [one for own in list(of_effect.values())[:effects] for one in own[:niches]]


def _polished(population: _Population, follower: Follower) -> _Population:
    """The population on all segments, with the local minimum near its best member in the place of its worst one."""
    population.judge_by(follower)
    population.polish()
    return population


def _finished(population: _Population) -> Optimum:
    """The best member of a population after its last generations, with the low gain, or the local minimum near it,
    whichever costs less."""
    population.evolve_low_gain()
    best, follower = population.best(), population.follower
    local = Descent.of(best.model, follower, WEAK).model
    return min(best, replace(best, model=local, cost=_cost(follower, local)), key=lambda one: one.cost)
