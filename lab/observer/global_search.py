"""Global search for parameters and effects of gears by the prediction error of observers.  No selection here.

The error of a free simulation of gears has a local minimum for every confusion of impacts; that of an observer has
hardly any.  Its prediction error is a smooth function of play, damping and effects, minimised by differential evolution
(Storn and Price 1997), first with a high gain and then with a lower one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import ACCEL
from lostmotion.lab.deadline import is_over
from lostmotion.lab.observer.filter import STRONG, WEAK, can_follow
from lostmotion.lab.observer.objective import Follower
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.initial_guess import initial_guesses, scales_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects.guesses import MotionScales
from lostmotion.model.motion import FloatArray

__all__ = ["Optimum", "nearest", "shortlist"]

FIRST, EACH, MOST_EACH, POPULATION = 72, 9, 240, 20
"""Size of the first population; for effects with many initial guesses the number around each, up to a limit; size of
the later population."""
BASE_GENERATIONS, EFFECT_GENERATIONS, FINAL_GENERATIONS = 8, 5, 8
WIDTH = {"d": 0.22, "alpha": 0.3, "k": 0.01, "b": 0.25, "l": 0.03}
"""Standard deviations of a first population, in logarithms."""
BIAS_WIDTH = 0.05  # m/s²
EFFECT_WIDTH = 0.4
SURE = 0.2
"""Share of these widths around fitted values."""
LARGER = 4.0
DIFFERENTIAL_WEIGHT, CROSSOVER = 0.6, 0.9
MUTATED, FARTHEST = 0.5, 3
NICHES, NICHES_LEFT = 4, 2
"""Number of subpopulations (niches) over the range of a whole number; number of those that are evolved to the end."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """A model from the search, its cost (see ``_cost``), and the effect that it adds to the base."""

    model: Model
    cost: float
    effect: str = ""


def nearest(model: Model, task: Task, seed: int = 0) -> Model:
    """The model with the free parameters that minimise the prediction error of observers."""
    model = _with_bias(model, task)
    follower = Follower.of(task, model)
    found = _Population(follower, [model], seed)
    found.evolve(BASE_GENERATIONS)
    found.evolve_low_gain()
    return found.best("").model


def shortlist(base: Level, effects: Sequence[str], task: Task, pool: Executor) -> list[Optimum]:
    """The effects with the least prediction error of observers, best first; one with a whole number, and so distant
    local minima, may occur twice.  None where there is no time for it, or the bar was not measured.

    base: the fit without them; initial guesses of an effect's parameters are combined with its values and with the
    file's.
    """
    if is_over() or not can_follow(task.rough, *task.experiments):
        return []
    follower, size = _follower(base.model, task), scales_of(base.model, base.segments, task.substep_s)
    begin = partial(_begun, base=base.model, follower=follower.roughly(), size=size)
    niches = zip(effects, pool.map(begin, effects), strict=True)
    begun = [(population, effect) for effect, found in niches for population in found]
    best = _leading(begun, policy.FINISHED, NICHES)
    further = pool.map(partial(_further, follower=follower), (population for population, _ in best))
    best = list(zip(further, [effect for _, effect in best], strict=True))
    best = _leading(best, math.ceil(policy.FINISHED / 2), NICHES_LEFT)
    return sorted(pool.map(_finished, *zip(*best, strict=True)), key=lambda one: one.cost)


def _cost(follower: Follower, model: Model) -> float:
    """The geometric mean of the costs of observers with a high and a low gain.  With the low gain even the right model
    may diverge where a wrong one happens not to."""
    return math.sqrt(follower.cost(model, STRONG) * follower.cost(model, WEAK))


def _follower(model: Model, task: Task) -> Follower:
    given = {name: p.value for name, p in task.rough.parameters.items()}
    return Follower.of(task, _with_bias(model.replace(given), task))


def _with_bias(model: Model, task: Task) -> Model:
    """The model with the sensor's offset set to the mean reading, where it is free."""
    bias = model.parameters["bias"]
    if bias.fixed:
        return model
    mean = float(np.mean([np.nanmean(e.measured[ACCEL]) for e in task.experiments]))
    return model.replace({"bias": min(max(mean, bias.low), bias.high)})


class _Population:
    """A population of differential evolution (current-to-pbest): models and their costs.

    A mutant takes whole numbers from its target, or neighbouring ones.
    """

    def __init__(self, follower: Follower, models: Sequence[Model], seed: int, sure: Sequence[bool] = ()) -> None:
        self._follower, self._coupling, self._random = follower, STRONG, np.random.default_rng(seed)
        self._unknowns = Unknowns.of(models[0], follower.rough)
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
        """The costs of a first population (K,), exact for those of its best that will be kept."""
        costs = np.full(len(models), math.inf)
        best: list[float] = []
        for i, model in enumerate(models):
            most = best[-1] if len(best) == POPULATION else math.inf
            costs[i] = self._cost(model, z[i], most)
            best = sorted([*best, costs[i]])[:POPULATION]
        return costs

    def best(self, effect: str) -> Optimum:
        """The best member."""
        best = int(np.argmin(self.costs))
        model = self._unknowns.put(self._models[best], self._z[best])
        return Optimum(model, _cost(self._follower, model), effect)

    def evolve_low_gain(self) -> None:
        """Evolves some more generations with the low gain."""
        self.judge_by(self._follower, WEAK)
        self.evolve(FINAL_GENERATIONS)

    def judge_by(self, follower: Follower, coupling: float = STRONG) -> None:
        """Sets the cost function and evaluates the population."""
        self._follower, self._coupling = follower, coupling
        self.costs = np.array([self._cost(model, one) for model, one in zip(self._models, self._z, strict=True)])

    def evolve(self, generations: int) -> None:
        """Differential evolution, current to p-best."""
        random, z, size = self._random, self._z, len(self._z)
        for _ in range(generations):
            if is_over():
                break
            top = np.argsort(self.costs)[: max(3, size // 5)]
            for i in range(size):
                (a, b), lead = random.choice(size, 2, replace=False), int(random.choice(top))
                step = DIFFERENTIAL_WEIGHT * (z[lead] - z[i]) + random.uniform(0.3, 0.9) * (z[a] - z[b])
                crossed = np.where(random.random(step.size) < CROSSOVER, step, 0.0)
                trial = np.clip(z[i] + crossed, *self._unknowns.bounds)
                model = self._mutated(self._models[lead])
                cost = self._cost(model, trial, self.costs[i])
                if cost < self.costs[i]:
                    self._models[i], z[i], self.costs[i] = model, trial, cost

    def _mutated(self, model: Model) -> Model:
        """The model with its whole numbers mutated by a little."""
        if not self._whole or self._random.random() > MUTATED:
            return model
        values = {name: model.parameters[name] for name in self._whole}
        steps = self._random.integers(-FARTHEST, FARTHEST + 1, len(values))
        return model.replace({name: min(max(p.value + step, p.low), p.high)
                              for (name, p), step in zip(values.items(), steps, strict=True)})  # fmt: skip

    def _cost(self, model: Model, z: FloatArray, most: float = math.inf) -> float:
        return self._follower.cost(self._unknowns.put(model, z), self._coupling, most)

    def _spread(self) -> FloatArray:
        """Standard deviations in z (P,): prior ones of the base, half the size of an effect."""
        items = self._unknowns.items
        return np.array([BIAS_WIDTH / i.scale if i.name == "bias" else WIDTH.get(i.name, EFFECT_WIDTH) for i in items])


def _begun(effect: str, base: Model, follower: Follower, size: MotionScales) -> list[_Population]:
    models = [base.with_effect(effect), follower.rough.with_effect(effect)]
    found = _values(models[0], effect, [size, replace(size, torque=LARGER * size.torque)])
    populations = []
    for part in _niches(models[0], found):
        every = [model.replace(values) for values in part for model in models]
        populations.append(_Population(follower, every, 0, [True, False] * len(part)))
        populations[-1].evolve(EFFECT_GENERATIONS)
    return populations


def _values(model: Model, effect: str, wide: Sequence[MotionScales]) -> list[dict[str, float]]:
    """Initial guesses of the effect at these scales, of either sign."""
    found: list[dict[str, float]] = []
    for one in wide:
        found += [values for values in initial_guesses(model, effect, one) if values not in found]
    return found + [{**v, **opposite} for v in found if (opposite := _opposite(model, v))]


def _niches(model: Model, found: list[dict[str, float]]) -> list[list[dict[str, float]]]:
    """Divides the values into niches by their whole number, if there is one."""
    whole = [name for name in found[0] if model.parameters[name].domain.is_whole]
    if not whole:
        return [found]
    ordered = sorted(found, key=lambda values: values[whole[0]])
    edges = np.linspace(0, len(ordered), NICHES + 1).astype(int)
    return [ordered[a:b] for a, b in itertools.pairwise(edges) if b > a]


def _opposite(model: Model, values: dict[str, float]) -> dict[str, float]:
    """The values with the opposite sign, where that is allowed; angles and whole numbers are unchanged."""
    may = {name for name in values if -values[name] >= model.parameters[name].low and values[name] > 0}
    return {name: -values[name] for name in may if "." in name and not name.endswith(".phi")}


def _leading(
    populations: list[tuple[_Population, str]], effects: int, niches: int
) -> list[tuple[_Population, str]]:  # fmt: skip
    """The populations of so many best effects, and so many of each, best first."""
    of_effect: dict[str, list[tuple[_Population, str]]] = {}
    for pair in sorted(populations, key=lambda pair: float(pair[0].costs.min())):
        of_effect.setdefault(pair[1], []).append(pair)
    return [pair for pairs in list(of_effect.values())[:effects] for pair in pairs[:niches]]


def _further(population: _Population, follower: Follower) -> _Population:
    population.judge_by(follower)
    population.evolve(FINAL_GENERATIONS)
    return population


def _finished(population: _Population, effect: str) -> Optimum:
    population.evolve_low_gain()
    return population.best(effect)
