"""The hidden-effect bench: its simulator against the model, its cases on disk, its scoring, its run as a whole."""

from __future__ import annotations

import ast
import json
import math
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.hidden_effects import physics
from bench.hidden_effects.__main__ import main
from bench.hidden_effects.cases import DURATION, LEAD, RATE_HZ, draw_case, read_sensor, write_case
from bench.hidden_effects.catalogue import INSIDE
from bench.hidden_effects.motion import hand_waved
from bench.hidden_effects.mujoco_joint import write_joint
from bench.hidden_effects.physics import Command, follow, simulate
from bench.hidden_effects.scoring import score
from bench.hidden_effects.totals import Rate
from scipy.optimize import least_squares

from lostmotion.model import Sampled, build_model, catalogue

BASE = {name: value for name, value in physics.NEUTRAL.items() if "." not in name}
LEAST_NOISE = 0.05
HIDDEN: dict[str, dict[str, float]] = {
    "viscous_friction": {"b_v": 5e-4},
    "coulomb_friction": {"tau_c": 3e-4, "omega_0": 1e-2},
    "stribeck_friction": {"tau_c": 2e-4, "tau_s": 5e-4, "omega_s": 0.3, "omega_0": 1e-2},
    "load_dependent_friction": {"mu": 0.1, "omega_0": 1e-2},
    "gravity_torque": {"tau_g": 1e-3, "phi": 0.4},
    "gear_eccentricity": {"e": 1e-5, "N": 17.0, "phi": 0.7},
    "shaft_compliance": {"share": 0.7, "k_s": 60.0, "c_s": 8e-3},
    "actuator_lag": {"T": 4e-3},
    "command_delay": {"T": 5e-3},
    "finite_actuator": {"J1": 1e-3, "f1": 25.0, "zeta1": 0.7},
    "contact_asymmetry": {"ratio": 4.0},
    "hardening_spring": {"k3": 5e9},
    "quadratic_damping": {"b2": 2.0},
    "second_mode": {"f2": 190.0, "zeta2": 0.02, "participation": 0.3},
    "gravity_leakage": {"c": 0.1, "phi": 0.3},
    "centripetal_crosstalk": {"c": 8.0},
    "sensor_lag": {"T": 1.5e-3},
}
"""All that is in the equations of motion; what the sensor adds to a reading is tested through the cases."""


@pytest.fixture(scope="module")
def command() -> Command:
    """One motion for all."""
    return hand_waved(np.random.default_rng(7), 1.0)


def accel(values: dict[str, float], command: Command, duration: float, **tolerance: float) -> np.ndarray:
    """What the bench's accelerometer feels."""
    times = np.arange(round(duration * RATE_HZ)) / RATE_HZ
    return simulate(values, command, times, follow(values, command, 0.0), **tolerance)[0]


def test_nothing_of_ours_is_imported() -> None:
    """The bench shares no line with what it judges: no file of it imports lostmotion."""
    for path in Path(physics.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.startswith("lostmotion") for name in names), path


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["", *HIDDEN])
def test_agrees_with_the_model(command: Command, effect: str) -> None:
    """Two derivations of the same equations differ by far less than the least noise, with and without each effect."""
    hidden = {f"{effect}.{name}": value for name, value in HIDDEN.get(effect, {}).items()}
    knots = command.start + command.step * np.arange(len(command.coefficients))
    drive = Sampled(knots, command.at(knots))
    times = np.arange(round(0.5 * RATE_HZ)) / RATE_HZ
    model = build_model("play", (effect,) if effect else (), {**BASE, **hidden})
    ours = model.simulate(drive, times, substep_s=2e-5)["accel"]
    other = accel({**BASE, **hidden}, command, 0.5)
    assert np.sqrt(np.mean((ours - other) ** 2)) < LEAST_NOISE / 10
    if effect:
        assert np.sqrt(np.mean((accel(BASE, command, 0.5) - other) ** 2)) > LEAST_NOISE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "values"),
    [("sensor_saturation", {"a_max": 10.0}), ("clock_skew", {"s": 2e-3}), ("bias_drift", {"c": 0.3})],
)
def test_sensor_agrees_with_the_model(effect: str, values: dict[str, float]) -> None:
    """What the sensor does to a recording that starts in motion is what the model says, counted from its start."""
    motion = hand_waved(np.random.default_rng(5), 1.5)
    hidden = BASE | {f"{effect}.{name}": value for name, value in values.items()}
    times = np.arange(800) / RATE_HZ
    _, states = simulate(hidden, motion, np.array([0.0, LEAD]), follow(hidden, motion, 0.0))
    knots = motion.start + motion.step * np.arange(len(motion.coefficients))
    drive = Sampled(knots - LEAD, motion.at(knots))
    ours = build_model("play", (effect,), hidden).simulate(drive, times, states[-1, :4], substep_s=2e-5)["accel"]
    other = read_sensor(hidden, motion, LEAD + times)
    assert np.sqrt(np.mean((ours - other) ** 2)) < LEAST_NOISE / 10
    assert np.sqrt(np.mean((read_sensor(BASE, motion, LEAD + times) - other) ** 2)) > LEAST_NOISE


def test_every_effect_of_the_catalogue_on_play_is_hidden_somewhere() -> None:
    """The bench draws from all effects that the catalogue has on the base play, but for torque_ripple."""
    assert set(INSIDE) == {e.id for e in catalogue() if "play" in e.bases} - {"torque_ripple"}


@pytest.mark.parametrize("effect", ["", "coulomb_friction", "shaft_compliance"])
def test_integration_is_exact_enough(command: Command, effect: str) -> None:
    """A tolerance a thousand times tighter moves no sample by as much as a tenth of the least noise."""
    values = BASE | {f"{effect}.{name}": value for name, value in HIDDEN.get(effect, {}).items()}
    assert np.max(np.abs(accel(values, command, 1.0) - accel(values, command, 1.0, rtol=1e-12))) < LEAST_NOISE / 10


@pytest.mark.slow
def test_case_on_disk(tmp_path: Path) -> None:
    """A case is a rough model within what is promised, three recordings of 4 s at 800 Hz and the truth."""
    write_case(draw_case("nothing", 1, 3), tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text())
    model = tomllib.loads((tmp_path / "model.toml").read_text())
    assert model["base"] == "play"
    assert "effects" not in model
    off = {name: given["value"] / truth["parameters"][name] for name, given in model["parameters"].items()}
    limits = {"d": 0.3, "k": 0.103, "l": 0.05, "alpha": 0.5, "b": 0.5}
    assert set(off) == set(limits)
    assert all(abs(ratio - 1) <= limits[name] + 1e-5 for name, ratio in off.items())
    commands = []
    for i in (1, 2, 3):
        table = np.genfromtxt(tmp_path / f"rec{i}.csv", delimiter=",", names=True)
        assert len(table) == DURATION * RATE_HZ
        np.testing.assert_allclose(
            table["accel"] / truth["count"], np.round(table["accel"] / truth["count"]), atol=1e-2
        )
        commands.append(table["command"])
    assert np.max(np.abs(commands[0] - commands[1])) > 0.05


def document(**changed: Any) -> dict[str, Any]:
    """An answer that names coulomb_friction."""
    ranked = {"effect": "coulomb_friction", "rms_before": 4.0, "rms_after": 0.2, "p_value": 1e-9,
              "parameters": {"tau_c": [3e-4, 2.9e-4, 3.1e-4], "omega_0": [0.01, 0.01, 0.01]}}  # fmt: skip
    answer = {"verdict": "missing", "missing": ["coulomb_friction"], "confusable": [], "ranking": [ranked],
              "error": {"before": 4.0, "after": 0.2, "noise": 0.2, "unit": "m/s^2"}, "residual": None, "advice": "",
              "parameters": {"d": [8e-5, 7.9e-5, 8.1e-5]}}  # fmt: skip
    return answer | changed


def truth(kind: str, *effects: str, **parameters: float) -> dict[str, Any]:
    """What was hidden, with a noise of 0.2 m/s²."""
    return {"kind": kind, "effects": list(effects), "parameters": parameters, "noise": [0.2, 0.2, 0.2]}


def test_right_answer_and_its_intervals() -> None:
    """The right effect at the noise floor; an interval that misses the truth is counted, a fixed parameter is not."""
    true = truth(
        "strong", "coulomb_friction", d=8.2e-5, **{"coulomb_friction.tau_c": 3e-4, "coulomb_friction.omega_0": 5e-3}
    )
    judged = score("x", true, document(), 3.0, "")
    assert (judged.strict, judged.lenient, judged.error_ok) == (True, True, True)
    assert judged.inside == {"d": False, "coulomb_friction.tau_c": True}


def test_error_must_reach_the_true_noise_too() -> None:
    """An answer that takes its own misfit for noise is right in name but not in error."""
    error = {"before": 4.0, "after": 0.3, "noise": 0.3, "unit": "m/s^2"}
    assert score("x", truth("strong", "coulomb_friction"), document(error=error), 3.0, "").error_ok is False


def test_confusable_counts_only_as_lenient() -> None:
    """A truth that stands in the named effect's group is not right, yet not all wrong; in another group it is wrong."""
    true = truth("strong", "stribeck_friction")
    alike = document(confusable=[["coulomb_friction", "stribeck_friction"]])
    apart = document(confusable=[["actuator_lag", "stribeck_friction"]])
    assert [score("x", true, told, 1.0, "").lenient for told in (alike, apart, document())] == [True, False, False]
    assert not score("x", true, alike, 1.0, "").strict


def test_pair_needs_both() -> None:
    """One of two is not a pair; both in the other order are."""
    true = truth("pair", "sensor_lag", "coulomb_friction")
    assert not score("x", true, document(), 1.0, "").strict
    assert score("x", true, document(missing=["coulomb_friction", "sensor_lag"]), 1.0, "").strict


def test_nothing_and_outside() -> None:
    """An effect or an unknown structure on a clean recording are alarms; outside needs its verdict."""
    nothing = document(verdict="nothing_missing", missing=[], ranking=[])
    outside = document(verdict="outside_catalogue", missing=[], ranking=[])
    clean, hum = truth("nothing"), truth("outside", "hum")
    assert [score("x", clean, told, 1.0, "").strict for told in (nothing, outside, document())] == [True, False, False]
    assert [score("x", hum, told, 1.0, "").strict for told in (nothing, outside, document())] == [False, True, False]


def test_phase_may_stand_half_a_turn_off() -> None:
    """-0.1 g at phi + pi is the same leakage as 0.1 g at phi, and a phase a whole turn off is the same phase."""
    true = truth("strong", "gravity_leakage", **{"gravity_leakage.c": -0.1, "gravity_leakage.phi": 0.3})
    told = {
        "gravity_leakage.c": [0.1, 0.09, 0.11],
        "gravity_leakage.phi": [0.3 - math.pi, 0.2 - math.pi, 0.4 - math.pi],
    }
    judged = score("x", true, document(missing=["gravity_leakage"], ranking=[], parameters=told), 1.0, "")
    assert judged.inside == {"gravity_leakage.c": True, "gravity_leakage.phi": True}


def test_wilson() -> None:
    """Wilson's interval of 9 out of 10 is 0.596 to 0.982 (Newcombe 1998 gives the formula)."""
    assert Rate("x", 9, 10, "", bool).interval == pytest.approx((0.596, 0.982), abs=1e-3)


@pytest.mark.slow
def test_run_as_a_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Generates, asks a command that sees only model and recordings, scores it, and draws the confusions."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    told = document(verdict="nothing_missing", missing=[], ranking=[])
    fake = tmp_path / "fake.py"
    fake.write_text(
        "import json, sys\n"
        "assert sys.argv[1:] == ['model.toml', 'rec1.csv', 'rec2.csv', 'rec3.csv', '--json'], sys.argv\n"
        f"print({json.dumps(told)!r})\n"
    )
    call = ["run", "--kinds", "nothing", "--count", "1", "--command", f"{sys.executable} {fake}", "--json"]
    main([*call, "--figures", str(tmp_path)])
    answer = json.loads(capsys.readouterr().out)
    alarms = next(rate for rate in answer["rates"] if rate["what"].startswith("false alarm"))
    assert (alarms["hits"], alarms["of"], alarms["reached"]) == (0, 1, True)
    assert (tmp_path / "hidden_effects.png").stat().st_size > 10_000
    fake.write_text("import sys\nsys.exit('the answer is not at home')\n")
    main(call)
    answer = json.loads(capsys.readouterr().out)
    assert answer["cases"][0]["remark"] == "exit status 1: the answer is not at home"
    assert next(rate for rate in answer["rates"] if rate["what"] == "no answer")["hits"] == 1


def test_mujoco_moves_the_same_joint(tmp_path: Path) -> None:
    """The base joint with the truth's values, its start fitted, meets MuJoCo's angle to within the noise."""
    write_joint("gravity_torque", 3, tmp_path)
    true = json.loads((tmp_path / "truth.json").read_text())
    table = np.genfromtxt(tmp_path / "rec1.csv", delimiter=",", names=True)
    model = build_model("joint", true["effects"], true["parameters"])
    torque = Sampled(table["time"], table["torque"])

    def residual(start: np.ndarray) -> np.ndarray:
        return model.simulate(torque, table["time"], start)["position"] - table["position"]

    speed, angle = np.polyfit(table["time"][:40], table["position"][:40], 1)
    fit = least_squares(residual, [angle, speed])
    assert np.sqrt(np.mean(fit.fun**2)) < 1.05 * true["noise"][0]
