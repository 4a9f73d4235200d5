"""The torque that a model needs for the measured motion, beside the measured one.  No parameter is fitted.

The torque of a controlled joint reacts to every disturbance, so that a simulation with this torque as its input
diverges (an integrated error of 1 % of a torque is thousands of degrees after a minute).  The inverse model integrates
nothing: tau = J theta_2'' less the torques of the effects, within the band in which the motion exceeds its noise.  Fit
and search minimise the same error for such a joint.

Reference: W. Khalil and E. Dombre, Modeling, Identification and Control of Robots (2002), chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.comparison.predict import Prediction
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.discrepancy.localise import Localisation
from lostmotion.lab.discrepancy.shape import shapes
from lostmotion.lab.fitting.identifiability import held
from lostmotion.lab.inverse.problem import Data
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals, informative_band
from lostmotion.lab.inverse.torques import noise_floor
from lostmotion.model import Model, Trajectory
from lostmotion.model.motion import FloatArray

__all__ = ["TORQUE", "needed_torques", "torque_missing"]

TORQUE = "torque"
VARIABLES = {"position": "theta_2", "velocity": "omega_2", "acceleration": "acceleration"}


def needed_torques(model: Model, experiments: Sequence[Experiment]) -> tuple[list[Prediction], float]:
    """For each experiment, the measured torque and the one that the model needs, and the sensors' noise [N m].

    The time axis is that on which a fit compares them; the measured torque is NaN where it does not: near both ends,
    where the filter has transients, and at rest, where dry friction may have any value up to its largest.
    """
    band = informative_band(experiments)
    signals = [Signals.of(one, most_hz=band) for one in experiments]
    data = Data.of(signals, model)
    zeros = regressed(held(model, model.parameters), data).nuisance  # of encoders that count from where they start
    pairs = zip(data.shifted(zeros), data.needed(model, zeros), strict=True)
    predictions = [_prediction(one, torque) for one, torque in pairs]
    return predictions, max(noise_floor(one, model) for one in signals)


def _prediction(signals: Signals, torque: FloatArray) -> Prediction:
    """torque: what the model needs (N,) [N m], at the signals' times."""
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


def torque_missing(predictions: Sequence[Prediction]) -> Localisation:
    """Describes the residual torque by the state of the motion on which it depends."""
    found, variables = [], []
    for one in predictions:
        residual = one.residual(TORQUE)
        there = ~np.isnan(residual)
        found.append(residual[there])
        motion = {words: one.trajectory[name][there] for name, words in VARIABLES.items()}
        variables.append({**motion, "time": one.trajectory.time[there]})
    size = float(np.sqrt(np.mean(np.concatenate(found) ** 2)))
    unit = words.column(TORQUE, any(one.experiment.is_linear for one in predictions))[1]
    followed = shapes(found, [np.full(one.size, size) for one in found], variables)
    return Localisation("joint", {"joint": 0.0}, size, unit, followed)
