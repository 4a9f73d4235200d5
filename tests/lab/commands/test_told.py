"""What the lab's commands leave for programs: curves, progress as lines of JSON, sentences in the document."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from tests.conftest import ROOT

RUBBING = {"viscous_friction.b_v": 0.08, "coulomb_friction.tau_c": 0.15}
KNOWN = "kt = { value = 1.2, fixed = true }"


def model(path: Path, **parameters: float) -> Path:
    """A servo whose effects are those of the parameters."""
    lines = [f"{name} = {value}" for name, value in parameters.items()]
    effects = list(dict.fromkeys(["viscous_friction", *(name.split(".")[0] for name in parameters)]))
    path.write_text(f'base = "servo"\neffects = {json.dumps(effects)}\n[parameters]\n{KNOWN}\n' + "\n".join(lines))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A servo that rubs, recorded twice for three seconds, and a model that does not know of it."""
    folder = tmp_path_factory.mktemp("rubbing")
    true = model(folder / "true.toml", **RUBBING)
    model(folder / "model.toml")
    for seed in (1, 2):
        call("simulate", true, "-o", folder / f"rec{seed}.csv", "--motion", f"hand-waved:{seed}", "--duration", 3,
             "--rate-hz", 100, "--noise", 0.0005, "--seed", seed)  # fmt: skip
    return folder


def call(*arguments: object) -> Any:
    """A command in this process; it must succeed."""
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.stderr
    return result


def test_curves_are_what_was_compared(folder: Path) -> None:
    """Measured minus modelled of the file has the error that the document tells; the sentences tell it, too."""
    path = folder / "compared.json"
    found = json.loads(
        call("lab", "compare", folder / "model.toml", folder / "rec1.csv", "--json", "--curves", path).stdout
    )
    (curve,) = json.loads(path.read_text())
    assert (curve["column"], curve["what"], curve["unit"], curve["before"]) == ("position", "angle", "rad", None)
    left = np.array(curve["measured"]) - np.array(curve["modelled"])
    assert np.sqrt(np.mean(left**2)) == pytest.approx(found["columns"]["position"]["rms"], rel=1e-3)
    assert len(curve["time"]) == left.size == 300
    assert curve["noise"] == pytest.approx(0.0005, rel=0.3)
    assert found["words"][0].startswith("The error in angle is ")


@pytest.mark.slow
@pytest.mark.slow
def test_what_was_found_is_taken_out_of_the_curve_before(folder: Path) -> None:
    """The error without what was found is far above the one with it; each effect has its name, the one that was found
    also what to look at; progress begins at 0 and ends at 1."""
    path = folder / "explained.json"
    result = call(
        "lab", "improve", folder / "model.toml", folder / "rec1.csv", folder / "rec2.csv", "-o", folder / "better.toml",
        "--json", "--curves", path, "--progress", "json",
    )  # fmt: skip
    found = json.loads(result.stdout)
    assert found["missing"] == ["coulomb_friction"]
    assert found["names"]["coulomb_friction"] == "Coulomb friction"
    assert found["names"].keys() >= {entry["effect"] for entry in found["ranking"]}
    assert "bearing" in found["look"]["coulomb_friction"]
    assert any("Coulomb friction of 0.1" in sentence for sentence in found["words"])
    curve = json.loads(path.read_text())[0]
    measured, modelled, before = (np.array(curve[name]) for name in ("measured", "modelled", "before"))
    assert np.std(measured - modelled) == pytest.approx(0.0005, rel=0.2)
    assert np.std(measured - before) > 3 * np.std(measured - modelled)
    parts = [json.loads(line)["part"] for line in result.stderr.splitlines()]
    assert parts[0] == 0.0
    assert parts[-1] == 1.0
    assert parts == sorted(parts)


@pytest.mark.slow
@pytest.mark.slow
def test_an_effect_of_ones_own_that_was_found_is_told(tmp_path: Path) -> None:
    """A tight spot, which the catalogue does not have, is named from its file, told in words and in the table."""
    effect = tmp_path / "tight_spot.py"
    effect.write_text((ROOT / "examples" / "tight_spot_effect.py").read_text())
    true = model(tmp_path / "true.toml", **{"viscous_friction.b_v": 0.08})
    text = true.read_text().replace('"viscous_friction"]', '"viscous_friction", "tight_spot.py:tight_spot"]')
    true.write_text(text + "\ntight_spot.tau_t = 0.6\ntight_spot.where = 0.1\ntight_spot.width = 0.06\n")
    call("simulate", true, "-o", tmp_path / "rec.csv", "--motion", "hand-waved:1", "--duration", 4,
         "--rate-hz", 100, "--noise", 0.0005)  # fmt: skip
    result = call("lab", "explain", model(tmp_path / "model.toml"), tmp_path / "rec.csv", "--budget", "1s",
                  "--effect", f"{effect}:tight_spot")  # fmt: skip
    assert "An effect of the user's own: tau_t = 0.6" in result.stdout
    assert "Adding it brings the error from" in result.stdout
