"""What the lab's commands leave for programs: curves, progress as lines of JSON, sentences in the document."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.lab.commands.table import print_table
from lostmotion.lab.commands.terminal import show
from lostmotion.lab.models.own import load_effect
from lostmotion.lab.results import Ranked
from lostmotion.model.effects.registry import catalogue, registered
from tests.conftest import ROOT
from tests.lab import report_example

MODEL = """base = "servo"
effects = ["viscous_friction"]
[parameters]
kt = { value = 1.2, fixed = true }
"""
TIGHT = 'effects = ["viscous_friction", "tight_spot.py:tight_spot"]'
SPOT = "tight_spot.tau_t = 0.6\ntight_spot.where = 0.1\ntight_spot.width = 0.06\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A servo with a tight spot, recorded for 2.5 s, a model that does not know of it, and the effect."""
    folder = tmp_path_factory.mktemp("tight")
    (folder / "tight_spot.py").write_text((ROOT / "examples" / "tight_spot_effect.py").read_text())
    (folder / "model.toml").write_text(MODEL)
    (folder / "true.toml").write_text(MODEL.replace('effects = ["viscous_friction"]', TIGHT) + SPOT)
    call("simulate", folder / "true.toml", "-o", folder / "rec.csv", "--motion", "hand-waved:1", "--duration", 2.5,
         "--rate-hz", 100, "--noise", 0.0005)  # fmt: skip
    return folder


def call(*arguments: object) -> Any:
    """A command in this process; it must succeed."""
    result = CliRunner().invoke(cli, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.stderr
    return result


def test_a_unit_in_brackets_is_no_markup(capsys: pytest.CaptureFixture[str]) -> None:
    """The name of a column keeps its unit, and no line ends in blanks."""
    print_table(("effect", "error [rad]", "p"), [("torque_ripple", "0.1", "[bold]")])
    first, _, last = capsys.readouterr().out.splitlines()
    assert first == "effect          error [rad]   p"
    assert last == "torque_ripple   0.1           [bold]"


@pytest.mark.slow
def test_an_effect_of_ones_own_is_in_the_ranking(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """However many of the catalogue are better; of these the best are printed."""
    explanation = report_example.explanation()
    names = [effect.id for effect in catalogue()][:12]
    tried = tuple(Ranked(name, 1.0, 1.0, 1.0) for name in [*names, "tight_spot"])
    with registered([load_effect("tight_spot.py:tight_spot", folder)]):
        show(replace(explanation, ranking=tried), None)
    rows = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert "tight_spot" in rows
    assert names[7] in rows
    assert names[8] not in rows


def test_the_legend_of_a_plot_is_below_it(folder: Path) -> None:
    """No box lies on the curves."""
    lines = call("lab", "compare", folder / "model.toml", folder / "rec.csv").stdout.splitlines()
    assert sum("┌" in line for line in lines) == 1
    assert "• measured   ⢕ modelled" in [line.strip() for line in lines]


def test_curves_are_what_was_compared(folder: Path) -> None:
    """Measured minus modelled of the file has the error that the document tells; the sentences tell it, too."""
    path = folder / "compared.json"
    result = call("lab", "compare", folder / "model.toml", folder / "rec.csv", "--json", "--curves", path)
    found = json.loads(result.stdout)
    (curve,) = json.loads(path.read_text())
    assert (curve["column"], curve["what"], curve["unit"], curve["before"]) == ("position", "angle", "rad", None)
    left = np.array(curve["measured"]) - np.array(curve["modelled"])
    assert np.sqrt(np.mean(left**2)) == pytest.approx(found["columns"]["position"]["rms"], rel=1e-3)
    assert len(curve["time"]) == left.size == 250
    assert curve["noise"] == pytest.approx(0.0005, rel=0.3)
    assert found["words"][0].startswith("The error in angle is ")
    assert found["variables"]["omega_2"] == "the joint's speed"


@pytest.mark.slow
def test_an_effect_of_ones_own_that_was_found_is_told(folder: Path) -> None:
    """A tight spot, which the catalogue does not have, is named from its file and told in words; the curve without it
    is far above the one with it; progress begins at 0 and ends at 1."""
    path = folder / "explained.json"
    result = call(
        "lab", "improve", folder / "model.toml", folder / "rec.csv", "-o", folder / "better.toml", "--budget", "600s",
        "--effect", f"{folder / 'tight_spot.py'}:tight_spot", "--json", "--curves", path, "--progress", "json",
    )  # fmt: skip
    found = json.loads(result.stdout)
    assert found["missing"] == ["tight_spot"]
    assert found["names"]["tight_spot"] == "tight spot"
    assert found["names"].keys() >= {entry["effect"] for entry in found["ranking"]}
    assert any("Tight spot, an effect of the user's own: tau_t = 0.6" in sentence for sentence in found["words"])
    assert '"tight_spot.py:tight_spot"' in (folder / "better.toml").read_text()
    curve = json.loads(path.read_text())[0]
    measured, modelled, before = (np.array(curve[name]) for name in ("measured", "modelled", "before"))
    assert np.std(measured - modelled) == pytest.approx(0.0005, rel=0.2)
    assert np.std(measured - before) > 3 * np.std(measured - modelled)
    parts = [json.loads(line)["part"] for line in result.stderr.splitlines()]
    assert parts[0] == 0.0
    assert parts[-1] == 1.0
    assert parts == sorted(parts)
