"""Readings that are finer than the integration of a search."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.shooting.task import DITHER, coarse_substep, dithered
from lostmotion.model import build_model
from lostmotion.model.motion import Sine


def test_readings_finer_than_the_integration_are_dithered() -> None:
    """Of a force without noise the added noise is DITHER times what the coarse step changes in a quarter of a second;
    an acceleration with noise of one per cent stays as it is."""
    model, drive, times = build_model("play"), Sine(0.2, 1.5), np.arange(0.0, 2.0, 1e-3)
    exact = model.simulate(drive, times)
    noise = {"accel": 0.01 * float(np.std(exact["accel"])), "force": 1e-9}
    rng = np.random.default_rng(1)
    accel = exact["accel"] + noise["accel"] * rng.standard_normal(times.size)
    given = Experiment("made", drive, times, {"accel": accel, "force": np.array(exact["force"])})
    (changed,), least = dithered(model, [given], noise)
    step, errors = coarse_substep(model, [given]), []
    for k in (0, 250, 500, 750):
        coarse = model.simulate(drive, times[k : k + 250], exact.states[k], substep_s=step)["force"]
        errors.append(np.sqrt(np.mean((coarse - exact["force"][k : k + 250]) ** 2)))
    assert least["force"] == pytest.approx(DITHER * np.median(errors), rel=0.3)
    assert np.std(changed.measured["force"] - given.measured["force"]) == pytest.approx(least["force"], rel=0.1)
    assert least["accel"] == noise["accel"]
    assert np.array_equal(changed.measured["accel"], given.measured["accel"])


@pytest.mark.slow
def test_nothing_is_missing_from_the_model_that_made_the_recording(tmp_path: Path) -> None:
    """``simulate --noise`` makes noise of the acceleration alone; position and force are as exact as the simulation."""
    path = str(tmp_path / "worn.csv")
    made = CliRunner().invoke(cli, ["simulate", "play", "-o", path, "--duration", "1.5", "--noise", "0.1"])
    assert made.exit_code == 0, made.stderr
    found = json.loads(CliRunner().invoke(cli, ["lab", "explain", "play", path, "--json"]).stdout)
    assert (found["verdict"], found["missing"], found["residual"]) == ("nothing_missing", [], None)
    assert found["error"]["after"] == pytest.approx(0.1, rel=0.05)
