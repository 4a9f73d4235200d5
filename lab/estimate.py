"""Estimates the free parameters of a model from recordings, by the error that suits its input."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

from lostmotion.lab.data.experiment import Experiment, with_one_column
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.deadline import Progress
from lostmotion.lab.fitting.fit import fit_segments
from lostmotion.lab.inverse.explain import fitted, method_of
from lostmotion.lab.inverse.release import released
from lostmotion.lab.results import Fit
from lostmotion.model import Model

__all__ = ["fit"]


def fit(
    model: Model, experiments: Sequence[Experiment], pool: Executor, progress: Progress = lambda what, part: None
) -> Fit:
    """The model with its free parameters fitted to all the experiments together.

    progress: called with what is being done and the part that is done, 0 to 1.  Ctrl-C (KeyboardInterrupt) during the
    last refinement of gears leaves the best so far, with ``complete`` False.
    """
    method = method_of(model, experiments)
    if method is None:
        return fit_segments(model, experiments, pool, progress)
    progress("fitting", 0.0)
    experiments = released(with_one_column(experiments))
    found = fitted(model, experiments, method, noise_of(experiments))
    progress("done", 1.0)
    return found
