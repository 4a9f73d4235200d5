"""Compiles what a search runs, before its time begins.  Nothing is fitted here."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.model import Model, ModelError
from lostmotion.model.observer import follow

__all__ = ["compile_kernels"]


def compile_kernels(model: Model, effects: Sequence[str], experiment: Experiment, in_segments: bool) -> None:
    """Compiles the kernels of a model and of these effects, and the integrator; in_segments: also what simulates short
    segments and observers.

    numba keeps them on disk.  On a machine without them this takes about 10 s of processor time, which a search of a
    servo within 60 s lacked; else some milliseconds.
    """
    drive, own, column = experiment.drive, experiment.model(model), next(iter(experiment.measured))
    time, reading = experiment.time[:2], experiment.measured[column][:2]
    for effect in effects:
        with suppress(ModelError):  # a search leaves it out as well
            own.with_effect(effect).plan(is_driven=drive is not None)
    with suppress(ModelError):  # a search says what the model cannot do
        start = own.initial_state(drive, float(time[0]))
        step = own.simulate(drive, time, start).substep_s
        if in_segments:
            own.prepare(drive, time, [column], experiment.clock_zero)(start[None], step)
            run = own.observer(drive, time, column, experiment.clock_zero)
            follow([run], start[None], np.zeros((1, start.size)), reading, step)
