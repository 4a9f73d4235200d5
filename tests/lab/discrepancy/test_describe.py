"""What is outside of the catalogue, described: on recordings of simulators of its own, the function that was hidden."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.discrepancy.basis import Guess
from lostmotion.lab.discrepancy.describe import _finding, _nearest, described
from lostmotion.lab.fitting.strategy import first_fit
from lostmotion.lab.results import Finding
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model, Parameter, build_model, catalogue
from lostmotion.model.effects import get_effect
from lostmotion.model.signals import SENSOR, TORQUE
from tests.lab.simulated_gears import moved

NOISE, LENGTH = 0.1, 0.6


def finding(model: Model, recordings: list[Recording]) -> Finding | None:
    """What is told of these recordings after a first fit."""
    task = Task.of(model, measured := experiments(model, recordings), noise_of(measured))
    with ThreadPoolExecutor(2) as pool:
        return described(first_fit(model, task, pool), task)


def gears(seed: int, length: float = LENGTH, **hidden: float) -> Recording:
    """The accelerometer of gears with something hidden, a hum among it."""
    run = moved(seed, length, **hidden)
    hum = hidden.get("hum.a", 0.0) * np.sin(2 * np.pi * hidden.get("hum.f", 0.0) * run.time + seed)
    return run.recording(run.accel + hum + NOISE * run.noise, f"rec{seed}.csv")


def heard(seeds: tuple[int, int] = (31, 32), **hidden: float) -> Finding:
    """What is told of two recordings of such gears."""
    rough = build_model("play", values={"d": 9e-5, "alpha": 3000.0, "b": 0.2, "k": 2500.0})
    found = finding(rough, [gears(seed, **hidden) for seed in seeds])
    assert found is not None
    return found


@pytest.mark.slow
def test_a_spring_that_is_softer_on_one_side() -> None:
    """A force on the bar that follows its deflection, about as its square.  Of eight pairs of recordings (seeds 31 to
    46) five are described so; after a first fit in another minimum it is a damping (two), or acts on the joint."""
    found = heard((33, 34), **{"quadratic_spring.k2": 0.25 * 2600.0 / 0.25e-3})
    assert (found.acts_on, found.depends_on) == ("oscillator", ("q",))
    assert found.formula is not None
    assert found.formula.endswith("q²")


@pytest.mark.slow
def test_hum_of_the_sensor() -> None:
    """A wave in the sensor, its frequency within a tenth of a hertz, whatever its phase in each recording."""
    found = heard(**{"hum.a": 1.0, "hum.f": 103.3})
    assert (found.acts_on, found.depends_on) == ("sensor", ("time",))
    assert found.formula is not None
    size, hz = float(found.formula.split()[0]), float(found.formula.split()[2])
    assert hz == pytest.approx(103.3, abs=0.1)
    assert size == pytest.approx(1.0, rel=0.1)


@pytest.mark.slow
def test_an_oscillator_alone() -> None:
    """A bar that rings down with a quadratic spring, by SciPy: the force follows the deflection, with its factor."""
    m, b, k, k2 = 0.02, 0.05, 2600.0, 2e5
    times = np.arange(1200) / 1000
    motion = solve_ivp(lambda t, y: (y[1], (-b * y[1] - k * y[0] - k2 * y[0] ** 2) / m), (0, 1.2), (1e-3, 0.0), "LSODA",
                       times, rtol=1e-9, atol=1e-12).y[0]  # fmt: skip
    noise = np.random.default_rng(5).normal(0, 2e-6, times.size)
    model = build_model("oscillator", values={"m": Parameter(m, "kg", fixed=True), "k": 2500.0, "b": 0.08})
    found = finding(model, [Recording(times, {"displacement": motion + noise}, name="ring.csv")])
    assert found is not None
    assert (found.acts_on, found.depends_on) == ("oscillator", ("q",))
    assert found.formula is not None
    assert found.formula.endswith("q²")
    assert float(found.formula.split()[0]) == pytest.approx(-k2, rel=0.1)


@pytest.mark.slow
def test_friction_with_the_cube_of_the_speed() -> None:
    """A joint that is pushed to and fro, by SciPy: its curve holds the truth, the formula its factor."""
    J, b3, times = 2e-3, 3e-3, np.arange(2000) / 500
    torque = 0.03 * np.sin(2 * np.pi * 0.7 * times) + 0.02 * np.sin(2 * np.pi * 1.9 * times + 1)

    def rates(t: float, y: np.ndarray) -> tuple[float, float]:
        return y[1], (np.interp(t, times, torque) - b3 * y[1] ** 3) / J

    angle = solve_ivp(rates, (0, 4), (0.0, 0.0), "LSODA", times, rtol=1e-9, atol=1e-12, max_step=2e-3).y[0]
    noise = np.random.default_rng(6).normal(0, 1e-4, times.size)
    model = build_model("joint", values={"J": Parameter(J, "kg m^2", fixed=True)})
    found = finding(model, [Recording(times, {"torque": torque, "position": angle + noise}, name="swing.csv")])
    assert found is not None
    assert (found.acts_on, found.depends_on) == ("joint", ("omega_2",))
    assert found.curve is not None
    truth = -b3 * found.curve.x**3
    assert np.mean((found.curve.low <= truth) & (truth <= found.curve.high)) > 0.5
    assert found.formula is not None
    assert found.formula.endswith("omega_2³")
    assert float(found.formula.split()[0]) == pytest.approx(-b3, rel=0.15)  # chords of a curve


@pytest.mark.slow
def test_a_model_that_runs_away_is_not_described() -> None:
    """No function can be looked for along motions that are not finite."""
    rough = build_model("play", values={"d": 9e-5, "alpha": 3000.0, "b": 0.2, "k": 2500.0})
    measured = experiments(rough, [gears(31), gears(32)])
    task, away = Task.of(rough, measured, noise_of(measured)), rough.replace({"alpha": 1e9})
    with ThreadPoolExecutor(2) as pool:
        assert _nearest(away, [], {TORQUE: 1e-3, SENSOR: 1.0}, task, pool) is None


def test_the_catalogue_is_as_it_was() -> None:
    """Functions that were tried are no effects for others."""
    assert not [effect.id for effect in catalogue() if effect.id.startswith("unknown")]


def test_one_known_height_is_no_curve() -> None:
    """Where the fit tells only the height at rest, the finding says on what it depends, and draws nothing."""
    x = np.linspace(-2.0, 2.0, 5)
    guess = Guess(get_effect("viscous_friction"), "N m", ("omega_2",), x, np.ones(5, dtype=bool))
    finding = _finding(guess, {name: (0.1, 0.01 if i == 2 else 1e3) for i, name in enumerate(guess.heights)})
    assert (finding.depends_on, finding.curve, finding.formula) == (("omega_2",), None, None)
    known = _finding(guess, {name: (0.3 * at, 0.01) for name, at in zip(guess.heights, x, strict=True)})
    assert known.curve is not None
    assert known.formula == "0.3 omega_2"


def test_heights_of_zero_are_no_curve() -> None:
    """A fit that is cut short leaves the heights where they begin, at zero: nothing is drawn."""
    x = np.linspace(-2.0, 2.0, 5)
    guess = Guess(get_effect("viscous_friction"), "N m", ("omega_2",), x, np.ones(5, dtype=bool))
    finding = _finding(guess, dict.fromkeys(guess.heights, (0.0, 0.01)))
    assert (finding.depends_on, finding.curve, finding.formula) == (("omega_2",), None, None)
