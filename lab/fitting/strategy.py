"""The strategy of a fit: a first rough fit near the global minimum, then the growing horizon.  No selection here.

The oscillator's frequency comes from the spectrum, the play from observer runs, or from a grid of values where no bar
was measured: the play shifts every impact, so that the error has many local minima in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.observer.filter import can_follow, states_at
from lostmotion.lab.observer.global_search import nearest
from lostmotion.lab.shooting.continuation import Level, fitted, merged, missing, residuals
from lostmotion.lab.shooting.initial_state import find_start, polished, repaired, ringing_hz, segment_of
from lostmotion.lab.shooting.parameters import Unknowns, free_names
from lostmotion.lab.shooting.segment import Segment
from lostmotion.lab.shooting.task import Task, coarse_substep
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = [
    "begun",
    "best_of",
    "doubled",
    "first_fit",
    "full_fit",
    "grown",
    "nearest_fit",
    "passed",
    "predictable",
    "refined",
    "repaired_fit",
    "seeded",
    "started",
    "subset",
]

PLAY_SHARE = np.geomspace(0.62, 1.5, 11)
DAMPING_SHARE = (1.0, 0.4)
FREQUENCY_SHARE = 0.12
SUBSET = 10
CONVERGED = 0.3
"""Largest change with half the integration step, in units of the noise."""
DISTURBANCE = 1e-4
CHAOTIC = 4.0
"""Disturbance of the initial state, as a share of its scale, and the change, in units of the noise, above which a
segment is chaotic."""
LONGEST_S = 1.01
DOUBTED_SHARE = 0.3
SCANNED = 4
KEPT = 2
SEEDS = 2
POLISHED = 5


def seeded(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with the bar's frequency from the spectrum, where its acceleration was measured and its stiffness is
    free."""
    ringing = [one for one in experiments if ACCEL in one.measured]
    if not ringing or "k" not in free_names(model):
        return model
    k, m = model.parameters["k"], model.parameters["m"].value
    rough = math.sqrt(k.value / m) / (2 * math.pi)
    lines = [ringing_hz(e, rough * (1 - FREQUENCY_SHARE), rough * (1 + FREQUENCY_SHARE)) for e in ringing]
    stiffness = m * (2 * math.pi * float(np.median(lines))) ** 2
    return model.replace({"k": min(max(stiffness, k.low), k.high)})


def subset(task: Task) -> list[Experiment]:
    """A sample of the shortest segments, spread over the experiments."""
    every = task.tiles
    return [every[i] for i in np.unique(np.linspace(0, len(every) - 1, min(SUBSET, len(every))).astype(int))]


def started(model: Model, segments: Sequence[Experiment], task: Task) -> Level:
    """The segments with their start states found, nothing else fitted."""
    found = begun(model, segments, passed(model, segments, task.experiments, task), task)
    return fitted(model, Unknowns.of(model, task.rough), found, task.substep_s, iterations=0)


Likely = Mapping[tuple[str, float], FloatArray]
"""Likely start states (K, n), by the experiment's name and the time [s]."""


def passed(model: Model, pieces: Sequence[Experiment], experiments: Sequence[Experiment], task: Task) -> Likely:
    """The states of observer runs at the starts of the pieces; none without a bar."""
    likely: dict[tuple[str, float], FloatArray] = {}
    for experiment in experiments:
        if can_follow(model, experiment):
            times = np.array([float(p.time[0]) for p in pieces if p.name == experiment.name])
            states = states_at(model, experiment, times, task.substep_s)
            likely |= {(experiment.name, time): found for time, found in states.items()}
    return likely


def begun(model: Model, pieces: Sequence[Experiment], likely: Likely, task: Task) -> tuple[Segment, ...]:
    """Segments with their start states: a likely one, where it fits; else from a scan."""
    segments = [segment_of(model, piece, task.noise) for piece in pieces]
    found = [_near(model, s, likely.get((s.experiment.name, float(s.experiment.time[0]))), task) for s in segments]
    missed = missing(model, found, task.substep_s) if likely else np.zeros(len(found), dtype=bool)
    return tuple(find_start(model, s, task.substep_s, [s.start]) if out else s
                 for s, out in zip(found, missed, strict=True))  # fmt: skip


def _near(model: Model, segment: Segment, likely: FloatArray | None, task: Task) -> Segment:
    if likely is None:
        return find_start(model, segment, task.substep_s)
    own = segment.experiment.model(model)
    return segment.starting(polished(own, segment, likely, task.substep_s, POLISHED)[0])


def first_fit(model: Model, task: Task, pool: Executor) -> Level:
    """The best fit on the shortest segments; for gears from the minimum of observer runs, or from a grid of plays and
    dampings."""
    model = seeded(model, task.experiments)
    if can_follow(model, *task.experiments):
        return best_of(pool.map(partial(nearest_fit, model, task), range(SEEDS)), 1)[0]
    scanned = best_of(pool.map(partial(started, segments=subset(task), task=task), _grid(model)), SCANNED)
    rough = best_of(pool.map(partial(refined, task=task), scanned), KEPT)
    return best_of(pool.map(partial(full_fit, task=task), [level.model for level in rough]), 1)[0]


def nearest_fit(model: Model, task: Task, seed: int) -> Level:
    """The fit on all short segments from the minimum of observer runs, beginning with the model's values."""
    return full_fit(nearest(model, task, seed), task)


def refined(level: Level, task: Task, iterations: int = 8) -> Level:
    """A few steps from a level's values."""
    return fitted(level.model, level.unknowns, level.segments, task.substep_s, iterations=iterations)


def best_of(levels: Iterable[Level], count: int) -> list[Level]:
    """Those with the smallest typical error, best first."""
    return sorted(levels, key=lambda level: level.typical)[:count]


def full_fit(model: Model, task: Task, max_missed: float = 1.0) -> Level:
    """A fit on all of the shortest segments; initial states of missed ones are searched for again."""
    level = started(model, task.tiles, task)
    level = fitted(model, level.unknowns, level.segments, task.substep_s)
    again = repaired(level.model, level.segments, task.substep_s, max_missed)
    return level if again == level.segments else fitted(level.model, level.unknowns, again, task.substep_s)


def repaired_fit(
    model: Model, unknowns: Unknowns, segments: Sequence[Segment], task: Task, max_missed: float = 1.0
) -> Level:
    """The fit from these initial states; those of missed segments are searched for again."""
    again = repaired(model, segments, task.substep_s, max_missed)
    return fitted(model, unknowns, again, task.substep_s)


def grown(level: Level, task: Task) -> Level:
    """The fit on segments twice as long, and so on; the longest of these levels that can be trusted.

    Trusted: hardly a segment is missed, and half the integration step changes nothing.  For chaotic motion neither
    holds on long segments.
    """
    found = [level]
    while (longer := doubled(found[-1], task)) is not None:
        found.append(longer)
        if longer.typical > policy.MISSED * max(level.typical, 1.0):
            break
    doubts = [_doubt(level, task) for level in found]
    return min(zip(doubts, found, strict=True), key=lambda pair: (pair[0], -pair[1].horizon_s))[1]


def doubled(level: Level, task: Task, max_missed: float = 1.0) -> Level | None:
    """The fit on segments twice as long, from where this one ended; None where there are none, or the motion
    diverges."""
    segments = _doubled(level.segments, task)
    return repaired_fit(level.model, level.unknowns, segments, task, max_missed) if segments else None


def _doubled(segments: Sequence[Segment], task: Task) -> tuple[Segment, ...]:
    halvings = round(math.log2(len(segments) / len(task.experiments)))
    return merged(segments, task.experiments, halvings - 1) if halvings else ()


def predictable(level: Level, task: Task) -> float:
    """Longest segments, up to a second, over which the motion is not chaotic [s]: these distinguish models best."""
    segments, horizon = level.segments, level.horizon_s
    while segments := _doubled(segments, task):
        longer = max(segment.experiment.duration for segment in segments)
        if longer > LONGEST_S or np.mean(_unpredictable(level.model, segments, task)) > DOUBTED_SHARE:
            break
        horizon = longer
    return horizon


def _doubt(level: Level, task: Task) -> float:
    """Share of the segments that are missed, not converged or chaotic; up to a tenth of them count as none."""
    missed = missing(level.model, level.segments, task.substep_s)
    share = float(np.mean(missed | _unpredictable(level.model, level.segments, task)))
    return share if share > 0.1 else 0.0


def _unpredictable(model: Model, segments: Sequence[Segment], task: Task) -> NDArray[np.bool_]:
    """Which segments are changed by half the integration step or by a small disturbance of their start (S,)."""
    fine = coarse_substep(model, task.experiments, 1.0)
    here, halved = residuals(model, segments, fine), residuals(model, segments, fine / 2)
    apart = residuals(
        model, [segment.starting(segment.start + DISTURBANCE * segment.scale) for segment in segments], fine
    )
    with np.errstate(invalid="ignore"):  # a motion that cannot be simulated has infinite errors in both
        moved = [_rms(a - b) > CONVERGED for a, b in zip(here, halved, strict=True)]
        chaotic = [_rms(a - b) > CHAOTIC for a, b in zip(here, apart, strict=True)]
    return np.asarray(np.array(moved) | np.array(chaotic))


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _grid(model: Model) -> list[Model]:
    if model.base != "play":
        return [model]
    free = free_names(model)
    plays = PLAY_SHARE if "d" in free else (1.0,)
    dampings = DAMPING_SHARE if "alpha" in free else (1.0,)
    d, alpha = model.parameters["d"], model.parameters["alpha"]
    values = {(min(max(d.value * a, d.low), d.high), min(max(alpha.value * b, alpha.low), alpha.high))
              for a in plays for b in dampings}  # fmt: skip
    return [model.replace({"d": value, "alpha": damping}) for value, damping in sorted(values)]
