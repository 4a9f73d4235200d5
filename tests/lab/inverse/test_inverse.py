"""Joints whose torque was measured, or that swing freely: simulated here and by SciPy, not by the lab's solver."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, write_recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.fitting.identifiability import with_scale
from lostmotion.lab.inverse.likelihood import Method, WholeMotion
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import can_run, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import softened
from lostmotion.lab.models import modelfile
from lostmotion.lab.selection.evidence import shapes_tried
from lostmotion.lab.selection.forward import selected
from lostmotion.model import Model, build_model
from lostmotion.model.effects import get_effect

INERTIA, VISCOUS, COULOMB = 0.4, 2.0, 1.3
LENGTH, LONG = 12.0, 16.0


def robot(
    seed: int, viscous: float = VISCOUS, coulomb: float = COULOMB, disturbance: float = 0.2, length: float = LENGTH
) -> Recording:
    """A joint held to a smooth reference by a stiff controller, whose torque follows every disturbance; dry friction
    after Karnopp, steps of 0.5 ms, a noisy encoder."""
    rng = np.random.default_rng(seed)
    frequencies, phases = rng.uniform(0.2, 1.2, 5), rng.uniform(0, 2 * np.pi, 5)
    step, every = 5e-4, 20
    times = np.arange(0.0, length, step)
    w = 2 * np.pi * frequencies
    waves = np.multiply.outer(times, w) + phases
    wanted = np.sum(0.5 / frequencies * np.sin(waves), -1).tolist()
    rate = np.sum(0.5 / frequencies * w * np.cos(waves), -1).tolist()
    push = np.repeat(disturbance * rng.standard_normal(times.size // 100 + 1), 100).tolist()
    q, v, torques, angles = wanted[0], rate[0], [], []
    for k in range(times.size):
        torque = 4e3 * (wanted[k] - q) + 80 * (rate[k] - v)
        torques.append(torque)
        angles.append(q)
        drive = torque - viscous * v - push[k]
        if abs(v) < 1e-4 and abs(drive) < coulomb:
            v = 0.0
            continue
        before, v = v, v + step / INERTIA * (drive - math.copysign(coulomb, v or drive))
        v = 0.0 if before * v < 0 else v
        q += step * v
    measured = np.array(angles[::every]) + 1e-4 * rng.standard_normal(len(angles[::every]))
    columns = {"torque": np.array(torques[::every]), "position": measured}
    return Recording(times[::every], columns, {}, {}, 0, f"robot{seed}.csv")


def back_and_forth(seed: int) -> Recording:
    """A joint that goes four times to and fro, each time faster, against its weight and friction."""
    rng = np.random.default_rng(seed)
    speeds = np.repeat(0.2 * 1.5 ** np.arange(4), 2) * np.tile([1, -1], 4)
    steps = np.concatenate([np.r_[np.full(round(140 / abs(speed)), speed), np.zeros(30)] for speed in speeds])
    speed = gaussian_filter1d(steps, 12)
    times, angle = np.arange(speed.size) / 100, np.cumsum(speed) / 100 - 0.7
    dry, weight = 0.26 * np.tanh(speed / 0.01), 0.33 * np.sin(angle - 1.62)
    torque = 0.06 * np.gradient(speed, 0.01) + 0.33 * speed + dry + weight + 0.01 * rng.standard_normal(speed.size)
    measured = angle + 1e-4 * rng.standard_normal(speed.size)
    return Recording(times, {"torque": torque, "position": measured}, {}, {}, 0, f"joint{seed}.csv")


def pendulum(seed: int, drag: float = 0.02, inertia: float = 1.0) -> Recording:
    """A pendulum in air, filmed at 30 frames a second: quadratic drag per inertia, 0.5 degrees of noise."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 20.0, 1 / 30)
    law = solve_ivp(
        lambda t, x: [x[1], -7.0 * np.sin(x[0]) - drag * x[1] * abs(x[1])], (0, 20), [0.9, 0.0], "LSODA", times,
        rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    angle = law.y[0] + 0.009 * rng.standard_normal(times.size)
    return Recording(times, {"position": angle}, {}, {}, 0, f"pendulum{seed}.csv")


def named(model: Model, recordings: list[Recording]) -> tuple[str, ...]:
    """The effects that the selection adds."""
    held = experiments(model, recordings)
    model, _ = with_scale(model, held)
    signals = [Signals.of(one) for one in held]
    return selected(WholeMotion(Method.of(model, held), model, signals), lambda what, part: None).added


@pytest.mark.slow
def test_friction_is_found_in_a_closed_loop() -> None:
    """A stiff controller's torque follows the disturbances; viscous and Coulomb friction are named all the same."""
    assert set(named(build_model("joint"), [robot(1), robot(2)])) == {"viscous_friction", "coulomb_friction"}


@pytest.mark.slow
def test_what_helps_only_together() -> None:
    """Coulomb friction comes first, and then neither the weight nor viscous friction is significant alone."""
    found = named(build_model("joint"), [back_and_forth(0)])
    assert set(found) == {"coulomb_friction", "viscous_friction", "gravity_torque"}


@pytest.mark.slow
def test_intervals_hold_the_truth() -> None:
    """Of inertia, viscous and Coulomb friction 95 % intervals hold the truth in 65 to 71 of 72 cases and 50 % ones in
    24 to 48: neither half nor twice as wide.  Friction is right to 1 % in the mean."""
    truth = {"J": INERTIA, "viscous_friction.b_v": VISCOUS, "coulomb_friction.tau_c": COULOMB}
    model = build_model("joint", ["viscous_friction", "coulomb_friction"])
    off, sizes = [], []
    for seed in range(100, 124):
        (one,) = experiments(model, [robot(seed, length=LONG)])
        data = InverseModel.of([Signals.of(one)], model)
        fit = regressed(softened(model, data.signals), data)
        deviations = fit.deviations
        values = {name: fit.model.parameters[name].value for name in truth}
        off += [abs(values[name] - true) / deviations[name] for name, true in truth.items()]
        sizes.append([values[name] / true for name, true in truth.items()])
    assert 65 <= sum(one < 2.1 for one in off) <= 71
    assert 24 <= sum(one < 0.7 for one in off) <= 48
    assert np.mean(sizes, axis=0) == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_missing() -> None:
    """Of four searches of a complete model at most one names an effect: 5 % a step for the whole catalogue, which
    test_levels counts."""
    model = build_model("joint", ["viscous_friction", "coulomb_friction"])
    false = [seed for seed in range(200, 204) if named(model, [robot(seed)])]
    assert len(false) <= 1


def test_friction_that_would_take_all_of_the_torque_is_not_load_dependent() -> None:
    """Where power always flows one way, friction of mu rescales all other torques by 1 - mu: it is not apt near one."""
    least, most = (get_effect("load_dependent_friction").is_apt({"mu": mu, "omega_0": 1e-3}) for mu in (0.6, 0.9))
    assert (least, most) == (True, False)


@pytest.mark.slow
def test_drag_that_adds_up_over_many_swings_is_found() -> None:
    """A pendulum's drag, invisible in its acceleration, is named from the whole motion."""
    found = named(build_model("joint", ["gravity_torque"]), [pendulum(1), pendulum(2)])
    assert found[0] == "quadratic_damping"
    assert "coulomb_friction" not in found


def explained(folder: Path, model: str, recordings: list[Recording], *options: str) -> dict[str, Any]:
    """What the command says of a model file and recordings."""
    file = folder / "model.toml"
    file.write_text(model)
    paths = []
    for recording in recordings:
        paths.append(str(folder / recording.name))
        write_recording(recording, Path(paths[-1]))
    result = CliRunner().invoke(cli, ["lab", "explain", str(file), *paths, "--json", "--budget", "600s", *options])
    assert result.exit_code == 0, result.output
    return dict(json.loads(result.stdout))


@pytest.mark.slow
def test_friction_of_the_last_recording_alone_is_told_as_such(tmp_path: Path) -> None:
    """A bearing that rubs in the last recording only is not named, as the fit has not seen it; that far more is left
    there is said, and not where the others rub as well."""
    model = 'base = "joint"\neffects = ["viscous_friction"]\n'
    said = "The samples kept for judging leave"
    for rubs in (0.0, COULOMB):
        recordings = [replace(robot(seed, coulomb=rubs), name=f"r{seed}.csv") for seed in (1, 2)]
        recordings.append(replace(robot(3, coulomb=COULOMB), name="r3.csv"))
        words = " ".join(explained(tmp_path, model, recordings)["words"])
        assert (said in words) is (rubs == 0.0)


@pytest.mark.slow
def test_the_scale_of_a_free_swing_is_held_and_told(tmp_path: Path) -> None:
    """Without a torque the inertia stays at the file's value, whatever that is; no name or error depends on it."""
    recordings = [pendulum(3), pendulum(4)]
    found = []
    for inertia in (0.001, 10.0):
        model = f'base = "joint"\neffects = ["gravity_torque"]\n[parameters]\nJ = {{ value = {inertia} }}\n'
        answer = explained(tmp_path, model, recordings)
        assert answer["scale"] == [{"parameter": "J", "value": inertia, "unit": "kg m^2"}]
        assert "J" not in answer["parameters"]
        found.append(answer)
    first, second = found
    assert first["missing"] == second["missing"]
    assert first["error"]["after"] == pytest.approx(second["error"]["after"], rel=0.02)
    b2 = [one["parameters"]["quadratic_damping.b2"][0] for one in found]
    assert b2[1] / b2[0] == pytest.approx(1e4, rel=0.05)
    assert b2[0] / 0.001 == pytest.approx(0.02, rel=0.2)


@dataclass(frozen=True)
class Asked:
    """Recordings that more than one test asks of, the model file, and what `lab explain --json --curves` said."""

    model: str
    recordings: list[Recording]
    answer: dict[str, Any]
    curves: list[dict[str, Any]]


def asked(folder: Path, base: str, recordings: list[Recording]) -> Asked:
    """A model with nothing in it, asked once."""
    model, curves = f'base = "{base}"\n', folder / "curves.json"
    answer = explained(folder, model, recordings, "--curves", str(curves))
    return Asked(model, recordings, answer, json.loads(curves.read_text()))


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    """A joint in a closed loop."""
    return asked(tmp_path_factory.mktemp("driven"), "joint", [robot(4), robot(5), robot(6)])


@pytest.fixture(scope="module")
def swinging(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    """A pendulum."""
    return asked(tmp_path_factory.mktemp("swinging"), "joint", [pendulum(1), pendulum(2)])


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> Asked:
    """A bar of two modes that rings down."""
    return asked(tmp_path_factory.mktemp("struck"), "oscillator", [ringing(1, 0.8), ringing(2, 0.8)])


@pytest.mark.slow
def test_the_answer_has_its_keys(driven: Asked) -> None:
    """complete, share, columns and an independent noise stand in the answer; shares add up to the fall of the error.
    The torque is drawn, first of the recording that judges: its residual is the error with and without the effects."""
    answer, drawn = driven.answer, driven.curves
    assert [one["column"] for one in drawn] == ["torque"] * 3
    assert PurePath(drawn[0]["recording"]).name.endswith(", not fitted")
    for key, modelled in (("after", "modelled"), ("before", "before")):
        left = np.subtract(drawn[0]["measured"], drawn[0][modelled])
        assert math.sqrt(np.mean(left**2)) == pytest.approx(answer["error"][key], rel=0.05)
    error = answer["error"]
    assert answer["verdict"] == "missing"
    assert error["unit"] == "N m"
    assert answer["columns"]["torque"] == error
    assert sum(answer["share"].values()) == pytest.approx(1 - (error["after"] / error["before"]) ** 2)
    assert error["noise"] < 0.7 * error["after"], "the disturbances are no noise of the sensors"
    assert answer["complete"] is False
    assert answer["residual"]["acts_on"] == "joint"


def turning(seed: int, speed: float, ripple: float, wobble: float, angle: float = 60.0) -> Recording:
    """A shaft that turns by so much at a speed [rad/s] that varies by a tenth, so many times a turn, with a torque of
    friction, a wave of once a turn and a disturbance; its encoder counts from wherever the shaft stood at first."""
    rng = np.random.default_rng(seed)
    times, start = np.arange(0, angle / abs(speed), 0.1 / abs(speed)), rng.uniform(0, 2 * np.pi)
    rate = abs(speed) * wobble * rng.uniform(0.7, 1.4)
    turned = speed * times + 0.1 * speed / rate * (np.cos(rate * times) - 1)
    velocity = speed - 0.1 * speed * np.sin(rate * times)
    acceleration = -0.1 * speed * rate * np.cos(rate * times)
    push = np.convolve(rng.normal(0, 2e-4, times.size), np.ones(5), "same")
    torque = 2e-4 * acceleration + 3e-5 * velocity + 5e-3 * np.sign(velocity) + ripple * np.cos(turned + start) + push
    columns = {"torque": torque, "position": turned + rng.normal(0, 1e-4, times.size) * (times > 0)}
    return Recording(times, columns, {}, name=f"turning{seed}.csv")


SPEEDS = (1.0, -2.0, 4.0, -6.0, 10.0, 2.0)
TURNED = 'base = "joint"\neffects = ["viscous_friction", "coulomb_friction"]\n'


@pytest.mark.slow
@pytest.mark.parametrize("ripple", [8e-4, 0.0])
def test_a_ripple_is_found_by_encoders_that_count_from_where_they_start(ripple: float, tmp_path: Path) -> None:
    """The phase differs from one recording to the next, and is fitted in each; without a ripple that finds none."""
    answer = explained(tmp_path, TURNED, [turning(seed, speed, ripple, 1.0) for seed, speed in enumerate(SPEEDS[:4])])
    assert answer["missing"] == (["torque_ripple"] if ripple else [])
    if ripple:
        assert answer["error"]["after"] < 0.7 * answer["error"]["before"]
        value, low, high = answer["parameters"]["torque_ripple.tau_r"][:3]
        assert low < ripple < high < 1.3 * value


@pytest.mark.slow
def test_a_curve_that_two_speeds_do_not_tell_is_not_named(tmp_path: Path) -> None:
    """Friction of three shapes through two points bends to anything in between: drag was named beside the ripple."""
    turned = [turning(30 + i, speed, 8e-4, 1.0, 250.0) for i, speed in enumerate((10.0, -6.0, -1.0))]
    assert explained(tmp_path, TURNED, turned)["missing"] == ["torque_ripple"]


@pytest.mark.slow
def test_an_inertia_that_hardly_accelerates_stays_where_it_was(tmp_path: Path) -> None:
    """Constant speeds do not tell it; it went to zero, and nothing could be simulated."""
    answer = explained(tmp_path, TURNED, [turning(seed, speed, 0.0, 0.05) for seed, speed in enumerate(SPEEDS[:4])])
    assert answer["missing"] == []
    assert answer["parameters"]["J"][0] > 1e-6


def test_an_angle_in_counts_of_an_encoder(tmp_path: Path) -> None:
    """65536 a turn, as if they were rad: the speeds within which friction changes its sign are beyond their bounds."""
    turned = [turning(seed, speed, 0.0, 1.0) for seed, speed in enumerate((2.0, -2.0))]
    counts = [
        replace(one, columns={**one.columns, "position": np.rint(one.columns["position"] * 65536 / (2 * np.pi))})
        for one in turned
    ]
    assert explained(tmp_path, 'base = "joint"\n', counts)["missing"] == ["coulomb_friction"]


@pytest.mark.slow
def test_a_comparison_of_a_driven_joint_is_one_of_torques(tmp_path: Path) -> None:
    """With the true law, what is left of the torque in a closed loop is its disturbance, and without friction ten
    times as much is left, which follows the speed; simulated with the torque as input, the joint would run away."""
    write_recording(robot(13, length=LONG), tmp_path / "rec.csv")
    found = {}
    for name, effects in (("law", ["viscous_friction", "coulomb_friction"]), ("bare", [])):
        values = {"J": INERTIA, "viscous_friction.b_v": VISCOUS, "coulomb_friction.tau_c": COULOMB}
        model = build_model("joint", effects, {k: v for k, v in values.items() if k.split(".")[0] in ["J", *effects]})
        modelfile.save(modelfile.ModelFile(model.base, model.effects, model.parameters), tmp_path / f"{name}.toml")
        arguments = ["lab", "compare", str(tmp_path / f"{name}.toml"), str(tmp_path / "rec.csv"), "--json"]
        result = CliRunner().invoke(cli, arguments, catch_exceptions=False)
        found[name] = json.loads(result.stdout)
    assert list(found["law"]["columns"]) == ["torque"]
    assert found["law"]["error"]["unit"] == "N m"
    assert found["law"]["columns"]["torque"]["fit_percent"] > 95
    assert found["law"]["error"]["after"] < 0.2
    assert found["bare"]["error"]["after"] > 10 * found["law"]["error"]["after"]
    assert found["bare"]["residual"]["depends_on"][0] == "omega_2"
    assert {row["column"] for row in found["bare"]["recordings"]} == {"torque"}


UNITS = {"torque": (1.0, 0.0, -2.0), "position": (0.0, 0.0, 0.0), "accel": (0.0, 1.0, -2.0)}
"""Powers of the units of torque, length and time in each column; of the torque that of J / T², too."""


def in_units(recording: Recording, inertia: float, length: float, time: float) -> Recording:
    """The same recording in units in which a kg m², a metre and a second are so many."""
    columns = {}
    for name, values in recording.columns.items():
        powers = UNITS[name]
        columns[name] = values * inertia ** powers[0] * length ** powers[1] * time ** powers[2]
    return Recording(recording.time * time, columns, {}, {}, 0, recording.name)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "time"), [("driven", 60.0), ("swinging", 0.01), ("struck", 7.0)])
def test_units_change_nothing(case: str, time: float, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """In other units of inertia, length and time the names, the shares and the errors over the noise are the same.
    Simulated motions 60 times as slow pass, too, but take ten times as long."""
    asked: Asked = request.getfixturevalue(case)
    other = explained(tmp_path, asked.model, [in_units(one, 1e4, 1e3, time) for one in asked.recordings])
    first = asked.answer
    assert first["missing"]
    assert other["missing"] == first["missing"]
    assert other["complete"] == first["complete"]
    for effect, share in first["share"].items():
        assert other["share"][effect] == pytest.approx(share, abs=1e-3)
    for which in ("before", "after"):
        ratio = first["error"][which] / first["error"]["noise"]
        assert other["error"][which] / other["error"]["noise"] == pytest.approx(ratio, rel=1e-2)


def test_the_band_ends_where_the_angle_falls_into_its_noise() -> None:
    """A swing at 0.5 Hz in white noise has a band above it and far below half of the rate; the noise is that put in."""
    rng = np.random.default_rng(0)
    time = np.arange(0, 40, 0.01)
    angle = np.sin(np.pi * time) + 1e-3 * rng.standard_normal(time.size)
    found = Signals.of(Experiment("swing", None, time, {"position": angle}))
    assert 0.5 < found.band_hz < 5.0
    assert np.sqrt(found.position_density * 50) == pytest.approx(1e-3, rel=0.1)
    inside = slice(400, -400)
    assert found.acceleration[inside] == pytest.approx(-(np.pi**2) * np.sin(np.pi * time[inside]), abs=0.15)


OWN = """
import math

from lostmotion.lab import Parameter, effect


@effect(acts_on="joint", parameters={"depth": Parameter(0.5, "N m", 0.0, 50.0, meaning="depth of a detent")})
def detent(theta, depth):
    return -depth * math.sin(12 * theta)
"""


@pytest.mark.slow
def test_an_effect_of_ones_own_is_tried_beside_the_catalogue(tmp_path: Path) -> None:
    """explain --effect FILE.py:function names a user's effect among the others."""
    (tmp_path / "own.py").write_text(OWN)
    answer = explained(
        tmp_path,
        'base = "joint"\n',
        [robot(20), robot(21)],
        "--effect",
        f"{tmp_path / 'own.py'}:detent",
        "--budget",
        "600s",
    )
    assert "detent" in [one["effect"] for one in answer["ranking"]]
    assert "detent" not in answer["missing"]


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_damper_whose_displacement_is_given(sign: float, tmp_path: Path) -> None:
    """Force and displacement of a damper on a shaking table, under other names, pushing or pulling counted as positive:
    viscous and Coulomb friction are named through the command line with their sizes, although the motion tells no
    inertia."""
    rng = np.random.default_rng(6)
    time = np.arange(0, 20, 0.01)
    stroke, speed = np.zeros(time.size), np.zeros(time.size)
    for size, w, phase in zip((0.008, 0.004, 0.003), 2 * np.pi * np.array([0.5, 1.3, 2.9]), (0, 1, 2), strict=True):
        stroke, speed = stroke + size * np.sin(w * time + phase), speed + size * w * np.cos(w * time + phase)
    force = 1400 * speed + 50 * np.tanh(speed / 1e-3) - 130 + rng.normal(0, 2.0, time.size)
    measured = 1e3 * stroke + rng.normal(0, 0.02, time.size)
    np.savetxt(tmp_path / "damper.csv", np.column_stack([time, measured, sign * force]), delimiter=",",
               header="time,stroke,load", comments="")  # fmt: skip
    (tmp_path / "axis.toml").write_text('base = "joint"\n')
    files = [str(tmp_path / name) for name in ("axis.toml", "damper.csv")]
    said = ["--map", "position=stroke:mm", "--map", "torque=load:N", "--json"]
    result = CliRunner().invoke(cli, ["lab", "explain", *files, "--budget", "600s", *said])
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert set(found["missing"]) == {"viscous_friction", "coulomb_friction"}
    values = found["parameters"]
    assert values["viscous_friction.b_v"][0] == pytest.approx(1400, rel=0.05)
    assert values["coulomb_friction.tau_c"][0] == pytest.approx(50, rel=0.1)


def ringing(seed: int, second: float) -> Recording:
    """The accelerometer on a bar that was struck, in closed form: two damped modes of 23 and 71 Hz at any phase."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 0.7, 1e-3)
    modes = ((23.0, 0.008, 3.0), (71.0, 0.012, second))
    felt = sum(
        size * np.exp((-zeta + 1j * math.sqrt(1 - zeta**2)) * 2 * np.pi * f * times + 1j * rng.uniform(0, 2 * np.pi))
        for f, zeta, size in modes
    )
    return Recording(times, {"accel": np.real(felt) + 0.02 * rng.standard_normal(times.size)}, name=f"bar{seed}.csv")


@pytest.mark.slow
def test_a_second_mode_of_a_bar_that_rings_down(struck: Asked, tmp_path: Path) -> None:
    """It begins at any phase, and its frequency and damping are found; nothing is named where there is none."""
    found = struck.answer
    assert found["missing"] == ["second_mode"]
    assert found["complete"]
    low, high = found["parameters"]["second_mode.f2"][1:]
    assert low < 71.0 < high
    assert high - low < 0.5
    assert found["parameters"]["second_mode.zeta2"][0] == pytest.approx(0.012, rel=0.05)
    alone = explained(tmp_path, 'base = "oscillator"\n', [ringing(seed, 0.0) for seed in (3, 4)])
    assert alone["missing"] == []
    assert alone["verdict"] == "nothing_missing"


def lopsided(seed: int) -> Recording:
    """An arm of 3.4 Hz between springs that are not alike rings down from 0.5, and creeps back to its rest by 0.01."""
    rng = np.random.default_rng(seed)
    times, own = np.arange(0.0, 8.0, 4e-3), 2 * math.pi * 3.4

    def moved(t: float, x: np.ndarray) -> list[float]:
        rest = 0.01 * math.exp(-t / 4)
        return [x[1], -(own**2) * ((x[0] - rest) + 0.15 * x[0] ** 2) - 0.4 * x[1]]

    angle = solve_ivp(moved, (0, 8), [0.5, 0.0], "LSODA", times, rtol=1e-8, atol=1e-10).y[0]
    return Recording(times, {"displacement": angle + 4e-4 * rng.standard_normal(times.size)}, name=f"arm{seed}.csv")


@pytest.mark.slow
def test_a_rest_that_creeps_is_no_second_mode(tmp_path: Path) -> None:
    """A mode that is damped so much that it has no resonance is none, whatever it takes of the error."""
    found = explained(tmp_path, 'base = "oscillator"\n', [lopsided(seed) for seed in (1, 2)])
    assert "second_mode" not in found["missing"]
    assert not found["complete"]


@pytest.mark.slow
def test_the_strongest_effect_is_named_first(tmp_path: Path) -> None:
    """A swinging arm without its weight is not even out of phase, so that what stops it takes most of its error alone;
    its weight makes most of the acceleration."""
    found = explained(tmp_path, 'base = "joint"\n', [pendulum(seed, 0.2) for seed in (1, 2)])
    assert found["missing"] == ["gravity_torque", "quadratic_damping"]
    assert 0.9 < sum(found["share"].values()) < 1.01


def test_a_whole_number_is_paid_for_in_the_p_value() -> None:
    """A ripple of 12 periods a turn was chosen among many shapes: its p-value is 156 times that of the test alone, one
    of once a turn twice that; an effect without a whole number pays nothing."""
    model = build_model("joint", ["torque_ripple", "coulomb_friction"])
    once = model.replace({"torque_ripple.N": 1.0})
    assert shapes_tried("torque_ripple", model) == 156
    assert shapes_tried("torque_ripple", once) == 2
    assert shapes_tried("coulomb_friction", model) == 1


@pytest.mark.slow
def test_a_joint_that_mostly_rests() -> None:
    """At rest dry friction may have any value up to its largest: Coulomb friction is named, right to a tenth, although
    the joint stands still for most of the time, under a torque that goes on."""
    recordings = []
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        times = np.arange(0.0, 40.0, 0.01)
        lively = (times % 20) < 6  # 6 of 20 s
        speed = gaussian_filter1d(0.3 * np.sign(np.sin(2 * np.pi * times / rng.uniform(1.5, 2.5))) * lively, 8)
        angle = np.cumsum(speed) * 0.01
        friction = np.where(np.abs(speed) > 1e-3, 0.5 * np.sign(speed), 0.4 * np.sin(2 * np.pi * times / 11))
        torque = 0.02 * np.gradient(speed, 0.01) + 0.2 * speed + friction + 0.01 * rng.standard_normal(times.size)
        columns = {"torque": torque, "position": angle + 1e-4 * rng.standard_normal(times.size)}
        recordings.append(Recording(times, columns, {}, {}, 0, f"resting{seed}.csv"))
    model = build_model("joint", ["viscous_friction"])
    held = experiments(model, recordings)
    signals = [Signals.of(one) for one in held]
    found = selected(WholeMotion(Method.TORQUE, model, signals), lambda what, part: None)
    assert found.added == ("coulomb_friction",)
    assert found.fits[-1].model.parameters["coulomb_friction.tau_c"].value == pytest.approx(0.5, rel=0.1)


@pytest.mark.parametrize(("inertia", "play", "runs"), [(0.4, 1e-2, True), (0.4, 4e-5, True), (1e-13, 1e-2, False)])
def test_a_model_without_inertia_cannot_run(inertia: float, play: float, runs: bool) -> None:
    """A play of 40 µrad, of which a second takes 50 million steps, can be simulated."""
    values = {"J": inertia, "viscous_friction.b_v": VISCOUS}
    values |= {f"friction_behind_play.{name}": v for name, v in (("tau_p", COULOMB), ("e", play), ("c", 0.08))}
    model = build_model("joint", ["viscous_friction", "friction_behind_play"], values)
    assert can_run(model, [Signals.of(one) for one in experiments(model, [robot(1)])]) is runs
