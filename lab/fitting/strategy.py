"""The strategy of a fit by multiple shooting: a first fit near the global minimum, then a growing horizon.

The frequency of the bar comes from the spectrum.  The play comes from observer runs, or from a grid of values where no
bar was measured, as it shifts every impact, so that the error has many local minima over it.  fit.py uses these
functions for a single fit, and the likelihood of gears for the fits of a search.  No selection here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.deadline import is_over
from lostmotion.lab.observer.filter import can_follow, states_at
from lostmotion.lab.observer.global_search import SEEDS, search_parameters
from lostmotion.lab.shooting.continuation import LONGER, Level, are_missed, fitted, merged
from lostmotion.lab.shooting.initial_state import find_start, repaired, ringing_hz, segment_of, with_best_starts
from lostmotion.lab.shooting.parameters import AT_BOUND, Unknowns, free_names
from lostmotion.lab.shooting.segment import Segment, residuals
from lostmotion.lab.shooting.task import Task, fine_substep
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = [
    "best_fit",
    "best_of",
    "doubled",
    "first_fit",
    "full_fit",
    "grown",
    "observed_states",
    "observer_fit",
    "predictable",
    "refined",
    "repaired_fit",
    "searched_fit",
    "settled",
    "some_tiles",
    "unfitted",
    "with_bar_frequency",
    "with_initial_states",
]

OTHER_PLAYS = (0.7, 0.5, 0.35, 0.25, 1.4, 2.0)
"""Of eight recordings with plays of 20, 27, 40 and 160 µm none is fitted from 80 µm, and all are from one of these."""
DISTANT_PLAYS, MUCH_LESS = (0.5, 0.25, 2.0), 0.75
"""The same for a search; a fit from each of them comes to plays from 0.14 to 3.6 times that of the file.  Largest ratio
of the typical errors: 0.44 and 0.68 of two recordings with 0.37 and 0.5 of the play, 0.96 and 1.0 with Coulomb friction
or a compliant shaft."""
PLAY_SHARE = np.geomspace(0.62, 1.5, 11)
"""The plays of a grid, in that of the model."""
DAMPING_SHARE = (1.0, 0.4)
"""The dampings of the contact in a grid, in that of the model."""
FREQUENCY_SHARE = 0.12
"""Largest relative difference of the frequency of the bar from that of the model."""
SUBSET = 10
"""Largest number of segments on which the models of a grid are compared."""
CONVERGED = 0.3
"""Largest change of a residual with half the integration step, in units of the noise, at which it has converged."""
DISTURBANCE = 1e-4
CHAOTIC = 4.0
"""Disturbance of an initial state, in units of its scale, and the change of the residual by it, in units of the noise,
above which a segment is chaotic."""
LONGEST_S = 1.01
"""Largest length of segments for predictions [s]."""
DOUBTED_SHARE = 0.3
"""Share of unpredictable segments above which segments are too long for predictions."""
SCANNED = 4
"""Number of models of a grid that are fitted by a few steps."""
KEPT = 2
"""Number of these that are fitted to the end."""
POLISHED = 5
"""Steps of the fits of initial states from guesses."""


def with_bar_frequency(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with the stiffness of the bar from the frequency of its strongest spectral line, where the acceleration
    was measured and the stiffness is free."""
    ringing = [one for one in experiments if ACCEL in one.measured]
    if not ringing or "k" not in free_names(model):
        return model
    k, m = model.parameters["k"], model.parameters["m"].value
    rough = math.sqrt(k.value / m) / (2 * math.pi)
    lines = [ringing_hz(e, rough * (1 - FREQUENCY_SHARE), rough * (1 + FREQUENCY_SHARE)) for e in ringing]
    stiffness = m * (2 * math.pi * float(np.median(lines))) ** 2
    return model.replace({"k": k.clipped(stiffness)})


def some_tiles(task: Task) -> list[Experiment]:
    """At most ``SUBSET`` of the shortest segments, spread evenly over the experiments."""
    every = task.tiles
    return [every[i] for i in np.unique(np.linspace(0, len(every) - 1, min(SUBSET, len(every))).astype(int))]


def unfitted(model: Model, segments: Sequence[Experiment], task: Task) -> Level:
    """A level with estimated initial states of these segments, and the parameters of the model as they are."""
    found = with_initial_states(model, segments, observed_states(model, segments, task.experiments, task), task)
    return fitted(model, Unknowns.of(model, task.rough), found, task.substep_s, iterations=0)


StateGuesses = Mapping[tuple[str, float], FloatArray]
"""Guesses of initial states (K, n), by the name of the experiment and the time [s]."""


def observed_states(
    model: Model, pieces: Sequence[Experiment], experiments: Sequence[Experiment], task: Task
) -> StateGuesses:
    """The states of observer runs over the experiments at the starts of these pieces; none where no bar was
    measured."""
    guesses: dict[tuple[str, float], FloatArray] = {}
    for experiment in experiments:
        if can_follow(model, experiment):
            times = np.array([float(p.time[0]) for p in pieces if p.name == experiment.name])
            states = states_at(model, experiment, times, task.substep_s)
            guesses |= {(experiment.name, time): found for time, found in states.items()}
    return guesses


def with_initial_states(
    model: Model, pieces: Sequence[Experiment], guesses: StateGuesses, task: Task
) -> tuple[Segment, ...]:
    """The segments of these pieces with estimated initial states: from a guess, or from a scan where there is none or
    where the model misses the segment with it."""
    segments = [segment_of(model, piece, task.noise) for piece in pieces]
    states = [guesses.get((piece.name, float(piece.time[0]))) for piece in pieces]
    known = {i: found for i, found in enumerate(states) if found is not None}
    near = with_best_starts(model, [segments[i] for i in known], [*known.values()], task.substep_s, POLISHED)
    begun = dict(zip(known, near, strict=True))
    found = [begun.get(i) or find_start(model, segment, task.substep_s) for i, segment in enumerate(segments)]
    missed = are_missed(model, found, task.substep_s) if guesses else np.zeros(len(found), dtype=bool)
    return tuple(find_start(model, s, task.substep_s, [s.start]) if out else s
                 for s, out in zip(found, missed, strict=True))  # fmt: skip


def first_fit(model: Model, task: Task, pool: Executor) -> Level:
    """The best fit on the shortest segments.  It begins at the minimum of the prediction error of observers where the
    acceleration of a bar was measured, else, for gears, on a grid of plays and dampings."""
    model = with_bar_frequency(model, task.experiments)
    if can_follow(model, *task.experiments):
        return best_of(pool.map(partial(observer_fit, model, task), range(SEEDS)), 1)[0]
    scanned = best_of(pool.map(partial(unfitted, segments=some_tiles(task), task=task), _grid(model)), SCANNED)
    rough = best_of(pool.map(partial(refined, task=task), scanned), KEPT)
    return best_of(pool.map(partial(full_fit, task=task), [level.model for level in rough]), 1)[0]


def best_fit(model: Model, task: Task, pool: Executor) -> Level:
    """``first_fit``, and where it misses most segments the best of those that begin with other plays: impacts that come
    at other times do not lead to the play, and observers do from within a factor of about 1.5."""
    best = first_fit(model, task, pool)
    if not _may_have_another_play(best, task):
        return best
    others = pool.map(partial(_from_play, model, task), *zip(*product(OTHER_PLAYS, range(SEEDS)), strict=True))
    return best_of([best, *others], 1)[0]


def searched_fit(model: Model, task: Task, pool: Executor) -> Level:
    """``first_fit``, or that of three with other plays whose error is much less (``MUCH_LESS``).  It is for a search of
    effects: a missing effect moves the impacts, too, and observers search the play again with each effect."""
    best = first_fit(model, task, pool)
    if not _may_have_another_play(best, task):
        return best
    other = best_of(pool.map(partial(_from_play, model, task), DISTANT_PLAYS, [0] * len(DISTANT_PLAYS)), 1)[0]
    return other if other.typical < MUCH_LESS * best.typical else best


def _may_have_another_play(level: Level, task: Task) -> bool:
    """Whether a fit misses most segments, or its play is at the bound of what a search trusts."""
    if "d" not in level.unknowns.names or not can_follow(level.model, *task.experiments):
        return False
    at = level.unknowns.names.index("d")
    low, high = level.unknowns.items[at].ends
    return level.typical > policy.MISSED or min(level.z[at] - low, high - level.z[at]) < AT_BOUND


def _from_play(model: Model, task: Task, share: float, seed: int) -> Level:
    """``observer_fit`` with this share of the play, near which the prior is."""
    play = model.parameters["d"]
    near = {"d": play.clipped(share * play.value)}
    return observer_fit(model.replace(near), replace(task, rough=task.rough.replace(near)), seed)


def observer_fit(model: Model, task: Task, seed: int) -> Level:
    """The fit on all of the shortest segments that begins at the minimum of the prediction error of observers."""
    return full_fit(search_parameters(model, task, seed), task)


def refined(level: Level, task: Task, iterations: int = 8) -> Level:
    """The level after a few more steps from its values."""
    return fitted(level.model, level.unknowns, level.segments, task.substep_s, iterations=iterations)


def best_of(levels: Iterable[Level], count: int) -> list[Level]:
    """The ``count`` levels with the smallest typical errors, best first."""
    return sorted(levels, key=lambda level: level.typical)[:count]


def full_fit(model: Model, task: Task, max_missed: float = 1.0) -> Level:
    """A fit on all of the shortest segments, from the values of the model.  The initial states of segments that it
    misses are then searched for again, unless their share exceeds ``max_missed``."""
    level = unfitted(model, task.tiles, task)
    level = fitted(model, level.unknowns, level.segments, task.substep_s)
    again = repaired(level.model, level.segments, task.substep_s, max_missed)
    return level if again == level.segments else fitted(level.model, level.unknowns, again, task.substep_s)


def repaired_fit(
    model: Model, unknowns: Unknowns, segments: Sequence[Segment], task: Task, max_missed: float = 1.0
) -> Level:
    """The fit from the initial states of these segments, after those of missed segments were searched for again, unless
    their share exceeds ``max_missed``."""
    again = repaired(model, segments, task.substep_s, max_missed)
    return fitted(model, unknowns, again, task.substep_s)


def settled(level: Level, task: Task) -> Level:
    """The fit after the initial states of missed segments were searched for again at its values, and the fits from
    these, as long as that lowers the error.

    New initial states change the parameters, and these the initial states of other segments (block coordinate
    descent).  A finite actuator beside gravity on the sensor ended at 1.6 to 1.9 times the noise from four initial
    values, and from each of them after two to four rounds at 0.8 (seed 7200); of nine fits to simulated gears with a
    finite actuator two had the error of the noise before, and six have it now.
    """
    before = math.inf
    while policy.is_less(level.typical, before) and not is_over():
        before = level.typical
        again = repaired_fit(level.model, level.unknowns, level.segments, task)
        level = min(level, again, key=lambda one: one.typical)
    return level


def grown(level: Level, task: Task) -> Level:
    """The fits on segments twice as long, and so on; the longest of these levels that is reliable.

    It is reliable if few segments are missed, and if neither half the integration step nor a small disturbance of the
    initial state changes their residuals.  For chaotic motion this does not hold on long segments.
    """
    found = [level]
    while (longer := doubled(found[-1], task)) is not None:
        found.append(longer)
        if longer.typical > policy.MISSED * max(level.typical, 1.0):
            break
    doubts = [_doubt(level, task) for level in found]
    return min(zip(doubts, found, strict=True), key=lambda pair: (pair[0], -pair[1].horizon_s))[1]


def doubled(level: Level, task: Task, max_missed: float = 1.0) -> Level | None:
    """The fit on segments twice as long that begins at the values of a level; None where the segments are whole
    experiments."""
    segments = _doubled(level.segments, task)
    return repaired_fit(level.model, level.unknowns, segments, task, max_missed) if segments else None


def _doubled(segments: Sequence[Segment], task: Task) -> tuple[Segment, ...]:
    """Segments twice as long; none where the segments are whole experiments, or longer ones too long for the input."""
    halvings = round(math.log2(len(segments) / len(task.experiments)))
    if halvings and 2 * max(one.experiment.duration for one in segments) <= LONGER * task.longest_s:
        return merged(segments, task.experiments, halvings - 1)
    return ()


def predictable(level: Level, task: Task) -> float:
    """The length of the longest segments, up to a second, over which the motion is not chaotic [s].  Segments of this
    length distinguish models best."""
    segments, horizon = level.segments, level.horizon_s
    while segments := _doubled(segments, task):
        longer = max(segment.experiment.duration for segment in segments)
        if longer > LONGEST_S or np.mean(_unpredictable(level.model, segments, task)) > DOUBTED_SHARE:
            break
        horizon = longer
    return horizon


def _doubt(level: Level, task: Task) -> float:
    """The share of the segments that are missed, have not converged with the integration step, or are chaotic; 0 for up
    to a tenth of them."""
    missed = are_missed(level.model, level.segments, task.substep_s)
    share = float(np.mean(missed | _unpredictable(level.model, level.segments, task)))
    return share if share > 0.1 else 0.0


def _unpredictable(model: Model, segments: Sequence[Segment], task: Task) -> NDArray[np.bool_]:
    """Which segments (S,) change with half the integration step or with a small disturbance of their initial state."""
    fine = fine_substep(model, task.experiments)
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
    """Models on a grid of plays and dampings, those that are free, around the values of the model."""
    if model.base != "play":
        return [model]
    free = free_names(model)
    plays = PLAY_SHARE if "d" in free else (1.0,)
    dampings = DAMPING_SHARE if "alpha" in free else (1.0,)
    d, alpha = model.parameters["d"], model.parameters["alpha"]
    values = {(d.clipped(d.value * a), alpha.clipped(alpha.value * b)) for a in plays for b in dampings}
    return [model.replace({"d": value, "alpha": damping}) for value, damping in sorted(values)]
