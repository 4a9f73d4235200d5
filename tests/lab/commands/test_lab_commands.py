"""Whole runs of the lab through the command line, on recordings of the bench's own simulator: what is hidden is named.

Everything that a user would see: files in, JSON or a table out, a model file that the next command reads.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench.hidden_effects.cases import read_sensor
from bench.hidden_effects.motion import hand_waved
from click.testing import CliRunner, Result

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from tests.lab.inverse.test_inverse import robot

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

BASE = {"d": 8e-5, "alpha": 5000.0, "l": 0.1, "b": 0.18, "k": 2600.0, "bias": 0.05}
ROUGH = 'base = "play"\n[parameters]\nd = 6.4e-5\nalpha = 4000.0\nb = 0.22\nk = 2500.0\nl = 0.097\n'
"""What a user would know: the play 20 % off, the frequency 2 %."""
NEAR = 'base = "play"\n[parameters]\nd = 7e-5\nalpha = 4500.0\nb = 0.2\nk = 2550.0\nl = 0.099\n'
LEAD, RATE_HZ = 0.5, 800
COUNT = 16 * 9.80665 / 32768
TIGHT_RAD = 0.1
HARDENING = {"hardening_spring.k3": 0.03 * 2600.0 / 0.25e-3**2}
FRICTION = {"coulomb_friction.tau_c": 1.5e-4, "coulomb_friction.omega_0": 1e-2}


def case(
    folder: Path,
    hidden: dict[str, float],
    noise: float,
    length: float,
    seed: int = 0,
    model: str = ROUGH,
    count: int = 3,
) -> Path:
    """Some recordings of gears in motion, with white noise and counts, and a rough model, in a folder."""
    rng = np.random.default_rng(seed)
    times = LEAD + np.arange(round(length * RATE_HZ)) / RATE_HZ
    for number in range(1, count + 1):
        command = hand_waved(rng, LEAD + length)
        accel = read_sensor({**BASE, **hidden}, command, times) + rng.normal(0, noise, times.size)
        columns = {"command": command.at(times), "accel": np.round(accel / COUNT) * COUNT}
        write_recording(Recording(times - LEAD, columns), folder / f"rec{number}.csv")
    (folder / "model.toml").write_text(model)
    return folder


def tight(seed: int) -> Recording:
    """A joint with viscous friction, and dry friction about one angle only, moved by five sines for twelve seconds."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 12.0, 0.01)
    waves = 2 * np.pi * rng.uniform(0.2, 1.5, (5, 1))
    phases = waves * times + rng.uniform(0, 2 * np.pi, (5, 1))
    angle, speed, acceleration = (
        0.25 * part.sum(axis=0) for part in (np.sin(phases), waves * np.cos(phases), -(waves**2) * np.sin(phases))
    )
    friction = 0.6 * np.exp(-(((angle - TIGHT_RAD) / 0.2) ** 2)) * np.tanh(speed / 0.01)
    torque = 0.05 * acceleration + 0.1 * speed + friction + rng.normal(0, 3e-3, times.size)
    return Recording(times, {"position": angle + rng.normal(0, 1e-5, times.size), "torque": torque})


def run(command: str, folder: Path, *options: object) -> Result:
    """`lostmotion lab COMMAND model.toml rec1.csv rec2.csv …` in a folder; it must succeed."""
    files = [folder / "model.toml", *sorted(folder.glob("rec*.csv"))]
    result = CliRunner().invoke(cli, ["lab", command, *map(str, files), *map(str, options)])
    assert result.exit_code == 0, result.stderr
    return result


def explained(folder: Path) -> dict[str, Any]:
    """What `lab explain --json` says with time enough; one document, nothing else on stdout."""
    return dict(json.loads(run("explain", folder, "--budget", "600s", "--json").stdout))


def test_hidden_friction(tmp_path: Path) -> None:
    """Coulomb friction that spoils the model twentyfold is named, with its size; the error falls to the noise."""
    found = explained(case(tmp_path, FRICTION, 0.2, 1.5, seed=4, model=NEAR, count=2))
    assert found["verdict"] == "missing"
    assert found["missing"] == ["coulomb_friction"]
    assert found["error"]["before"] > 10 * found["error"]["after"]
    assert found["error"]["after"] == pytest.approx(0.2, rel=0.15)
    assert found["ranking"][0]["effect"] == "coulomb_friction"
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(1.5e-4, rel=0.1)
    assert found["parameters"]["d"][0] == pytest.approx(BASE["d"], rel=0.02)


def test_hidden_hardening_spring(tmp_path: Path) -> None:
    """A spring that hardens so faintly that the error rises by 1 % only is named, significantly for all candidates."""
    found = explained(case(tmp_path, HARDENING, 0.3, 1.5, count=2))
    assert found["verdict"] == "missing"
    assert found["missing"] == ["hardening_spring"]
    assert found["effects"] == ["hardening_spring"]
    assert found["ranking"][0]["p_value"] < 0.05
    assert found["error"]["after"] < found["error"]["before"]
    assert found["error"]["after"] == pytest.approx(0.3, rel=0.1)
    value, low, high = found["parameters"]["hardening_spring.k3"]
    assert value == pytest.approx(HARDENING["hardening_spring.k3"], rel=0.5)
    assert low < value < high


def test_nothing_missing(tmp_path: Path) -> None:
    """The true base: nothing is added, and the sizes that would have been seen are told, as finite numbers."""
    found = explained(case(tmp_path, {}, 0.3, 1.5, count=2))
    assert found["verdict"] == "nothing_missing"
    assert found["missing"] == []
    assert found["effects"] == []
    assert found["residual"] is None
    assert found["error"]["before"] == found["error"]["after"] == pytest.approx(0.3, rel=0.1)
    assert found["parameters"]["d"][0] == pytest.approx(BASE["d"], rel=0.02)
    assert 0 < found["detectable"]["coulomb_friction"]["tau_c"] < 1e-4
    assert 0 < found["detectable"]["hardening_spring"]["k3"] < 1e11


def test_outside_of_the_catalogue(tmp_path: Path) -> None:
    """A joint that rubs more about one angle, which no effect describes: nothing is named, and what is left is a dry
    friction that follows the angle."""
    for number in (1, 2, 3):
        write_recording(tight(number), tmp_path / f"rec{number}.csv")
    (tmp_path / "model.toml").write_text('base = "joint"\neffects = ["viscous_friction", "coulomb_friction"]\n')
    found = explained(tmp_path)
    assert found["verdict"] == "outside_catalogue"
    assert found["missing"] == []
    assert found["error"]["after"] > 5 * found["error"]["noise"]
    assert (found["residual"]["acts_on"], found["residual"]["depends_on"]) == ("joint", ["theta_2", "omega_2"])
    assert "dry friction whose size follows the joint's angle" in found["residual"]["description"]
    curve = found["residual"]["curve"]
    assert curve["x"][int(np.argmax(curve["mean"]))] == pytest.approx(TIGHT_RAD, abs=0.15)


def test_improve_prints_the_ladder(tmp_path: Path) -> None:
    """The table's errors fall, rung by rung, and the file written has the effect and fits the data: of a joint, whose
    search takes seconds."""
    out = tmp_path / "better.toml"
    for number in (1, 2):
        write_recording(robot(number), tmp_path / f"rec{number}.csv")
    (tmp_path / "model.toml").write_text('base = "joint"\neffects = ["viscous_friction"]\n')
    result = run("improve", tmp_path, "-o", out)
    head, _, *rungs = result.stdout[result.stdout.index("effects ") :].splitlines()
    assert head.split() == ["effects", "error", "on", "unseen", "data", "[N", "m]", "noise", "[N", "m]"]
    before, after = ([*rung.replace(",", " ").split()] for rung in rungs[:2])
    assert before[:-2] == ["viscous_friction"]
    assert after[:-2] == ["viscous_friction", "coulomb_friction"], after
    error = float(after[-2])
    assert error < 0.2 * float(before[-2])
    assert "active effects: viscous_friction, coulomb_friction" in result.stdout
    assert 'effects = ["viscous_friction", "coulomb_friction"]' in out.read_text()
    compared = json.loads(
        CliRunner().invoke(cli, ["lab", "compare", str(out), str(tmp_path / "rec2.csv"), "--json"]).stdout
    )
    assert compared["columns"]["torque"]["rms"] == pytest.approx(error, rel=0.1)


def test_fit_writes_a_model(tmp_path: Path) -> None:
    """The fitted file holds the true play, and compare leaves only noise with it; the document tells the intervals."""
    folder = case(tmp_path, {}, 0.3, 1.0, count=2)
    out = tmp_path / "fitted.toml"
    document = json.loads(run("fit", folder, "-o", out, "--json").stdout)
    value, low, high = document["parameters"]["d"]
    assert value == pytest.approx(BASE["d"], rel=0.01)
    assert low < value < high
    assert document["complete"] is True
    assert document["rms"]["accel"] == pytest.approx(0.3, rel=0.1)
    assert document["error"] == document["columns"]["accel"]
    result = CliRunner().invoke(cli, ["lab", "compare", str(out), str(folder / "rec2.csv"), "--json"])
    assert result.exit_code == 0, result.stderr
    compared = json.loads(result.stdout)
    assert compared["columns"]["accel"]["rms"] == pytest.approx(0.3, rel=0.1)


def test_fit_and_compare_say_whether_only_noise_is_left(tmp_path: Path) -> None:
    """``complete``, ``error``, ``columns`` and ``scale`` mean what they mean in explain; a fit of a pendulum without
    its weight had ``complete`` true at 80 times the noise, and did not say that its inertia had been held."""
    time = np.arange(0, 4, 0.01)
    swing = 0.1 * np.cos(6 * time) + np.random.default_rng(5).normal(0, 1e-3, time.size)
    write_recording(Recording(time, {"position": swing}), tmp_path / "rec.csv")
    for effects, complete in (('"gravity_torque"', True), ("", False)):
        (tmp_path / "m.toml").write_text(
            f'base = "joint"\neffects = [{effects}]\n[parameters]\nJ.value = 2e-4\nJ.fixed = false\n'
        )
        arguments = [str(tmp_path / "m.toml"), str(tmp_path / "rec.csv"), "--json"]
        fit = CliRunner().invoke(cli, ["lab", "fit", *arguments, "-o", str(tmp_path / "out.toml")])
        document = json.loads(fit.stdout)
        assert (document["complete"], document["stopped_early"]) == (complete, False)
        assert document["scale"] == [{"parameter": "J", "value": 2e-4, "unit": "kg m^2"}]
        assert document["columns"] == {"position": document["error"]}
        assert document["error"]["unit"] == "rad"
        assert (document["error"]["after"] < 1.1e-3) is complete
        arguments[0] = str(tmp_path / "out.toml")
        compared = json.loads(CliRunner().invoke(cli, ["lab", "compare", *arguments]).stdout)
        assert (compared["error"]["after"] < 1.1e-3, compared["complete"]) == (complete, complete)


def test_a_model_of_which_all_is_known_has_an_error_and_no_intervals(tmp_path: Path) -> None:
    """A recorded torque and an inertia that is a little wrong."""
    time = np.arange(0, 4, 0.01)
    angle = 0.2 * np.cos(5 * time) + 0.1 * np.cos(11 * time)
    torque = -0.02 * (5 * np.cos(5 * time) + 12.1 * np.cos(11 * time))
    write_recording(Recording(time, {"position": angle, "torque": torque}), tmp_path / "rec1.csv")
    known = "J = { value = 0.021, fixed = true }\nbias = { value = 0.0, fixed = true }\n"
    (tmp_path / "model.toml").write_text(f'base = "joint"\n[parameters]\n{known}')
    document = json.loads(run("fit", tmp_path, "-o", tmp_path / "out.toml", "--json").stdout)
    assert document["parameters"] == {}
    assert document["error"]["after"] == pytest.approx(0.05 * np.std(torque), rel=0.1)
