"""What can be calculated by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.model import HandWaved, Sampled, Sine, Step, build_model
from lostmotion.model.solve import integrate

TIMES = np.arange(2001) * 1e-3


def test_free_ring_down() -> None:
    """A deflected oscillator rings down as exp(-zeta w t) cos(w_d t + phase), to 1e-5 over 116 periods."""
    model = build_model("oscillator")
    m, b, k = (model.parameters[name].value for name in "mbk")
    w, zeta = math.sqrt(k / m), b / (2 * math.sqrt(k * m))
    w_d = w * math.sqrt(1 - zeta**2)
    exact = 1e-3 * np.exp(-zeta * w * TIMES) * (np.cos(w_d * TIMES) + zeta * w / w_d * np.sin(w_d * TIMES))
    ring = model.simulate(None, TIMES, model.initial_state(q=1e-3))
    assert np.max(np.abs(ring["displacement"] - exact)) < 1e-5 * 1e-3
    assert ring["accel"][0] == pytest.approx(-k / m * 1e-3)


def test_driven_steady_state() -> None:
    """Driven at 50 Hz the oscillator settles to the amplitude and phase of its transfer function."""
    model = build_model("oscillator")
    m, b, k = (model.parameters[name].value for name in "mbk")
    w = 2 * math.pi * 50
    settled = model.simulate(Sine(50.0, 1.0), np.arange(6000) * 1e-3)
    response = 1 / (k - m * w**2 + 1j * w * b)
    late = settled.time > 5.0
    exact = (response * np.exp(1j * w * settled.time)).imag
    assert np.max(np.abs(settled["displacement"] - exact)[late]) < 1e-4 * abs(response)


def test_bar_on_a_rigid_joint() -> None:
    """Without play the bar under a sine of 6 Hz settles to eq. 7's own steady state."""
    model = build_model("play", (), {"d": 1e-7, "b": 3.0})
    m, b, k, l = (model.parameters[name].value for name in "mbkl")  # noqa: E741
    w, motion = 2 * math.pi * 6, Sine(6.0, 0.02)
    settled = model.simulate(motion, TIMES)
    foot = w**2 * 0.02 * l  # amplitude of -omega_2' l
    response = foot * m / (k - m * w**2 + 1j * w * b)
    late = settled.time > 1.0
    exact = (response * np.exp(1j * w * settled.time)).imag
    assert np.max(np.abs(settled["displacement"] - exact)[late]) < 0.03 * abs(response)


def test_constant_torque() -> None:
    """A constant torque turns a joint by tau t²/(2 J), exactly: RK4 integrates parabolas."""
    model = build_model("joint", (), {"J": 1e-3, "bias": 2e-3})
    turned = model.simulate(None, TIMES)["position"]
    assert np.allclose(turned, TIMES**2, rtol=0, atol=1e-12)


def test_pendulum_period() -> None:
    """Gravity makes a joint swing; for a small angle with the period 2 pi sqrt(J/tau_g)."""
    model = build_model("joint", ["gravity_torque"])
    period = 2 * math.pi * math.sqrt(model.parameters["J"].value / model.parameters["gravity_torque.tau_g"].value)
    after = model.simulate(None, [0.0, period / 2, period], [1e-3, 0.0])["position"]
    assert after == pytest.approx([1e-3, -1e-3, 1e-3], abs=1e-8)


def test_servo_reaches_its_command_or_is_let_go() -> None:
    """A servo without load ends at its command; let go it keeps its speed."""
    servo = build_model("servo")
    assert servo.simulate(Step(0.2, 0.1, 0.0), np.arange(300) * 0.01)["position"][-1] == pytest.approx(0.2, abs=1e-6)
    assert servo.simulate(None, TIMES, [0.0, 1.5])["position"][-1] == pytest.approx(3.0)


def test_friction_behind_a_play() -> None:
    """A heavy joint at 1 rad/s crosses half of a play of 0.1 rad in 50 ms, then the friction builds up with a time
    constant of 20 ms; after a reversal it falls over 20 ms, is zero for 100 ms, and builds up with the other sign."""
    given = {
        "J": 1e3,
        "friction_behind_play.tau_p": 2.0,
        "friction_behind_play.e": 0.1,
        "friction_behind_play.c": 0.2,
    }
    joint = build_model("joint", ["friction_behind_play"], given)
    times = np.arange(0.0, 0.3, 0.005)

    def share(speed: float, place: float) -> np.ndarray:
        run = joint.simulate(None, times, [0.0, speed, place])
        return np.asarray(run["acceleration"] * 1e3 / 2.0)

    onward = 1 - np.exp(-np.maximum(times - 0.05, 0.0) / 0.02)
    assert share(1.0, 0.0) == pytest.approx(-onward, abs=5e-3)
    left = np.clip((0.02 - times) / 0.02, 0.0, 1.0) - (1 - np.exp(-np.maximum(times - 0.12, 0.0) / 0.02))
    assert share(-1.0, 0.07) == pytest.approx(-left, abs=5e-3)


def test_a_limited_servo_moves_at_the_limit() -> None:
    """A goal 1 rad away is approached at the limit of 0.5 rad/s for two seconds, at a distance of v (kt/U)/(kp e); a
    goal that moves more slowly is followed as without the limit."""
    servo = build_model("servo", ["velocity_limit"], {"velocity_limit.omega_max": 0.5})
    times = np.arange(0.0, 4.0, 0.01)
    start = [0.0, 0.0, 0.0]
    run = servo.simulate(Sampled([0.0, 4.0], [1.0, 1.0]), times, start)
    behind = 0.5 * 1.2 / 12.0 / (32.0 * 0.165)
    assert run["velocity"][100] == pytest.approx(0.5, rel=1e-3)
    assert run["position"][150] == pytest.approx(0.75 - behind, abs=1e-3)
    assert run["position"][-1] == pytest.approx(1.0, abs=1e-3)
    slow = Sampled([0.0, 4.0], [0.0, 1.0])
    bare = build_model("servo").simulate(slow, times, start[:2])["position"]
    assert servo.simulate(slow, times, start)["position"] == pytest.approx(bare, abs=5e-4)


def test_capped_servo_speed() -> None:
    """Far from its command the servo runs at its no-load speed, cap U / kt."""
    servo = build_model("servo", (), {"cap": 0.5})
    speed = servo.simulate(Sampled([0, 10], [100.0, 100.0]), TIMES, [0.0, 0.0])["velocity"][-1]
    assert speed == pytest.approx(0.5 * 12.0 / 1.2, rel=1e-3)


@pytest.mark.parametrize("play", [1e-5, 1e-6, 1e-7])
def test_without_play_output_is_input(play: float) -> None:
    """As d goes to 0 the output angle becomes the input angle, to within the play; the sub-step copes by itself."""
    motion = HandWaved(seed=1)
    model = build_model("play", (), {"d": play})
    trajectory = model.simulate(motion, TIMES)
    lost = np.max(np.abs(trajectory["position"] - motion.position(TIMES)))
    assert lost < 1.5 * play / model.parameters["R2"].value
    assert trajectory.substep_s > 3e-6


def test_fourth_order() -> None:
    """Halving the step divides the error by about 16, with impacts in the record."""
    model, motion = build_model("play"), HandWaved(seed=0)
    exact = model.simulate(motion, TIMES, substep_s=7.8125e-6)
    assert np.max(np.abs(exact["gap"])) > 0.5 * model.parameters["d"].value / 2
    for name in ("position", "accel", "displacement"):
        errors = [
            np.sqrt(np.mean((model.simulate(motion, TIMES, substep_s=h)[name] - exact[name]) ** 2))
            for h in (2.5e-4, 1.25e-4, 6.25e-5)
        ]
        orders = np.log2(np.divide(errors[:-1], errors[1:]))
        assert np.all((orders > 3.6) & (orders < 4.4)), (name, orders)


def test_output_between_the_steps_is_as_good() -> None:
    """Outputs at uneven times, between the steps, have errors of the same order as those on the steps."""
    model, motion = build_model("play"), HandWaved(seed=0)
    uneven = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 400))
    uneven[0] = 0.0
    exact = model.simulate(motion, uneven, substep_s=1e-5)
    found = model.simulate(motion, uneven, substep_s=1e-4)
    scale = np.sqrt(np.mean(exact["accel"] ** 2))
    assert np.max(np.abs(found["accel"] - exact["accel"])) < 1e-3 * scale


def test_result_is_smooth_in_the_parameters() -> None:
    """Central differences of two widths agree to 1e-4: the fixed step makes a usable Jacobian."""
    model, motion, times = build_model("play"), HandWaved(seed=0), np.arange(301) * 1e-3

    def slope(width: float) -> np.ndarray:
        ahead, behind = (
            model.replace({"alpha": 4000 * (1 + sign * width)}).simulate(motion, times, substep_s=1e-4)["accel"]
            for sign in (1, -1)
        )
        return (ahead - behind) / (2 * width)

    wide, narrow = slope(1e-4), slope(1e-6)
    assert np.max(np.abs(wide - narrow)) < 1e-4 * np.max(np.abs(wide))


def test_solver_knows_no_physics() -> None:
    """The solver's compiled code is one and the same whatever the base and the effects."""
    for base, effects in (("play", ["coulomb_friction", "sensor_lag"]), ("joint", []), ("servo", ["actuator_lag"])):
        build_model(base, effects).simulate(Sine(), TIMES[:10])
    assert len(integrate.signatures) == 1
