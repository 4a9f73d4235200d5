"""Building, changing and simulating models: the contract that other folders rely on."""

from __future__ import annotations

import dataclasses
import itertools
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.model import (
    BASES,
    HandWaved,
    ModelError,
    Parameter,
    Sampled,
    Sine,
    build_model,
    catalogue,
)
from lostmotion.model import model as model_module
from lostmotion.model.base import Base

TIMES = np.arange(501) * 1e-3
MOTION = HandWaved(seed=4, high_hz=6.0)
BROKEN = st.sampled_from([float("nan"), float("inf"), float("-inf")])


def test_blocks_continue_seamlessly() -> None:
    """A run cut into blocks at the knots gives the same samples as one run, effects with memory included."""
    model = build_model("play", ["sensor_lag", "actuator_lag", "second_mode"])
    whole = model.simulate(MOTION, TIMES, substep_s=1e-4)
    state, parts = None, []
    for first, last in itertools.pairwise((0, 120, 121, 300, 500)):
        block = model.simulate(MOTION, TIMES[first : last + 1], state, substep_s=1e-4)
        parts.append(block["accel"][: last - first])
        state = block.state
    assert np.max(np.abs(np.concatenate(parts) - whole["accel"][:-1])) < 1e-7 * np.max(np.abs(whole["accel"]))
    assert state == pytest.approx(whole.state, abs=1e-9)


def test_years_later_is_like_now() -> None:
    """A block that starts a year later is as exact as one that starts at zero: time is counted from its start."""
    year = 365.25 * 86400.0
    now = build_model("play").simulate(Sampled(TIMES, MOTION.position(TIMES)), TIMES, substep_s=1e-4)
    later = Sampled(TIMES + year, MOTION.position(TIMES))
    then = build_model("play").simulate(later, later.time, substep_s=1e-4)
    assert np.max(np.abs(then["accel"] - now["accel"])) < 1e-2 * np.max(np.abs(now["accel"]))


def test_play_may_grow_between_blocks() -> None:
    """The state of one model starts another with more play, which loses more motion."""
    thin = build_model("play", (), {"d": 2e-5})
    block = thin.simulate(MOTION, TIMES)
    worn = thin.replace({"d": 4e-4}).simulate(MOTION, TIMES + TIMES[-1], block.state)
    assert np.ptp(worn["gap"]) > 3 * np.ptp(block["gap"])


def test_samples_of_a_closed_form_give_the_same_motion() -> None:
    """A motion and its own samples at 1 kHz lead to the same trajectory."""
    exact, sampled = (
        build_model("play").simulate(drive, TIMES, substep_s=1e-4)
        for drive in (MOTION, Sampled(TIMES, MOTION.position(TIMES)))
    )
    assert np.max(np.abs(exact["accel"] - sampled["accel"])) < 1e-3 * np.max(np.abs(exact["accel"]))


def test_one_output_and_uneven_outputs() -> None:
    """One time gives the start; uneven times give what the even run shows there."""
    model = build_model("play")
    assert model.simulate(MOTION, [0.25])["position"] == pytest.approx(MOTION.position(np.array([0.25])))
    uneven = TIMES[[0, 1, 7, 8, 200, 455, 500]]
    even, few = (model.simulate(MOTION, t, substep_s=1e-4) for t in (TIMES, uneven))
    assert few["accel"] == pytest.approx(even["accel"][[0, 1, 7, 8, 200, 455, 500]], rel=1e-9)


@pytest.mark.parametrize("base", ["oscillator", "joint"])
def test_outputs_within_and_on_a_step(base: str) -> None:
    """Several outputs within one long step, the last of them on its end, are all exact."""
    model = build_model(base, (), {"bias": 1e-3})
    coarse, fine = (model.simulate(None, np.arange(17) * 5e-4, substep_s=h) for h in (2e-3, 1e-5))
    for name in ("velocity", "displacement" if base == "oscillator" else "position"):
        assert np.max(np.abs(coarse[name] - fine[name])) < 0.05 * np.max(np.abs(fine[name]))
        assert np.all(np.diff(coarse[name][:4]) > 0)


def test_threads_get_what_one_thread_gets() -> None:
    """Simulations run at the same time do not disturb one another."""
    model = build_model("play", ["coulomb_friction"])
    alone = [model.simulate(HandWaved(seed=i), TIMES)["accel"] for i in range(4)]
    found: dict[int, np.ndarray] = {}

    def work(i: int) -> None:
        found[i] = model.simulate(HandWaved(seed=i), TIMES)["accel"]

    threads = [threading.Thread(target=work, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(np.array_equal(found[i], alone[i]) for i in range(4))


def test_order_of_the_list_does_not_matter() -> None:
    """Effects listed in any order give the same numbers."""
    names = ["sensor_saturation", "coulomb_friction", "sensor_lag", "gravity_leakage", "actuator_lag", "bias_drift"]
    forward, backward = (build_model("play", order).simulate(MOTION, TIMES) for order in (names, names[::-1]))
    assert np.array_equal(forward["accel"], backward["accel"])


def test_fused_terms_equal_the_single_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fast combined kernels give what the terms of the paper give one by one."""

    def unfused(name: str) -> Base:
        return dataclasses.replace(BASES[name], fusions=())

    fused = build_model("play").simulate(MOTION, TIMES, substep_s=1e-4)
    partly = build_model("play", ["viscous_friction"], {"viscous_friction.b_v": 0.0})
    half = partly.simulate(MOTION, TIMES, substep_s=1e-4)
    monkeypatch.setattr(model_module, "get_base", unfused)
    single = build_model("play").simulate(MOTION, TIMES, substep_s=1e-4)
    for name, values in single.signals.items():
        assert fused[name] == pytest.approx(values, rel=1e-9, abs=1e-12), name
        assert half[name] == pytest.approx(values, rel=1e-9, abs=1e-12), name


def test_substep_follows_the_contact() -> None:
    """A steeper contact and a heavier blow get shorter steps, and each is converged to 1e-3."""
    gentle, times = HandWaved(seed=1), np.arange(301) * 1e-3
    steps = []
    for values, motion in (
        ({"n": 11}, gentle),
        ({"n": 31}, gentle),
        ({"n": 101}, gentle),
        ({}, HandWaved(1, 0.5, 0.5, 6.0)),
    ):
        model = build_model("play", (), values)
        chosen = model.simulate(motion, times)
        finer = model.simulate(motion, times, substep_s=chosen.substep_s / 2)
        error = np.sqrt(np.mean((chosen["accel"] - finer["accel"]) ** 2) / np.mean(finer["accel"] ** 2))
        assert error < 1e-3
        steps.append(chosen.substep_s)
    assert steps[0] > steps[1] > steps[2]
    assert steps[3] < steps[0]


def test_a_violent_start_is_caught_by_the_second_run() -> None:
    """A blow that the input does not announce shortens the step after the first run."""
    model = build_model("play")
    calm = model.simulate(None, TIMES, model.initial_state(omega_2=0.01))
    blow = model.simulate(None, TIMES, model.initial_state(omega_2=20.0))
    assert blow.substep_s < calm.substep_s / 4
    finer = model.simulate(None, TIMES, model.initial_state(omega_2=20.0), substep_s=blow.substep_s / 2)
    assert np.max(np.abs(blow["force"][:10] - finer["force"][:10])) < 0.01 * np.max(np.abs(finer["force"]))


def test_names_are_told() -> None:
    """Unknown bases, effects, parameters and states are refused, and the possible ones named."""
    with pytest.raises(ModelError, match="play, oscillator, joint, servo"):
        build_model("gear")
    with pytest.raises(ModelError, match="coulomb_friction"):
        build_model("play", ["coulomb"])
    with pytest.raises(ModelError, match="only on play, oscillator"):
        build_model("servo", ["hardening_spring"])
    with pytest.raises(ModelError, match="twice"):
        build_model("play", ["gravity_torque", "gravity_torque"])
    with pytest.raises(ModelError, match="R1, R2, J2, beta"):
        build_model("play", (), {"D": 1e-4})
    with pytest.raises(ModelError, match="theta_2, omega_2"):
        build_model("play").initial_state(theta=1.0)


def test_replace_and_with_effect_leave_the_original() -> None:
    """Copies change, the model they come from does not; values travel along."""
    model = build_model("play", (), {"d": 1e-4})
    richer = model.with_effect("coulomb_friction").replace({"coulomb_friction.tau_c": Parameter(1e-4, "N m", 0, 1e-3)})
    assert model.effects == ()
    assert richer.effects == ("coulomb_friction",)
    assert richer.parameters["d"].value == 1e-4
    assert richer.parameters["coulomb_friction.tau_c"].high == 1e-3
    assert list(richer.parameters)[:4] == ["R1", "R2", "J2", "beta"]
    with pytest.raises(ModelError, match="twice"):
        richer.with_effect("coulomb_friction")


def test_parameters_have_units_bounds_and_sources() -> None:
    """Every parameter of every base and effect says its unit's place, its finite bounds, meaning and source."""
    for base in BASES.values():
        model = build_model(base.id, [effect.id for effect in catalogue() if base.id in effect.bases])
        for name, parameter in model.parameters.items():
            assert parameter.source, name
            assert parameter.meaning, name
            assert np.isfinite([parameter.low, parameter.high]).all(), name
    fixed = [name for name, parameter in build_model("play").parameters.items() if parameter.fixed]
    assert fixed == ["R1", "R2", "J2", "beta", "n", "m"]


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("d", 0.0),
        ("d", -1e-5),
        ("J2", 0.0),
        ("m", -1.0),
        ("R1", 0.0),
        ("n", 10),
        ("n", 11.5),
        ("n", 103),
        ("alpha", -1.0),
    ],
)
def test_impossible_values(name: str, bad: float) -> None:
    """What physics forbids is refused with the parameter's name."""
    with pytest.raises(ModelError, match=f"parameter {name}: "):
        build_model("play", (), {name: bad})


def test_units_and_bounds_are_checked() -> None:
    """A parameter in another unit, or outside its own bounds, is refused; a plain value widens the default bounds."""
    with pytest.raises(ModelError, match="unit"):
        build_model("play", (), {"d": Parameter(0.08, "mm")})
    with pytest.raises(ModelError, match="bounds"):
        Parameter(2e-3, "m", 1e-6, 1e-3)
    widened = build_model("play", (), {"d": 1e-7}).parameters["d"]
    assert widened.low == 1e-7
    assert widened.high == 1e-3


@given(name=st.sampled_from(list(build_model("play").parameters)), bad=BROKEN)
def test_parameters_must_be_finite(name: str, bad: float) -> None:
    """No parameter can be NaN or infinite."""
    with pytest.raises(ModelError, match=f"parameter {name}"):
        build_model("play", (), {name: bad})


@given(where=st.integers(0, 19), bad=BROKEN, in_time=st.booleans())
def test_samples_must_be_finite(where: int, bad: float, in_time: bool) -> None:
    """A recording with a number missing is refused, and the place told."""
    time, values = np.arange(20) * 1e-2, np.zeros(20)
    (time if in_time else values)[where] = bad
    with pytest.raises(ModelError, match=f"sample {where} "):
        Sampled(time, values)


@given(st.lists(st.one_of(st.floats(), st.integers(-5, 5).map(float)), max_size=6))
def test_times_must_ascend(times: list[float]) -> None:
    """Output times are finite and ascending, or refused."""
    good = len(times) > 0 and np.isfinite(times).all() and all(a < b for a, b in itertools.pairwise(times))
    if not good:
        with pytest.raises(ModelError, match="output times"):
            build_model("oscillator").simulate(None, times)


@given(st.lists(st.one_of(BROKEN, st.floats(-1, 1)), min_size=0, max_size=6))
def test_states_must_fit(state: list[float]) -> None:
    """A state of another length or with broken numbers is refused."""
    if len(state) != 4 or not np.isfinite(state).all():
        with pytest.raises(ModelError, match="a state needs 4"):
            build_model("play").simulate(None, [0.0, 0.01], state)


def test_what_explodes_is_told() -> None:
    """A step beyond stability, and a state beyond all numbers, end in one clear error instead of NaN."""
    with pytest.raises(ModelError, match="sub-step"):
        build_model("play", (), {"k": 1e7}).simulate(MOTION, TIMES, substep_s=1e-3)
    with pytest.raises(ModelError):
        build_model("play").simulate(None, TIMES, [1e30, 0.0, 0.0, 0.0])
    with pytest.raises(ModelError, match="not possible"):
        build_model("play").simulate(Sine(), TIMES, substep_s=0.0)
    with pytest.raises(ModelError, match="steps"):
        build_model("play", (), {"k": 1e18}).simulate(Sine(), np.arange(1001) * 1.0)


class Hole:
    """A motion of somebody else's that has a hole."""

    def position(self, t: np.ndarray) -> np.ndarray:
        return np.where(t > 0.1, np.nan, t)

    def velocity(self, t: np.ndarray) -> np.ndarray:
        return np.ones_like(t)

    def acceleration(self, t: np.ndarray) -> np.ndarray:
        return np.zeros_like(t)


def test_motion_with_a_hole() -> None:
    """A motion that gives NaN is refused."""
    with pytest.raises(ModelError, match="finite"):
        build_model("play").simulate(Hole(), TIMES)
