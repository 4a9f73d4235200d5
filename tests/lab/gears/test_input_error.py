"""Gears whose command is known a hundred times a second, in the steps of a servo."""

from __future__ import annotations

import csv
import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.gears.input_error import input_error
from lostmotion.model import build_model
from lostmotion.model.motion import Sine

STEP = 1.534e-3
"""of a servo with 12 bits [rad]"""


def recorded(folder: Path, model: str, seeds: tuple[int, ...], step: float) -> list[str]:
    """Recordings of the model at 800 Hz, its command at 100 Hz and rounded."""
    paths = []
    for seed in seeds:
        path = folder / f"rec{seed}.csv"
        options = f"--motion hand-waved:{seed} --duration 3 --rate-hz 800 --servo-rate-hz 100 --noise 0.3 --seed {seed}"
        made = CliRunner().invoke(cli, ["simulate", model, "-o", str(path), *options.split()])
        assert made.exit_code == 0, made.stderr
        _round(path, step)
        paths.append(str(path))
    return paths


def _round(path: Path, step: float) -> None:
    """Rounds command and position in place, and drops the force, which no robot measures."""
    if not step:
        return
    lines = path.read_text().splitlines()
    comments = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    for row in rows:
        del row["force"]
        row |= {name: repr(round(float(row[name]) / step) * step) for name in ("command", "position") if row[name]}
    table = [",".join(rows[0]), *(",".join(row.values()) for row in rows)]
    path.write_text("\n".join([*comments, *table]) + "\n")


def explained(model: str, paths: list[str]) -> dict[str, object]:
    ran = CliRunner().invoke(cli, ["lab", "explain", model, *paths, "--json", "--budget", "600s"])
    assert ran.exit_code == 0, ran.stderr
    return dict(json.loads(ran.stdout))


def test_an_input_in_closed_form_has_no_error() -> None:
    """As of an experiment that a program makes."""
    times = np.arange(0.0, 1.0, 1e-3)
    model, drive = build_model("play"), Sine(0.2, 1.5)
    made = Experiment("made", drive, times, {"accel": np.array(model.simulate(drive, times)["accel"])})
    with ThreadPoolExecutor(1) as pool:
        found = input_error(model, made, {"accel": 0.1}, pool)
    assert (found.columns, found.longest_s) == ({"accel": 0.0}, np.inf)
    assert found.limit(made, {"accel": 0.1}) is None


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.0, STEP])
def test_nothing_is_missing_from_a_model_with_a_slow_command(tmp_path: Path, step: float) -> None:
    """The error of the command between its samples, and that of its steps, is no effect."""
    found = explained("play", recorded(tmp_path, "play", (21, 22, 23), step))
    assert found["verdict"] == "nothing_missing", found["residual"]
    limit = found["input_limit"]
    if not step:
        assert limit is None
        return
    assert isinstance(limit, dict)
    assert limit["step"] == pytest.approx(STEP, rel=1e-3)
    assert limit["rate_hz"] == pytest.approx(100)
    assert limit["sensor"] == pytest.approx(0.3, rel=0.2)
    assert limit["error"] > limit["sensor"] / 5


@pytest.mark.slow
def test_friction_is_found_with_a_rounded_command(tmp_path: Path) -> None:
    """Its interval includes the error of the command."""
    rubbing = tmp_path / "rubbing.toml"
    rubbing.write_text('base = "play"\neffects = ["coulomb_friction"]\n[parameters]\ncoulomb_friction.tau_c = 3e-4\n')
    found = explained("play", recorded(tmp_path, str(rubbing), (21, 25), STEP))
    parameters = found["parameters"]
    assert isinstance(parameters, dict)
    assert found["missing"] == ["coulomb_friction"]
    value, low, high = parameters["coulomb_friction.tau_c"]
    assert low < 3e-4 < high
    assert 0.8 < value / 3e-4 < 1.2


@pytest.mark.slow
def test_a_play_that_is_far_from_that_of_the_file_is_no_effect(tmp_path: Path) -> None:
    """A third and twice of the play, as nobody knows the play of a worn gear."""
    made = recorded(tmp_path, "play", (27, 28), STEP)
    for play in (1.6e-4, 2.6e-4):
        model = tmp_path / "other.toml"
        model.write_text(f'base = "play"\n[parameters]\nd = {play}\n')
        found = explained(str(model), made)
        assert found["verdict"] == "nothing_missing", (play, found["missing"], found["residual"])
