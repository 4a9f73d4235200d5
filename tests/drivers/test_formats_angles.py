"""Angles without a unit: rad by definition, degrees where rad are impossible; what is told where neither is sure."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.cli import cli
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.recordings import read_recordings
from tests.drivers.test_formats import read, refused
from tests.drivers.test_formats_as_saved import rows

T = np.arange(400) * 0.02
SWING = np.exp(-T / 8) * np.cos(6 * T)


def saved(path: Path, header: str, *columns: np.ndarray) -> Path:
    path.write_text(header + "\n" + rows(T, *columns, sign=","))
    return path


def test_joint_states_are_in_rad(tmp_path: Path) -> None:
    """A motor may turn to and fro over more than a turn; --map knows better."""
    path = saved(tmp_path / "x.csv", "__time,/joint_states/a/position,/joint_states/a/effort", 14 * SWING, SWING)
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(14 * SWING, abs=1e-3)
    assert [one.unit for one in found.columns] == ["rad", "N m"]
    assert not [note for note in found.notes if "no unit is given" in note]
    degrees = read(path, "position=/joint_states/a/position:deg").recording.columns["position"]
    assert degrees == pytest.approx(np.radians(14 * SWING), abs=1e-3)
    path = saved(tmp_path / "alone.csv", "__time,/joint_states/a/position", 14 * SWING)
    assert read(path).recording.columns["position"] == pytest.approx(14 * SWING, abs=1e-3)


def test_what_a_motor_moves_is_no_swing_in_degrees(tmp_path: Path) -> None:
    """A pendulum does not turn over to and fro; the shaft of a motor may.  The command is not used, but there."""
    path = saved(tmp_path / "x.csv", "__time,/a/shaft_position,/wheel/command", 14 * SWING, 0 * SWING)
    found = read(path, "command=")
    assert found.recording.columns["position"] == pytest.approx(14 * SWING, abs=1e-3)
    assert [note for note in found.notes if note.startswith("position: no unit is given, and") and ":deg" in note]


def test_a_swing_in_degrees_says_what_to_type_for_rad(tmp_path: Path) -> None:
    found = read(saved(tmp_path / "x.csv", "t,angle", 60 * SWING))
    (note,) = [one for one in found.notes if "taken as deg" in one]
    assert note.endswith("else use --map position=angle:rad")
    assert found.recording.metadata["imported"]["position_assumed"] == "deg"
    known = read(saved(tmp_path / "x.csv", "t,angle", 60 * SWING), "position=angle:rad").recording
    assert "position_assumed" not in known.metadata["imported"]


@pytest.mark.parametrize(("name", "factor"), [("angle", np.pi / 180), ("q", 1.0)])
def test_whole_numbers_that_swing_far_are_degrees_if_they_are_called_an_angle(
    name: str, factor: float, tmp_path: Path
) -> None:
    """Others may be counts of an encoder."""
    whole = np.rint(150 * SWING)
    found = read(saved(tmp_path / "x.csv", f"t,{name}", whole))
    assert found.recording.columns["position"] == pytest.approx(whole * factor, abs=1e-6)
    assert [note for note in found.notes if "no unit is given" in note and f"position={name}:" in note]


def test_whole_numbers_over_a_turn_are_doubted(tmp_path: Path) -> None:
    """Nobody measures in whole rad: eight of them are degrees or counts, also below two turns."""
    found = read(saved(tmp_path / "x.csv", "t,q,tau", np.rint(4 * SWING), SWING))
    (note,) = [one for one in found.notes if "no unit is given" in one]
    assert "whole numbers, which rad hardly are, -4 to 4 were taken as rad" in note
    assert note.endswith("use --map position=q:deg, if counts of 4096 a turn, --map 'position=q*0.00153398'")
    assert not [one for one in read(saved(tmp_path / "y.csv", "t,q,tau", 4 * SWING, SWING)).notes if "no unit" in one]


def test_a_swing_in_counts_is_asked_about(tmp_path: Path) -> None:
    """Nothing swings by 900 rad, nor by 900 degrees; a shaft that a motor drives may, and whoever says so."""
    path = saved(tmp_path / "x.csv", "t,q", np.rint(2048 + 900 * SWING))
    said = refused(path, base="joint")
    assert (
        "in which nothing swings so far; if these are counts of 4096 a turn, use --map 'position=q*0.00153398'" in said
    )
    assert np.ptp(read(path, "position=q:rad", base="joint").recording.columns["position"]) > 1700
    runs = [saved(tmp_path / f"pos{at}.csv", "t,q", np.rint(2048 + 900 * SWING)) for at in range(2)]
    with pytest.raises(RecordingError, match=r"pos0\.csv: found a swing from"):
        read_recordings(runs, base="joint")
    driven = saved(tmp_path / "y.csv", "t,q,tau", np.rint(2048 + 900 * SWING), SWING)
    assert np.ptp(read(driven, base="joint").recording.columns["position"]) > 1700


@pytest.mark.parametrize(("unit", "si"), [("mm", "N"), ("deg", "N m")])
def test_what_drives_an_axis_along_a_line_is_a_force(unit: str, si: str, tmp_path: Path) -> None:
    """Columns without names: of a piston the drive was called a torque in N m."""
    path = saved(tmp_path / "x.csv", "t,a,b", 60 * SWING, SWING)
    found = read(path, f"position=a:{unit}", "torque=b")
    assert [one.si for one in found.columns if one.column == "torque"] == [si]
    assert found.recording.unit("torque") == si
    assert [one.si for one in read(path, f"position=a:{unit}", "torque=b:N cm").columns][1] == "N m"


def test_an_acceleration_by_itself_is_no_angle(tmp_path: Path) -> None:
    """A plucked beam swings by more than half a turn's number, in m/s²."""
    found = read(saved(tmp_path / "x.csv", "time,acceleration", 14 * SWING))
    assert found.recording.columns["accel"] == pytest.approx(14 * SWING, abs=1e-3)
    assert not [note for note in found.notes if "deg" in note]


SPEED = np.gradient(SWING, T)
"""of an angle of ``SWING`` rad"""
PUSH = np.sin(3 * T)


def test_an_angle_in_degrees_beside_a_speed_in_rad(tmp_path: Path) -> None:
    """How fast the angle changes tells its unit; a speed in the same unit tells none."""
    path = saved(tmp_path / "x.csv", "time,angle,velocity,torque", np.degrees(SWING), SPEED, PUSH)
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-3)
    assert found.recording.metadata["imported"]["position_assumed"] == "deg"  # as in other files of the question
    (note,) = [one for one in found.notes if "taken as deg" in one]
    assert "times as fast as velocity says; else use --map position=angle:rad" in note
    known = read(path, "position=angle:rad")
    assert known.recording.columns["position"] == pytest.approx(np.degrees(SWING), abs=0.1)
    assert any("angle and velocity are not in rad and rad/s" in note for note in known.notes)
    for names in ("Winkel,Winkelgeschwindigkeit,Drehmoment", "angle,angular velocity,torque"):
        found = read(saved(tmp_path / "x.csv", f"time,{names}", np.degrees(SWING), SPEED, PUSH))
        assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-3)
    geared = read(saved(tmp_path / "x.csv", "time,angle,velocity,torque", 60 * SWING, SPEED, PUSH))
    assert geared.recording.columns["position"] == pytest.approx(60 * SWING, abs=1e-3)  # the angle is that of the motor
    path = saved(tmp_path / "x.csv", "time,angle,velocity,torque", SWING, SPEED, PUSH)
    assert not [note for note in read(path).notes if "deg" in note]


def test_units_in_the_header_that_contradict_each_other(tmp_path: Path) -> None:
    found = read(saved(tmp_path / "x.csv", "time,angle_deg,velocity (rad/s),torque", SWING, SPEED, PUSH))
    assert any("angle_deg and velocity (rad/s) are not in deg and rad/s" in note for note in found.notes)


def test_only_the_goal_of_a_servo_is_in_degrees(tmp_path: Path) -> None:
    """Beside an angle in rad, which stays in rad.  In a small motion, which may be either, it is told."""
    goal = np.sin(2 * T)
    angle = np.sin(2 * (T - 0.05))
    found = read(saved(tmp_path / "x.csv", "time,goal,position", np.degrees(goal), angle)).recording
    assert found.columns["command"] == pytest.approx(goal, abs=1e-3)
    assert found.columns["position"] == pytest.approx(angle, abs=1e-3)
    found = read(saved(tmp_path / "x.csv", "time,goal,position,velocity", np.degrees(goal), np.degrees(angle),
                       2 * np.cos(2 * (T - 0.05)))).recording  # fmt: skip
    assert found.columns["command"] == pytest.approx(goal, abs=1e-3)
    small = read(saved(tmp_path / "x.csv", "time,goal,position", 5 * goal, np.radians(5 * angle)))
    assert any("as degrees beside rad do; if so, use --map command=goal:deg" in note for note in small.notes)


def test_a_recording_of_ones_own_in_degrees(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The columns of the format are in rad: a speed beside them, or the command, tells a mistake; the lab says it."""
    (tmp_path / "joint.toml").write_text('base = "joint"\n')
    path = saved(tmp_path / "x.csv", "time,position,velocity,torque", np.degrees(SWING), SPEED, PUSH)
    assert CliRunner().invoke(cli, ["lab", "compare", str(tmp_path / "joint.toml"), str(path)]).exit_code == 0
    said = "times as fast as velocity says, as degrees beside rad/s do; if so, use --map position=position:deg"
    assert said in caplog.text
    path = saved(tmp_path / "x.csv", "time,command,position", np.degrees(np.sin(2 * T)), np.sin(2 * (T - 0.05)))
    CliRunner().invoke(cli, ["lab", "compare", "servo", str(path)])
    assert "command: command moves 57" in caplog.text
