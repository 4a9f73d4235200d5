"""Recordings that a fit can use, and those that it cannot: one clear line, exit status 2, nothing written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording, read_recording, write_recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.errors import ExperimentError
from lostmotion.model import HandWaved, Sampled, build_model
from lostmotion.model.motion import FloatArray

RATE_HZ = 800.0
TIMES = np.arange(801) / RATE_HZ
COMMAND = HandWaved(seed=1).position(TIMES)
ACCEL = 3 * np.sin(40 * TIMES) + np.random.default_rng(0).normal(0, 0.1, TIMES.size)


def recording(times: FloatArray = TIMES, metadata: dict[str, object] | None = None, **columns: FloatArray) -> Recording:
    """Columns over time, under the name that the messages begin with."""
    return Recording(times, columns, metadata or {}, name="rec.csv")


def held(base: str, *recordings: Recording) -> tuple[Experiment, ...]:
    """The experiments for a base of default parameters."""
    return experiments(build_model(base), recordings)


def changed(values: FloatArray, where: slice | int, value: float) -> FloatArray:
    """A copy with some values replaced."""
    values = values.copy()
    values[where] = value
    return values


def without(first: int, last: int, **columns: FloatArray) -> Recording:
    """The recording with some rows missing."""
    keep = np.ones(TIMES.size, bool)
    keep[first:last] = False
    return recording(TIMES[keep], **{name: values[keep] for name, values in columns.items()})


BAD = {
    "no command": ("play", recording(accel=ACCEL), "found accel, expected 'command'; it drives the base 'play'"),
    "no output": ("play", recording(command=COMMAND), "found command, expected at least one of accel, position, force"),
    "empty output": ("joint", recording(torque=COMMAND, position=TIMES * np.nan), "found no number in position"),
    "only gaps": (
        "play",
        recording(np.repeat(np.arange(9.0), 40) + np.tile(np.arange(40), 9) / RATE_HZ,
                  command=COMMAND[:360], accel=ACCEL[:360]),
        "samples of command between two gaps: found 40 at most, expected at least 50",
    ),
    "infinite command": (
        "play",
        recording(command=changed(COMMAND, 80, np.inf), accel=ACCEL),
        "command at 0.1 s is not finite, expected numbers",
    ),
    "infinite output": (
        "play",
        recording(command=COMMAND, accel=changed(ACCEL, 7, -np.inf)),
        "accel holds a value that is not finite, expected numbers or empty cells",
    ),
    "flat": (
        "play",
        recording(command=COMMAND, accel=changed(ACCEL, slice(None), 9.81)),
        "accel is flat at 9.81, expected a signal that moves; is the sensor connected?",
    ),
    "saturated": (
        "play",
        recording(command=COMMAND, accel=np.clip(ACCEL, -1, 1)),
        "of accel stands at its largest or smallest value; expected a signal within the sensor's range",
    ),
    "10 samples": (
        "play",
        recording(TIMES[:10], command=COMMAND[:10], accel=ACCEL[:10]),
        "samples of command: found 10, expected at least 50; is the recording too short?",
    ),
    "10 samples without input": (
        "oscillator",
        recording(TIMES[:10], displacement=ACCEL[:10]),
        "usable samples of displacement: found 10, expected at least 50; is the recording too short",
    ),
    "input and output at different times": (
        "play",
        recording(
            command=changed(COMMAND, slice(400, None), np.nan), accel=changed(ACCEL, slice(None, 401), np.nan)
        ),
        "usable samples of accel: found 0, expected at least 50",
    ),
    "text for a number": (
        "servo",
        recording(command=COMMAND, position=0.9 * COMMAND, metadata={"kp": "stiff"}),
        "# kp: found 'stiff', expected a number",
    ),
    "a goal that is what was reached": (
        "servo",
        recording(command=COMMAND, position=np.concatenate([COMMAND[:1], COMMAND[:-1]])),
        "found a command that is the position 1 row(s) later, expected the goal that was sent",
    ),
}  # fmt: skip


def run(*args: object) -> Result:
    """The program with these arguments."""
    return CliRunner().invoke(cli, [str(arg) for arg in args])


@pytest.mark.parametrize(("base", "bad", "message"), BAD.values(), ids=BAD.keys())
def test_refused_by_the_library(base: str, bad: Recording, message: str) -> None:
    """The line names the recording, what was found and what was expected."""
    with pytest.raises(ExperimentError) as caught:
        held(base, bad)
    assert str(caught.value).startswith("rec.csv: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


IN_A_FILE = {name: case for name, case in BAD.items() if not name.startswith("infinite")}


@pytest.mark.parametrize(("base", "bad", "message"), IN_A_FILE.values(), ids=IN_A_FILE.keys())
def test_refused_by_the_command_line(base: str, bad: Recording, message: str, tmp_path: Path) -> None:
    """The same line from the file, with exit status 2, for each of the three commands; no model is written."""
    file, out = tmp_path / "rec.csv", tmp_path / "out.toml"
    write_recording(bad, file)
    for command in (("explain",), ("fit", "-o", out), ("improve", "-o", out)):
        result = run("lab", *command, base, file)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert result.stderr.count("\n") == 1
        assert f"{file}: " in result.stderr
        assert message in result.stderr
    assert not out.exists()


@pytest.mark.parametrize("cell", ["inf", "-1e999", "1,5"])
def test_cell_that_is_no_number(cell: str, tmp_path: Path) -> None:
    """The line of the file and the cell are named."""
    file = tmp_path / "rec.csv"
    write_recording(recording(command=COMMAND, accel=ACCEL), file)
    lines = file.read_text().splitlines()
    fields = lines[100].split(",")
    lines[100] = ",".join([*fields[:2], f'"{cell}"'])
    file.write_text("\n".join(lines))
    result = run("lab", "explain", "play", file)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert f"line 101: found {cell!r} in the column 'accel', expected a" in result.stderr


@pytest.mark.parametrize(
    ("model", "file", "message"),
    [("gears", "rec.csv", "gears"), ("play", "none.csv", "none.csv: cannot be read: No such file")],
    ids=["model", "recording"],
)
def test_files_that_are_not_there(model: str, file: str, message: str, tmp_path: Path) -> None:
    """A model file or a recording of that name does not exist: one line too."""
    write_recording(recording(command=COMMAND, accel=ACCEL), tmp_path / "rec.csv")
    result = run("lab", "explain", model, tmp_path / file)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert message in result.stderr


def test_signals_of_different_rates() -> None:
    """Commands at 100 Hz drive outputs at 800 Hz; rows without an output are none, a second output keeps its gaps."""
    slow = np.arange(TIMES.size) % 8 == 0
    rows = recording(
        command=np.where(slow, COMMAND, np.nan),
        accel=changed(ACCEL, slice(100, 108), np.nan),
        position=np.where(np.arange(TIMES.size) % 4 == 0, COMMAND, np.nan),
    )
    (experiment,) = held("play", rows)
    assert isinstance(experiment.drive, Sampled)
    np.testing.assert_array_equal(experiment.drive.time, TIMES[slow])
    assert experiment.rate_hz == pytest.approx(RATE_HZ)
    assert experiment.time.size == TIMES.size - 6  # of the eight rows without accel two have a position
    assert np.sum(~np.isnan(experiment.measured["accel"])) == TIMES.size - 8
    assert np.sum(~np.isnan(experiment.measured["position"])) == 201
    np.testing.assert_allclose(experiment.drive.position(TIMES), COMMAND, atol=1e-4)


def test_output_outside_of_the_input_is_left_out() -> None:
    """Before the first and after the last command nothing is known of the motion."""
    known = changed(changed(COMMAND, slice(0, 80), np.nan), slice(721, None), np.nan)
    (experiment,) = held("play", recording(command=known, accel=ACCEL))
    assert experiment.time[0] == TIMES[80]
    assert experiment.time[-1] == TIMES[720]
    assert experiment.duration == pytest.approx(0.8)


def test_repeated_times_count_once() -> None:
    """A row that repeats the time before it, as merged files may have, is left out of input and output."""
    times = changed(TIMES, 200, TIMES[199])
    (experiment,) = held("play", recording(times, command=COMMAND, accel=ACCEL))
    assert experiment.time.size == TIMES.size - 1
    assert np.all(np.diff(experiment.time) > 0)


def test_metadata_set_what_is_fixed() -> None:
    """Each recording states its own gain; a free parameter is not taken from the metadata."""
    first, second = (
        recording(command=COMMAND, position=0.9 * COMMAND, metadata={"kp": gain, "J": 7.0}) for gain in (8, 16.5)
    )
    model = build_model("servo")
    gains = [e.model(model).parameters["kp"].value for e in experiments(model, [first, second])]
    assert gains == [8.0, 16.5]
    assert experiments(model, [first])[0].model(model).parameters["J"].value == model.parameters["J"].value


def test_segment_between_two_times() -> None:
    """From the first time on, up to but without the second; the input stays whole."""
    (whole,) = held("play", recording(command=COMMAND, accel=ACCEL))
    part = whole.between(0.25, 0.5)
    np.testing.assert_array_equal(part.time, TIMES[200:400])
    np.testing.assert_array_equal(part.measured["accel"], ACCEL[200:400])
    assert part.drive is whole.drive
    assert part.clock_zero == whole.clock_zero == 0.0


def test_a_joint_may_stand_still_at_the_end_of_its_motion() -> None:
    """A servo that holds its last position is not saturated, although that is its largest value."""
    moved = recording(command=TIMES, position=np.minimum(2 * TIMES, TIMES[-1]))
    assert held("servo", moved)[0].time.size == TIMES.size


def test_a_torque_of_zeros_is_none(caplog: pytest.LogCaptureFixture) -> None:
    """A robot's log has a column of it; a gap in it leaves nothing out of the motion, and a current is taken."""
    zeros = changed(np.zeros(TIMES.size), slice(200, 400), np.nan)
    (free,) = held("joint", recording(position=ACCEL, torque=zeros))
    assert free.drive is None
    assert free.time.size == TIMES.size
    assert "the torque is zero throughout" in caplog.text
    (driven,) = held("joint", recording(position=ACCEL, torque=zeros, current=COMMAND))
    assert isinstance(driven.drive, Sampled)
    assert driven.drive_unit == "A"


def test_a_voltage_that_differs_between_recordings_is_the_motors() -> None:
    """A step from rest in each, of sizes of its own and both signs: no supply; of one size it may be one."""
    steps = [recording(position=ACCEL, voltage=np.full(ACCEL.size, size)) for size in (6.0, -2.0, 12.0)]
    assert [one.drive_unit for one in experiments(build_model("joint"), steps)] == ["V"] * 3
    assert [one.drive for one in experiments(build_model("joint"), steps[:1] * 2)] == [None] * 2


def test_the_voltage_of_a_motor_is_taken_for_its_torque(caplog: pytest.LogCaptureFixture) -> None:
    """A motor's stands at zero sometimes, or is switched about an operating point; a supply, which falls by a fifth,
    drives nothing."""
    (driven,) = held("joint", recording(position=ACCEL, voltage=np.maximum(COMMAND, 0.0)))
    assert isinstance(driven.drive, Sampled)
    assert driven.drive_unit == "V"
    assert "the motor's voltage is taken for it" in caplog.text
    (switched,) = held("joint", recording(position=ACCEL, voltage=2.1 + 0.6 * np.sign(ACCEL)))  # about 2.1 V
    assert switched.drive_unit == "V"
    bare = recording(position=ACCEL, voltage=11.0 + np.sign(ACCEL))
    (free,) = held("joint", replace(bare, metadata={"imported": {"voltage": "u"}}))
    assert free.drive is None
    assert "as that of a supply; the part is taken to move freely" in caplog.text
    assert "give its torque: --map torque=u" in caplog.text


def test_free_oscillation_needs_no_input() -> None:
    """An oscillator that rings by itself is an experiment without a drive."""
    (experiment,) = held("oscillator", recording(accel=ACCEL))
    assert experiment.drive is None
    assert tuple(experiment.measured) == ("accel",)


def test_a_position_is_the_displacement_of_an_oscillator(caplog: pytest.LogCaptureFixture) -> None:
    """Where there is no other motion, and this is told."""
    times = np.arange(0.0, 3.0, 0.01)
    (one,) = experiments(build_model("oscillator"), [Recording(times, {"position": np.cos(9 * times)}, name="p.csv")])
    assert list(one.measured) == ["displacement"]
    assert "no displacement was found; the position is taken for it, so that m stands for rad" in caplog.text


def test_an_acceleration_that_a_logger_derives_gives_way_to_its_position(caplog: pytest.LogCaptureFixture) -> None:
    """As of a motion sensor: its acceleration is that of its position, in whatever window.  An accelerometer of another
    part, or in other units, is not."""
    times = np.arange(0.0, 12.0, 0.01)
    position = 0.1 * np.exp(-times / 9) * np.cos(8.4 * times)
    rounded = np.round(position, 4)
    derived = np.convolve(np.gradient(np.gradient(rounded, times), times), np.ones(9) / 9, "same")
    columns = {"position": rounded, "accel": derived}
    (one,) = experiments(build_model("oscillator"), [Recording(times, columns, name="p.csv")])
    assert list(one.measured) == ["displacement"]
    np.testing.assert_allclose(one.measured["displacement"], rounded)
    assert "accel is the second derivative of position" in caplog.text
    for other in (2 * derived, np.cos(30 * times)):
        (one,) = experiments(build_model("oscillator"), [Recording(times, {**columns, "accel": other}, name="q.csv")])
        assert list(one.measured) == ["accel"]
    chosen = {"imported": {"accel": "Acceleration", "accel_given": True}}
    (one,) = experiments(build_model("oscillator"), [Recording(times, columns, chosen, name="r.csv")])
    assert list(one.measured) == ["accel"]


def test_an_oscillator_takes_no_number_for_degrees(caplog: pytest.LogCaptureFixture) -> None:
    """A swing of 68 was read as that of a pendulum: it is the file's number that moves."""
    times = np.arange(0.0, 3.0, 0.01)
    metadata = {"imported": {"position": "column2", "position_assumed": "deg"}}
    swing = Recording(times, {"position": np.radians(68 * np.cos(9 * times))}, metadata, name="p.csv")
    (one,) = experiments(build_model("oscillator"), [swing])
    np.testing.assert_allclose(one.measured["displacement"], 68 * np.cos(9 * times), atol=1e-9)
    assert "but its numbers as m; if they are in mm, use --map displacement=column2:mm" in caplog.text
    (turns,) = experiments(build_model("joint"), [swing])
    np.testing.assert_allclose(turns.measured["position"], np.radians(68 * np.cos(9 * times)), atol=1e-9)


@pytest.mark.parametrize("place", [{"displacement": "m"}, {"position": "m"}])
def test_a_force_drives_a_linear_axis(place: dict[str, str], caplog: pytest.LogCaptureFixture) -> None:
    """As of a damper on a test bench: without its force it would be taken to move freely.  An angle has no force."""
    times = np.arange(0.0, 3.0, 0.01)
    ((name, unit),) = place.items()
    columns = {name: np.cos(9 * times), "force": np.sin(9 * times)}
    damper = Recording(times, columns, {f"{name}_unit": unit}, name="d.csv")
    (one,) = experiments(build_model("joint"), [damper])
    assert one.is_linear
    assert one.drive_unit == ""
    assert isinstance(one.drive, Sampled)
    assert one.drive.values == pytest.approx(np.sin(9 * times), abs=1e-12)
    assert "no torque was found; the force is taken for it" in caplog.text
    (arm,) = experiments(build_model("joint"), [Recording(times, {**columns, "position": times}, name="arm.csv")])
    assert arm.drive is None


def test_rounded_times_of_the_outputs_are_evened() -> None:
    """30 frames a second, stamped to 10 ms, give even steps."""
    frames = np.arange(300) / 30
    stamped = Recording(np.round(frames, 2), {"position": np.cos(frames)}, name="film.csv")
    (one,) = experiments(build_model("joint"), [stamped])
    assert np.diff(one.time) == pytest.approx(1 / 30, rel=0.03)


def test_a_clock_that_stops_at_the_end(caplog: pytest.LogCaptureFixture) -> None:
    """An actuator's log repeated each reading 15 times, and its clock stood for the last 250 rows.  Of 745 readings
    four were used, as evened times were compared with those of the rows between them."""
    count, read = 11_000, 15
    times = np.minimum(np.round(np.arange(count) * 1e-3, 3), 10.75)
    angle = np.sin(4 * (np.arange(count) // read * read) * 1e-3)
    torque = np.cos(4 * np.arange(count) * 1e-3)
    (one,) = experiments(
        build_model("joint"), [Recording(times, {"position": angle, "torque": torque}, name="arm.csv")]
    )
    assert one.time.size == pytest.approx(10.75 / (read * 1e-3), abs=3)
    assert np.diff(one.time) == pytest.approx(read * 1e-3, rel=0.2)
    assert "the last 250 rows have one time, 10.75 s, and are left out" in caplog.text


def test_a_torque_is_not_held_in_a_gap(caplog: pytest.LogCaptureFixture) -> None:
    """One that is the same on both sides by chance: an actuator's log began with a reading of 0.4 s before, of another
    angle, and left 138 N m instead of 0.31."""
    times = np.concatenate([[0.0], 0.4 + np.arange(800) / 400])
    torque = np.concatenate([[0.0], np.sin(np.arange(800) / 20)])
    (one,) = experiments(
        build_model("joint"), [Recording(times, {"position": torque, "torque": torque}, name="arm.csv")]
    )
    assert one.time[0] >= 0.4
    assert "torque has a gap of 0.4 s at 0 s" in caplog.text


def test_the_longest_part_without_a_gap_is_used(caplog: pytest.LogCaptureFixture) -> None:
    """Of a recording whose input is missing for 41 samples the longer part is taken, and this is said."""
    (found,) = held("play", without(300, 340, command=COMMAND, accel=ACCEL))
    assert found.time[[0, -1]] == pytest.approx([340 / RATE_HZ, 800 / RATE_HZ])
    assert "command has a gap of 0.0512 s at 0.37375 s" in caplog.text
    assert "used from 0.425 to 1 s" in caplog.text


def test_the_gaps_beside_the_part_that_is_used(caplog: pytest.LogCaptureFixture) -> None:
    """A wider gap elsewhere is not what ends it."""
    times = np.arange(1200) / 100
    times[100:] += 5.0
    times[500:] += 0.4
    torque = np.sin(times)
    experiments(build_model("joint"), [Recording(times, {"position": torque, "torque": torque}, name="arm.csv")])
    assert "torque has a gap of 0.41 s at 9.99 s" in caplog.text
    assert "5.01" not in caplog.text


def test_a_recording_that_is_mostly_gaps_is_refused() -> None:
    """Sixty bursts of up to a second, seconds apart: the longest would be a thirtieth of the recording."""
    rng, time, start = np.random.default_rng(3), list[float](), 0.0
    for rows in rng.integers(10, 100, 60):
        time += [start + 0.01 * row for row in range(rows)]
        start = time[-1] + rng.uniform(1.0, 40.0)
    steps = Recording(np.array(time), {"position": np.sin(time), "torque": np.cos(time)}, name="steps.csv")
    with pytest.raises(ExperimentError, match=r"59 gaps of more than 20 sample spacings, and only 9\d of 3\d+ rows"):
        experiments(build_model("joint"), [steps])


def test_a_goal_that_is_the_same_after_a_gap_was_held_in_it(caplog: pytest.LogCaptureFixture) -> None:
    """Steps of a servo, whose log pauses every tenth of a second for longer than 20 samples: all of it is used."""
    goal = np.where(TIMES % 0.5 < 0.25, 0.3, 0.0)
    kept = (TIMES % 0.1 < 0.06) | (np.abs(np.gradient(goal)) > 0)
    steps = Recording(TIMES[kept], {"command": goal[kept], "position": np.roll(goal, 40)[kept]}, {}, name="rec.csv")
    (found,) = held("servo", steps)
    assert found.time[-1] == TIMES[kept][-1]
    assert "gap" not in caplog.text


@pytest.mark.parametrize("command", [("compare",), ("fit", "-o", "out.toml"), ("explain",)])
def test_gears_that_were_sampled_too_slowly(command: tuple[str, ...], tmp_path: Path) -> None:
    """Ten samples a second tell nothing of teeth (times in milliseconds look like that): one line says so, and what can
    be asked instead."""
    path, model = tmp_path / "slow.csv", tmp_path / "gears.toml"
    times = np.arange(270) / 10
    goal = 0.15 * np.sign(np.sin(0.5 * times))
    noise = np.random.default_rng(2).normal(0, 1e-3, times.size)
    write_recording(recording(times, command=goal, position=0.9 * goal + noise), path)
    model.write_text('base = "play"\n')
    result = run("lab", command[0], model, path, *command[1:])
    assert result.exit_code == 2
    assert "slow.csv: found 10 samples a second, expected at least 32" in result.stderr
    assert "the base 'joint'" in result.stderr


@pytest.mark.parametrize(("base", "first", "last"), [("servo", 0, 499), ("joint", 500, 800)])
def test_a_servo_that_is_let_go(base: str, first: int, last: int, caplog: pytest.LogCaptureFixture) -> None:
    """A servo is compared while its motor is on, a joint that moves freely while it is off; a warning says which."""
    columns = {"position": COMMAND} | ({"command": COMMAND} if base == "servo" else {})
    enabled = ["1"] * 500 + ["0"] * (TIMES.size - 500)
    (found,) = held(base, Recording(TIMES, columns, extra={"torque_enabled": enabled}, name="rec.csv"))
    assert found.time[[0, -1]] == pytest.approx(TIMES[[first, last]])
    assert f"from {TIMES[first]:.3g} to {TIMES[last]:.3g} s" in caplog.text


def test_the_voltage_of_a_sensor_is_the_motion_of_an_oscillator(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Where it is all that there is; the unit is told.  Beside another column it may drive
    something."""
    time = np.arange(400) / 50
    path = tmp_path / "seismometer.txt"
    volts = np.exp(-0.2 * time) * np.sin(5 * time)
    path.write_text(
        "Time ( s )\tVoltage ( V )\n" + "".join(f"{t}\t{v:.5f}\n" for t, v in zip(time, volts, strict=True))
    )
    model = build_model("oscillator")
    for terms in ([], ["displacement=Voltage ( V )"]):
        caplog.clear()
        (one,) = experiments(model, [read_recording(path, terms=terms)])
        assert one.measured["displacement"] == pytest.approx(volts, abs=1e-5)
        assert "the displacement is in V, so that m stands for V" in caplog.text
        assert ("nothing but a voltage" in caplog.text) is (not terms)
    both = Recording(time, {"voltage": volts, "current": volts}, name="both.csv")
    with pytest.raises(ExperimentError, match=r"found voltage, current, expected at least one of displacement, accel"):
        experiments(model, [both])


def test_a_refusal_repeats_what_the_reader_says_of_a_speed(tmp_path: Path) -> None:
    """A drive that reports speed and torque, the speed without a unit: the line to type integrates it."""
    path = tmp_path / "drive.csv"
    lines = "".join(f"{t / 100},{np.sin(t / 9):.4f},{np.cos(t / 9):.4f}\n" for t in range(300))
    path.write_text("Time,Servo motor speed,Torque\n" + lines)
    with pytest.raises(ExperimentError, match=r"--map 'position=Servo motor speed:rpm' .* integrates a speed"):
        experiments(build_model("joint"), [read_recording(path)])
    (one,) = experiments(build_model("joint"), [read_recording(path, terms=["position=Servo motor speed:rpm"])])
    assert one.is_driven
