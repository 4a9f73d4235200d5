"""Which physical effect is missing: search, judge by what no fit has seen, say how sure.  The heart of the lab.

1. The last recording is kept for judging (the last third of a single one's motion); no parameter is fitted to it.
2. What drives the motion says whose error counts (``Method``).  A controller's torque follows every disturbance: the
   torque that the measured motion needs is compared with the measured one (inverse model).  A command, a force or
   nothing at all follows none: the whole motion is simulated (output error).  Gears with play are chaotic: they are
   followed on short segments with initial states of their own (multiple shooting), as long as they can be.
3. The model is fitted as it is.  Then every effect of the catalogue is a candidate, fitted together with it from
   initial values of its own.  Of gears a score test, and observers that follow the measurement, say which are worth it.
4. A candidate is named if it predicts samples better that its fit has not seen, significantly for the whole catalogue
   (``policy.FALSE_NAME``), takes a share of the error that is worth a name, and has a size that is not zero.  Of those
   that explain alike the simplest is taken; the others are told as confusable.  Where none is significant alone, two
   are tried at once.
5. Again, with that effect in the model, until nothing is significant or the time is up; what later effects have made
   superfluous is taken out again.
6. What is left is held against the sensors' noise, and described where it is more.

Steps 3 to 6 are ``lab.inverse`` for motions that can be predicted, ``lab.gears`` for those that cannot; the numbers
that decide are ``lab.policy``'s, the reasons docs/decisions/0009-lab-selection.md's.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.fitting.fit import Progress, noise_of
from lostmotion.lab.gears import explained_gears
from lostmotion.lab.inverse.explain import explained, method_of
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.results import Explanation
from lostmotion.model import Model

__all__ = ["explain"]


def explain(
    model: Model,
    experiments: Sequence[Experiment],
    pool: Executor,
    progress: Progress = lambda what, part: None,
    budget_s: float = policy.BUDGET_S,
) -> Explanation:
    """What these experiments say is missing from the model.

    budget_s: about how long it may take [s].  Raises ModelError where the model cannot be run on the experiments at
    all.
    """
    method, noise = method_of(model, experiments), noise_of(experiments)
    train, last = _split(experiments, method is not None)
    if method is None:
        return explained_gears(model, train, last, noise, pool, progress, budget_s)
    return explained(model, train, last, method, noise, pool, progress, budget_s)


def _split(experiments: Sequence[Experiment], is_smooth: bool) -> tuple[list[Experiment], Experiment]:
    """The experiments to fit and the one that judges.  is_smooth: there is one moving part, so that it can be said when
    it moves."""
    if len(experiments) > 1:
        return list(experiments[:-1]), experiments[-1]
    (only,) = experiments
    cut = Signals.of(only).until_moved(2 / 3) if is_smooth else float(only.time[0] + 2 * only.duration / 3)
    return [only.between(only.time[0], cut)], only.between(cut, only.time[-1] + 1.0)
