"""Recordings from models: the equations' own figures in the rows, and the commands around them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from lostmotion.drivers.recording import read_recording
from lostmotion.lab.cli import effects, simulate
from lostmotion.lab.errors import ModelFileError, SimulationError
from lostmotion.lab.models.modelfile import ModelFile
from lostmotion.lab.models.simulate import Simulation
from lostmotion.model import Sine, build_model


def run(*args: object) -> Result:
    """`lostmotion simulate` with these arguments; errors are raised."""
    return CliRunner().invoke(simulate, [str(arg) for arg in args], catch_exceptions=False, standalone_mode=False)


def made(simulation: Simulation) -> Any:
    """The recording of a simulation."""
    return simulation.recording(list(simulation.pieces()))


def test_recording_is_the_model(tmp_path: Path) -> None:
    """Without noise the rows are the model's own trajectory, written so that they read back the same."""
    run("play", "-o", tmp_path / "rec.csv", "--motion", "sine:6,0.02", "--duration", 1)
    recording = read_recording(tmp_path / "rec.csv")
    times = np.arange(1000) / 1000
    expected = build_model("play").simulate(Sine(6.0, 0.02), times)
    assert list(recording.columns) == ["command", "position", "force", "accel"]
    for column in recording.columns:
        np.testing.assert_allclose(recording.columns[column], expected[column], rtol=1e-9, atol=1e-12)


def test_pieces_join_without_a_seam() -> None:
    """A simulation longer than a piece is the one that is made at once."""
    at_once = build_model("oscillator", values={"b": 0.01})
    times = np.arange(25000) / 1000
    recording = made(Simulation(ModelFile("oscillator", (), {"b": at_once.parameters["b"]}), duration=25.0))
    expected = at_once.simulate(None, times, at_once.initial_state(None, q=1e-3))
    np.testing.assert_allclose(recording.columns["displacement"], expected["displacement"], atol=1e-7)


def test_clock_skew_runs_through() -> None:
    """A sensor whose clock runs 1 % fast has told 20 s of motion in 20.2 s of its stamps, also beyond a piece's end."""
    skewed = build_model("oscillator", ["clock_skew"], {"clock_skew.s": 0.01, "b": 1e-3})
    recording = made(Simulation(ModelFile("oscillator", ("clock_skew",), dict(skewed.parameters)), duration=15.0))
    late = recording.columns["accel"][12000:]
    spectrum = np.abs(np.fft.rfft(late * np.hanning(late.size), 16 * late.size))
    assert np.argmax(spectrum) / (16 * late.size / 1000) == pytest.approx(58.0 / 1.01, abs=0.05)


def test_noise_is_of_the_asked_size_and_seeded() -> None:
    """Only the accelerometer is noisy, by the given standard deviation, the same for the same seed."""
    silent = made(Simulation(ModelFile("play"), duration=5.0))
    noisy = [made(Simulation(ModelFile("play"), duration=5.0, noise=0.2, seed=seed)) for seed in (1, 1, 2)]
    difference = noisy[0].columns["accel"] - silent.columns["accel"]
    assert difference.std() == pytest.approx(0.2, rel=0.05)
    np.testing.assert_array_equal(noisy[0].columns["accel"], noisy[1].columns["accel"])
    assert not np.array_equal(noisy[0].columns["accel"], noisy[2].columns["accel"])
    np.testing.assert_array_equal(noisy[0].columns["position"], silent.columns["position"])


def test_servo_at_its_own_rate() -> None:
    """Command and position are there at 100 Hz, the accelerometer at 1 kHz."""
    recording = made(Simulation(ModelFile("play"), duration=1.0, servo_rate_hz=100.0))
    np.testing.assert_allclose(recording.signal("command")[0], np.arange(100) / 100)
    assert len(recording.signal("position")[0]) == 100
    assert len(recording.signal("accel")[0]) == 1000


def test_metadata_say_what_it_was_made_from(tmp_path: Path) -> None:
    """Model, effects, true parameters, motion, noise and seed, and the oscillator for the detector."""
    model = tmp_path / "m.toml"
    model.write_text(
        'base = "play"\neffects = ["viscous_friction"]\n[parameters]\nviscous_friction.b_v = 2e-4\nd = 7e-5\n'
    )
    result = run(model, "-o", tmp_path / "r.csv", "--duration", 0.5, "--seed", 3, "--noise", 0.1, "--json")
    metadata = read_recording(tmp_path / "r.csv").metadata
    assert metadata["model"] == "play"
    assert metadata["effects"] == ["viscous_friction"]
    assert (metadata["parameters"]["d"], metadata["parameters"]["viscous_friction.b_v"]) == (7e-5, 2e-4)
    assert (metadata["motion"], metadata["noise"], metadata["seed"]) == ("hand-waved", 0.1, 3)
    assert (metadata["f_res_hz"], metadata["zeta"]) == pytest.approx((58.0, 0.012))
    assert json.loads(result.stdout) == {"recording": str(tmp_path / "r.csv"), "rows": 500, **metadata}


def test_bases_without_a_motion_move_freely() -> None:
    """The oscillator rings down at 58 Hz from 1 mm with its own damping; a pendulum swings from 0.5 rad."""
    ringing = made(Simulation(ModelFile("oscillator"), duration=1.0)).columns["displacement"]
    assert ringing[0] == 1e-3
    peaks = ringing[1:-1][(ringing[1:-1] > ringing[:-2]) & (ringing[1:-1] > ringing[2:])]
    assert len(peaks) in (57, 58)
    assert np.log(peaks[0] / peaks[40]) / 40 == pytest.approx(2 * np.pi * 0.012, rel=0.02)
    swinging = made(Simulation(ModelFile("joint", ("gravity_torque",)), duration=2.0)).columns["position"]
    assert swinging[0] == 0.5
    assert swinging.min() == pytest.approx(-0.5, abs=1e-3)


@pytest.mark.parametrize(("alpha", "duration", "warned"), [(100, 3, True), (4000, 3, False), (100, 11, False)])
def test_chaotic_motion_is_told(tmp_path: Path, alpha: float, duration: float, warned: bool) -> None:
    """With weak contact damping one line says from when on; not for the default, nor where it would cost much."""
    (tmp_path / "m.toml").write_text(f'base = "play"\n[parameters]\nalpha = {alpha}\n')
    result = run(tmp_path / "m.toml", "-o", tmp_path / "r.csv", "--duration", duration)
    assert [line for line in result.stderr.splitlines() if "chaotic: from 1.7 s on" in line] == (
        [f"{tmp_path / 'r.csv'}: the motion is chaotic: from 1.7 s on, samples can be compared only statistically"]
        if warned
        else []
    )
    assert len(result.stderr.splitlines()) == 1 + warned


def test_what_cannot_be_simulated_is_one_line(tmp_path: Path) -> None:
    """A motion that does not exist, too many samples and a model that is none are told, and no file appears."""
    with pytest.raises(SimulationError, match="no motion is called 'wobble'; there are sine"):
        run("play", "-o", tmp_path / "r.csv", "--motion", "wobble")
    with pytest.raises(SimulationError, match="expected at most 50000000"):
        run("play", "-o", tmp_path / "r.csv", "--duration", 1e6)
    with pytest.raises(ModelFileError, match="expected a model file or a base"):
        run("plya", "-o", tmp_path / "r.csv")
    assert list(tmp_path.iterdir()) == []


def test_effects_table_and_json_list_the_catalogue() -> None:
    """Every effect with its parameters and units, as a table and as one JSON document."""
    rows = json.loads(CliRunner().invoke(effects, ["--json"]).stdout)
    ids = [row["id"] for row in rows]
    assert len(ids) == len(set(ids)) >= 21
    coulomb = rows[ids.index("coulomb_friction")]
    assert coulomb["acts_on"] == "joint"
    assert coulomb["parameters"]["tau_c"]["unit"] == "N m"
    assert coulomb["bases"] == ["play", "joint", "servo", "oscillator"]
    table = CliRunner().invoke(effects, []).stdout
    for name in ids:
        assert name in table
    assert "tau_c [N m]" in table
