"""Motors and arms as people log them: no name tells the angle, or what drives it, but the numbers do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from lostmotion.drivers.formats.rates import rates
from lostmotion.drivers.formats.read import imported
from lostmotion.drivers.formats.source import Choice
from lostmotion.drivers.formats.words import is_input
from lostmotion.drivers.recording import read_recording
from tests.drivers.test_formats import read, refused
from tests.drivers.test_formats_as_saved import rows

T = np.arange(600) / 100
INPUT = np.sign(np.sin(1.3 * T)) * 40.0
SPEED = 30 * np.sin(1.3 * T) + 4 * np.sin(7 * T)
"""of a motor [rad/s]"""
ANGLE = np.concatenate([[0.0], np.cumsum((SPEED[1:] + SPEED[:-1]) / 200)])


def arm() -> list[np.ndarray]:
    """Three angles, their speeds and torques, as a robot's interface logs them."""
    angles = [np.sin((1 + 0.3 * joint) * T) + 0.3 * np.cos((3 + joint) * T) for joint in range(3)]
    speeds = [np.gradient(angle, 0.01) for angle in angles]
    return [*angles, *speeds, *(np.sign(speed) + 5 * np.gradient(speed, 0.01) for speed in speeds)]


@pytest.mark.parametrize("factor", [1.0, 180 / np.pi, 6.0])
def test_the_angle_of_a_motor_is_what_its_speed_changes(factor: float, tmp_path: Path) -> None:
    """``alpha`` may be anything, but ``vel`` is how fast it changes, and in which unit; ``final_u`` drives it."""
    path = tmp_path / "motor.mat"
    scipy.io.savemat(path, {"alpha": factor * ANGLE, "final_u": INPUT, "t": T, "vel": SPEED})
    found = read(path)
    unit = 1.0 if factor == 1 else np.pi / 180
    assert found.recording.columns["position"] == pytest.approx(unit * factor * ANGLE)
    assert found.recording.columns["voltage"] == pytest.approx(INPUT)
    assert [one.why for one in found.columns] == ["vel is how fast it changes", "the motor's input, by its name"]


def test_the_columns_of_an_array_need_no_names(tmp_path: Path) -> None:
    """Of ``data``, with times, a goal, angle, speed and torque, the speed tells the angle; the times ascend evenly."""
    path = tmp_path / "motor.mat"
    scipy.io.savemat(path, {"data": np.stack([T, 0 * T, ANGLE, SPEED, INPUT], axis=1), "Iz": np.full(T.size, -0.006)})
    found = read(path, "torque=data[4]")
    assert [(one.column, one.series) for one in found.columns] == [("position", "data[2]"), ("torque", "data[4]")]
    assert found.clock == "data[0] [s]"
    push = np.sin(3 * T)
    scipy.io.savemat(path, {"data": np.stack([T, 0 * T, ANGLE, SPEED, push], axis=1), "Iz": np.full(T.size, -0.006)})
    told = "data[4] is not used, and the motion is taken as free; if data[4] drives it, use --map"
    assert any(told in note for note in read(path).notes)


def test_an_input_is_taken_once_and_beside_a_motion_only(tmp_path: Path) -> None:
    """Of two inputs the plainest, or none; none where a torque is known; and alone it is a motion."""
    path = tmp_path / "log.csv"
    for header, series in (("t,q,pwm,data.input", "pwm"), ("t,q,tau,u", ""), ("t,q,left_pwm,right_pwm", "")):
        path.write_text(header + "\n" + rows(T, ANGLE, INPUT, INPUT / 2, sign=","))
        found = read(path)
        assert [one.series for one in found.columns if one.column == "voltage"] == ([series] if series else [])
    assert "voltage: found several inputs, left_pwm, right_pwm; choose with --map" in "".join(found.notes)
    path.write_text("t,u\n" + rows(T, 0.3 * np.sin(8 * T), sign=","))
    assert [one.column for one in read(path).columns] == ["position"]
    assert all(map(is_input, ("LPWM", "RPWM")))  # of a driver with a half bridge for each direction
    assert [name for name in ("u", "U1", "control_input", "control_mode", "input_voltage") if is_input(name)] == [
        "u", "U1", "control_input",
    ]  # fmt: skip


def test_the_difference_of_two_series(tmp_path: Path) -> None:
    """Of encoders before and behind a gear, if it is asked for; of the inputs of two half bridges without."""
    path = tmp_path / "log.csv"
    path.write_text("t,motor (deg),out - put (deg)\n" + rows(T, 30 * ANGLE, 20 * ANGLE, sign=","))
    found = read(path, "position=motor (deg) - out - put (deg)").recording
    np.testing.assert_allclose(found.columns["position"], np.radians(10 * ANGLE), atol=1e-5)
    path.write_text("t,q,LPWM,RPWM\n" + rows(T, ANGLE, np.maximum(-INPUT, 0), np.maximum(INPUT, 0), sign=","))
    found = read(path).recording
    np.testing.assert_allclose(found.columns["voltage"], INPUT, atol=1e-4)
    np.testing.assert_allclose(
        read(path, "voltage=LPWM").recording.columns["voltage"], np.maximum(-INPUT, 0), atol=1e-4
    )


def test_positions_of_an_arm_without_names_are_told(tmp_path: Path) -> None:
    """Six columns are three positions and their speeds: the line to type names them, and the rate."""
    path = tmp_path / "arm.csv"
    columns = arm()
    path.write_text(rows(*columns, sign=","))
    told = refused(path)
    assert "column4 is how fast column1 changes, column5 is how fast column2 changes, column6 is how fast" in told
    assert told.endswith(
        "if there are 100 rows a second: 'FILE#rate-hz=100,position=column1', and a torque as torque=SERIES"
    )
    found = read(path, "position=column1", "torque=column7", rate_hz=100).recording
    assert found.columns["position"] == pytest.approx(columns[0], abs=1e-5)
    path.write_text(rows(columns[0], columns[3], columns[6], sign=","))
    told = refused(path)
    assert told.endswith(" 'FILE#rate-hz=100,position=column1,torque=column3', if column3 is the torque")
    found = read(path, "position=column1", "torque=column3", rate_hz=100).recording
    assert found.columns["torque"] == pytest.approx(columns[6], abs=1e-5)
    path.write_text(rows(T, *columns, sign=","))
    assert "assign one of them, as in --map position=column2, and what drives it" in refused(path)


@pytest.mark.parametrize("noise", [0.0, 0.3, 1.0])
def test_noise_of_a_speed_does_not_hide_degrees(noise: float) -> None:
    """A speed with as much noise as motion makes the regression 4 to 15 % too small; 60 is a gear, and no degrees."""
    time = np.arange(4000) / 100
    angle, speed = np.sin(3 * time) + np.sin(1.3 * time), 3 * np.cos(3 * time) + 1.3 * np.cos(1.3 * time)
    read = speed + noise * speed.std() * np.random.default_rng(1).standard_normal(time.size)
    (rate,) = rates({"alpha": np.degrees(angle), "vel": read}, time)
    assert rate.unit == "deg"
    (rate,) = rates({"alpha": 2 * np.degrees(angle), "vel": read}, time)
    assert rate.unit == ""
    if not noise:
        (rate,) = rates({"alpha": 60 * angle, "vel": read}, time)
        assert rate.unit == ""


def test_a_speed_and_a_torque_are_no_position() -> None:
    """A torque is how fast a speed changes, too, but not in its unit: without names nothing is taken."""
    speed = np.cumsum(INPUT) / 100
    assert [rate.of for rate in rates({"column2": speed, "column3": INPUT}, T)] == ["column2"]
    assert not rates({"column2": 7 * speed, "column3": INPUT}, T)


def test_numbers_in_a_column_alone_need_a_rate(tmp_path: Path) -> None:
    """No header and no times: the one option that is missing is told, also where every line ends with a tab."""
    path = tmp_path / "data0000.txt"
    for end in ("\n", "\t\n"):
        path.write_text(rows(0.03 * np.cos(8 * T), sign=",").replace("\n", end))
        assert refused(path).endswith(
            "found column1, and no times; give the rows a second, if there are 100: FILE#rate-hz=100"
        )
    assert read(path, rate_hz=200).recording.time[-1] == pytest.approx(599 / 200)


def test_structures_with_times_of_their_own(tmp_path: Path) -> None:
    """Simulink's "Structure With Time": an input that is known once a second holds, and ``time`` is no joint."""
    path = tmp_path / "base.mat"
    seconds = np.arange(6)
    scope = {"time": T, "signals": {"values": ANGLE, "dimensions": 1, "label": "Angle"}, "blockName": "ip/Angle"}
    speed = {"time": T + 1e-9, "signals": {"values": SPEED, "dimensions": 1}}
    test = {"motorAngle": scope, "motorSpeed": speed, "voltage": {"PWM": 10 * seconds, "time": seconds}}
    scipy.io.savemat(path, {"test": test})
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(ANGLE)
    assert found.recording.columns["voltage"] == pytest.approx(10 * np.floor(T + 1e-9))
    assert "test.voltage.PWM: sampled at other times; each value is held until the next one" in found.notes


def test_an_angle_that_does_not_change_and_times_that_do_not(tmp_path: Path) -> None:
    """The angle at which a bench is set is no motion: the note names the speed; a date to the minute is no time."""
    path = tmp_path / "bench.csv"
    path.write_text("time,bench_angle,vel,cur\n" + rows(T, 0 * T + 1.5708, SPEED, INPUT, sign=","))
    notes = read(path).notes
    assert "left out, as it never changes: bench_angle" in notes
    assert "position: none; --map position=vel:rpm (or :rad/s) integrates a speed" in notes
    path.write_text("Timestamp,pos\n" + "".join(f"13/05/2024 0:53,{angle:.4f}\n" for angle in ANGLE))
    assert "found the same time in 'Timestamp' in all 600 rows" in refused(path)
    assert read(path, rate_hz=100).recording.columns["position"] == pytest.approx(ANGLE, abs=1e-4)


def test_a_goal_and_its_speed_are_no_angle_without_a_name(tmp_path: Path) -> None:
    """What was measured moves as the goal does, but its speed is too rough to tell: one of them must be named."""
    path = tmp_path / "friction.txt"
    rough = np.degrees(ANGLE) + 3 * np.random.default_rng(3).standard_normal(T.size)
    path.write_text(rows(T, rough, ANGLE, SPEED, INPUT, sign=" "))
    told = refused(path)
    assert "column4 is how fast column3 changes, as column2 does: assign one of them, as in --map position=" in told
    assert "or a servo's goal, as in --map command=SERIES" in told


def test_a_header_as_ours_with_the_input_of_a_motor(tmp_path: Path) -> None:
    """``time`` and ``position`` may be another program's, too: what drives the motor is not left out."""
    path = tmp_path / "cart.csv"
    path.write_text("time,position,angle,control_input\n" + rows(T, ANGLE, 0 * T, INPUT, sign=","))
    assert [one.series for one in imported(path, Choice()).columns] == ["position", "control_input"]
    assert read_recording(path).columns["voltage"] == pytest.approx(INPUT)
    path.write_text("time,position,note\n" + rows(T, ANGLE, 0 * T, sign=","))
    assert set(read_recording(path).columns) == {"position"}


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_letter_is_a_speed_if_its_numbers_are(factor: float, tmp_path: Path) -> None:
    """``v`` may be a voltage; it is the speed of x if it is how fast x changes, in its unit."""
    path = tmp_path / "rack.mat"
    scipy.io.savemat(path, {"t": T, "x": ANGLE, "v": factor * SPEED, "F": INPUT, "a": np.gradient(SPEED, 0.01)})
    if factor == 1:
        found = read(path)
        assert [one.series for one in found.columns] == ["x", "F"]
        assert found.columns[0].why == "v is how fast it changes"
        assert found.recording.metadata["position_unit"] == "m"
    else:
        assert "none that is clearly a column" in refused(path)


def test_a_torque_of_zero_beside_another_one_is_told(tmp_path: Path) -> None:
    """A driver that measures no effort logs zeros, and the command of the effort elsewhere: it is read as told."""
    path = tmp_path / "plot.csv"
    header = "__time,/effort_control/data.0,/joint_states/joint0/effort,/joint_states/joint0/position"
    path.write_text(header + "\n" + rows(T, INPUT, 0 * T, ANGLE, sign=","))
    (note,) = [one for one in read(path, joint="joint0").notes if "zero throughout" in one]
    assert note.endswith("if another one drives it, use --map torque=/effort_control/data.0")
    found = read(path, "torque=/effort_control/data.0", joint="joint0")
    assert found.recording.columns["torque"] == pytest.approx(INPUT)
    assert not [one for one in found.notes if "zero throughout" in one]


@pytest.mark.parametrize(
    ("name", "per_row", "option"),
    [
        ("timestep (8Hz)", 1, "--map 'time=timestep (8Hz)*0.125', or give"),
        ("count [2 kHz]", 20, "--map 'time=count [2 kHz]*0.0005', or give"),
        (
            "timestep (8Hz)",
            50,
            "--map 'time=timestep (8Hz)*0.000125' (if it counts at 8000 Hz, as a row in 6.25 s would be slow)",
        ),
    ],
)
def test_a_counter_with_its_rate_in_its_name_is_proposed(name: str, per_row: int, option: str, tmp_path: Path) -> None:
    """The first row has no numbers, the last have zeros, and the steps are uneven: a log asks as fast as it can."""
    path = tmp_path / "chirp.csv"
    uneven = per_row * np.arange(T.size) + np.where(np.arange(T.size) % 3, 0, per_row // 10) + 7
    path.write_text(f"{name},voltage,position\nnan,nan,nan;\n" + rows(uneven, INPUT, ANGLE, sign=","))
    path.write_text(path.read_text() + 2 * "0.0,0.0,0.0\n")  # of a buffer that was not full
    told = refused(path)
    assert f"and no times; choose their series, as in {option}" in told
    term = told.split("--map '")[1].split("'")[0]
    assert np.ptp(read(path, term).recording.time) == pytest.approx(np.ptp(uneven) * float(term.split("*")[1]))


def test_a_fast_motor_turns_in_rpm(tmp_path: Path) -> None:
    """Beside its torque; a slower one may be in rad/s."""
    path, speed = tmp_path / "axis.csv", 2000 * np.sin(3 * T)
    for size, is_taken in ((1.0, True), (0.1, False)):
        path.write_text("t,motor speed,torque\n" + rows(T, size * speed, np.cos(3 * T), sign=","))
        found = read(path)
        told = "motor speed is taken in rpm; else use --map 'position=motor speed:rad/s'"
        assert any(told in note for note in found.notes) is is_taken
        if is_taken:
            assert np.ptp(found.recording.columns["position"]) == pytest.approx(2 * 2000 * np.pi / 30 / 3, rel=0.01)
