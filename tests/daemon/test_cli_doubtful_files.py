"""Files that a program reads wrongly with ease: what ``lostmotion`` asks about instead, and what it takes."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from lostmotion.drivers.recordings import read_recordings
from lostmotion.lab.commands.reading import Files, used
from tests.daemon.cli_world import call

T = np.arange(1500) / 100
SWING = 40 * np.exp(-T / 20) * np.cos(5 * T)
"""of a pendulum [deg]"""
STEPS = 50 * np.floor(T / 5)
NONE = "and none that is clearly a column"


def noise(deviation: float, seed: int, size: int = T.size) -> np.ndarray:
    """White noise."""
    return np.random.default_rng(seed).normal(0, deviation, size)


def table(path: Path, *columns: np.ndarray, head: str = "", sign: str = ",") -> Path:
    """A table, without a header where none is given."""
    np.savetxt(path, np.column_stack(columns), "%.6f", sign, header=head, comments="")
    return path


def told(path: Path, *options: str) -> str:
    """All that is printed of a file."""
    result = call("import", path, *options)
    assert result.exit_code in (0, 2), result.output
    return result.output


def explained(base: str, path: Path, *options: str) -> str:
    """By which line a question about a file is refused."""
    result = call("lab", "explain", base, path, *options)
    assert result.exit_code == 2, result.output
    return result.output


def test_beside_what_moves_more_a_swing_is_asked_about(tmp_path: Path) -> None:
    """Of a robot's wheels: a noisy speed is no swing, and the counters move 400 times as much; of a pendulum on an arm
    that turns on, the arm.  A swing with noise beside an input in steps and a counter is taken."""
    speed = np.rint(6 * (2 + np.sin(T) + noise(0.5, 1))) / 6
    count = 40 * np.cumsum(speed) + noise(20, 2)
    path = tmp_path / "log.txt"
    assert NONE in told(table(path, T, speed, speed + noise(0.5, 3), count, count + 3))
    assert NONE in told(table(path, T, STEPS, SWING, 3 * SWING + 400 * np.sqrt(T)))
    noisy = SWING + noise(0.5, 4)
    assert "position = column3  (deg" in told(table(path, T, STEPS, noisy, np.arange(T.size)))


def test_a_swing_whose_readings_are_repeated_is_one(tmp_path: Path) -> None:
    """Of a film that is far slower than its log: of 30 rows each reading is in all."""
    swing = np.rint(10 * SWING[np.arange(T.size) // 30 * 30]) / 10
    assert "position = column2  (deg" in told(table(tmp_path / "film.csv", T, swing))


def test_of_a_mass_the_only_column_is_its_place(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """No angle in degrees, however large its numbers are: the base says so."""
    path = table(tmp_path / "mass.csv", T, np.rint(SWING), sign=";")
    assert call("lab", "compare", "oscillator", path).exit_code == 0
    assert "displacement = column2  (m, as no unit is given; the only series beside the time)" in caplog.text
    assert "if its numbers are in mm, use --map displacement=column2:mm" in caplog.text
    assert "position = column2  (deg" in told(path)


def whole_degrees(speed: np.ndarray) -> tuple[np.ndarray, ...]:
    """A motor's duty, times, speed and angle in whole degrees, from a controller of a toy."""
    angle = np.rint(np.cumsum(speed) / 160 - 400)
    return np.full(speed.size, 40.0), np.arange(speed.size) / 160, np.rint(speed), angle


def test_a_speed_is_that_of_an_angle_in_whole_degrees(tmp_path: Path) -> None:
    """A second of a motor that starts: the angle rises by a degree a row, and the speed does not swing."""
    speed = 220 * (1 - np.exp(-np.arange(160) / 20)) + noise(2, 5, 160)
    said = told(table(tmp_path / "data40.csv", *whole_degrees(speed), sign=";"))
    assert "position = column4  (rad, as no unit is given; column3 is how fast it changes)" in said


def test_a_column_without_a_name_means_the_same_in_all_files(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A second file, of which the numbers do not tell the position; and a small swing beside one that is in degrees."""
    speed = 220 * np.sin(np.arange(320) / 20)
    first = table(tmp_path / "a.csv", *whole_degrees(speed))
    second = table(tmp_path / "b.csv", *whole_degrees(noise(30, 6, 300)))
    assert NONE in told(second)
    read = read_recordings([second, first])
    assert [one.metadata["imported"]["position"] for one in read] == ["column4", "column4"]
    assert f"{second}: read with --map position=column4, as the other files are" in caplog.messages
    far, near = (table(tmp_path / name, T, size * SWING, head="t,theta") for name, size in (("far", 1), ("near", 0.04)))
    sizes = [float(np.ptp(one.columns["position"])) for one in read_recordings([near, far])]
    assert sizes[1] / sizes[0] == pytest.approx(25, rel=1e-4)


def test_what_does_not_move_as_an_angle_is_asked_about(tmp_path: Path) -> None:
    """A temperature beside its times; a voltage, by its unit; seven angles of an arm in one column; a walk."""
    warm = np.rint(20 * (25 + np.cumsum(noise(0.02, 7)) + noise(0.03, 8))) / 20
    path = tmp_path / "log.txt"
    said = told(table(path, T + 1290, warm))
    assert "column2 neither swings nor keeps its speed, as what has an inertia does" in said
    assert "position = column2" in told(path, "--map", "position=column2:deg")
    for values in (SWING, 3 * T**2 + np.rint(T), np.rint(T * 30)):
        assert "position = column2" in told(table(path, T, values))
    assert "--map 'position=Channel 1 (V)*FACTOR'" in told(table(path, T, SWING, head="Time (s),Channel 1 (V)"))
    arm = np.stack([3 * joint + np.sin((1 + joint / 5) * T) for joint in range(7)], axis=1)
    assert "every seventh number of column1 is close to the one before" in told(table(path, arm.ravel()))
    places = (0 * T + 42.6, 0 * T - 78.9, np.rint(90 + noise(20, 9)))
    assert NONE in told(table(path, T, *places, head="Time (s),Latitude (°),Longitude (°),Direction (°)"))


def test_runs_one_after_another_need_no_names(tmp_path: Path) -> None:
    """Three runs of a motor in one table: its times begin anew, and an angle that begins anew at each turn is none."""
    runs = [whole_degrees(np.sin(np.arange(size) / 20) * 220) for size in (330, 400, 350)]
    path = table(tmp_path / "lab.csv", *(np.concatenate(each) for each in zip(*runs, strict=True)))
    said = told(path)
    assert "rows 331 to 730 are used, the longest part" in said
    assert "position = column4" in said
    assert "if there are 100 rows a second" in told(
        table(path, 1.7 * T % (2 * np.pi), np.sin(3 * T), np.cos(2 * T)), "-o", str(tmp_path / "x.csv")
    )


def test_a_servo_whose_goal_never_changes_is_refused(tmp_path: Path) -> None:
    """It holds, and is pulled by hand."""
    path = table(tmp_path / "servo.csv", T, 0 * T + 0.2, 0.2 + SWING / 2000, head="time,goal,position")
    assert "found the command 0.2 at all times, expected a goal that changes" in explained("servo", path)


def test_a_film_of_an_oscillator_has_no_angle(tmp_path: Path) -> None:
    """The end of a leg, on an arc of 12 by 9 cm: x for the oscillator, and the angle for a joint."""
    angle = SWING / 60
    path = table(tmp_path / "leg.csv", T, 0.1 * np.sin(angle), 0.1 * np.cos(angle), head="t,x,y")
    for base, column in (("oscillator", "displacement"), ("joint", "position")):
        (found,) = Files((path,)).read(base)
        assert list(found.columns) == [column]
    np.testing.assert_allclose(
        Files((path,)).read("oscillator")[0].columns["displacement"], 0.1 * np.sin(angle), atol=1e-6
    )


def test_numbers_that_agree_are_one_rate(tmp_path: Path) -> None:
    """``Ts`` and ``fs`` of one recording; none of them where they contradict each other."""
    path = tmp_path / "arm.mat"
    held = {"Input": SWING, "Output": np.sin(3 * T), "Ts": 0.002, "fs": 500.0}
    scipy.io.savemat(path, held)
    said = told(path, "--map", "force=Input", "--map", "displacement=Output")
    assert "500 rows a second, as Ts and fs say" in said
    assert "--map displacement=Output, and a force --map force=Input (m;" in explained("oscillator", path)
    scipy.io.savemat(path, {"data": 0.2 * SWING, "ActualRate": 1000.0, "duration": 30.0})
    assert "1000 rows a second, as ActualRate says" in told(path)
    scipy.io.savemat(path, held | {"fs": 100.0})
    assert "give the rows a second" in told(path, "--map", "displacement=Output", "-o", str(tmp_path / "x.csv"))


def test_a_motion_along_a_line_is_asked_for_by_the_names_of_the_file(tmp_path: Path) -> None:
    """A series whose name has that of another column in it keeps its name in the advice."""
    path = table(tmp_path / "line.csv", T, 0.01 * np.sin(5 * T), np.cos(5 * T), head="time,Output,torquemeter")
    assert "--map displacement=Output, and a force --map force=torquemeter" in explained("oscillator", path)
    path = table(tmp_path / "line.csv", T, 200 * np.sin(5 * T), np.cos(5 * T), head="time,Output,torquemeter")
    assert "--map displacement=Output:mm, and a force" in explained("oscillator", path)  # no degrees
    assert "--map position=Output:deg, and a torque" in explained("joint", path)


def test_a_drive_exports_demand_and_actual_value(tmp_path: Path) -> None:
    """Its times have a unit and no name; the increments of its encoder are asked about."""
    goal = np.rint(25000 + 50 * SWING)
    head = "Date:;2026-01-31\n;Position actual value;Position demand value;Following error actual value\nms;inc;inc;inc"
    path = table(tmp_path / "drive.csv", 8000 * T, goal - 2, goal, 0 * T + 2, head=head, sign=";")
    said = explained("servo", path)
    assert "found whole numbers without a known unit" in said
    assert "--map 'command=Position demand value*0.00153398' --map 'position=Position actual value*0.00153398'" in said
    maps = [
        f"{column}=Position {word} value*0.0015" for column, word in (("command", "demand"), ("position", "actual"))
    ]
    assert "time: time [ms]" in told(path, *(each for one in maps for each in ("--map", one)))


def test_what_a_controller_puts_out_may_drive(tmp_path: Path) -> None:
    """``out`` beside a speed; with the ``duty`` of the programme both are named, and none is taken."""
    rpm = 60 + 20 * np.sin(T)
    path = table(tmp_path / "motor.csv", T, rpm, np.cos(T), 0 * T + 60, head="t,rpm,out,rpm_sp")
    assert "voltage = out  (V, as no unit is given; the motor's input, by its name)" in told(path)
    said = told(table(path, STEPS, T, rpm, np.cos(T), head="duty,t,rpm,out"))
    assert "voltage: found several inputs, duty, out; choose with --map voltage=duty" in said
    assert "voltage = " not in said


def test_an_input_at_which_the_angle_settles_is_a_goal(tmp_path: Path) -> None:
    """A step of 100 counts, and the angle ends at 100; a motor that turns on under a step of a voltage does not."""
    step, since = 100.0 * (T >= 1), np.maximum(T - 1, 0)
    settled = np.rint(100 * (1 - np.exp(-3 * since) * (np.cos(9 * since) + np.sin(9 * since) / 3)))
    path = table(tmp_path / "step.csv", T, step, step - settled, settled, head="t,u,v,theta")
    said = (
        "u is taken as the goal, as theta follows it with a gain of 1.00; if it drives the motor, use --map voltage=u"
    )
    assert said in told(path)
    assert "command = u  (rad" in told(path)
    assert f"{said}, or give what drives it: --map voltage=v" in explained("joint", path)
    table(path, T, step, step - settled, 20 * since, head="t,u,v,theta")
    assert "as the goal" not in told(path)


def test_an_angular_velocity_is_in_rad_a_second(tmp_path: Path) -> None:
    """As a position without a unit is in rad, if there is nothing else."""
    path = table(tmp_path / "gyro.csv", T, np.cos(5 * T), head="time,angular_velocity")
    said = told(path)
    assert "position = angular_velocity  (rad/s, now rad; a speed, as there is no angle)" in said
    assert "taken in rad/s; else use --map position=angular_velocity:deg/s" in said


def test_readings_that_are_cut_off_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Of an accelerometer whose range ends at 30 m/s², for an oscillator; not of one that has a wider range."""
    caplog.set_level(logging.WARNING)
    for reach, is_cut in ((30.0, True), (60.0, False)):
        caplog.clear()
        felt = np.clip(SWING + noise(0.05, 10), -reach, reach)
        path = table(tmp_path / "beam.csv", T, felt, head="time,accel (m/s^2)")
        with used("oscillator", Files((path,))):
            pass
        said = [one for one in caplog.messages if "the range of the sensor cut the motion off" in one]
        assert len(said) == is_cut
        assert not is_cut or "readings of accel stand at -30 and 30 m/s^2" in said[0]


def test_a_servo_is_asked_for_its_goal(tmp_path: Path) -> None:
    """No torque is proposed for the base ``servo``; without names the goal stands before what follows it."""
    path = table(tmp_path / "servo.txt", T, 40.0 * (T >= 1), 40.0 * np.clip(T - 1, 0, 1) + np.sin(9 * T), head="")
    said = explained("servo", path)
    assert "--map position=column3:deg, and its goal --map command=column2:deg" in said
    assert "torque" not in said
    assert "and a torque --map torque=" in explained("joint", path)


def test_the_log_of_an_actuator_needs_no_help(tmp_path: Path) -> None:
    """``torAct`` and ``posAct`` are quantities and no joints.  The steps of an encoder of 12 bits show that its angle
    of several turns is in rad, in which no servo turns so often."""
    step = 2 * np.pi / 4096
    counts = np.rint(9 * np.pi * np.sin(2 * T) / step) * step
    goal = counts + 0.1 * np.cos(3 * T)
    head = "t,torDes,posDes,velDes,torAct,posAct,velAct"
    path = tmp_path / "log.csv"
    columns = np.stack([T, np.sin(T), goal, 0 * T, np.cos(9 * T), counts, 0 * T], axis=1)
    np.savetxt(path, columns, "%.15g", ",", header=head, comments="")
    said = told(path)
    assert "command = posDes  (rad" in said
    assert "position = posAct  (rad" in said
    assert "torque = torAct  (N m" in said
    assert "deg" not in said.split("note: command")[0]
    columns[:, 5] = np.rint(counts / step / 20) * 360 / 4096
    columns[:, 2] = columns[:, 5] + 3 * np.cos(3 * T)
    np.savetxt(path, columns, "%.15g", ",", header=head, comments="")
    assert "position = posAct  (deg, now rad" in told(path)
