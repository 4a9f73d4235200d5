"""The fit of a model to recordings, by the error that suits its input: ``lab fit``, and ``fit`` of the notebook."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

from lostmotion.lab.data.experiment import Experiment, with_one_column
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.deadline import Progress
from lostmotion.lab.fitting.fit import fit_segments
from lostmotion.lab.inverse.explain import fitted
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.lab.inverse.modes import band_limited
from lostmotion.lab.inverse.release import released
from lostmotion.lab.results import Fit
from lostmotion.model import Model

__all__ = ["fit"]


def fit(
    model: Model, experiments: Sequence[Experiment], pool: Executor, progress: Progress = lambda what, part: None
) -> Fit:
    """Fits the free parameters of a model to all experiments together.

    progress: called with what is being done and the share that is done, 0 to 1.  After Ctrl-C (KeyboardInterrupt) in
    the refinement of gears the best fit so far is returned, with ``stopped_early``.  Raises ModelError where the model
    cannot be simulated, and ExperimentError where the recordings do not go together.
    """
    method = Method.of(model, experiments)
    if method is Method.SEGMENTS:
        return fit_segments(model, experiments, pool, progress)
    progress("fitting", 0.0)
    experiments = released(band_limited(model, with_one_column(experiments)))
    found = fitted(model, experiments, method, noise_of(experiments))
    progress("done", 1.0)
    return found
