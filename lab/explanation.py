"""Which physical effect is missing: the search, its validation on unseen data, and the significance of the result.

1.  The last recording is kept for judging (a third of a single one's motion); no parameter is fitted to it.
2.  The input of the motion determines which error is compared (``Method``).  A controller's torque follows every
   disturbance: the torque that the measured motion needs is compared with the measured one (inverse model).  A command
   or a force follows none, nor does a free motion: the whole motion is simulated (output error).  Gears with play are
   chaotic: they are simulated on short segments, each with its initial state (multiple shooting), as long as they can
   be predicted.
3.  The model is fitted as it is.  Then every effect of the catalogue is a candidate, fitted together with it from the
   initial values of the effect.  For gears a score test and observers select the candidates to fit.
4.  A candidate is named if it predicts unseen samples better, significantly for all candidates (``policy.FALSE_NAME``),
   if it takes a large enough share of the error, and if its size differs from zero.  Of candidates that explain the
   data equally well the simplest is taken; the others are reported as confusable.  Where none is significant alone,
   pairs are tried.
5.  Step 3 is repeated with that effect in the model until nothing is significant or the time is up; effects that later
   ones have made superfluous, or that make the prediction of the last recording worse, are eliminated.
6.  The remaining error is compared with the sensors' noise, and described where it is larger.

Steps 3 to 5 are ``lab.selection``, one search and one test for all.  It asks a likelihood for fits and predictions:
``lab.inverse`` for motions that can be predicted, ``lab.gears`` for those that cannot.  The thresholds are in
``lab.policy``, the reasons in docs/decisions/0009-lab-selection.md and 0014-lab-rules.md.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from concurrent.futures import Executor

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment, with_one_column
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.data.series import is_onward
from lostmotion.lab.deadline import Progress
from lostmotion.lab.gears.explain import explained_gears
from lostmotion.lab.inverse.explain import explained
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.lab.inverse.modes import band_limited
from lostmotion.lab.inverse.release import released
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.models.compile import compile_kernels
from lostmotion.lab.results import Explanation
from lostmotion.lab.selection.nesting import others
from lostmotion.model import Model

__all__ = ["explain"]

log = logging.getLogger(__name__)


def explain(
    model: Model,
    experiments: Sequence[Experiment],
    pool: Executor,
    progress: Progress = lambda what, part: None,
    budget_s: float = policy.BUDGET_S,
    spent_s: float = 0.0,
) -> Explanation:
    """Finds the effects that are missing from the model of these experiments.

    budget_s: about how long it may take [s]; what a first search on a machine compiles does not count; spent_s: what
    reading the files has taken of it [s].  Raises ModelError where the model cannot be run on the experiments at all.
    """
    experiments = _distinct(experiments)
    method = Method.of(model, experiments)
    in_segments = method is Method.SEGMENTS
    progress("compiling the model, once on a machine", 0.0)
    compile_kernels(model, others(model), experiments[0], in_segments)
    experiments = experiments if in_segments else released(band_limited(model, with_one_column(experiments)))
    noise = noise_of(experiments)
    train, last = _split(experiments, is_smooth=not in_segments)
    if in_segments:
        return explained_gears(model, train, last, noise, pool, progress, budget_s, spent_s)
    return explained(model, train, last, method, noise, pool, progress, budget_s - spent_s)


def _distinct(experiments: Sequence[Experiment]) -> list[Experiment]:
    """The experiments without copies, as the last one would be no unseen data; a warning reports each."""
    found: list[Experiment] = []
    for one in experiments:
        if first := next((other for other in found if one.has_samples_of(other)), None):
            log.warning("%s: has the samples of %s, and is left out", one.name, first.name)
        else:
            found.append(one)
    return found


def _split(experiments: Sequence[Experiment], is_smooth: bool) -> tuple[list[Experiment], Experiment]:
    """The experiments to fit and the one for validation.  is_smooth: the part moves smoothly, so a single recording is
    divided by motion instead of time.  What is fitted has both directions if the recording has, as one of them does not
    distinguish friction from a constant: then the first third is for validation."""
    if len(experiments) > 1:
        return list(experiments[:-1]), experiments[-1]
    (only,) = experiments
    first, end = float(only.time[0]), float(only.time[-1]) + 1.0
    if not is_smooth:
        cut = first + 2 * only.duration / 3
        return [only.between(first, cut)], only.between(cut, end)
    signals = Signals.of(only)
    cut = signals.until_moved(2 / 3)
    fitted, last = only.between(first, cut), only.between(cut, end)
    if only.is_driven and is_onward(fitted.measured[signals.column]) and not is_onward(only.measured[signals.column]):
        cut = signals.until_moved(1 / 3)
        fitted, last = only.between(cut, end), only.between(first, cut)
    return [fitted], last
