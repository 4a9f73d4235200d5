"""Whether a servo saturates where its model does, at the error cap / (kp error_gain) of its angle.

The defaults of these parameters are those of one servo, whose drive is full at 11°.  The legs of a robot dog lag by 26°
and are driven in proportion.  A model that saturates cannot follow them, whatever effect it is given.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import Model, build_model
from lostmotion.model.motion import FloatArray

__all__ = ["with_saturation"]

STATED = ("cap", "error_gain")
"""The parameters of which one is stated by a user who knows where a servo saturates."""
DELAYS_S = (0.0, 0.01, 0.015, 0.022, 0.034, 0.051, 0.076)
"""Delays of the command [s] beside which the two models are compared.  Behind a delay the error of the angle seems
larger than it is: without delays, four of 13 simulated servos that saturate seem not to, all with a delay or a lag."""
MARGIN = 2.0
"""The duty at which the model saturates that should not, over the largest one of the measured motion: the simulated
motion trails its command by more before effects are found."""
log = logging.getLogger(__name__)


def with_saturation(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model of a servo without a limit of its duty, where the default limit is passed in these experiments and the
    acceleration is explained better without it.

    The acceleration is a + b omega + c sign(omega) + d omega |omega| + e sin(theta_2) + f cos(theta_2) + g duty, by
    least squares, as effects are not yet found: once with the duty limited, once without.  Better is by
    ``policy.LEAST_GAIN`` of the squared error, both of all samples and of those beyond the limit, as both have as many
    parameters.  On the hip and the calf of a robot dog the gain is 0.09 and 0.34 of all samples, and 0.72 and 0.57 of
    those beyond.  Of 120 simulated servos (``bench.driven_motions``, seeds 400 to 411) none is taken for unlimited; one
    with a strong ripple would be, but its best delay is the longest one, so that it has none within the range.  A limit
    that the model file or the recorded voltage states is left as it is.
    """
    driven = [one for one in experiments if one.drive is not None]
    if model.base != "servo" or not driven or _is_stated(model, driven):
        return model
    signals = [Signals.of(one, is_force=False) for one in driven]
    most = max(float(np.abs(_duty(model, one)).max()) for one in signals)
    cap = model.parameters["cap"].value
    if most <= cap:
        return model
    delay = min(DELAYS_S, key=lambda one: float(np.sum(_residual(model, signals, one, cap) ** 2)))
    limited, unlimited = (_residual(model, signals, delay, limit) for limit in (cap, math.inf))
    beyond = np.concatenate([np.abs(_duty(model, one, delay))[one.kept] > cap for one in signals])
    is_better = all(_is_less(unlimited[part], limited[part]) for part in (slice(None), beyond))
    if not is_better or delay == DELAYS_S[-1]:
        return model
    _warn(model, driven[0])
    return model.replace({"cap": MARGIN * most})


def _is_stated(model: Model, experiments: Sequence[Experiment]) -> bool:
    """Whether the model file or a recording states where the servo saturates."""
    usual = build_model(model.base, model.effects).parameters
    return any(
        model.parameters[name] != usual[name] or any(name in one.given for one in experiments) for name in STATED
    )


def _duty(model: Model, signals: Signals, delay: float = 0.0) -> FloatArray:
    """The duty (N,) of the measured motion if it had no limit, with a delayed command; delay [s]."""
    one = signals.experiment
    assert one.drive is not None
    own = one.model(model).parameters
    command = one.drive.position(np.clip(signals.time - delay, *one.time[[0, -1]]))
    return np.asarray(own["kp"].value * own["error_gain"].value * (command - signals.position))


def _residual(model: Model, signals: Sequence[Signals], delay: float, limit: float) -> FloatArray:
    """The acceleration (M,) [rad/s²] that the usual effects and the duty leave, with this delay [s] and limit."""
    parts = []
    for one in signals:
        duty = one.filtered(np.clip(_duty(model, one, delay), -limit, limit))
        angle, speed = one.position[one.kept], one.velocity[one.kept]
        friction = np.tanh(speed / (policy.UNSURE_SPEED * math.sqrt(np.mean(one.velocity**2)) + 1e-300))
        laws = (duty, speed, friction, speed * np.abs(speed), np.sin(angle), np.cos(angle), np.ones_like(angle))
        parts.append(np.column_stack(laws))
    A, y = np.concatenate(parts), np.concatenate([one.acceleration[one.kept] for one in signals])
    A /= np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    return np.asarray(y - A @ np.linalg.lstsq(A, y)[0])


def _is_less(residual: FloatArray, other: FloatArray) -> bool:
    return policy.is_less(float(np.linalg.norm(residual)), float(np.linalg.norm(other)))


def _warn(model: Model, first: Experiment) -> None:
    own = first.model(model).parameters
    angle = math.degrees(own["cap"].value / (own["kp"].value * own["error_gain"].value))
    log.warning(
        "%s: the drive of the model is full at an error of %.3g° of the angle (cap / (kp error_gain)), that of the "
        "servo is not; it is fitted without this limit; if the limit is known, state cap and error_gain in the model "
        "file",
        first.name, angle,
    )  # fmt: skip
