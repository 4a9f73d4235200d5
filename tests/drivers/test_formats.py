"""Tables of other programs, written by their own libraries: which series is taken for what, and what is refused."""

from __future__ import annotations

import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.choice import parse_map, parse_term, split_address
from lostmotion.drivers.formats.read import Imported, imported
from lostmotion.drivers.formats.registry import open_source
from lostmotion.drivers.formats.source import Choice, Term, in_words
from lostmotion.drivers.formats.words import column_of, joint_of, speed_of, unit_of
from lostmotion.drivers.recording import read_recording
from lostmotion.drivers.recordings import read_recordings
from tests.conftest import Measurements
from tests.drivers.mat_objects import save_output, save_timeseries

T = np.arange(200) * 0.01
ANGLE = 0.5 * np.sin(T)
JOINT = {
    "/joint_states/elbow/position": ANGLE,
    "/joint_states/elbow/effort": 2 * ANGLE,
    "/joint_trajectory_controller/controller_state/reference/elbow/positions": ANGLE + 0.01,
}


def read(path: Path, *terms: str, **choice: Any) -> Imported:
    """What is taken of a file, with ``--map``."""
    return imported(path, Choice(parse_map(terms), **choice))


def refused(path: Path, *terms: str, **choice: Any) -> str:
    """The one line by which a file is refused."""
    with pytest.raises(RecordingError) as caught:
        read(path, *terms, **choice)
    told = str(caught.value)
    assert "\n" not in told
    assert told.startswith(("--map", str(path)))
    return told


@pytest.mark.parametrize(
    ("name", "column", "joint"),
    [
        ("/joint_states/elbow/position", "position", "elbow"),
        ("/joint_states.position[elbow]", "position", "elbow"),
        ("/controller_state.reference.positions[elbow]", "command", "elbow"),
        ("/joint_states/position[2]", "position", "2"),
        ("observation.state[shoulder_pan.pos]", "position", "shoulder_pan"),
        ("action[shoulder_pan.pos]", "command", "shoulder_pan"),
        ("goal_position", "command", ""),
        ("Present_Load", None, ""),
        ("elbow_torque_Nm", "torque", "elbow"),
        ("/imu/linear_acceleration/x", "accel", ""),
        ("joint1_velocity", None, "joint1"),
        ("position_error", None, ""),
        ("q_ref", "command", ""),
        ("motorTemp", "temperature", ""),
        ("Output Angle [deg]", "position", ""),
        ("Torque [mNm]", "torque", ""),
        ("/c/controller_state.output.effort[elbow]", None, "elbow"),
        ("Motor Speed (RPM)", None, ""),
        ("alpha_deg", "position", "alpha"),
        ("FL_1_target", "command", "FL_1"),
        ("FL_1_actual", "position", "FL_1"),
        ("M1 [N]", "force", "1"),
        ("phase_a", None, "phase_a"),
        ("motorStatePos_0", "position", "0"),
        ("motorAction_0", "command", "0"),
        ("motorStateCur_0", "current", "0"),
        ("joint_pos_FL_HAA", "position", "FL_HAA"),
        ("leftHipYawPos", "position", "leftHipYaw"),
        ("q_des_3", "command", "3"),
        ("pos_meas1", "position", "1"),
        ("posa1.txt", "position", "1"),
        ("posd1.txt", "command", "1"),
        ("Back-end Encoder [0:5]", "position", "Back-end"),
        ("commanded_deg_s", None, ""),
        ("feedback (rad/s)", None, ""),
    ],
)
def test_names_say_column_and_joint(name: str, column: str | None, joint: str) -> None:
    """Names as ROS, PlotJuggler, LeRobot, Dynamixel and people write them."""
    assert column_of(name) == column
    if column is not None:
        assert joint_of(name) == joint


def test_names_say_units() -> None:
    """In brackets any unit; behind an underscore one that suits the column, so that no metre is made of a motor."""
    assert unit_of("angle [deg]", "position") == "deg"
    assert unit_of("acc (g)", "accel") == "g"
    assert unit_of("elbow_mA", "current") == "mA"
    assert unit_of("torque_m", "torque") == ""
    assert unit_of("angle (counts)", "position") == ""
    for name in ("pos_deg", "Position, deg", "Position (degrees)", "angle/deg", "angle deg"):
        assert unit_of(name, "position") == "deg", name
    assert unit_of("Torque [mNm]", "torque") == "mN m"
    assert [speed_of(name) for name in ("Speed_rad_s", "omega_deg_per_s", "speed (rpm)")] == ["rad/s", "deg/s", "rpm"]
    assert speed_of("angle_rad") is None
    assert speed_of("tacho") == ""


def test_map_is_understood(tmp_path: Path) -> None:
    """A unit behind a colon, a factor and an offset, a name with a colon in it; and the same behind a #."""
    assert parse_term("angle:deg") == Term("angle", "deg")
    assert parse_term("raw*0.5-3") == Term("raw", factor=0.5, offset=-3.0)
    assert parse_term("raw*0.5-3:mm") == Term("raw", "mm", 0.5, -3.0)
    assert parse_term("a::b/c:0") == Term("a::b/c:0")
    path = tmp_path / "x.mat"
    path.touch()
    said = split_address(Path(f"{path}#joint=elbow,episode=3,position=q:deg,time=t:ms"))
    assert said == (path, Choice({"position": Term("q", "deg"), "time": Term("t", "ms")}, "elbow", (), 3))
    for wrong, message in (("speed=v", "expected COLUMN=SERIES"), ("position=q:furlong", "found the unit 'furlong'"),
                           ("position=q*0", "other than 0")):  # fmt: skip
        with pytest.raises(RecordingError, match=message):
            parse_map([wrong])


def test_plotjuggler_csv(tmp_path: Path) -> None:
    """Columns that were sampled at instants of their own keep them; times since 1970 become a start and seconds."""
    path = tmp_path / "pj.csv"
    joint = pd.DataFrame(JOINT, index=1.7e9 + T)
    imu = pd.DataFrame({"/imu/linear_acceleration/x": np.cos(T)}, index=1.7e9 + T + 0.005)
    pd.concat([joint, imu]).sort_index().to_csv(path, index_label="__time")
    found = read(path)
    assert found.kind == "PlotJuggler CSV"
    assert found.recording.metadata["joint"] == "elbow"
    assert found.recording.metadata["start"] == datetime.fromtimestamp(1.7e9, UTC)
    assert list(found.recording.columns) == ["command", "position", "accel", "torque"]
    for column, values in zip(("command", "position", "torque"), (ANGLE + 0.01, ANGLE, 2 * ANGLE), strict=True):
        times, read_back = found.recording.signal(column)
        np.testing.assert_allclose(read_back, values, rtol=1e-12)
        np.testing.assert_allclose(times, T, atol=1e-6)  # a float64 of 1.7e9 s tells 0.2 µs
    assert found.recording.signal("accel")[0][0] == pytest.approx(0.005, abs=1e-6)


@pytest.mark.parametrize("times", [T + 0.5, T**1.1])
def test_timeseries_of_matlab(times: np.ndarray, tmp_path: Path) -> None:
    """An object has the name of its variable, the unit of its own name, and its times, evenly spaced or not; damaged,
    it is none."""
    path = tmp_path / "swing.mat"
    save_timeseries(path, "pendulum_angle", "Pendulum angle [deg]", times, np.degrees(ANGLE)[None, None, :])
    found = read(path)
    np.testing.assert_allclose(found.recording.columns["position"], ANGLE)
    np.testing.assert_allclose(found.recording.time, times)
    assert found.columns[0].series == "pendulum_angle [deg]"
    path.write_bytes(path.read_bytes().replace(b"timeseries\0", b"timetables\0"))
    assert "found no vectors of numbers, expected signals; save objects such as timeseries as arrays" in refused(path)


def test_what_a_run_of_simulink_gave(tmp_path: Path) -> None:
    """``out`` is an object, whose signals have the names that the model gave them."""
    path = tmp_path / "run.mat"
    save_output(path, "out", {"tout": T, "theta_deg": np.degrees(ANGLE), "Ut": 2 * ANGLE})
    found = read(path)
    np.testing.assert_allclose(found.recording.columns["position"], ANGLE)
    np.testing.assert_allclose(found.recording.time, T)
    assert [one.series for one in found.columns] == ["out.theta_deg"]


def test_table_with_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    """As spreadsheets of half of Europe write it: units stand in the names, milliseconds too."""
    path = tmp_path / "messung.csv"
    frame = pd.DataFrame(
        {"Time (ms)": T * 1000, "Kommentar": "ja", "angle [deg]": np.degrees(ANGLE), "i_motor_mA": 100.0}
    )
    frame.to_csv(path, sep=";", decimal=",", index=False, encoding="cp1252")
    found = read(path, "current=i_motor_mA")
    np.testing.assert_allclose(found.recording.time, T, atol=1e-12)
    np.testing.assert_allclose(found.recording.columns["position"], ANGLE, atol=1e-12)
    np.testing.assert_allclose(found.recording.columns["current"], 0.1)
    assert [(one.unit, one.si, one.why) for one in found.columns] == [
        ("deg", "rad", "by its name"),
        ("mA", "A", "given"),
    ]


def test_other_layouts_of_text(tmp_path: Path) -> None:
    """numpy's comment as header, a line of units below the header, dates as times, no header at all, no times."""
    path = tmp_path / "x.txt"
    np.savetxt(path, np.column_stack([T, ANGLE]), header="t position_deg")
    np.testing.assert_allclose(read(path).recording.columns["position"], np.radians(ANGLE))
    path.write_text("t\tangle\tforce\nms\tdeg\tkN\n" + "".join(f"{k}\t90\t2\n" for k in range(9)))
    found = read(path).recording
    assert (found.time[-1], found.columns["force"][0]) == (0.008, 2000.0)
    assert found.columns["position"][3] == pytest.approx(np.pi / 2)
    pd.DataFrame({"timestamp": pd.date_range("2026-01-31", periods=5, freq="20ms", tz="UTC"), "q": 1.0}).to_csv(path)
    found = read(path).recording
    assert found.metadata["start"] == datetime(2026, 1, 31, tzinfo=UTC)
    np.testing.assert_allclose(found.time, [0, 0.02, 0.04, 0.06, 0.08])
    np.savetxt(path, np.column_stack([T, ANGLE]), delimiter=",")
    assert read(path).columns[0].why == "the only series beside the time"
    np.testing.assert_array_equal(read(path, "time=column1", "position=column2").recording.time, T)
    assert read(path, "position=column2", rate_hz=50).recording.time[-1] == pytest.approx(199 / 50)
    path.write_text("pos,load\n1,2\n3,4\n")
    assert "and no times; give the rows a second" in refused(path)


def test_lines_that_name_their_numbers(tmp_path: Path) -> None:
    """As programs print them to a serial port, with titles and what they say in between; ms where steps are of 2."""
    path = tmp_path / "x.txt"
    rows = [f"Time: {5000 + 2 * k + k % 2} Position: {k} Current: {500 - k}\n" for k in range(60)]
    path.write_text("".join(["Begin\n", *rows[:30], "DONE POSITIONING\n", *rows[30:]]))
    found = read(path).recording
    assert list(found.columns) == ["position", "current"]
    np.testing.assert_array_equal(found.columns["position"], np.arange(60))
    assert found.time[-1] - found.time[0] == pytest.approx(0.119)
    path.write_text("".join(f"t={k / 100} s, angle = {k}.5 deg; setpoint (deg): -1e1\n" for k in range(30)))
    found = read(path).recording
    assert found.time[-1] == pytest.approx(0.29)
    np.testing.assert_allclose(found.columns["position"], np.radians(np.arange(30) + 0.5))
    np.testing.assert_allclose(found.columns["command"], np.radians(-10.0))
    banner = "=~=~=~=~= PuTTY log 2018.05.10 12:39:00 =~=~=~=~=\n"
    path.write_text(banner + "".join(f"t,{10007 * k},PWM,{k // 20},Enc,{k / 2:.2f}\n" for k in range(60)))
    found = read(path).recording
    assert found.time[-1] == pytest.approx(59 * 0.010007)
    np.testing.assert_allclose(found.columns["position"], np.arange(60) / 2)
    np.testing.assert_allclose(found.columns["voltage"], np.arange(60) // 20)


def test_a_recording_in_several_files(tmp_path: Path) -> None:
    """Angles in one table and torques in another: names that say no quantity get that of their file, and the times of
    the first file that has them count."""
    q, tau = tmp_path / "q.csv", tmp_path / "tau.csv"
    both = Path(f"{q}+{tau}")
    pd.DataFrame({"t": T, "joint1": ANGLE, "joint2": T}).to_csv(q, index=False)
    pd.DataFrame({"t": T + 1, "joint1": 2 * ANGLE, "joint2": -T}).to_csv(tau, index=False)
    found = read(both, joint="joint2").recording
    np.testing.assert_array_equal(found.time, T)
    np.testing.assert_array_equal(found.columns["position"], T)
    np.testing.assert_array_equal(found.columns["torque"], -T)
    np.testing.assert_array_equal(read_recording(f"{both}#joint=joint1").columns["torque"], 2 * ANGLE)
    np.savetxt(q, np.column_stack([ANGLE, 0.9 * np.cos(T)]))
    np.savetxt(tau, np.column_stack([2 * ANGLE, np.cos(T)]))
    with pytest.raises(RecordingError, match="from 0, 1"):
        read_recordings([q, tau])
    first = read_recordings([f"{both}#joint=0,rate-hz=100"])[0]
    np.testing.assert_allclose(first.columns["torque"], 2 * ANGLE)
    np.savetxt(q, ANGLE)
    np.savetxt(tau, np.column_stack([T, 2 * ANGLE]))
    assert [one.name for one in open_source(both).series] == ["q", "tau[0]", "tau[1]"]
    np.savetxt(tau, ANGLE[1:])
    assert "200 of q, 199 of tau, expected as many rows" in refused(both, rate_hz=100)


def test_a_servo_turns_in_degrees(tmp_path: Path) -> None:
    """A goal and an angle beyond two turns in rad are degrees; whole numbers may be counts, unless both are called
    angles, and the angle of a motor may be more."""
    path = tmp_path / "x.csv"
    table = pd.DataFrame({"t": T, "goal": 100 * ANGLE, "position": 99 * ANGLE})
    table.to_csv(path, index=False)
    found = read(path)
    np.testing.assert_allclose(found.recording.columns["command"], np.radians(100 * ANGLE))
    assert any("a servo with a goal does not turn so often" in note for note in found.notes)
    table.round().to_csv(path, index=False)
    assert "found whole numbers without a known unit" in refused(path)
    given = read(path, "command=goal:rad", "position=position:rad").recording
    np.testing.assert_allclose(given.columns["command"], (100 * ANGLE).round())
    called = table.rename(columns={"goal": "command_angle", "position": "feedback_angle"})
    called.round().to_csv(path, index=False)
    np.testing.assert_allclose(read(path).recording.columns["command"], np.radians((100 * ANGLE).round()))
    table.drop(columns="goal").assign(torque=T).to_csv(path, index=False)
    np.testing.assert_allclose(read(path).recording.columns["position"], 99 * ANGLE)


def test_names_and_units_that_stand_behind_comment_signs(tmp_path: Path) -> None:
    """Of two comments above the rows, names and then units in brackets, each is what it is."""
    path = tmp_path / "pendulum.txt"
    rows = "".join(f"{t:.2f}\t{angle:.6f}\n" for t, angle in zip(T, ANGLE, strict=True))
    path.write_text(f"#Creator: somebody\n#Time\tAngle\n#[s]\t[deg]\n{rows}")
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(np.deg2rad(ANGLE), abs=1e-7)
    assert found.recording.time == pytest.approx(T)


def test_a_symbol_of_the_joint_and_a_quantity_of_it(tmp_path: Path) -> None:
    """``q3`` is the angle of joint 3, ``q3_tau_J_compensate`` its torque, not the angle of another joint."""
    path = tmp_path / "arm.csv"
    pd.DataFrame({"time": T, "q3": ANGLE, "q3_tau_J_compensate": 2 * ANGLE}).to_csv(path, index=False)
    found = read(path).recording.columns
    assert found["position"] == pytest.approx(ANGLE)
    assert found["torque"] == pytest.approx(2 * ANGLE)


@pytest.mark.slow
def test_text_with_metadata_and_many_columns(tmp_path: Path) -> None:
    """Lines of ``# key = value`` count, as in lostmotion's own files; a header of 100 kB is another program's."""
    path = tmp_path / "x.csv"
    path.write_text('\n# angle_unit = "deg"\n\n# by hand, at noon\n# joint = "elbow"\nt,angle\n0,90\n1,180\n')
    found = read_recording(path)
    np.testing.assert_allclose(found.columns["position"], [np.pi / 2, np.pi])
    assert found.metadata["joint"] == "elbow"
    names = [f"/robot/some/long/name/of/a/signal/number/{k}" for k in range(2000)]
    frame = pd.DataFrame(np.zeros((3, 2000)), columns=names)
    frame.insert(0, "__time", [0.0, 0.1, 0.2])
    frame["elbow/position"] = [1.0, 2.0, 3.0]
    frame.to_csv(path, index=False)
    assert read_recording(path).columns["position"].tolist() == [1, 2, 3]


def test_parquet(tmp_path: Path) -> None:
    """Lists become a series a place, nanoseconds stay exact, null is not sampled."""
    path = tmp_path / "x.parquet"
    frame = pd.DataFrame(
        {"timestamp": pd.to_datetime(1_700_000_000_000_000_000 + np.arange(200) * 10_000_001, utc=True)}
    )
    frame["state"] = list(np.column_stack([ANGLE, -ANGLE]))
    frame["torque"] = np.where(np.arange(200) % 2, np.nan, ANGLE)
    frame["label"] = "x"
    frame.to_parquet(path)
    found = read(path, "position=state[1]")
    np.testing.assert_allclose(found.recording.columns["position"], -ANGLE)
    assert found.recording.signal("torque")[0].size == 100
    assert found.recording.time[-1] == pytest.approx(199 * 0.010000001, abs=1e-12)


def test_parquet_without_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The line names the package and the command that installs it."""
    path = tmp_path / "x.parquet"
    pd.DataFrame({"time": T, "position": ANGLE}).to_parquet(path)
    for name in [name for name in sys.modules if name.partition(".")[0] == "pyarrow"]:
        monkeypatch.setitem(sys.modules, name, None)
    assert "needs the package pyarrow, which is not installed here: " in refused(path)


def test_matlab(tmp_path: Path) -> None:
    """Rows and columns, structures, matrices; vectors of another length are left out and counted."""
    path = tmp_path / "x.mat"
    logged = {"q": ANGLE[None, :], "tau": np.column_stack([ANGLE, 2 * ANGLE])}
    scipy.io.savemat(path, {"t": T[:, None], "out": logged, "gains": np.arange(3.0), "fs": 100.0}, do_compression=True)
    found = read(path, "torque=out.tau[1]*1.5")
    np.testing.assert_allclose(found.recording.columns["torque"], 3 * ANGLE)
    np.testing.assert_allclose(found.recording.columns["position"], ANGLE)
    assert "1 vectors that do not have 200 values are left out" in found.notes


def test_matlab_since_version_7_3(tmp_path: Path) -> None:
    """HDF5 behind MATLAB's own header: vectors lie on their sides, structures are groups, a text is no signal."""
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["t"], file["out/q"], file["out/tau"] = T[None, :], ANGLE[None, :], np.stack([ANGLE, 2 * ANGLE])
        file["title"] = np.frombuffer(b"swing" * 40, np.uint8).astype(np.uint16)[None, :]
        file["title"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"], file["gains"] = ANGLE[:9], np.arange(3.0)
    content = path.read_bytes()
    content = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + content[512:]
    path.write_bytes(content)
    assert [one.name for one in open_source(path).series] == ["out.q", "out.tau[0]", "out.tau[1]", "t"]
    found = read(path, "torque=out.tau[1]*1.5").recording
    np.testing.assert_allclose(found.columns["torque"], 3 * ANGLE)
    np.testing.assert_allclose(found.columns["position"], ANGLE)
    path.write_bytes(content[:3000])
    assert "cannot be read as HDF5" in refused(path)


def test_hdf5_of_a_robot(tmp_path: Path) -> None:
    """As imitation learning records it: joints as columns, images beside them, a rate, records, links elsewhere."""
    path = tmp_path / "episode_0.hdf5"
    with h5py.File(path, "w") as file:
        file["observations/qpos"] = np.stack([ANGLE, 2 * ANGLE], 1)
        file["action"] = np.stack([ANGLE, 2 * ANGLE], 1) + 0.01
        file["observations/images/top"] = np.zeros((T.size, 4, 4, 3), np.uint8)
        file["fps"], file["loop"], file["far"] = 50, h5py.SoftLink("/observations"), h5py.ExternalLink("y.h5", "/q")
    found = read(path, joint="1").recording
    np.testing.assert_allclose(found.time, np.arange(T.size) / 50)
    np.testing.assert_allclose(found.columns["position"], 2 * ANGLE)
    np.testing.assert_allclose(found.columns["command"], 2 * ANGLE + 0.01)
    with h5py.File(path, "w") as file:
        file["log/table"] = np.array(list(zip(T, ANGLE, strict=True)), dtype=[("t", "f8"), ("q", "f4")])
    np.testing.assert_allclose(read(path).recording.columns["position"], ANGLE, atol=1e-6)


def test_what_a_simulink_scope_saves(tmp_path: Path) -> None:
    """A structure with time: an array of signals, by their labels, whose units are read; one without is numbered."""
    signals = np.empty(3, dtype=[("values", object), ("label", object)])
    for index, (label, values) in enumerate((("angle [deg]", np.degrees(ANGLE)), ("torque", 2 * ANGLE), ("", T))):
        signals[index] = (values, label)
    scipy.io.savemat(tmp_path / "scope.mat", {"log": {"time": T, "signals": signals, "blockName": "motor/Scope"}})
    recording = read_recording(tmp_path / "scope.mat", terms=("torque=torque",))
    np.testing.assert_allclose(recording.columns["position"], ANGLE, atol=1e-12)
    np.testing.assert_allclose(recording.columns["torque"], 2 * ANGLE)


@pytest.mark.parametrize("row", ['{0},"[{1}, {2}]","[{3}, 0.0]"', "{0};[{1} {2}];[{3} 0.0]"])
def test_lists_in_the_cells_of_a_table(row: str, tmp_path: Path) -> None:
    """The numbers of all joints in one cell, as Python's csv or numpy print them, are a column each."""
    lines = [row.format(t, angle, 2 * angle, 3 * angle) for t, angle in zip(T, ANGLE, strict=True)]
    path = tmp_path / "state.csv"
    path.write_text("\n".join([f"time{row[3]}positions{row[3]}efforts", *lines]) + "\n")
    found = read_recording(path, terms=("position=positions[1]", "torque=efforts[0]"))
    np.testing.assert_allclose(found.columns["position"], 2 * ANGLE)
    np.testing.assert_allclose(found.columns["torque"], 3 * ANGLE)


@pytest.mark.parametrize("place", [145, 176, 250, 300])
def test_damaged_matlab_ends_no_program(place: int, tmp_path: Path) -> None:
    """A byte of a length or a type in place of another makes SciPy's reader crash: that is one line, too."""
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"t": T[:20], "q": ANGLE[:20]})
    content = bytearray(path.read_bytes())
    content[place] = 255
    path.write_bytes(content if place < 250 else content[:place])
    assert "cannot be read as a MAT file: " in refused(path)


def test_what_a_library_says_is_told_without_the_name_of_its_error(tmp_path: Path) -> None:
    """An empty MAT file in SciPy's words, not as a MatReadError."""
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, {"t": T[:20], "q": ANGLE[:20]})
    path.write_bytes(path.read_bytes()[:140])
    assert "Error" not in refused(path)
    assert in_words("MatReadError: Mat file appears to be empty") == "Mat file appears to be empty"
    assert in_words("KeyError: 'names'") == "KeyError: 'names'"


def test_several_joints_are_asked_for(tmp_path: Path) -> None:
    """Nothing is taken at random: the joints are listed, and one is chosen by its name."""
    path = tmp_path / "x.csv"
    names = [f"/joint_states/{joint}/position" for joint in ("base", "elbow", "wrist")]
    pd.DataFrame({"time": T, **{name: k + ANGLE for k, name in enumerate(names)}}).to_csv(path, index=False)
    assert "found 3 joints, expected one; choose with --joint NAME (or FILE#joint=NAME) from base, elbow" in refused(
        path
    )
    assert read_recording(f"{path}#joint=elbow").columns["position"][0] == 1.0
    assert "found no joint 'arm', expected one of base, elbow, wrist" in refused(path, joint="arm")
    assert "found no series 'wrist/pos'" in refused(path, "position=wrist/pos")
    assert read(path, "position=wrist/position").recording.metadata["joint"] == "wrist"


def test_axes_and_degrees_are_not_guessed(tmp_path: Path) -> None:
    """Of three axes none is taken; angles of hundreds without a unit are taken as rad, and doubted aloud."""
    path = tmp_path / "x.csv"
    axes = {f"/imu/linear_acceleration/{axis}": ANGLE for axis in "xyz"}
    pd.DataFrame({"time": T, "angle": 300 * ANGLE, **axes}).to_csv(path, index=False)
    found = read(path)
    assert list(found.recording.columns) == ["position"]
    assert any(note.startswith("accel: not taken, found /imu/linear_acceleration/x") for note in found.notes)
    doubt = "if they are degrees, use --map position=angle:deg, if turns, --map position=angle:rev"
    assert any(doubt in note for note in found.notes)
    assert read(path, "accel=acceleration/y:g").recording.columns["accel"][-1] == pytest.approx(9.80665 * ANGLE[-1])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "found an empty file"),
        (b"\n\n", "the file is empty"),
        (b"t,q\n", "found no time in 't'"),
        (b"t;q\n0;1\n1;2\n2026-01-01T00:00:00Z;3\n", "found q, and no times; give the rows a second"),
        (b"t,q\n0,nan\n1,\n", "found no numbers in q"),
        (b"t,q\n0,inf\n1,2\n", "found inf in 'q', expected finite numbers"),
        (b"t,q\n0,1\n2,2\n1,3\n", "found the time 1 s after 2 s in row 3, expected rows in time order"),
        (b"t,q\n0,1\n1\n2,2\n", "line 3: found 1 cells separated by commas, expected 2"),
        (b"t;q\n" + b"0;1\n" * 400 + b"0;x1\n" * 30, "line 402: found 'x1' in 'q', expected a number"),
        (b"PAR1" + bytes(100), "cannot be read as Parquet"),
        (b"MATLAB 5.0 MAT-file" + bytes(300), "cannot be read as a MAT file"),
        (b"PK\x03\x04" + bytes(50), "found a workbook, ZIP or NumPy archive"),
        (b"\xd0\xcf\x11\xe0" + bytes(600), "cannot be read as a workbook"),
        (b"#ROSBAG V2.0\n" + bytes(50), "cannot be read as ROS 1 bag"),
        (b"\x89HDF\r\n\x1a\n" + bytes(50), "cannot be read as HDF5"),
        (b"name,word\na,b\nc,d\n", "found text without a column of numbers"),
        (b"t,b,\x1b[31mq\x07" + b"z" * 1900 + b"\n0,1,2\n", "found t, b, ?[31mq?z"),
        (b"t," + b"z" * 5000 + b"\n0,1\n", "found a series with a name of 5000 characters, expected at most 2000"),
        (b"\x00\x01" * 500, "found bytes that are no text"),
    ],
)
def test_what_is_no_recording_is_told(content: bytes, message: str, tmp_path: Path) -> None:
    """Empty, damaged, of another kind, with names that would steer a terminal: one line says what was found."""
    path = tmp_path / "x.dat"
    path.write_bytes(content)
    told = refused(path)
    assert message in told
    assert len(told) < 500
    assert told.isprintable()


def test_cut_off_last_line_is_left_out(tmp_path: Path) -> None:
    """As a killed logger leaves it."""
    path = tmp_path / "x.csv"
    for rest in ("2;3", "2;3;4e", "2"):
        path.write_text(f"t;q;tau\n0;1;2\n1;2;3\n{rest}")
        assert read(path).recording.time.tolist() == [0, 1]


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_are_answered(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes in place of others in a file of each format: a recording, or RecordingError in one line."""
    path = tmp_path / "x.bin"
    frame = pd.DataFrame({"t": T[:20], "q": ANGLE[:20], "tau": 1.0})
    if data.draw(st.booleans()):
        frame.to_parquet(path)
    else:
        frame.to_csv(path, index=False, sep=data.draw(st.sampled_from(";,\t ")))
    content = path.read_bytes()
    begin, end = sorted(data.draw(st.tuples(*[st.integers(0, len(content))] * 2)))
    path.write_bytes(content[:begin] + data.draw(st.binary(max_size=20)) + content[min(end, begin + 30) :])
    told = ""
    try:
        assert read(path).recording.time.size > 0
    except RecordingError as error:
        told = str(error)
    assert "\n" not in told


def test_real_measurements_in_other_formats(real_data: Measurements, tmp_path: Path) -> None:
    """A servo's recording as PlotJuggler, pandas and SciPy write it is the same recording."""
    true = read_recording(real_data("bam_xl330") / "sin_sin_kp400.csv")
    frame = pd.DataFrame({"__time": true.time, **true.columns})
    frame.to_csv(tmp_path / "x.csv", index=False)
    frame.to_parquet(tmp_path / "x.parquet")
    scipy.io.savemat(tmp_path / "x.mat", {"t": true.time, **true.columns})
    for name in ("x.csv", "x.parquet", "x.mat"):
        found = read_recording(tmp_path / name)
        np.testing.assert_allclose(found.time, true.time, atol=1e-12)
        for column, values in true.columns.items():
            np.testing.assert_array_equal(found.columns[column], values, err_msg=f"{name} {column}")


@pytest.mark.parametrize(
    ("said", "scale"),
    [("displacement", 1.0), ("displacement*0.0254", 0.0254), ("raw*25.4:mm", 0.0254), ("raw:in", 0.0254)],
)
def test_a_length_makes_a_linear_axis(said: str, scale: float, tmp_path: Path) -> None:
    """What is a displacement by its name, or in a unit of length, is a position in m, and a force a torque in N."""
    path = tmp_path / "axis.csv"
    pd.DataFrame({"time": T, "displacement": T, "raw": T, "force": T}).to_csv(path, index=False)
    found = read(path, f"position={said}", "torque=force").recording
    np.testing.assert_allclose(found.columns["position"], scale * T)
    assert found.metadata["position_unit"] == "m"
    assert found.metadata["torque_unit"] == "N"


@pytest.mark.parametrize(("unit", "factor"), [("rpm", np.pi / 30), ("rad/s", 1.0)])
def test_a_speed_is_integrated_where_it_is_said_to_tell_the_position(unit: str, factor: float, tmp_path: Path) -> None:
    """A motor that runs up to 60 of the unit in 2 s has turned 60 of it: trapezoids, exact for a ramp; the recording
    says that it did so, and has the position's unit."""
    path = tmp_path / "motor.csv"
    path.write_text("time,wheel\n" + "".join(f"{k / 10},{3 * k}\n" for k in range(21)))
    found = read(path, f"position=wheel:{unit}")
    turned = found.recording.columns["position"]
    assert turned[[0, 10, 20]] == pytest.approx(np.array([0.0, 15.0, 60.0]) * factor)
    assert "position_unit" not in found.recording.metadata
    assert "position: integrated from a speed, from zero on" in found.notes


def table(path: Path, header: str, *columns: Any) -> Path:
    """A text file of these columns; without a header where that is empty."""
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


def test_a_speed_stands_for_the_motion_where_there_is_no_other(tmp_path: Path) -> None:
    """With a unit it is integrated; without one the line to type is printed."""
    path = table(tmp_path / "x.csv", "Time (ms),Speed [rpm],Torque [mNm]", 1e3 * T, 60 + 0 * T, 7 + T)
    found = read(path).recording
    assert found.columns["position"][-1] == pytest.approx(2 * np.pi * T[-1])
    assert found.columns["torque"][0] == pytest.approx(7e-3)
    path = table(tmp_path / "z.csv", "Tiempo (s),Velocidad (rad/s)", T, 2 + 0 * T)
    assert read(path).recording.columns["position"][-1] == pytest.approx(2 * T[-1])
    path = table(tmp_path / "y.csv", "t,omega,torque", T, T, T)
    assert "--map position=omega:rpm (or :rad/s) integrates a speed" in "".join(read(path).notes)


def test_a_time_without_a_name_ascends_evenly(tmp_path: Path) -> None:
    """A file without a header: its first column is the time, and the line to type names the second one."""
    path = table(tmp_path / "x.txt", "", T, ANGLE, 2 * ANGLE)
    assert "--map position=column2, and a torque --map torque=column3" in refused(path)
    found = read(path, "position=column2").recording
    np.testing.assert_allclose(found.time, T, atol=1e-9)
    path = table(tmp_path / "y.txt", "", ANGLE, 2 * ANGLE)
    assert "and no times; give the rows a second" in refused(path, "position=column2")


def test_what_stands_beside_our_own_names_is_read_too(tmp_path: Path) -> None:
    """A header of another program may hold some of the names of a recording."""
    path = table(tmp_path / "x.csv", "time,Shaft Angle [deg],torque,id", T, 180 + ANGLE, ANGLE, T)
    found = read_recording(path)
    assert found.columns["position"][0] == pytest.approx(np.pi)
    assert found.columns["torque"][5] == pytest.approx(ANGLE[5])
    assert "not used: id" in "".join(read(path).notes)


def test_a_series_is_found_as_people_write_it(tmp_path: Path) -> None:
    """Without its unit, in other capitals, and a rate in words of the command line."""
    path = table(tmp_path / "x.csv", "data[0],Crank [deg]", T**2, ANGLE)
    address, choice = split_address(Path(f"{path}#rate-hz=50,position=crank,torque=data.0"))
    assert choice.rate_hz == 50
    found = imported(address, choice).recording
    assert found.columns["position"][9] == pytest.approx(np.radians(ANGLE[9]))
    assert found.columns["torque"][9] == pytest.approx(T[9] ** 2)
    assert found.time[1] == pytest.approx(0.02)


def test_a_speed_without_numbers_is_an_empty_position(tmp_path: Path) -> None:
    """Nothing is integrated: no sample is made up where the column that was named holds none."""
    path = tmp_path / "motor.csv"
    path.write_text("time,wheel,goal\n0,,1\n1,,2\n2,,3\n")
    found = read(path, "position=wheel:rpm", "command=goal:rad")
    assert np.isnan(found.recording.columns["position"]).all()
    assert found.recording.columns["command"].tolist() == [1.0, 2.0, 3.0]


def test_names_behind_a_hash_are_no_metadata(tmp_path: Path) -> None:
    """A table of numbers below lines of words behind # is another program's, and says which series it has."""
    path = tmp_path / "run.txt"
    path.write_text("#OPEN LOOP\n#t\tu\tv\n" + "".join(f"{i / 100}\t{i % 7}\t{i}\n" for i in range(60)))
    with pytest.raises(RecordingError, match="--map"):
        read_recording(path)
    found = read_recording(path, "", ["position=u", "torque=v"])
    assert set(found.columns) >= {"position", "torque"}


def test_a_line_below_the_header_and_numbers_of_runs(tmp_path: Path) -> None:
    """A drawn line is no row; the unit stands in front of ``Run #1``, as a data logger of schools writes it."""
    rows = "".join(f"{t:.2f}; {t / 5:.3f};\n" for t in T)
    (tmp_path / "run.csv").write_text(f"Time (s) Run #1;Position (m) Run #1;Velocity\n{'-' * 30}\n{rows}")
    found = read(tmp_path / "run.csv")
    assert found.recording.columns["position"] == pytest.approx(T / 5, abs=1e-3)
    assert found.recording.metadata["position_unit"] == "m"


def test_titles_above_numbers_without_names_are_left_out(tmp_path: Path) -> None:
    """Two lines of words above rows of tabs name no columns: these are numbered, and the first is the time."""
    rows = "".join(f"{t:.3f}\t{0.1:.3f}\t{y:.6f}\n" for t, y in zip(T, ANGLE, strict=True))
    (tmp_path / "swing.txt").write_text(f"--- a torsion pendulum ---\nTime.Motor.Pendulum\n{rows}")
    assert "as in --map position=column3 (rad;" in refused(tmp_path / "swing.txt")
    found = read(tmp_path / "swing.txt", "position=column3:rad").recording
    np.testing.assert_allclose(found.columns["position"], ANGLE, atol=1e-6)
    np.testing.assert_allclose(found.time, T, atol=1e-6)


def test_a_header_may_name_more_than_there_is(tmp_path: Path) -> None:
    """Names of errors that no row has, and a time that its name does not show."""
    rows = "".join(f"{t:.3E} {y:.6E}\n" for t, y in zip(T, ANGLE, strict=True))
    (tmp_path / "film.txt").write_text(f"x y dx dy\n{rows}")
    found = read(tmp_path / "film.txt").recording
    np.testing.assert_allclose(found.columns["position"], ANGLE, atol=1e-6)


def test_a_greek_letter_is_an_angle(tmp_path: Path) -> None:
    """The angle of a pendulum is most often called by its letter; beside it its uncertainty, which is no angle."""
    rows = "".join(f"{t:.3f}\t{y:.6f}\t1\n" for t, y in zip(T, ANGLE, strict=True))
    (tmp_path / "swing.txt").write_text(f"t\tθ (rad)\tuncertainty θ (of the camera)\n{rows}")
    np.testing.assert_allclose(read(tmp_path / "swing.txt").recording.columns["position"], ANGLE, atol=1e-6)


def test_the_number_of_a_run_may_stand_in_an_address(tmp_path: Path) -> None:
    """A # in the name of a joint does not end the name of the file."""
    path = tmp_path / "runs.csv"
    path.write_text("Position (mm) Run #1;Position (mm) Run #2\n1,5;2,5\n")
    file, choice = split_address(Path(f"{path}#joint=Run #2,rate_hz=50"))
    assert (file, choice.joint, choice.rate_hz) == (path, "Run #2", 50.0)


@pytest.mark.parametrize("title", ["mass_B\n", "Voltage, ChA, Run #1\nexported on Monday morning\n"])
def test_lines_above_the_header(title: str, tmp_path: Path) -> None:
    """A title above the names of the columns is no header, whatever it holds."""
    rows = "".join(f"{t:.2f}\t{t / 5:.3f}\n" for t in T)
    (tmp_path / "run.txt").write_text(f"{title}Time ( s )\tPosition ( m )\n{rows}")
    assert read(tmp_path / "run.txt").recording.columns["position"] == pytest.approx(T / 5, abs=1e-3)
