"""A whole set of results to report on: a simulated joint that rubs, seen by models without and with that friction.

The motions are simulated; what a search would have found in them is made up here, so that it is known.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.comparison.compare import Comparison, compare
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.results import Curve, Errors, Estimate, Explanation, Finding, Fit, Ladder, Ranked, Rung
from lostmotion.model import Model, Sensor, build_model, by_name, catalogue

TAU_C = 1.2e-4
NOISE = 0.4
NAME = "arm <script><b>&.csv"
FREE = ("d", "alpha", "l", "b", "k", "bias")
RUBBING = {"alpha": 8000.0, "coulomb_friction.tau_c": TAU_C}


@cache
def recordings(count: int = 3, duration: float = 4.0, rate_hz: float = 800.0) -> tuple[Recording, ...]:
    """Accelerations of the rubbing joint under hand-waved motion, with noise; the angle at a quarter of the rate."""
    truth = build_model("play", ["coulomb_friction"], RUBBING)
    times = np.arange(round(duration * rate_hz)) / rate_hz
    found = []
    for seed in range(count):
        trajectory = truth.simulate(by_name(f"hand-waved:{seed}"), times)
        accel = Sensor(noise=NOISE).apply(trajectory["accel"], np.random.default_rng(seed))
        position = Sensor(noise=2e-4).apply(trajectory["position"], np.random.default_rng(seed))
        position[np.arange(times.size) % 4 != 0] = np.nan
        columns = {"command": trajectory["command"], "accel": accel, "position": position}
        found.append(Recording(times, columns, name=f"/data/{seed} {NAME}"))
    return tuple(found)


def fit(*effects: str, **values: float) -> Fit:
    """A fit as lab.fit would give it; an effect's main parameter counts as estimated."""
    model = build_model("play", effects, {"alpha": 8000.0, **values})
    mains = tuple(next(name for name in model.parameters if name.startswith(f"{effect}.")) for effect in effects)
    estimates = tuple(_estimate(model, name) for name in (*FREE, *mains))
    tried = experiments(model, recordings())
    starts = tuple(model.initial_state(one.drive, float(one.time[0])) for one in tried)
    correlation = np.eye(len(estimates))
    correlation[0, 1] = correlation[1, 0] = -0.97
    correlation[2, 4] = correlation[4, 2] = 0.62
    return Fit(model, tried, starts, estimates, correlation, {"accel": NOISE}, {"accel": 0.41}, 1e-4)


@cache
def comparison(*effects: str) -> Comparison:
    """The accelerations against a model without or with the friction."""
    given = fit(*effects, **({"coulomb_friction.tau_c": TAU_C} if effects else {}))
    felt = [replace(one, measured={"accel": one.measured["accel"]}) for one in given.experiments]
    found = compare(given.model, felt, given.starts, is_described=False)  # nine seconds otherwise
    return replace(found, localisation=None if found.is_noise else tight_spot())


def explanation() -> Explanation:
    """Coulomb friction found, not to be told from Stribeck friction."""
    others = [effect.id for effect in catalogue() if "play" in effect.bases and effect.id != "coulomb_friction"]
    ranking = (
        Ranked("coulomb_friction", 4.1, 0.41, 1e-30, {"tau_c": (TAU_C, 1.12e-4, 1.28e-4)}),
        *(Ranked(name, 4.1, 1.0 + 0.15 * i, 1e-5 * 1.7**i) for i, name in enumerate(others)),
    )
    return Explanation(
        ("coulomb_friction",), (("coulomb_friction", "stribeck_friction"),), ranking,
        Errors(4.1, 0.41, NOISE, "m/s^2"), None, "Move slowly through rest, again and again: a sine of 0.5 Hz, 5°.",
        {}, fit(), fit("coulomb_friction", **{"coulomb_friction.tau_c": TAU_C}),
    )  # fmt: skip


def nothing_missing() -> Explanation:
    """Down to the noise, with the sizes that would have been seen."""
    best = fit("coulomb_friction", **{"coulomb_friction.tau_c": TAU_C})
    detectable = {"viscous_friction": ("b_v", 2.1e-5), "hardening_spring": ("k3", 3e8), "clock_skew": ("s", 2e-5)}
    ranking = (Ranked("viscous_friction", 0.41, 0.409, 0.31, {"b_v": (1e-6, -1e-5, 1.2e-5)}),)
    return Explanation((), (), ranking, Errors(0.41, 0.41, NOISE, "m/s^2"), None, "", detectable,
                       best, best, complete=True)  # fmt: skip


def tight_spot() -> Finding:
    """A torque in the joint that no effect knows."""
    x = np.linspace(-0.3, 0.3, 25)
    mean = 2e-4 * np.exp(-((x / 0.05) ** 2))
    shape = Curve("theta_2", "rad", x, mean, mean - 3e-5, mean + 3e-5, "N m")
    return Finding("joint", ("theta_2",), "A torque against the motion, in a narrow range of the angle.", shape,
                   "-0.0002 exp(-(theta_2/0.05)^2) sign(omega)")  # fmt: skip


def outside_catalogue() -> Explanation:
    """Nothing of the catalogue is named."""
    left = Errors(3.2, 3.2, NOISE, "m/s^2")
    return Explanation((), (), (), left, tight_spot(), "", {}, fit(), fit())


def ladder() -> Ladder:
    """Two rungs down to the noise."""
    rungs = (Rung((), 4.1, NOISE, "m/s^2"), Rung(("coulomb_friction",), 0.41, NOISE, "m/s^2"))
    return Ladder(replace(explanation(), complete=True, rungs=rungs))


def _estimate(model: Model, name: str) -> Estimate:
    parameter = model.parameters[name]
    half = 0.07 * abs(parameter.value) or 0.02
    return Estimate(name, parameter.value, parameter.value - half, parameter.value + half, parameter.unit,
                    identified=name != "alpha", at_bound=name == "b")  # fmt: skip
