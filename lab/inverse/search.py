"""The search for missing effects in motions that can be predicted, in the signals of one channel or of two."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import Progress, is_over
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.likelihood import Fitted, Method, WholeMotion, is_disturbed
from lostmotion.lab.inverse.regression import blocks_of
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.lab.selection.forward import Selection, selected
from lostmotion.model import Model

__all__ = ["searched"]


def searched(
    model: Model, train: Sequence[Experiment], last: Experiment, method: Method, pool: Executor, progress: Progress
) -> tuple[Channel, Signals, Selection[Fitted]]:
    """The channel, the signals of the last recording in it, and the search with the delay of the recordings, or that
    without it where its effects predict better, by the test of an effect.

    The delay is estimated before any effect is known, and an effect that the model lacks may look like one, such as a
    ripple.  Where much is left, the search goes on with a whitened misfit.
    """

    def likelihood(channel: Channel, *, is_whitened: bool = False) -> WholeMotion:
        *signals, unseen = (channel.signals(one, model.base != "servo", is_whitened) for one in (*train, last))
        is_fold = len(train) < policy.ENOUGH_RECORDINGS
        return WholeMotion(method, model, signals, unseen, is_fold, pool, is_whitened=is_whitened)

    channel = Channel.of(train) if method is Method.TORQUE else Channel()
    found = selected(own := likelihood(channel), progress)
    if channel.delay_s and not is_over():
        undelayed = replace(channel, delay_s=0.0)
        other = selected(less := likelihood(undelayed), progress)
        one, two = other.fits[-1].judged, found.fits[-1].judged
        if Predictions(two.predicted**2, one.predicted**2, blocks_of(one)).is_better():
            channel, own, found = undelayed, less, other
    if is_disturbed(found.fits[-1].inverse):
        found = selected(own := likelihood(channel, is_whitened=True), progress, found)
    assert own.unseen
    return channel, own.unseen, found
