"""Masses on springs that a force drives, simulated by SciPy's LSODA with the equations of bench/driven_systems.py."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from bench.driven_motions import Case
from bench.driven_systems import Bar
from scipy.signal import TransferFunction, lsim

from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explain
from lostmotion.lab.data.frequency_response import from_spectra, spectral_lines
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.fitting.identifiability import with_scale
from lostmotion.lab.inverse.candidates import refined, sizes_of
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.explain import fitted
from lostmotion.lab.inverse.fitted import fit_on
from lostmotion.lab.inverse.likelihood import Method, WholeMotion
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.regression import Regression, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.shooting import parameters
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray


def bar_of(case: Case) -> Bar:
    """The bar of a case, as it was drawn."""
    return Bar.drawn(np.random.default_rng((case.seed, *case.base.encode(), *case.hidden.encode())), case.effects)


def test_acceleration_gives_first_values() -> None:
    """Mass, damping and stiffness are within 15 % of the truth by the spectra of force and acceleration, where the
    file's resonance is 58 Hz and the true one 31 and 2.2 Hz."""
    for seed in (409, 413):
        case = Case("oscillator", "none", seed)
        true, model = bar_of(case), build_model("oscillator")
        assert true.column == "accel"
        rough = from_spectra(model, experiments(model, case.recordings()))
        values = [rough.parameters[name].value for name in ("m", "b", "k")]
        assert values == pytest.approx([true.mass, true.damping, true.spring], rel=0.15)


def test_first_values_come_from_what_was_recorded() -> None:
    """Of a displacement beside an acceleration the displacement gives the values, as it is the more direct."""
    case = Case("oscillator", "none", 404)
    true, model = bar_of(case), build_model("oscillator")
    one, other, _ = case.recordings()
    other = replace(other, columns={"force": other.columns["force"], "accel": other.columns["displacement"]})
    rough = from_spectra(model, experiments(model, [one, other]))
    assert rough.parameters["k"].value == pytest.approx(true.spring, rel=0.15)


def test_motion_from_rest_is_followed_to_its_noise() -> None:
    """A force that begins at once sets the bar into motion: what the filter says of the first speed is 30 times its
    noise off.  The fit leaves the noise, and its intervals hold the truth."""
    case = Case("oscillator", "none", 404)
    true, model = bar_of(case), build_model("oscillator")
    held = experiments(model, case.recordings())
    fit = fitted(model, held, Method.MOTION, noise_of(held))
    noise = true.noise * np.mean([np.std(one.measured[true.column]) for one in held])
    assert fit.rms[true.column] < 1.2 * noise
    for name, value in (("m", true.mass), ("b", true.damping), ("k", true.spring)):
        estimate = next(one for one in fit.estimates if one.name == name)
        assert estimate.value == pytest.approx(value, rel=2e-3)


def test_a_motion_from_rest_is_judged_on_its_own_branch() -> None:
    """A bar that stiffens, with the true values, is followed to the noise where it is driven ten times as hard as
    usual.  From what the filter says of its first place it ended on another branch, with 275 m/s² left."""
    case = Case("oscillator", "hardening_spring", 9700)
    true = bar_of(case)
    values = {"m": true.mass, "b": true.damping, "k": true.spring}
    cubic = 0.3 * true.size * true.spring / true.usual**2
    known = build_model("oscillator", ["hardening_spring"], values | {"hardening_spring.k3": cubic})
    known = parameters.held(known, parameters.free_names(known))
    first, _, last = (Signals.of(one) for one in experiments(known, case.recordings()))
    there = fit_on(regressed(known, OutputError.of([first], known)), last)
    assert there is not None
    assert there.rms < 1.5 * true.noise * true.reading  # in the steps of the bare model


def test_a_force_that_is_counted_against_the_motion_is_turned_round(caplog: pytest.LogCaptureFixture) -> None:
    """As two sensors have their own positive directions: the fit is the same, and a warning says so."""
    for seed in (404, 409):
        case, model = Case("oscillator", "none", seed), build_model("oscillator")
        recordings = case.recordings()[:2]
        against = [replace(one, columns={**one.columns, "force": -one.columns["force"]}) for one in recordings]
        caplog.clear()
        one, other = experiments(model, recordings), experiments(model, against)
        assert caplog.text.count("the force is counted against the motion; it is turned round") == 1
        fits = [fitted(model, held, Method.MOTION, noise_of(held)) for held in (one, other)]
        masses = [next(each.value for each in fit.estimates if each.name == "m") for fit in fits]
        assert masses[1] == pytest.approx(masses[0], rel=1e-6)


def flexible_arm(seed: int) -> Recording:
    """The hand of an arm that a torque of many tones bends, by its modes (transfer functions); the strongest one moves
    against the torque."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 16.0, 5e-3)
    tones = np.arange(1, 125) / 5
    torque = 0.02 * np.cos(2 * np.pi * tones * times[:, None] + rng.uniform(0, 2 * np.pi, tones.size)).sum(axis=1)
    hand = 0.003 * rng.standard_normal(times.size)
    for gain, hertz, ratio in ((703.0, 7.28, 0.0026), (-2508.0, 15.85, 0.0032), (3000.0, 42.0, 0.003)):
        w = 2 * np.pi * hertz
        hand += lsim(TransferFunction([gain], [1.0, 2 * ratio * w, w**2]), torque, times)[1]
    late = times >= 10.0
    return Recording(times[late], {"force": torque[late], "displacement": hand[late]}, {}, {}, 0, f"arm{seed}.csv")


def test_a_bar_with_more_modes_is_fitted_to_the_end() -> None:
    """A fit that ended before would make every effect look needed: no further step lowers the error of the model as it
    is, which follows the strongest mode."""
    model = build_model("oscillator")
    held = experiments(model, [flexible_arm(1), flexible_arm(2)])
    model, _ = with_scale(model, held)
    signals = [Channel().signals(one) for one in held]
    first = WholeMotion(Method.MOTION, from_spectra(model, held), signals).first
    assert refined(first.generalised).rms > 0.999 * first.rms
    values = {name: first.model.parameters[name].value for name in ("m", "k")}
    assert np.sqrt(values["k"] / values["m"]) / (2 * np.pi) == pytest.approx(15.85, rel=0.01)


def test_accelerometer_leaves_a_constant_force_alone() -> None:
    """A constant force only shifts the place of rest, which an accelerometer does not feel: it is held.  Of a
    displacement it is estimated."""
    for seed, is_estimated in ((409, False), (404, True)):
        model = build_model("oscillator")
        held = experiments(model, Case("oscillator", "none", seed).recordings()[:2])
        fit = fitted(model, held, Method.MOTION, noise_of(held))
        assert any(one.name == "bias" for one in fit.estimates) is is_estimated


@pytest.mark.slow
def test_drift_of_any_size_is_found() -> None:
    """A drift of 30 m/s³ and more is found, as no bound of a parameter is that of one robot."""
    case = Case("oscillator", "bias_drift", 404)
    model = build_model("oscillator")
    with ThreadPoolExecutor(1) as pool:
        found = explain(model, experiments(model, case.recordings()[:2]), pool, budget_s=600.0)
    assert found.missing == ("bias_drift",)
    assert found.best["bias_drift.c"].value > 10
    assert found.error.after < 1.3 * found.error.noise


def test_end_at_a_bound_is_reported() -> None:
    """A fit that a bound of the file ends, which it approaches from within, says so."""
    case = Case("oscillator", "bias_drift", 404)
    model = build_model("oscillator", ["bias_drift"])
    limited = replace(model.parameters["bias_drift.c"], high=10.0, low=-10.0)
    held = experiments(model, case.recordings()[:2])
    fit = fitted(model.replace({"bias_drift.c": limited}), held, Method.MOTION, noise_of(held))
    assert [one.name for one in fit.estimates if one.at_bound] == ["bias_drift.c"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "seed", "count"), [("second_mode", 406, 2), ("sensor_lag", 406, 3), ("hardening_spring", 404, 2)]
)
def test_hidden_effects_are_found(hidden: str, seed: int, count: int) -> None:
    """A second mode that lies between the tones of the force, a lag of the sensor and a stiffening spring are named
    alone, and the error falls to the noise."""
    case = Case("oscillator", hidden, seed)
    model = build_model("oscillator")
    with ThreadPoolExecutor(2) as pool:
        found = explain(model, experiments(model, case.recordings()[:count]), pool, budget_s=600.0)
    assert found.missing == (hidden,)
    assert found.error.after < 1.5 * found.error.noise


def two_modes(share: float, power: float) -> Recording:
    """A force of 110 sines, which grow with a power of their frequency, moves two modes, at 15.84 and, by a share of
    the force and against it, at 7.28 Hz."""
    time = np.arange(0.0, 20.0, 0.005)
    rng, sines = np.random.default_rng(3), np.arange(1.5, 29.0, 0.25)
    force = sum((at / 16) ** power * np.sin(2 * np.pi * (at * time + rng.random())) for at in sines)

    def mode(at_hz: float, share: float) -> FloatArray:
        w = 2 * np.pi * at_hz
        return np.asarray(lsim(TransferFunction([share / 0.02], [1, 0.006 * w, w * w]), force, time)[1])

    moved = mode(15.84, 1.0) + mode(7.28, -share)
    return Recording(time, {"force": force, "displacement": moved + 1e-5 * rng.standard_normal(time.size)})


def first_of(recorded: Recording) -> Regression:
    """The fit of an oscillator without a second mode."""
    model = build_model("oscillator")
    (held,) = experiments(model, [recorded])
    return WholeMotion(Method.MOTION, from_spectra(model, [held]), [Signals.of(held)]).first.ordinary


@pytest.mark.filterwarnings("ignore::scipy.signal.BadCoefficients")
def test_a_second_mode_is_looked_for_in_what_the_first_one_leaves() -> None:
    """The six strongest lines of the motion are near the first mode and above it."""
    recorded = two_modes(0.02, 3.0)
    assert not any(line == pytest.approx(7.28, rel=0.05) for line in spectral_lines(recorded["displacement"], 200.0))
    assert sizes_of(first_of(recorded)).lines[0] == pytest.approx(7.28, rel=0.05)


@pytest.mark.filterwarnings("ignore::scipy.signal.BadCoefficients")
def test_a_fit_begins_at_the_strongest_mode_beside_another_one() -> None:
    """The spectra of both modes give values from which the fit left 99.7 % of the motion, at 15.93 Hz."""
    recorded = two_modes(0.25, 1.0)
    first = first_of(recorded)
    at_hz = np.sqrt(first.model.parameters["k"].value / first.model.parameters["m"].value) / (2 * np.pi)
    assert at_hz == pytest.approx(15.84, abs=0.01)
    assert first.rms < 0.6 * np.std(recorded["displacement"])
