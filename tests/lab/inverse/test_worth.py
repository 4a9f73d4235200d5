"""What is worth a name, and what a user is told of a torque with the other sign: joints by closed forms of prescribed
motions, written apart from the simulator."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab import policy
from tests.lab.inverse.test_inverse import explained

BARE = 'base = "joint"\n'
INERTIA, VISCOUS, COULOMB, WEIGHT = 0.05, 0.22, 0.3, 11.0


def slow(
    seed: int, weight: float = 0.0, ripple: float = 0.0, noise: float = 0.01, sign: float = 1.0, length: float = 60.0
) -> Recording:
    """A joint led along sines of some ten seconds, 50 samples a second; its dry friction changes sign at
    once.  ripple: seven a turn [N m]; sign: of the torque that is written down."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, length, 0.02)
    rates = 2 * math.pi * np.array([0.1, 0.17])
    angle, speed, acceleration = (
        sum(0.6 * rate**order * np.sin(rate * time + order * math.pi / 2) for rate in rates) for order in (0, 1, 2)
    )
    torque = INERTIA * acceleration + VISCOUS * speed + COULOMB * np.sign(speed)
    torque += weight * np.sin(angle + 0.4) + ripple * np.sin(7 * angle)
    columns = {
        "position": angle + 2e-5 * rng.standard_normal(time.size),
        "torque": sign * (torque + noise * rng.standard_normal(time.size)),
    }
    return Recording(time, columns, {}, {}, 0, f"slow{seed}.csv")


@pytest.mark.slow
def test_friction_near_rest_is_no_larger_than_the_motion_can_show(tmp_path: Path) -> None:
    """Dry friction that changes sign faster than a model's is no Stribeck friction at speeds that count as rest."""
    answer = explained(tmp_path, BARE, [slow(1, noise=0.003)])
    assert answer["missing"] == ["coulomb_friction", "viscous_friction"]
    assert answer["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(COULOMB, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("least", [policy.LEAST_SHARE, 0.0])
def test_a_ripple_of_a_thousandth_is_not_worth_a_name(
    least: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside a weight of 11 N m a ripple of 10 mN m is told by three thousand samples, and is not what is missing."""
    monkeypatch.setattr(policy, "LEAST_SHARE", least)
    answer = explained(tmp_path, BARE, [slow(2, WEIGHT, 0.01, 0.003)])
    assert {"gravity_torque", "viscous_friction", "coulomb_friction"} <= set(answer["missing"])
    assert ("torque_ripple" in answer["missing"]) == (least == 0.0)


@pytest.mark.slow
def test_dry_friction_beside_a_back_emf_is_worth_a_name(tmp_path: Path) -> None:
    """Dry friction of 2 % of the voltage takes 5e-5 of the error of a model without the back EMF, as this takes most of
    it, but more than half of what is left."""
    time, rng = np.arange(0.0, 20.0, 0.002), np.random.default_rng(7)
    rate = 2 * math.pi * 1.4
    speed, acceleration = 110 * np.sin(rate * time), 110 * rate * np.cos(rate * time)
    voltage = 1.05e-4 * acceleration + 0.0189 * speed + 0.04 * np.sign(speed) + 0.01 * rng.standard_normal(time.size)
    columns = {"position": -110 / rate * np.cos(rate * time) + 2e-4 * rng.standard_normal(time.size), "torque": voltage}
    answer = explained(tmp_path, BARE, [Recording(time, columns, {}, {}, 0, "motor.csv")])
    assert answer["missing"] == ["viscous_friction", "coulomb_friction"]
    assert answer["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(0.04, rel=0.05)


@pytest.mark.slow
def test_a_motor_that_cogs_under_speed_control_is_not_turned_round(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The controller's torque falls where the speed rises, as if friction drove; yet it feeds the motor."""
    step, many = 1e-4, 80_000
    inertia, angle, speed, whole = 1.3e-4, 0.0, 5.3, 0.0
    torque, place = np.empty(many), np.empty(many)
    for k in range(many):
        whole += 2.0 * (5.3 - speed) * step
        torque[k], place[k] = 0.09 + 0.02 * (5.3 - speed) + whole, angle
        speed += step * (torque[k] - 0.09 - 0.18 * math.sin(72 * angle)) / inertia
        angle += step * speed
    rng, kept = np.random.default_rng(3), slice(20_000, None, 10)
    noise = rng.standard_normal((2, torque[kept].size))
    columns = {"position": place[kept] + 2e-5 * noise[0], "torque": torque[kept] + 5e-3 * noise[1]}
    answer = explained(tmp_path, BARE, [Recording(np.arange(noise[0].size) * 1e-3, columns, {}, {}, 0, "cogs.csv")])
    assert answer["missing"] == ["torque_ripple"]
    assert "counted against the angle" not in caplog.text
    assert answer["parameters"]["J"][0] > inertia / 2


@pytest.mark.slow
def test_a_torque_with_the_other_sign_is_turned_round(tmp_path: Path) -> None:
    """An inertia is positive and friction takes energy; a torque that says otherwise is counted against the angle."""
    answers = [explained(tmp_path, BARE, [slow(3, sign=sign, length=30.0)]) for sign in (1.0, -1.0)]
    assert answers[0]["missing"] == answers[1]["missing"] != []
    for name, (value, _, _) in answers[0]["parameters"].items():
        assert answers[1]["parameters"][name][0] == pytest.approx(value, rel=1e-3), name


def damper(frequency_hz: float, stiffness: float, sign: float) -> Recording:
    """A damper on a test bench [m, N]: a sine, with viscous and dry friction and the spring of its gas."""
    times, at = np.arange(0.0, 12.0, 1 / 300), 2 * np.pi * frequency_hz
    place, speed = 0.016 * np.sin(at * times), 0.016 * at * np.cos(at * times)
    force = 40.0 + stiffness * place + 950.0 * speed + 20.0 * np.sign(speed)
    noise = np.random.default_rng(int(10 * frequency_hz)).normal(size=times.size)
    columns = {"displacement": place, "force": sign * (force + noise)}
    return Recording(times, columns, {"displacement_unit": "m"}, name=f"damper{frequency_hz}.csv")


@pytest.mark.slow
def test_a_gas_spring_does_not_hide_that_a_force_is_counted_the_other_way(tmp_path: Path) -> None:
    """Of another pressure in each recording it looks like an inertia, which then is surely positive."""
    runs = [damper(hz, stiffness, -1.0) for hz, stiffness in ((0.5, 350.0), (2.4, 800.0), (2.9, 1100.0))]
    answer = explained(tmp_path, 'base = "joint"\n', runs)
    assert {"viscous_friction", "coulomb_friction"} <= set(answer["missing"])
    assert answer["parameters"]["viscous_friction.b_v"][0] == pytest.approx(950.0, rel=0.03)
