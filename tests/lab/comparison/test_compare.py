"""The model against recordings whose misfit is known, from a simulator of their own, through the command too."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bench.hidden_effects.motion import hand_waved
from bench.hidden_effects.physics import follow, simulate
from click.testing import CliRunner, Result
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording, read_recording, write_recording
from lostmotion.lab.commands.group import compare as command
from lostmotion.lab.comparison.compare import Comparison, compare
from lostmotion.lab.comparison.phases import phases
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.report.verdict import of_comparison
from lostmotion.lab.results import Finding
from lostmotion.model import HandWaved, Model, build_model
from tests.conftest import Measurements

NOISE = 0.2
GEARS = {"d": 8e-5, "alpha": 5000.0, "b": 0.18, "k": 2600.0}
LEAD = 0.4


def measured(seed: int = 0, duration: float = 2.0, rate_hz: float = 800.0, **hidden: float) -> Recording:
    """The accelerometer of gears with hidden effects, from the bench's own simulator, begun in motion, with noise."""
    rng = np.random.default_rng(seed)
    command = hand_waved(rng, duration + LEAD)
    values = {**GEARS, **hidden}
    times = LEAD + np.arange(round(duration * rate_hz)) / rate_hz
    start = follow(values, command, 0.0)
    accel = simulate(values, command, np.concatenate(([0.0], times)), start)[0][1:]
    columns = {"command": command.at(times), "accel": accel + rng.normal(0, NOISE, times.size)}
    return Recording(times - LEAD, columns, name=f"rec{seed}.csv")


def held(model: Model, *recordings: Recording, is_described: bool = False) -> Comparison:
    """The comparison."""
    return compare(model, experiments(model, recordings), recordings=recordings, is_described=is_described)


def described(seed: int, hidden: Mapping[str, float]) -> tuple[Comparison, Finding]:
    """The comparison with the base as it is, and how a hidden effect is described."""
    found = held(build_model("play", values=GEARS), measured(seed, 0.8, **hidden), is_described=True)
    assert found.localisation is not None
    return found, found.localisation


def run(*args: object) -> Result:
    """`lostmotion lab compare` with these arguments; errors are raised."""
    return CliRunner().invoke(command, [str(arg) for arg in args], catch_exceptions=False, standalone_mode=False)


def test_true_model_leaves_only_noise() -> None:
    """With the right parameters and an unknown start what is left is the noise, and said to be so."""
    found = held(build_model("play", values=GEARS), measured(duration=1.5))
    assert found.rms("accel") == pytest.approx(NOISE, rel=0.08)
    assert found.columns["accel"].noise.rms == pytest.approx(NOISE, rel=0.1)
    assert found.is_noise
    assert found.localisation is None
    assert found.fit_percent("accel") == pytest.approx(93, abs=1)
    assert "nothing is missing" in of_comparison(found)[-1]


def test_a_servo_slower_than_its_accelerometer() -> None:
    """What the service records, an angle in one of ten rows, is compared at its own rows: noise of 1 mrad is found."""
    fast = measured(duration=1.5)
    rows = np.arange(fast.time.size) % 10 == 0
    noise = np.random.default_rng(3).normal(0, 1e-3, fast.time.size)
    angle = np.where(rows, fast.columns["command"] + noise, np.nan)
    found = held(build_model("play", values=GEARS), replace(fast, columns={**fast.columns, "position": angle}))
    column = found.columns["position"]
    assert column.noise.rms == pytest.approx(1e-3, rel=0.2)
    assert found.rms("position") == pytest.approx(1e-3, abs=2e-3)  # the gap lies between the two gears
    assert column.spectra.frequency_hz[-1] == pytest.approx(40)
    assert sum(one.samples for one in column.phases) == pytest.approx(1)


@pytest.mark.slow
def test_document_is_consistent() -> None:
    """Phases and blocks add up to the whole error, and recordings to the column's."""
    found = held(build_model("play", values=GEARS), measured(0, **FRICTION), measured(1, **FRICTION))
    document = json.loads(json.dumps(found.document(), allow_nan=False))
    column = document["columns"]["accel"]
    assert sum(one["samples"] for one in column["phases"]) == pytest.approx(1)
    assert sum(one["error"] for one in column["phases"]) == pytest.approx(1)
    weights = [one["samples"] * one["rms"] ** 2 for one in column["phases"]]
    assert np.sqrt(sum(weights)) == pytest.approx(column["rms"])
    assert len(column["blocks"]) == 40
    of_recordings = [one["rms"] ** 2 for one in document["recordings"]]
    assert np.sqrt(np.mean(of_recordings)) == pytest.approx(column["rms"])
    assert document["error"] == {"before": column["rms"], "after": column["rms"], "noise": column["noise"],
                                 "unit": "m/s^2"}  # fmt: skip
    assert column["rms"] > 5 * column["noise"]
    assert column["tests"]["residual with itself"]["significant"]


FRICTION = {"coulomb_friction.tau_c": 3e-4, "coulomb_friction.omega_0": 5e-3}
LEAKAGE = {"gravity_leakage.c": 0.2, "gravity_leakage.phi": 0.1}


@pytest.mark.slow
def test_localise() -> None:
    """A hidden effect is located in its equation, and found to follow its variable; document and words say so, too."""
    comparison, finding = described(4, LEAKAGE)
    assert (finding.acts_on, finding.depends_on) == ("sensor", ("theta_2",))
    document = comparison.document()["residual"]
    assert document["acts_on"] == "sensor"
    assert document["curve"]["variable"] == "theta_2"
    assert "an error of the sensor" in " ".join(of_comparison(comparison))


@pytest.mark.slow
def test_size_of_the_missing_torque() -> None:
    """Of a hidden Coulomb friction the torque is found with its size, and that it follows the sign of the speed."""
    found = described(5, FRICTION)[1]
    assert (found.acts_on, found.depends_on) == ("joint", ("omega_2",))
    assert found.formula is not None
    size, *shape = found.formula.split()
    assert shape == ["sign(omega_2)"]
    assert float(size) == pytest.approx(-3e-4, rel=0.05)


@pytest.mark.slow
def test_map_of_a_sensor_that_leaks() -> None:
    """Gravity that leaks into the sensor shows as a line over the angle, of slope c g, in the first map."""
    found = held(build_model("play", values=GEARS), measured(2, **LEAKAGE))
    first = found.columns["accel"].maps[0]
    assert first.variable in ("theta_2", "command")
    slope = np.polyfit(first.x, first.mean, 1)[0]
    assert slope == pytest.approx(0.2 * 9.80665, rel=0.1)


@pytest.mark.slow
def test_temperature_is_one_of_the_variables() -> None:
    """A reading that follows the temperature, recorded beside it at a fortieth of the rate, maps over temperature."""
    plain = measured(4)
    temperature = 30 + 5 * np.sin(2 * np.pi * 2.3 * plain.time)
    columns = {**plain.columns, "accel": plain.columns["accel"] + 0.3 * (temperature - 30)}
    columns["temperature"] = np.where(np.arange(temperature.size) % 40 == 0, temperature, np.nan)
    found = held(build_model("play", values=GEARS), Recording(plain.time, columns, name="warm.csv"))
    first = found.columns["accel"].maps[0]
    assert first.variable == "temperature"
    assert first.significant
    assert np.polyfit(first.x, first.mean, 1)[0] == pytest.approx(0.3, rel=0.15)


def test_phases_of_a_joint() -> None:
    """A swinging joint reverses where its speed changes sign; every sample is in one phase."""
    model = build_model("joint", ["gravity_torque"], {"gravity_torque.tau_g": 0.01})
    times = np.arange(0, 3, 0.005)
    trajectory = model.simulate(None, times, model.initial_state(None, theta_2=0.5))
    found = phases("joint", trajectory)
    assert np.all(sum(mask.astype(int) for mask in found.values()) == 1)
    speed = np.abs(trajectory["velocity"])
    assert speed[found["at a reversal"]].max() < 0.3 * speed.max()
    assert speed[found["on the move"]].mean() > 3 * speed[found["at a reversal"]].mean()
    swings = np.count_nonzero(np.diff(np.sign(trajectory["velocity"])) != 0)
    assert np.count_nonzero(np.diff(found["at a reversal"].astype(int)) == 1) == pytest.approx(swings, abs=1)


def test_phases_of_gears() -> None:
    """The contact force rises at impacts, and there is none in free flight."""
    model = build_model("play", values=GEARS)
    trajectory = model.simulate(HandWaved(1), np.arange(0, 2, 1 / 800))
    found = phases("play", trajectory)
    force = np.abs(trajectory["force"])
    assert np.all(sum(mask.astype(int) for mask in found.values()) == 1)
    assert force[found["at an impact"]].mean() > 5 * force[found["before an impact"]].mean()
    assert force[found["in free flight"]].max() <= 0.02 * force.max()


@pytest.mark.parametrize("base", ["oscillator", "joint", "servo"])
def test_other_bases(base: str) -> None:
    """Every base is compared: 5 % off in its inertia it is off by more than the noise, with it right it is not."""
    inertia = {"oscillator": "k", "joint": "J", "servo": "J"}[base]
    truth = build_model(base, ["viscous_friction"] if base != "oscillator" else [])
    drive = HandWaved(2, {"oscillator": 0.5, "joint": 1e-3, "servo": 0.5}[base])
    times = np.arange(0, 4, 1 / 400)
    trajectory = truth.simulate(drive, times)
    output = "displacement" if base == "oscillator" else "position"
    source = {"oscillator": "force", "joint": "torque", "servo": "command"}[base]
    noise = (1e-4 if base == "joint" else 0.01) * float(np.std(trajectory[output]))
    values = trajectory[output] + np.random.default_rng(1).normal(0, noise, times.size)
    recording = Recording(times, {source: drive.position(times), output: values}, name="rec.csv")
    right = held(truth, recording)
    output = right.column
    if output == "torque":  # what is compared of a joint that is driven
        noise = right.columns["torque"].noise.rms
    else:
        assert right.rms(output) == pytest.approx(noise, rel=0.1)
    assert right.is_noise
    wrong = held(truth.replace({inertia: 1.3 * truth.parameters[inertia].value}), recording, is_described=True)
    assert not wrong.is_noise
    assert wrong.rms(output) > 1.5 * noise


def test_command_tells_and_writes_json(tmp_path: Path) -> None:
    """The command prints a table, a plot and plain words; with --json one document of the same figures."""
    write_recording(measured(0, duration=1.5), tmp_path / "rec.csv")
    (tmp_path / "model.toml").write_text(
        'base = "play"\n[parameters]\nd = 8e-5\nalpha = 5000.0\nb = 0.18\nk = 2600.0\n'
    )
    output = run(tmp_path / "model.toml", tmp_path / "rec.csv").stdout
    assert "base play, active effects: none" in output
    assert "rec.csv" in output
    assert "measured" in output
    assert "nothing is missing" in output
    document = json.loads(run(tmp_path / "model.toml", tmp_path / "rec.csv", "--json").stdout)
    assert document["base"] == "play"
    assert document["error"]["unit"] == "m/s^2"
    assert document["columns"]["accel"]["rms"] == pytest.approx(NOISE, rel=0.1)
    assert document["residual"] is None


def test_a_recording_without_the_columns(tmp_path: Path) -> None:
    """A recording of something else is refused with what was found and what the base needs."""
    times = np.arange(0, 1, 0.01)
    write_recording(Recording(times, {"voltage": np.sin(times)}), tmp_path / "rec.csv")
    with pytest.raises(ExperimentError, match=r"rec\.csv: found voltage, expected"):
        run("play", tmp_path / "rec.csv")


def test_silverbox(real_data: Measurements) -> None:
    """The linear oscillator with rough parameters on the Silverbox: far above the noise, the oscillator is named."""
    recording = read_recording(real_data("silverbox") / "multisine_1.csv")
    part = slice(0, 4000)
    columns = {name: values[part] for name, values in recording.columns.items()}
    short = Recording(recording.time[part], columns, recording.metadata, name="silverbox")
    w = 2 * np.pi * 68.0
    model = build_model("oscillator", values={"m": 1.0, "k": w**2, "b": 2 * 0.05 * w})
    gain = np.nanstd(short.columns["displacement"]) / np.std(
        model.simulate(experiments(model, [short])[0].drive, short.time)["displacement"]
    )
    scaled = model.replace({"m": 1 / gain, "k": w**2 / gain, "b": 0.1 * w / gain})
    found = held(scaled, short, is_described=True)
    assert found.columns["displacement"].noise.rms < 0.2 * found.rms("displacement")
    assert found.localisation is not None
    assert found.localisation.acts_on == "oscillator"


def test_recordings_with_zeros_of_their_own(tmp_path: Path) -> None:
    """Three films of one pendulum, measured from where the user liked: a fitted model follows all of them, and one
    alone."""
    rng, times, paths = np.random.default_rng(1), np.arange(0.0, 12.0, 0.02), []
    for at, (swing, zero) in enumerate(((0.8, 0.0), (0.6, 0.5), (1.0, -0.8))):
        motion = solve_ivp(lambda _, y: (y[1], -20 * np.sin(y[0]) - 0.15 * y[1]), (0, 12), (swing, 0), "DOP853", times,
                           rtol=1e-9)  # fmt: skip
        paths.append(tmp_path / f"film{at}.csv")
        columns = {"position": zero + motion.y[0] + rng.normal(0, 1e-3, times.size)}
        write_recording(Recording(times, columns, name=paths[-1].name), paths[-1])
    model = tmp_path / "model.toml"
    values = "gravity_torque.tau_g = 4e-3\nviscous_friction.b_v = 3e-5"
    effects = 'effects = ["gravity_torque", "viscous_friction"]'
    model.write_text(f'base = "joint"\n{effects}\n[parameters]\nJ = 2e-4\n{values}\n')
    for recordings in (paths, paths[1:2]):
        found = json.loads(run(model, *recordings, "--json").stdout)
        assert found["error"]["after"] == pytest.approx(1e-3, rel=0.1)
        assert found["is_noise"]


def test_a_place_on_which_nothing_depends_stays_as_it_was_recorded(tmp_path: Path) -> None:
    """Without a weight or a spring any zero of the angle is cancelled by the initial angle: the measured angle is shown
    as it is in the file."""
    time = np.arange(0.0, 6.0, 0.02)
    path, curves = tmp_path / "swing.csv", tmp_path / "curves.json"
    swing = 0.8 * np.exp(-0.1 * time) * np.cos(5 * time)
    write_recording(Recording(time, {"position": swing}), path)
    done = CliRunner().invoke(command, ["joint", str(path), "--curves", str(curves)])
    assert done.exit_code == 0, done.stderr
    (curve,) = json.loads(curves.read_text())
    assert np.interp(curve["time"], time, swing) == pytest.approx(np.array(curve["measured"]), abs=1e-3)
