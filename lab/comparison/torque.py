"""Compares the measured torque of a joint with the torque that a model needs for the measured motion.

The torque of a controlled joint reacts to every disturbance, so that a simulation with this torque as its input
diverges (an integrated error of 1 % of a torque is thousands of degrees after a minute).  The inverse model integrates
nothing: tau = J theta_2'' less the torques of the effects, within the band in which the motion exceeds its noise.  For
such a joint fits and searches minimise the same error.  No parameter is fitted here.

Reference: W. Khalil and E. Dombre, Modeling, Identification and Control of Robots (2002), chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.comparison.residual_analysis import Prediction
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.describe import described
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration, noise_floor
from lostmotion.lab.results import Finding
from lostmotion.lab.shooting.parameters import held
from lostmotion.model import Model, Trajectory, build_model
from lostmotion.model.motion import FloatArray

__all__ = ["TORQUE", "needed_torques"]

TORQUE = "torque"


def needed_torques(
    model: Model, experiments: Sequence[Experiment], channel: Channel
) -> tuple[list[Prediction], float, Finding]:
    """The measured torque and the one that the model needs, for each experiment; the noise of the sensors [N m]; and
    the description of the residual torque.  channel: that of a fit, or of these recordings.

    The times are those at which a fit compares the two.  The measured torque is NaN where a fit does not compare them:
    near both ends, where the filter has transients, and at rest, where dry friction has any value up to its largest.
    """
    signals = [channel.signals(one) for one in experiments]
    data = InverseModel.of(signals, model)
    fit = regressed(held(model, model.parameters), data)  # fits the zero angles only
    pairs = list(zip(data.shifted(fit.nuisance), data.needed(model, fit.nuisance), strict=True))
    for one, torque in pairs:
        _check_finite(model, one, torque)
    predictions = [_prediction(one, torque) for one, torque in pairs]
    return predictions, max(noise_floor(one, model) for one in signals), described(fit)


def _check_finite(model: Model, signals: Signals, torque: FloatArray) -> None:
    """Raises ExperimentError where an effect has no finite torque for the measured motion."""
    if np.isfinite(torque).all():
        return
    found = {name: np.flatnonzero(~np.isfinite(_of_effect(model, name, signals))) for name in model.effects}
    name, at = next(((name, every[0]) for name, every in found.items() if every.size), (model.base, 0))
    raise ExperimentError(
        f"{signals.experiment.name}: found no finite torque of {name} with theta = {signals.position[at]:.4g}, "
        f"omega = {signals.velocity[at]:.4g}, expected one wherever the joint moves"
    )


def _of_effect(model: Model, name: str, signals: Signals) -> FloatArray:
    """The acceleration of the joint with this effect alone (N,) [rad/s²]."""
    own = {key: value for key, value in model.parameters.items() if key.startswith(f"{name}.")}
    return acceleration(build_model(model.base, (name,), own), signals, np.zeros(signals.time.size))


def _prediction(signals: Signals, torque: FloatArray) -> Prediction:
    """The prediction of one recording; torque: the one that the model needs at the times of the signals (N,) [N m]."""
    at = signals.grid
    time = signals.time[at]
    measured = np.where(np.isin(at, signals.kept), signals.smooth(signals.torque)[at], math.nan)
    modelled = {
        "torque": signals.smooth(torque)[at],
        "position": signals.position[at],
        "velocity": signals.velocity[at],
        "acceleration": signals.acceleration[at],
    }
    states = np.stack([modelled["position"], modelled["velocity"]], axis=1)
    experiment = replace(signals.experiment, time=time, measured={TORQUE: measured})
    return Prediction(experiment, Trajectory(time, modelled, states, states[-1], float(time[1] - time[0])))
