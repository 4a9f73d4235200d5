"""One effect of the catalogue, tried: its grid of sizes, phases and plays, and the best few of it fitted.  No verdicts.

An effect that moves the gears moves all impacts, and the play that fitted best without it is then the wrong one, so
effect and play are laid out together.  Effects on bar and sensor leave the gears as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.grow import Level
from lostmotion.lab.search import Task, best_of, refined, started
from lostmotion.lab.seeds import Sizes, seeds
from lostmotion.lab.unknowns import free_names
from lostmotion.model import Model

__all__ = ["Trial", "try_effect"]

OFF_THE_GEARS = frozenset(
    (
        "hardening_spring",
        "quadratic_damping",
        "second_mode",
        "gravity_leakage",
        "centripetal_crosstalk",
        "sensor_saturation",
        "clock_skew",
        "bias_drift",
    )
)
PLAY_SHARE = np.geomspace(0.65, 1.45, 8)
MOST_GRIDDED = 12
HALVING = (2, 4, 6)
"""Stretches on which the grid is tried; after each, the better part goes on."""
KEPT = 3


@dataclass(frozen=True, eq=False)
class Trial:
    """An effect and the best rough fits with it, best first."""

    effect: str
    levels: tuple[Level, ...]


def try_effect(effect: str, base: Level, size: Sizes, few: Sequence[Experiment], task: Task) -> Trial:
    """Rough fits of the base with one more effect on a few stretches.

    base: the fit without the effect, of whose stretches the few are some.
    """
    models = _grid(effect, base, size, task)
    order = [few[i] for i in np.argsort(np.arange(len(few)) % 3, kind="stable")]  # spread from the beginning
    for count in HALVING:
        levels = [started(model, order[:count], task, base) for model in models]
        levels = best_of((level for level in levels if np.isfinite(level.typical)), max(KEPT, len(models) // 2))
        models = [level.model for level in levels]
    return Trial(effect, tuple(best_of([refined(level, task) for level in levels[:KEPT]], KEPT)))


def _grid(effect: str, base: Level, size: Sizes, task: Task) -> list[Model]:
    """Models to begin from; those with an effect on the gears around what the file says, not around a wrong fit."""
    model = base.model.with_effect(effect)
    found = seeds(model, effect, size)
    if "d" not in free_names(task.rough) or effect in OFF_THE_GEARS or len(found) > MOST_GRIDDED:
        return [model.replace(values) for values in found]
    d = task.rough.parameters["d"]
    plays = [float(np.clip(d.value * share, d.low, d.high)) for share in PLAY_SHARE]
    model = task.rough.with_effect(effect)
    return [model.replace({**values, "d": play}) for values in found for play in plays]
