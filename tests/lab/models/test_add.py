"""`lostmotion lab add`: the model file with one more effect, for a person to edit and for every command to read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from lostmotion.lab.commands.group import add
from lostmotion.lab.errors import EffectFileError, ModelFileError
from lostmotion.lab.models.modelfile import dumps, load, loads, save
from lostmotion.model import Sine, build_model
from lostmotion.model.effects import registry, unregister
from tests.conftest import ROOT

EXAMPLE = ROOT / "examples" / "tight_spot_effect.py"
TIMES = np.arange(301) * 1e-3


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder to work in, with the effect file of the documentation; its effects end with the test."""
    (tmp_path / "own.py").write_text(EXAMPLE.read_text())
    monkeypatch.chdir(tmp_path)
    before = set(registry._EFFECTS)
    yield tmp_path
    for name in set(registry._EFFECTS) - before:
        unregister(name)


def run(*args: object) -> Result:
    """`lostmotion lab add` with these arguments; errors are raised."""
    return CliRunner().invoke(add, [str(arg) for arg in args], catch_exceptions=False, standalone_mode=False)


def test_effect_of_the_catalogue(folder: Path) -> None:
    """The file lists the effect and its parameters as they are on this base; what was there stays as it was."""
    (folder / "m.toml").write_text('base = "servo"\n[parameters]\nkp = 12\n')
    assert run("m.toml", "coulomb_friction", "-o", "m2.toml").stdout == (
        "m2.toml: base servo, active effects: coulomb_friction\n"
        "added coulomb_friction on the joint: -tau_c sign(omega)\n"
        "  coulomb_friction.tau_c = 0.06 N m (0 to 20 N m): Coulomb friction\n"
        "  coulomb_friction.omega_0 = 0.002 rad/s (fixed): speed within which sign(omega) is smoothed\n"
    )
    assert (folder / "m2.toml").read_text() == (
        'base = "servo"\n'
        'effects = ["coulomb_friction"]\n'
        "\n"
        "[parameters]\n"
        "kp = { value = 12.0, fixed = true }\n"
        'coulomb_friction.tau_c = { value = 0.06, unit = "N m", low = 0.0, high = 20.0 }\n'
        'coulomb_friction.omega_0 = { value = 0.002, unit = "rad/s", low = 1e-05, high = 1.0, fixed = true }\n'
    )
    assert load("m2.toml").build().parameters["coulomb_friction.tau_c"].value == 0.06


def test_own_effect(folder: Path) -> None:
    """The model file names the effect's file relative to itself, and moves as the model with the effect does."""
    (folder / "models").mkdir()
    run("servo", "own.py:tight_spot", "-o", "models/m.toml")
    assert 'effects = ["../own.py:tight_spot"]' in (folder / "models" / "m.toml").read_text()
    moved = load("models/m.toml").build()
    expected = build_model("servo", ["tight_spot"]).simulate(Sine(), TIMES)["position"]
    np.testing.assert_array_equal(moved.simulate(Sine(), TIMES)["position"], expected)
    assert np.ptp(build_model("servo").simulate(Sine(), TIMES)["position"] - expected) > 1e-3


def test_own_effect_stays_when_the_model_is_written_elsewhere(folder: Path) -> None:
    """A model that was read, fitted and saved into another folder finds the effect's file from there."""
    run("play", "own.py:tight_spot", "-o", "m.toml")
    (folder / "fitted" / "today").mkdir(parents=True)
    save(load("m.toml"), "fitted/today/m.toml")
    unregister("tight_spot")
    assert load(folder / "fitted" / "today" / "m.toml").effects == ("tight_spot",)
    assert dumps(load("m.toml")).splitlines()[1] == 'effects = ["own.py:tight_spot"]'


def test_two_effects_one_after_the_other(folder: Path) -> None:
    """The active list grows in the order of adding, in the text, in the file and in the JSON."""
    run("joint", "gravity_torque", "-o", "m.toml")
    document = json.loads(run("m.toml", "own.py:tight_spot", "-o", "m.toml", "--json").stdout)
    assert document["effects"] == ["gravity_torque", "tight_spot"]
    assert document["added"] == "tight_spot"
    assert document["equation"] == "-tau_t sign(omega) exp(-((theta - where)/width)^2)"
    assert document["parameters"]["tight_spot.where"] == {
        "value": 0.0, "unit": "rad", "low": -1.0, "high": 1.0, "fixed": False, "meaning": "its middle"
    }  # fmt: skip
    assert document["note"] is None
    assert load("m.toml").effects == ("gravity_torque", "tight_spot")


def test_plain_python_is_told(folder: Path) -> None:
    """Why the effect runs slowly stands on stderr, and in the JSON."""
    text = (folder / "own.py").read_text().replace("return -tau_t", "return -{0: math.sqrt}[0](1.0) * tau_t")
    (folder / "own.py").write_text(text)
    result = run("play", "own.py:tight_spot", "-o", "m.toml", "--json")
    assert "tight_spot runs in plain Python" in result.stderr
    assert "numba cannot compile it" in json.loads(result.stdout)["note"]


@pytest.mark.parametrize(
    ("model", "effect", "message"),
    [
        ("play", "coulomb", "no effect is called 'coulomb'; did you mean coulomb_friction?"),
        ("play", "stribek_friction", "did you mean stribeck_friction?"),
        (
            "oscillator",
            "rust",
            "on oscillator there are coulomb_friction, hardening_spring, quadratic_damping",
        ),
        ("joint", "gear_eccentricity", "joint: gear_eccentricity does not act on the base 'joint', only on play"),
        ("oscillator", "own.py:tight_spot", "tight_spot does not act on the base 'oscillator', only on play, joint"),
        ("play", "tight_spot", "no effect is called 'tight_spot'"),
        ("there.toml", "own.py:tight_spot", "there.toml: tight_spot is already there; active effects: tight_spot"),
        ("none.toml", "coulomb_friction", "none.toml: cannot be read: No such file"),
    ],
)
def test_what_cannot_be_added(folder: Path, model: str, effect: str, message: str) -> None:
    """One line says what was found and what is possible; no file is written."""
    (folder / "there.toml").write_text('base = "play"\neffects = ["own.py:tight_spot"]\n')
    with pytest.raises(ModelFileError) as caught:
        run(model, effect, "-o", "m2.toml")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (folder / "m2.toml").exists()


def test_output_that_cannot_be_written(folder: Path) -> None:
    """A folder that is not there is told."""
    with pytest.raises(ModelFileError, match="cannot be written"):
        run("play", "coulomb_friction", "-o", "none/m2.toml")


def test_model_file_whose_effect_is_broken(folder: Path) -> None:
    """The line names the model file, the effect file and the trouble; so it does for the same effect twice."""
    with pytest.raises(ModelFileError, match=r"^my.toml: gone.py: cannot be read: No such file"):
        loads('base = "play"\neffects = ["gone.py:tight_spot"]\n', "my.toml")
    with pytest.raises(ModelFileError, match=r"^my.toml: an effect can act only once, but tight_spot is listed twice"):
        loads('base = "play"\neffects = ["own.py:tight_spot", "own.py:tight_spot"]\n', "my.toml")
    (folder / "own.py").write_text("oops(\n")
    with pytest.raises(ModelFileError, match=r"^my.toml: own.py, line 1: no valid Python"):
        loads('base = "play"\neffects = ["own.py:tight_spot"]\n', "my.toml")
    with pytest.raises(EffectFileError, match=r"^own.py, line 1: no valid Python"):
        run("play", "own.py:tight_spot", "-o", "m2.toml")
