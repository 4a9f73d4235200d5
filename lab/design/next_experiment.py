"""Proposes the next experiment: of some motions the one in which competing models differ most.

The motion of the first model is simulated and taken as measured.  The other models predict it in short segments from
the same states, as impacts amplify every difference.  Their differences are projected off the derivatives by the
initial states and by the free parameters of the first model, as these will be fitted to the new recording.  A search
asks for it where the recordings do not distinguish two effects.  Nothing is fitted here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from lostmotion.lab import policy, words
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import is_over
from lostmotion.lab.quantity import of_axis, quantity
from lostmotion.lab.shooting.continuation import first_level, tiles
from lostmotion.lab.shooting.least_squares import projected_off
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Linearised, Segment, start_with, state_scales
from lostmotion.lab.shooting.task import Task, coarse_substep
from lostmotion.model import Chirp, HandWaved, Model, ModelError, Motion, Sampled, Sine

__all__ = ["what_to_record"]

LENGTH_S = 4.0
"""Length of a proposed recording [s]."""
REST_S = 0.5
"""Length of a rest between two steps [s]."""
LARGEST = 1e30
"""number that a recording may hold"""
INPUT_UNITS = {"oscillator": "N", "joint": "N m"}
"""By base, the unit of its input; rad for the others."""


@dataclass(frozen=True)
class _Proposal:
    """A motion, and the text that describes it to a person."""

    text: str
    motion: Motion


def what_to_record(models: Sequence[Model], task: Task, pool: Executor) -> str:
    """A sentence on the motion to record to distinguish models that explain the recordings equally well.

    models: fitted models of one base, the best first.  Where they differ by more than the noise in every recording, the
    sentence says so instead.  Returns "" where there is nothing to distinguish, the recordings have no input, or the
    time of the search is up.
    """
    if len(models) < 2 or task.experiments[0].drive is None:
        return ""
    task = _suited(task, models)
    here = min(_separation(one.drive, models, task) for one in task.experiments if one.drive)
    names = " and ".join(words.name(_own(model, models)) for model in models)
    if here >= 1:  # no larger motion helps where the noise is not what hides it
        return (
            f"In these recordings {names} differ by more than the noise: what else is missing hides which of them acts."
        )
    proposals = _proposals(models[0].base, task.experiments)
    apart = list(pool.map(partial(_separation, models=models, task=task), [p.motion for p in proposals]))
    if is_over():  # some were not simulated to the end
        return ""
    best = int(np.argmax(apart))
    samples = LENGTH_S * task.experiments[0].rate_hz
    if apart[best] * math.sqrt(samples) < policy.SEEN or apart[best] < policy.WORTH_RECORDING * here:
        known = f"{here:.2g} times the noise"
        return f"No motion that was tried separates {names} better than these recordings do: {known}."
    return (
        f"Record {proposals[best].text}: there {names} differ by {apart[best]:.2g} times the noise, "
        f"in these recordings by {here:.2g}."
    )


def _suited(task: Task, models: Sequence[Model]) -> Task:
    """The task with an integration step that all of these models allow: that of a task is chosen before a fit."""
    steps = [coarse_substep(model, task.experiments) for model in models]
    return replace(task, substep_s=min(task.substep_s, *steps))


def _own(model: Model, models: Sequence[Model]) -> str:
    """The effect of a model that not all of the models have."""
    shared = set.intersection(*(set(other.effects) for other in models))
    return next((effect for effect in model.effects if effect not in shared), model.base)


def _proposals(base: str, experiments: Sequence[Experiment]) -> list[_Proposal]:
    """The motions to compare: slower, faster, larger and smaller ones than the recorded motion, a sweep, an irregular
    motion, and steps with rests."""
    size, hz = _recorded(experiments)
    unit = INPUT_UNITS.get(base, "rad")
    unit = of_axis(unit, experiments[0].is_linear, experiments[0].drive_unit)

    def sine(what: str, frequency: float, amplitude: float) -> _Proposal:
        text = f"{what} sine of {quantity(frequency, 'Hz', 2)} and {quantity(amplitude, unit, 2)}"
        return _Proposal(text, Sine(frequency, amplitude))

    sweep = f"a sweep from {quantity(hz / 4, 'Hz', 2)} to {quantity(4 * hz, 'Hz', 2)} with {quantity(size, unit, 2)}"
    wave = f"an irregular motion twice as fast, of {quantity(size / 2, unit, 2)}"
    steps = f"steps of {quantity(size, unit, 2)} with rests of {REST_S:g} s between them"
    return [
        sine("a slow", hz / 5, size),
        sine("a slow, small", hz / 4, size / 5),
        sine("a fast", 3 * hz, size / 3),
        sine("a large", hz, 2 * size),
        _Proposal(sweep, Chirp(hz / 4, 4 * hz, LENGTH_S, size)),
        _Proposal(wave, HandWaved(1, size / 2, hz, 4 * hz)),
        _Proposal(steps, _steps(size, 1 / (4 * hz))),
    ]


def _recorded(experiments: Sequence[Experiment]) -> tuple[float, float]:
    """Amplitude and frequency [Hz] of the sine with the same standard deviations of position and speed as the
    inputs."""
    drives = [(e.drive, e.time) for e in experiments if e.drive is not None]
    place = float(np.mean([np.std(drive.position(time)) for drive, time in drives]))
    speed = float(np.mean([np.std(drive.velocity(time)) for drive, time in drives]))
    return math.sqrt(2) * place, speed / place / (2 * math.pi)


def _steps(size: float, rise_s: float) -> Sampled:
    """Smooth steps up and down with rests in between; rise_s: the length of a step [s]."""
    time = np.arange(0.0, LENGTH_S, rise_s / 20)
    phase, turn = np.divmod(time, rise_s + REST_S)
    share = (1 - np.cos(np.pi * np.clip(turn / rise_s, 0.0, 1.0))) / 2
    return Sampled(time, size * np.where(phase % 2 == 0, share, 1 - share))


def _separation(motion: Motion, models: Sequence[Model], task: Task) -> float:
    """Root mean square difference between the first model and the most similar of the others, in units of the noise; 0
    where one of them cannot be simulated, or not in time."""
    first = models[0]
    try:
        segments = _segments(motion, first, task)
        unknowns = Unknowns.of(first, task.rough)
        z = unknowns.z(first)
        blocks = []
        for segment in segments:  # a stiff friction may take a minute for the length of a recording
            if is_over():
                return 0.0
            blocks.append(segment.linearised(first, unknowns, z, task.substep_s))
        return min(_apart(model, first, segments, blocks, task.substep_s) for model in models[1:])
    except ModelError:
        return 0.0


def _segments(motion: Motion, model: Model, task: Task) -> list[Segment]:
    """The simulated motion of a model in short segments, as if it were measured, each with its true initial state."""
    like = task.experiments[0]
    own = like.model(model)
    start = float(motion.time[0]) if isinstance(motion, Sampled) else 0.0
    time = start + np.arange(0.0, min(LENGTH_S, like.duration), 1 / like.rate_hz)
    run = own.simulate(motion, time, substep_s=task.substep_s)
    measured = {name: run[name] for name in like.measured}
    if any(np.abs(values).max() > LARGEST for values in measured.values()):
        raise ModelError("the motion exceeds what a recording may hold")
    whole = replace(like, drive=motion, time=time, measured=measured, clock_zero=start)
    pieces = tiles(whole, first_level(model.base, whole))
    states = run.states[np.searchsorted(time, [float(piece.time[0]) - 1e-9 for piece in pieces])]
    scale = state_scales(model, whole)
    return [Segment(piece, task.noise, scale, state) for piece, state in zip(pieces, states, strict=True)]


def _apart(
    model: Model, before: Model, segments: Sequence[Segment], blocks: Sequence[Linearised], substep_s: float
) -> float:
    """Root mean square of the difference of a model to the first one that neither initial states nor parameters of the
    first one imitate; blocks: its linearised residuals.  0 where the simulation fails."""
    differences, slopes = [], []
    for segment, block in zip(segments, blocks, strict=True):
        own = segment.experiment.model(model)
        r = segment.residual(own, start_with(own, segment, before.state_names), substep_s) - block.r
        if not np.all(np.isfinite(r)):
            return 0.0
        differences.append(projected_off(block.B, r))
        slopes.append(projected_off(block.B, block.A))
    left = projected_off(np.concatenate(slopes), np.concatenate(differences))
    return rms(left) if np.isfinite(left).all() else 0.0
