"""A joint that sticks at each reversal: what its filter mixes with the rest knows little of its friction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.inverse.torques import softened
from lostmotion.model import Sampled, build_model

INERTIA, VISCOUS, COULOMB = 0.05, 1.0, 0.5
STEP_S, EVERY = 5e-4, 10


def sticking(seed: int) -> Experiment:
    """A joint under a soft controller that sticks until its friction of 0.5 N m is overcome (Karnopp 1985), in steps of
    0.5 ms for 20 s; an encoder with noise of 0.3 mrad, 200 samples a second."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, STEP_S)
    goal, rate, needs = (np.zeros(time.size) for _ in range(3))
    for size, hz in ((0.8, 0.25 * rng.uniform(0.7, 1.3)), (0.6, 0.25 * rng.uniform(0.3, 0.6)), (0.02, 2.5)):
        w, phase = 2 * math.pi * hz, rng.uniform(0, 2 * math.pi)
        goal += size * np.sin(w * time + phase)
        rate += size * w * np.cos(w * time + phase)
        needs += size * w * (VISCOUS * np.cos(w * time + phase) - INERTIA * w * np.sin(w * time + phase))
    q, v, angle, torque = float(goal[0]), float(rate[0]), [], []
    for wanted, speed, known in zip(goal.tolist(), rate.tolist(), needs.tolist(), strict=True):
        drive = 8.0 * (wanted - q) + 0.3 * (speed - v) + known
        angle.append(q)
        torque.append(drive)
        free = drive - VISCOUS * v
        if v == 0.0 and abs(free) < COULOMB:
            continue
        before, v = v, v + STEP_S / INERTIA * (free - math.copysign(COULOMB, v or free))
        v = 0.0 if before * v < 0 else v
        q += STEP_S * v
    noisy = np.array(angle[::EVERY]) + 3e-4 * rng.standard_normal(len(angle[::EVERY]))
    given = np.array(torque[::EVERY]) + 0.01 * rng.standard_normal(noisy.size)
    return Experiment(f"{seed}.csv", Sampled(time[::EVERY], given), time[::EVERY], {"position": noisy})


def fit_of(seed: int) -> Regression:
    """The usual joint fitted to one recording."""
    recorded, model = sticking(seed), build_model("joint", ["viscous_friction", "coulomb_friction"])
    signals = [Channel.of([recorded]).signals(recorded)]
    return regressed(softened(model, signals), InverseModel.of(signals, model))


@pytest.mark.slow
def test_friction_of_a_joint_that_sticks() -> None:
    """The mean errors of six fits are below 0.5 % (viscous friction) and 1 % (Coulomb): 1.1 and 2.3 % with the samples
    beside a reversal."""
    fits = [fit_of(seed).model.parameters for seed in range(7000, 7006)]
    viscous = [one["viscous_friction.b_v"].value / VISCOUS - 1 for one in fits]
    coulomb = [one["coulomb_friction.tau_c"].value / COULOMB - 1 for one in fits]
    assert np.mean(np.abs(viscous)) < 0.005, viscous
    assert np.mean(np.abs(coulomb)) < 0.01, coulomb


def test_samples_beside_a_reversal_do_not_count() -> None:
    """None within 0.15 periods of the end of the band; most others do."""
    recorded = sticking(7000)
    signals = Channel.of([recorded]).signals(recorded)
    turns = signals.time[1:][np.diff(np.sign(signals.velocity)) != 0]
    nearest = np.abs(signals.time[signals.kept][:, None] - turns).min(axis=1)
    assert nearest.min() > 0.15 / signals.band_hz - 1 / 200
    assert signals.kept.size > 0.7 * signals.grid.size
