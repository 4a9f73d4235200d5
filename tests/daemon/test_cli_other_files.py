"""What ``lostmotion import`` says of the files of others: which series it takes, and else what to type."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import call

T = np.arange(1000) / 100
ANGLE = np.sin(3 * T) + 0.2 * np.sin(11 * T)
SPEED = np.gradient(ANGLE, 0.01)


def told(path: Path, *options: str) -> str:
    """All that is printed of a file."""
    result = call("import", path, *options)
    assert result.exit_code in (0, 2), result.output
    return result.output


def saved(path: Path, columns: Mapping[str, np.ndarray], form: str = "%.6f") -> Path:
    """A table with a header."""
    np.savetxt(path, np.column_stack(list(columns.values())), form, ",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize("volts", [np.cos(T**2), 3.0 * (T > 1)], ids=["a sweep", "a step"])
def test_a_letter_that_is_no_speed_may_drive_the_motion(volts: np.ndarray, tmp_path: Path) -> None:
    """``v`` beside angles is named as what may drive them, however one is chosen, unless it is how fast that turns."""
    path = saved(tmp_path / "arm.csv", {"t": T, "phi1": ANGLE, "phi2": np.cos(T), "v": volts})
    for options in (["--joint", "1"], ["--map", "position=phi1"]):
        assert "not used, and the motion is taken as free; if v drives it, use --map torque=v" in told(path, *options)
    assert "for a motor's voltage --map voltage=v" in told(path, "--joint", "1")
    assert "taken as free" not in told(path, "--joint", "1", "--map", "voltage=v")
    saved(path, {"t": T, "phi1": ANGLE, "phi2": np.cos(T), "v": 57.3 * SPEED})
    assert "taken as free" not in told(path, "--joint", "1")


def test_of_several_joints_the_one_that_turns_is_taken(tmp_path: Path) -> None:
    """The goals of the others, and the places of the hand, do not say that they turn."""
    goals = np.stack([ANGLE, 0.4 * np.sin(T), 0.1 * T], axis=1)
    turned = np.stack([ANGLE, 0 * T, 0 * T + 1], axis=1)
    np.savez(tmp_path / "arm.npz", time=T, q=turned, q_cmd=goals, hand_pos=0.01 * goals[:, :2])
    said = told(tmp_path / "arm.npz")
    assert "position = q[0]" in said
    assert "taken is 0, which moves most by far; not 1, 2" in said
    assert "position = q[1]" in told(tmp_path / "arm.npz", "--map", "position=q[1]")
    np.savez(tmp_path / "arm.npz", time=T, q_cmd=goals)
    assert "choose with --joint NAME (or FILE#joint=NAME) from 0, 1, 2" in told(tmp_path / "arm.npz")


def test_a_displacement_without_a_name_is_found_by_its_speed(tmp_path: Path) -> None:
    """Of t, A, D, V, F the speed is V, whatever its case, and the force moves D along a line."""
    columns = {
        "t": T,
        "A": np.gradient(SPEED, 0.01) / 981,
        "D": ANGLE,
        "fs": np.nan * T,
        "V": SPEED,
        "F": 9 * np.sign(SPEED),
    }
    said = told(path := saved(tmp_path / "damper.csv", columns))
    assert "position = D  (m; V is how fast it changes)" in said
    assert "force = F  (N" in said
    del columns["V"], columns["A"]
    said = told(saved(path, columns | {"Y": 20 * ANGLE}))
    assert "as in --map position=D, and a force --map force=F (rad" in said


def test_whole_numbers_of_a_servo_are_refused_with_what_to_type(tmp_path: Path) -> None:
    """Goals and angles of 1747 to 2247 are counts, and no rad; so the lab does not fit them."""
    turned = np.rint(2000 + 200 * ANGLE)
    path = saved(tmp_path / "servo.csv", {"t": T, "target pos (3)": turned, "pos (3)": turned - 1}, "%.8g")
    result = call("lab", "explain", "servo", path)
    assert result.exit_code == 2
    assert (
        "expected rad, in which a servo with a goal does not turn so often; if they are counts of 4096" in result.output
    )
    options = ["--map", "command=target pos (3)*0.00153398", "--map", "position=pos (3)*0.00153398"]
    assert f"use --map '{options[1]}' --map '{options[3]}', if degrees," in result.output
    assert "times 0.00153398 [rad]" in told(path, *options)


def test_what_never_changes_is_no_position_beside_what_swings(tmp_path: Path) -> None:
    """An angle that nobody measured is left out, and the axis of the accelerometer that swings is taken."""
    axes = {"xAccl": 1000 + ANGLE, "yAccl": 300 * ANGLE, "zAccl": 0 * T}
    path = saved(tmp_path / "pendulum.csv", {**axes, "newPosition": 0 * T, "time": T})
    said = told(path)
    assert "accel = yAccl" in said
    assert "left out, as it never changes: newPosition" in said
    result = call("lab", "explain", "joint", path)
    assert "found accel, expected at least one of position" in result.output
    assert "position = angle" in told(saved(path, {"time": T, "position": 0 * T, "angle": ANGLE}))
    alone = saved(path, {"time": T, "position": 0 * T, "torque": ANGLE})
    assert "position is flat at 0" in call("lab", "explain", "joint", alone).output


@pytest.mark.parametrize(("names", "sign"), [([], ","), (["time", "angle", "torque"], ";"), ([], " ")])
def test_a_matrix_on_its_side_is_read_row_by_row(names: list[str], sign: str, tmp_path: Path) -> None:
    """Three rows of a thousand numbers are three series, and are said to be; their first cells may be names."""
    lines = [
        sign.join([*names[at : at + 1], *(f"{value:.6f}" for value in row)]) for at, row in enumerate((T, ANGLE, T))
    ]
    path = tmp_path / "matrix.csv"
    path.write_text("\n".join(lines) + "\n")
    said = told(path, *(["--map", "position=column2"] if not names else []))
    assert f"3 rows of {T.size + bool(names)} numbers each: every row is read as a column" in said
    assert f"position = {'angle' if names else 'column2'}" in said
    imported = tmp_path / "out.csv"
    assert call("import", path, "-o", imported, *(["--map", "position=column2"] if not names else [])).exit_code == 0
    assert read_recording(imported).columns["position"] == pytest.approx(ANGLE, abs=1e-5)


def test_what_is_recorded_beside_a_command_is_the_position(tmp_path: Path) -> None:
    """Two lists in JSON, at a rate that stands beside them; readings that were lost are null."""
    path = tmp_path / "run.json"
    sensed: list[float | None] = [*ANGLE.tolist()[:-1], None]
    held = {"config": {"action_hz": 50}, "data": [{"type": "chirp", "actions": ANGLE.tolist(), "sensor_data": sensed}]}
    path.write_text(json.dumps(held))
    said = told(path)
    assert "50 rows a second, as config.action_hz says" in said
    assert "command = data.actions" in said
    assert "position = data.sensor_data" in said
    assert "position = " not in told(saved(tmp_path / "error.csv", {"t": T, "goal": ANGLE, "error": 0.1 * ANGLE}))


def test_a_cell_in_quotes_may_hold_the_end_of_a_line(tmp_path: Path) -> None:
    """As the answer of an instrument does; a sign of inches in the header opens none."""
    rows = [f'{t:.2f},"{v:.6f}\n",{q:.6f}' for t, v, q in zip(T, SPEED, ANGLE, strict=True)]
    (tmp_path / "meter.csv").write_text("\n".join(["time,voltage,angle", *rows]) + "\n")
    assert told(tmp_path / "meter.csv", "-o", tmp_path / "rec.csv")
    found = read_recording(tmp_path / "rec.csv")
    np.testing.assert_allclose(found.columns["position"], ANGLE, atol=1e-6)
    np.testing.assert_allclose(found.columns["voltage"], SPEED, atol=1e-6)
    rows = [f"{t:.2f},{q:.6f}" for t, q in zip(T, ANGLE, strict=True)]
    (tmp_path / "ruler.csv").write_text("\n".join(['time,position (")', *rows]) + "\n")
    assert "position = position" in told(tmp_path / "ruler.csv", "-o", tmp_path / "rec.csv")


def test_an_error_beside_an_output_is_none(tmp_path: Path) -> None:
    """In Portuguese: reference, output, error."""
    goal = np.sin(T)
    path = saved(tmp_path / "eixo.csv", {"Tempo": T, "Referencia": goal, "Saída": ANGLE, "Erro": goal - ANGLE})
    said = told(path)
    assert "command = Referencia" in said
    assert "position = Saída  (rad, as no unit is given; the only series beside the time and the command)" in said


def test_a_current_along_the_q_axis_is_no_angle(tmp_path: Path) -> None:
    """The unit says what the letter does not; a current that is asked for is no goal of the angle."""
    names = ("a1 position [rad]", "a1 q-axis cmd [A]", "a1 q-axis [A]")
    said = told(saved(tmp_path / "drive.csv", {"time [s]": T} | dict(zip(names, (ANGLE, SPEED, SPEED), strict=True))))
    assert "position = a1 position [rad]" in said
    assert "current = a1 q-axis [A]" in said
    assert "command" not in said
    assert "also found" not in said


def test_a_share_is_no_angle(tmp_path: Path) -> None:
    """The light that a pendulum lets through, in percent."""
    said = told(saved(tmp_path / "gate.csv", {"Time (s)": T, "Light Intensity (%)": 20 + 9 * np.sin(3 * T)}))
    assert "none that is clearly a column" in said


def test_a_switched_input_is_proposed_as_what_drives(tmp_path: Path) -> None:
    """Of two columns without names the one that has a few values; of two joints neither drives the other; and where
    nothing changes nothing is proposed."""
    columns = {"a": T, "b": 0.5 * (T > 2), "c": 3 * np.maximum(T - 2, 0)}
    np.savetxt(tmp_path / "motor.csv", np.column_stack(list(columns.values())), "%.4f", ",")
    assert "--map position=column3:deg, and a torque --map torque=column2 (" in told(tmp_path / "motor.csv", "-o", "-")
    path = saved(tmp_path / "arm.csv", {"timestamp": T, "joint1": ANGLE, "joint2": np.cos(T)})
    assert "assign them, as in --map position=joint1 (" in told(path, "-o", "-")
    path = saved(tmp_path / "off.csv", {"t": T, "a": 0 * T, "b": 0 * T + 1})
    assert "nothing in it changes; was something recorded?" in told(path, "-o", "-")
    path = saved(tmp_path / "table.csv", {"t": T, "v": SPEED, "F": np.cos(9 * T)})
    assert "--map position=v:m/s, and a force --map force=F (" in told(path, "-o", "-")


def test_a_drive_that_was_chosen_is_the_only_one(tmp_path: Path) -> None:
    """A current of which only the name is known does not outrank it, and a series is not used twice."""
    volts = np.sign(np.sin(T))
    path = saved(tmp_path / "motor.csv", {"t": T, "angle": ANGLE, "current": SPEED, "torque": SPEED, "volts": volts})
    said = told(path, "--map", "voltage=volts")
    assert "voltage = volts" in said
    assert "not used: current, torque" in said
    said = told(path, "--map", "position=current:rpm", "--map", "torque=")
    assert "position = current" in said
    assert "current = current" not in said


def test_an_angle_that_is_turned_evenly_is_no_time(tmp_path: Path) -> None:
    """Without times the rate is asked for; a counter of ms is the time, and one of rows neither that nor the motion."""
    path = saved(tmp_path / "cam.csv", {"angle": T, "torque": ANGLE})
    assert "and no times" in told(path, "-o", "-")
    assert "position = angle" in told(path, "-o", "-", "--rate-hz", "100")
    rows = np.arange(T.size)
    path = saved(tmp_path / "log.csv", {"i_ms": rows, "angle": ANGLE, "duty": SPEED})
    assert "time: i_ms [ms]" in told(path, "-o", "-")
    path = saved(tmp_path / "film.csv", {"Frame": rows, "Time (Seconds)": T, "a": ANGLE, "b": np.cos(T)})
    assert "assign them, as in --map position=a, and a torque --map torque=b (" in told(path, "-o", "-")


def test_turns_a_second_may_be_called_hertz(tmp_path: Path) -> None:
    """Of a speed; a frequency is none."""
    said = told(saved(tmp_path / "motor.csv", {"time [s]": T, "velocity [Hz]": SPEED, "torque [Nm]": ANGLE}))
    assert "position = velocity [Hz]  (rev/s, now rad; a speed, as there is no angle)" in said
    names = ("velocity setpoint [Hz]", "velocity measured [Hz]", "motor torque [Nm]", "brake torque [Nm]")
    said = told(saved(tmp_path / "brake.csv", {"time [s]": T} | dict.fromkeys(names, SPEED)))
    assert "position = velocity measured [Hz]" in said
    assert "torque = motor torque [Nm]" in said
    assert "position =" not in told(
        saved(tmp_path / "x.csv", {"time [s]": T, "rate [Hz]": SPEED, "torque [Nm]": ANGLE})
    )


def test_series_that_nobody_named_may_drive(tmp_path: Path) -> None:
    """As MATLAB calls what is saved without a name."""
    columns = {"time": T, "measured position": ANGLE, "timeseries28": np.sign(np.sin(T)), "unnamed": 0 * T}
    said = told(saved(tmp_path / "run.csv", columns))
    assert "timeseries28 has 3 values and is not used, and the motion is taken as free; if timeseries28 drives" in said


def test_of_two_speeds_the_one_that_changes_is_integrated(tmp_path: Path) -> None:
    """A second sensor that reads nothing is no choice."""
    columns = {"Time (s)": T, "Electrical Speed (RPM)": 0 * T, "Optical Speed (RPM)": SPEED, "Torque (Nm)": ANGLE}
    said = told(saved(tmp_path / "stand.csv", columns))
    assert "position = Optical Speed (RPM)  (rpm, now rad; a speed, as there is no angle)" in said
    columns["Electrical Speed (RPM)"] = ANGLE
    said = told(saved(tmp_path / "stand.csv", columns))
    assert "torque = Torque (Nm)" in said
    assert "--map 'position=Electrical Speed (RPM):rpm' (or :rad/s) integrates a speed" in said


def test_a_line_of_units_may_have_a_title(tmp_path: Path) -> None:
    """For each signal beside its own times, which are equal."""
    head = ["Timestamp,2020-03-16 17:04:51,Timestamp,2020-03-16 17:04:51", "Interval,0.01,Interval,0.01"]
    head += ['Channel name,"Angle",Channel name,"Torque"', 'Unit,"rad",Unit,"Nm"']
    rows = [f"{t:g},{q:.6f},{t:g},{v:.6f}" for t, q, v in zip(T, ANGLE, SPEED, strict=True)]
    (tmp_path / "daq.csv").write_text("\n".join([*head, *rows]) + "\n")
    said = told(tmp_path / "daq.csv")
    assert "time: Channel name [s]" in said
    assert "position = Angle" in said
    assert "torque = Torque  (N m" in said


def test_a_drive_without_a_motion_is_told_what_may_be_it(tmp_path: Path) -> None:
    """In Portuguese: output, error, effort."""
    said = told(saved(tmp_path / "eixo.csv", {"Tempo": T, "Saída": 90 * ANGLE, "Erro": SPEED, "Esforço": SPEED}))
    assert "torque = Esforço" in said
    assert "position: none; if Saída is it, use --map 'position=Saída:deg'" in said
