"""The search for missing effects in motions that can be predicted, in the signals of one channel or of two."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import Progress, is_over
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.likelihood import Fitted, Method, WholeMotion, is_disturbed
from lostmotion.lab.inverse.regression import Regression, blocks_of
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.selection.forward import Selection, selected
from lostmotion.model import Model

__all__ = ["Searched", "searched"]


@dataclass(frozen=True, eq=False)
class Searched:
    """A search, with the channel and the likelihood in it."""

    channel: Channel
    likelihood: WholeMotion
    selection: Selection[Fitted]

    @property
    def best(self) -> Fitted:
        """The fit with all effects that were found."""
        return self.selection.fits[-1]

    @property
    def unseen(self) -> Signals:
        """The signals of the last recording."""
        assert self.likelihood.unseen
        return self.likelihood.unseen


def searched(
    model: Model, train: Sequence[Experiment], last: Experiment, method: Method, pool: Executor, progress: Progress
) -> Searched:
    """The search with the delay of the recordings, or that without it where its effects predict better.

    The delay is estimated before any effect is known, and an effect that the model lacks may look like one: a ripple of
    ten a turn, of a simulated joint, like a delay of 20 ms, beside which it had p = 1.  Without the delay it leaves the
    noise.
    """
    is_alone = len(train) < policy.ENOUGH_RECORDINGS

    def search(channel: Channel, begun: Searched | None = None) -> Searched:
        *signals, unseen = (channel.signals(one, model.base != "servo", begun is not None) for one in (*train, last))
        likelihood = WholeMotion(method, model, signals, unseen, is_alone, pool, is_whitened=begun is not None)
        return Searched(channel, likelihood, selected(likelihood, progress, begun.selection if begun else None))

    found = search(Channel.of(train) if method is Method.TORQUE else Channel())
    if found.channel.delay_s and not is_over():
        other = search(replace(found.channel, delay_s=0.0))
        found = other if _predicts_better(other.best.judged, found.best.judged) else found
    return search(found.channel, found) if is_disturbed(found.best.inverse) else found


def _predicts_better(one: Regression, other: Regression) -> bool:
    """Whether the cross-validated errors of a fit are less than those of another one, by as much and as significantly
    as an effect has to reduce them.  With two effects and a delay of 3.5 ms a motor was predicted as well as with three
    effects and none (p = 0.1)."""
    return Predictions(other.predicted**2, one.predicted**2, blocks_of(one)).is_better()
