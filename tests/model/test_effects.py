"""The catalogue, effects of one's own, and the two effects on time."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from lostmotion.model import HandWaved, ModelError, Parameter, Sampled, build_model, catalogue
from lostmotion.model.base import Term
from lostmotion.model.effects import ActsOn, Effect, register, registry
from lostmotion.model.kernel import Slots, kernel, python_kernel
from lostmotion.model.signals import OMEGA2, TORQUE

TIMES = np.arange(401) * 1e-3
MOTION = HandWaved(seed=5, high_hz=6.0)
IDS = {
    *("viscous_friction", "coulomb_friction", "stribeck_friction", "load_dependent_friction", "gravity_torque"),
    *("constant_torque", "velocity_limit", "friction_behind_play"),
    *("gear_eccentricity", "shaft_compliance", "actuator_lag", "command_delay", "finite_actuator"),
    *("contact_asymmetry", "torque_ripple", "spring_torque", "hardening_spring", "quadratic_damping", "second_mode"),
    *(
        "presliding_friction",
        "gravity_leakage",
        "centripetal_crosstalk",
        "sensor_lag",
        "sensor_saturation",
        "clock_skew",
        "bias_drift",
    ),
}


@python_kernel
def slow(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """-b omega, in Python."""
    return -p[0] * s[OMEGA2]


@python_kernel
def broken(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """Fails."""
    raise ZeroDivisionError("oops")


@kernel
def remembering(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """A Maxwell damper: its own state follows omega, the torque is in proportion to the difference."""
    dx[0] = (s[OMEGA2] - x[0]) / p[1]
    return -p[0] * (s[OMEGA2] - x[0])


def effect(name: str, function: object, parameters: dict[str, float], states: int = 0) -> Effect:
    """An effect on the joint as a stranger would write it."""
    return Effect(
        id=name,
        equation="see the test",
        summary="an effect of somebody else's",
        acts_on=ActsOn.JOINT,
        bases=("play", "joint"),
        parameters={key: Parameter(value, source="test", meaning="test") for key, value in parameters.items()},
        terms={base: (Term(TORQUE, function, tuple(parameters)),) for base in ("play", "joint")},  # type: ignore[arg-type]
        states=(None,) * states,
    )


@pytest.fixture
def own_effects() -> Iterator[None]:
    """Three effects of one's own for the time of a test."""
    for one in (
        effect("slow_damping", slow, {"b": 4e-4}),
        effect("broken_effect", broken, {"b": 4e-4}),
        effect("maxwell", remembering, {"b": 4e-4, "T": 0.02}, 1),
    ):
        register(one)
    yield
    for name in ("slow_damping", "broken_effect", "maxwell"):
        del registry._EFFECTS[name]


def test_catalogue() -> None:
    """The catalogue holds the ids that users know, each explained."""
    assert {effect.id for effect in catalogue()} == IDS
    for info in catalogue():
        assert info.equation
        assert info.summary
        assert info.parameters
        assert set(info.bases) <= {"play", "oscillator", "joint", "servo"}
        assert info.acts_on in set(ActsOn)


@pytest.mark.usefixtures("own_effects")
def test_pure_python_effect() -> None:
    """A term in plain Python, called by address through ctypes, gives what the compiled one gives."""
    compiled = build_model("play", ["viscous_friction"], {"viscous_friction.b_v": 4e-4})
    python = build_model("play", ["slow_damping"])
    one, other = (model.simulate(MOTION, TIMES[:51], substep_s=2.5e-4) for model in (compiled, python))
    assert other["accel"] == pytest.approx(one["accel"], rel=1e-12)


@pytest.mark.usefixtures("own_effects")
def test_error_in_a_python_effect_comes_out() -> None:
    """What a Python term raises is not swallowed by the machine code around it."""
    with pytest.raises(ModelError, match=r"broken_effect.*oops"):
        build_model("play", ["broken_effect"]).simulate(MOTION, TIMES[:11])
    build_model("play").simulate(MOTION, TIMES[:11])


@pytest.mark.usefixtures("own_effects")
def test_own_effect_with_a_memory() -> None:
    """An own effect with a state: a joint coasting against it slows as the closed form of both says."""
    model = build_model("joint", ["maxwell"])
    inertia, b, T = 2e-4, 4e-4, 0.02
    coasting = model.simulate(None, TIMES, [0.0, 1.0, 0.0], substep_s=1e-4)
    rate = b / inertia + 1 / T
    exact = 1 - b / inertia * (1 - np.exp(-rate * TIMES)) / rate
    assert coasting["velocity"] == pytest.approx(exact, abs=1e-9)
    assert model.state_names == ("theta_2", "omega_2", "maxwell.0")
    with pytest.raises(ModelError, match="already"):
        register(effect("maxwell", remembering, {"b": 1.0}))


def test_command_delay() -> None:
    """A delayed command gives the same motion later; the command that is shown is the one that was sent."""
    plain = build_model("play").simulate(MOTION, TIMES - 0.03, substep_s=1e-4)
    delayed = build_model("play", ["command_delay"], {"command_delay.T": 0.03}).simulate(MOTION, TIMES, substep_s=1e-4)
    assert delayed["accel"] == pytest.approx(plain["accel"], abs=1e-6)
    assert delayed["command"] == pytest.approx(MOTION.position(TIMES), abs=1e-12)


@pytest.mark.parametrize("delay", [0.008, 0.016])
def test_a_motion_is_continuous_in_the_delay(delay: float) -> None:
    """Also where it is a whole number of integration steps: there differences over 10 ns give the same
    derivative on both sides as those over 10 us, to 3 %.  With equal steps in each interval it was up to six times as
    large."""
    times = np.arange(0.0, 1.001, 0.02)
    command = Sampled(times, 0.2 * np.sin(7 * times))
    model = build_model("servo", ["command_delay"])

    def at(T: float) -> NDArray[np.float64]:
        delayed = model.replace({"command_delay.T": T})
        return delayed.simulate(command, times, [0.3, 2.0], substep_s=8e-3)["position"]

    here = at(delay)
    slopes = [np.linalg.norm(at(delay + step) - here) / abs(step) for step in (1e-8, -1e-8, 1e-5, -1e-5)]
    assert slopes == pytest.approx([slopes[2]] * 4, rel=0.03)


@pytest.mark.parametrize("skew", [0.02, -0.02])
def test_clock_skew(skew: float) -> None:
    """A sensor clock at rate 1 + s stamps t what was felt at t/(1 + s); the joint's own signals keep their times."""
    model = build_model("play")
    skewed = model.with_effect("clock_skew").replace({"clock_skew.s": skew}).simulate(MOTION, TIMES, substep_s=1e-4)
    plain = model.simulate(MOTION, TIMES, substep_s=1e-4)
    at_felt = model.simulate(MOTION, TIMES / (1 + skew), substep_s=1e-4)
    assert np.max(np.abs(skewed["accel"] - at_felt["accel"])) < 1e-3 * np.max(np.abs(plain["accel"]))
    assert np.max(np.abs(skewed["position"] - plain["position"])) < 1e-6
    assert skewed.state == pytest.approx(plain.state, abs=1e-3)


def test_lags_begin_settled() -> None:
    """A run that starts in motion has no transient from its filters: they begin where their input stands."""
    lagging = build_model("play", ["actuator_lag", "sensor_lag"], {"d": 1e-6, "b": 20.0})
    start = lagging.initial_state(MOTION, 1.0)
    assert start[4] == pytest.approx(MOTION.position(np.array(1.0)))
    resting = build_model("play", ["sensor_lag", "bias_drift"], {"bias": 0.3, "bias_drift.c": 0.0})
    assert resting.simulate(None, TIMES)["accel"] == pytest.approx(0.3)


def test_let_go_servo_feels_no_motor() -> None:
    """Without a drive the servo swings as a joint with the same effects."""
    names = ["gravity_torque", "viscous_friction"]
    values = {"gravity_torque.tau_g": 0.4, "viscous_friction.b_v": 0.01, "J": 0.02}
    swings = [build_model(b, names, values).simulate(None, TIMES, [0.5, 0.0])["position"] for b in ("servo", "joint")]
    assert swings[0] == pytest.approx(swings[1], abs=1e-7)


def test_samples_at_uneven_times() -> None:
    """A recording with jitter drives as well as an even one."""
    jitter = np.sort(np.concatenate(([0.0, 0.4], np.random.default_rng(0).uniform(0, 0.4, 800))))
    exact, found = (
        build_model("play").simulate(drive, TIMES, substep_s=1e-4)
        for drive in (MOTION, Sampled(jitter, MOTION.position(jitter)))
    )
    assert np.max(np.abs(found["position"] - exact["position"])) < 1e-5
