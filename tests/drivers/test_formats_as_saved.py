"""Files as people save them: twins of published ones, in their form.  Each is read without an option."""

from __future__ import annotations

import json
import time
import zipfile
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import openpyxl
import pytest
import scipy.io
import xlwt
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.cells import date, number
from lostmotion.drivers.formats.registry import open_source
from lostmotion.drivers.formats.words import column_of, is_time, speed_of
from lostmotion.drivers.recordings import read_recordings
from tests.drivers.test_formats import read, refused

T = np.arange(300) / 30
SWING = 0.6 * np.exp(-T / 20) * np.cos(5 * T)
"""an angle [rad] of eight periods, as a film of 30 frames a second shows it"""


def rows(*columns: np.ndarray, sign: str = "\t", digits: int = 5) -> str:
    """Lines of numbers."""
    return "".join(sign.join(f"{value:.{digits}f}" for value in row) + "\n" for row in zip(*columns, strict=True))


@pytest.mark.parametrize(
    "title", ["Schwingung ohne Kopplung\n\n", "Symmetrische Eigenschwingung\n19.2\n", "boot\nsensor ok 3 of 3\n"]
)
def test_what_stands_above_the_numbers_is_a_title(title: str, tmp_path: Path) -> None:
    """Words, as many as the columns or not, and a number alone do not become names."""
    path = tmp_path / "pendel.txt"
    path.write_text(title + rows(T, SWING, 2 + 0.3 * np.sin(3 * T), sign=" "))
    assert "found column1, column2, column3, and none that is clearly a column" in refused(path)
    found = read(path, "position=column2").recording
    assert found.columns["position"] == pytest.approx(SWING, abs=1e-5)
    assert found.time == pytest.approx(T, abs=1e-5)


def test_times_without_a_name_are_used(tmp_path: Path) -> None:
    """Of two columns without names the one that ascends is the time, and is not listed as one that is not used."""
    path = tmp_path / "pendel.csv"
    path.write_text(rows(T, SWING, sign=", "))
    assert not any(note.startswith("not used") for note in read(path).notes)


@pytest.mark.parametrize("unit", ["millisec", "milliseconds", "msec"])
def test_milliseconds_by_any_name(unit: str, tmp_path: Path) -> None:
    path = tmp_path / "motor.csv"
    path.write_text(f"time ({unit}),angle (degree)\n" + rows(1000 * T, np.degrees(SWING), sign=","))
    assert read(path).recording.time == pytest.approx(T, abs=1e-5)


def test_the_advice_takes_the_input_for_what_drives(tmp_path: Path) -> None:
    """In ``t,u,y`` u is what drives, and y the answer, also where u comes first."""
    path = tmp_path / "prbs.csv"
    path.write_text("t,u,y\n" + rows(T, np.sign(SWING), SWING, sign=","))
    assert "--map position=y, and a torque --map torque=u " in refused(path)
    path.write_text("t,r,y,u\n" + rows(T, np.sign(SWING), SWING, -SWING, sign=","))
    assert "--map position=y, and a torque --map torque=u, and for a servo its goal --map command=r " in refused(path)


def test_a_force_moves_a_length(tmp_path: Path) -> None:
    """Of a cart with a pendulum, whose angle has a name: the place is what the force moves, and the angle is left."""
    path = tmp_path / "crane.csv"
    path.write_text("time [s],F_set [N],x [m],phi1_deg\n" + rows(T, np.sign(SWING), SWING, 90 * SWING, sign=","))
    found = read(path)
    assert found.lines()[:3] == [
        f"{path}: text separated by commas; time: time [s]",
        "  position = x [m]  (m; a length, which a force moves)",
        "  force = F_set [N]  (N; by its name)",
    ]
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-5)
    assert read(path, "position=phi1_deg").recording.columns["position"] == pytest.approx(np.pi / 2 * SWING, abs=1e-5)
    path.write_text("time [s],force [N],z [m],q1_deg,torque\n" + rows(T, SWING, SWING, 90 * SWING, -SWING, sign=","))
    assert "  position = q1_deg  (deg, now rad; by its name)" in read(path).lines()


def test_of_vectors_of_several_lengths_those_with_the_motion_are_used(tmp_path: Path) -> None:
    """A run that was stopped early: inputs that were computed ahead, and the times of the whole of it, are longer."""
    ahead = np.append(SWING, [0.0, 0.0])
    scipy.io.savemat(tmp_path / "x.mat", {"input": ahead, "inputDig": ahead, "arm": SWING, "theta": SWING, "t": T[:40]})
    found = read(tmp_path / "x.mat", rate_hz=30)
    np.testing.assert_allclose(found.recording.columns["position"], SWING)
    assert "3 vectors that do not have 300 values are left out" in found.notes


def test_of_several_accelerometers_the_refusal_names_one(tmp_path: Path) -> None:
    """Two bars in one file, each with two sensors and the same times, which no name of one word calls so."""
    bar = {"Out": {"Acc": np.stack([SWING, 2 * SWING], axis=1), "Time": T}}
    scipy.io.savemat(tmp_path / "bars.mat", {"Fe": bar, "Al": bar})
    assert "choose one with --map 'accel=Al.Out.Acc[0]'" in refused(tmp_path / "bars.mat").replace("Fe", "Al")
    found = read(tmp_path / "bars.mat", "accel=Fe.Out.Acc[1]").recording
    np.testing.assert_allclose(found.columns["accel"], 2 * SWING)
    np.testing.assert_allclose(found.time, T)


def test_the_only_series_is_the_motion_and_the_time_may_come_second(tmp_path: Path) -> None:
    """Names behind %, the position first: what is left beside the time needs no name that is known."""
    path = tmp_path / "oscilador.data"
    path.write_text("%y (m)\tt (s)\r\n" + rows(SWING / 9, T).replace("\n", "\r\n"))
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(SWING / 9, abs=1e-5)
    assert found.recording.metadata["position_unit"] == "m"
    assert found.columns[0].why == "the only series beside the time"


@pytest.mark.parametrize(("scale", "unit", "digits"), [(1e3, "ms", 0), (1e6, "us", 0), (1e6, "us", 3)])
def test_numbers_of_a_clock_and_a_swing_in_degrees(scale: float, unit: str, digits: int, tmp_path: Path) -> None:
    """Neither ``millis()`` nor ``micros()`` counts seconds, no log has a row in nine hours, and nothing swings by 34
    rad."""
    path = tmp_path / "log.txt"
    counted = np.round(12.9 * scale + T * scale, digits)
    path.write_text("".join(f"{t:.{digits}f}\t{np.degrees(y):.2f}\n" for t, y in zip(counted, SWING, strict=True)))
    found = read(path)
    assert f"[{unit}, by the size of its steps]" in found.clock
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-4)
    assert np.diff(found.recording.time) == pytest.approx(1 / 30, abs=1.1 / scale)
    assert "taken as deg, as nothing swings by 33." in "".join(found.notes)


def test_a_turn_of_many_rad_that_does_not_swing_stays_one(tmp_path: Path) -> None:
    """A shaft may turn on: only what goes to and fro is in degrees."""
    path = tmp_path / "shaft.txt"
    path.write_text("t,angle\n" + rows(T, 2 * T**2, sign=","))
    assert read(path).recording.columns["position"][-1] == pytest.approx(2 * T[-1] ** 2, abs=1e-4)


def test_a_name_that_is_a_unit_and_columns_without_one(tmp_path: Path) -> None:
    """``t rad error`` are names, no units of names above; a sheet may have columns that no name stands over."""
    path = tmp_path / "x.csv"
    path.write_text("t\trad\txerr\n" + rows(T, SWING, 0 * T))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-5)
    path.write_text("Time (s),Angle (deg)\n" + rows(T, SWING, 0 * T, T, sign=","))
    assert read(path).recording.columns["position"] == pytest.approx(np.radians(SWING), abs=1e-5)
    path.write_text("t,theta\n" + "".join(f"{t},{y}\n" for t, y in zip(T, np.rint(500 * SWING), strict=True)))
    assert "if counts of 4096 a turn" in "".join(read(path).notes)


@pytest.mark.parametrize(
    ("header", "ends"),
    [
        ("%Time (ms)\tAngle (deg)\t%4/25/20175:38 PM\n", "\t1.0\t0.0\n"),  # a date in the place of a name, then none
        ("%Time (ms)\tAngle (deg)\t\t\n\t%3/20/20171:31 PM\n", "\n"),  # a date below, and a name too many
        ("%Time (ms)\tAngle (deg)\t%3/11/20201:59 PM\n", "\n"),
    ],
)
def test_names_behind_a_sign_with_a_date_beside_them(header: str, ends: str, tmp_path: Path) -> None:
    """As a program of a laboratory saves them: the names are used, whatever stands beside or below them."""
    path = tmp_path / "rigidarm"
    lines = (f"{1000 * t:.3f}\t{np.degrees(y):.3f}{ends}" for t, y in zip(T, SWING, strict=True))
    path.with_suffix(".txt").write_text(header + "".join(lines))
    found = read(path.with_suffix(".txt"))
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-4)
    assert found.recording.time == pytest.approx(T, abs=1e-4)


def test_of_readings_in_two_units_those_of_the_column_are_used(tmp_path: Path) -> None:
    """A force in N beside the voltage of its sensor, which comes first."""
    path = tmp_path / "damper.csv"
    header = "Time (s),Force (V),Force (N),Displacement (V),Displacement (mm)\n"
    path.write_text(header + rows(T, SWING, 100 * SWING, 1 + SWING, 20 * SWING, sign=","))
    found = read(path).recording
    assert found.columns["force"] == pytest.approx(100 * SWING, abs=1e-4)
    assert found.columns["displacement"] == pytest.approx(0.02 * SWING, abs=1e-5)
    assert "force_unit" not in found.metadata


def test_names_behind_a_label_in_a_comment(tmp_path: Path) -> None:
    """As programs write them above their rows, also in another language; a label before anything else names nothing."""
    path = tmp_path / "swing.txt"
    for label in ("Columnas: t angle extra", "Columns:\tt\tangle\textra"):
        path.write_text(f"# Perfil: a b c\n# {label}\n#\n" + rows(T, SWING, 0 * T))
        found = read(path)
        assert found.clock.startswith("t [s")
        assert [one.series for one in found.columns] == ["angle"]


def test_a_unit_of_acceleration_says_what_it_is(tmp_path: Path) -> None:
    """Of a name that says nothing else; two runs side by side are two recordings."""
    path = tmp_path / "damper.csv"
    path.write_text("Time,With (m/s^2),Time (3),Without (m/s^2)\n" + rows(T, SWING, T, 2 * SWING, sign=","))
    found = read_recordings([path], base="oscillator")
    np.testing.assert_allclose([one.columns["accel"] for one in found], [SWING, 2 * SWING], atol=1e-4)


def test_runs_side_by_side(tmp_path: Path) -> None:
    """Each run has times of its own, and one ends earlier: the longest is read, and another one by its number; of
    several recordings each run is one."""
    path = tmp_path / "agua.csv"
    lines = [
        f"{t:.2E};{np.degrees(y):.3f};0;" + (f"{t:.4f};{np.degrees(y) / 2:.4f};0" if t < 5 else ";;")
        for t, y in zip(T, SWING, strict=True)
    ]
    path.write_text("t1;theta1;omega1;t2;theta2;omega2\n" + "\n".join(lines) + "\n")
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-4)
    (note,) = [note for note in found.notes if "side by side" in note]
    assert note.endswith("for another FILE#episode=1")
    first, second = read_recordings([path])
    assert first.columns["position"] == pytest.approx(SWING, abs=1e-4)
    by_map = read(path, "time=t2", "position=theta2:deg").recording
    for other in (by_map, read(path, joint="2").recording, read(path, episode=1).recording, second):
        assert other.columns["position"] == pytest.approx(SWING[T < 5] / 2, abs=1e-4)
        assert other.time == pytest.approx(T[T < 5], abs=1e-4)
    for wrong in (2, -1):
        assert f"{path}: found episode={wrong}, expected 0 to 1" in refused(path, episode=wrong)


def test_runs_one_after_another(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Where the times begin anew another recording begins; a stub and one at rest are left out beside the others."""
    path = tmp_path / "log.csv"
    still = 1e-3 * np.random.default_rng(4).standard_normal(T.size)
    runs = [(T, SWING), (T[:200], -SWING[:200]), (T, still), (T[:25], SWING[:25])]
    times, angles = (np.concatenate(each) for each in zip(*runs, strict=True))
    path.write_text("t,angle\n" + rows(times, angles, sign=","))
    first, second = read_recordings([path])
    np.testing.assert_allclose(first.columns["position"], SWING, atol=1e-4)
    np.testing.assert_allclose(second.columns["position"], -SWING[:200], atol=1e-4)
    assert second.name == f"{path}#episode=1"
    assert f"beside other runs: {path}#episode=2, {path}#episode=3" in caplog.text
    assert read(path, episode=3).recording.time.size == 25
    assert any(
        "rows 1 to 300 are used, the longest part; for another FILE#episode=1" in one for one in read(path).notes
    )
    assert f"{path}: found episode=4, expected 0 to 3" in refused(path, episode=4)


def test_a_run_that_moves_less_is_not_at_rest(tmp_path: Path) -> None:
    """A driven disk moves by 0.064 of what it does at its resonance, and a pendulum that hangs still by 0.005."""
    path = tmp_path / "driven.csv"
    header = ",".join(f"Time (s) Run #{run},Angle (rad) Run #{run}" for run in (1, 2, 3))
    angles = (SWING, 0.06 * SWING, 0.005 * SWING)
    path.write_text(f"{header}\n" + rows(*(each for angle in angles for each in (T, angle)), sign=","))
    moved = [np.ptp(one.columns["position"]) / np.ptp(SWING) for one in read_recordings([path])]
    assert moved == pytest.approx([1.0, 0.06], rel=0.01)


def test_a_joint_of_each_of_several_runs(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Two sensors in each run: that of a joint is one recording a run.  Rows beyond the end of a run are none of it."""
    path = tmp_path / "pasco.csv"
    names = ["Time (s)", "Angle, Ch 1 (rad)", "Angle, Ch 2 (rad)"]
    path.write_text(";".join(f'"{name} Run #{run}"' for run in (1, 2) for name in names) + "\n")
    with path.open("a") as file:
        for k, (t, y) in enumerate(zip(T, SWING, strict=True)):
            file.write(f"{t:.3f};{y:.5f};{2 * y:.5f};" + (f"{t:.3f};{3 * y:.5f};{4 * y:.5f}\n" if k < 99 else ";;\n"))
    first, second = read_recordings([path], joint="Ch 2")
    assert first.columns["position"] == pytest.approx(2 * SWING, abs=1e-4)
    assert second.columns["position"] == pytest.approx(4 * SWING[:99], abs=1e-4)
    assert "without a time" not in caplog.text
    assert "choose with --joint NAME (or FILE#joint=NAME) from Ch 1, Ch 2" in refused(path)


@pytest.mark.parametrize("header", ["\ufefft,x,y,vx\n", ""])
def test_the_points_of_a_film_are_an_angle_about_the_pivot(header: str, tmp_path: Path) -> None:
    """x and y of a filmed bob lie on a circle; so do two columns without names."""
    path = tmp_path / "film.csv"
    points = (830 + 400 * np.sin(SWING + 0.1), 20 - 400 * np.cos(SWING + 0.1))
    path.write_text(header + rows(T, *points, *([T] if header else []), sign=",", digits=3))
    angle = read(path).recording.columns["position"]
    assert angle - angle.mean() == pytest.approx(SWING - SWING.mean(), abs=1e-4)


@pytest.mark.parametrize(("pivot", "noise"), [((0.0, 0.0), 2e-3), ((0.0, 0.0), 4e-3), ((0.2, 0.9), 2e-3)])
def test_the_origin_is_the_pivot_if_the_points_are_nearly_on_a_circle_about_it(
    pivot: tuple[float, float], noise: float, tmp_path: Path
) -> None:
    """Noise of a small swing makes the radius of the fitted circle uncertain, but by a simple algebraic fit also too
    small, and the angle too large by a fifth.  An origin that was put elsewhere is no pivot."""
    swing, noises = SWING / 2, np.random.default_rng(5).normal(size=(2, T.size)) * noise
    x, y = pivot[0] + 0.5 * np.sin(swing) + noises[0], pivot[1] - 0.5 * np.cos(swing) + noises[1]
    path = tmp_path / "film.txt"
    path.write_text("t\tx\ty\n" + rows(T, x, y))
    size = np.std(read(path).recording.columns["position"]) / np.std(swing)
    assert size == pytest.approx(1, abs=0.005 if pivot == (0.0, 0.0) else 0.03)


def test_points_in_a_cell_of_their_own(tmp_path: Path) -> None:
    """``(830, 420)`` are x and y of a film, between lines that are blank."""
    path = tmp_path / "film.csv"
    points = [
        f'"({830 + 400 * np.sin(y):.3f}, {20 - 400 * np.cos(y):.3f})",{t:.2f}' for t, y in zip(T, SWING, strict=True)
    ]
    path.write_text("position,time\n\n" + "\n\n".join(points) + "\n")
    angle = read(path).recording.columns["position"]
    assert angle - angle.mean() == pytest.approx(SWING - SWING.mean(), abs=1e-4)


def test_a_measured_angle_comes_before_an_estimated_one(tmp_path: Path) -> None:
    path = tmp_path / "cart.csv"
    path.write_text("t,theta_hat,theta,u\n" + rows(T, SWING / 2, SWING, np.cos(T), sign=","))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-4)


def test_the_input_of_a_motor_is_no_angle(tmp_path: Path) -> None:
    """Not even where its speed, which has no unit, is all that stands beside it; the advice is to integrate that."""
    path = tmp_path / "motor.csv"
    path.write_text("Time,Input,Velo\n" + rows(T, np.cos(T), 5 * SWING, sign=","))
    assert "--map position=Velo:rad/s" in refused(path)


def test_the_points_of_a_mass_are_a_displacement(tmp_path: Path) -> None:
    """What moves along a line lies on no circle: of x and y the one that moves."""
    path = tmp_path / "mass.txt"
    path.write_text("t\tx\ty\n" + rows(T, 0.002 * np.sin(40 * T), 0.1 * SWING))
    found = read(path).recording
    assert found.columns["displacement"] == pytest.approx(0.1 * SWING, abs=1e-5)
    assert "position" not in found.columns
    path.write_text("t,x,y,z\n" + rows(T, SWING, 0 * T, 0.1 * SWING, sign=","))
    assert "found t, x, y, z, and none that is clearly a column" in refused(path)


def test_the_axis_that_moves_most(tmp_path: Path) -> None:
    """Of a telephone's three axes that of the motion; where two move alike, none."""
    path = tmp_path / "Raw Data.csv"
    header = ",".join(f'"Acceleration {axis} (m/s^2)"' for axis in "xyz")
    path.write_text('"Time (s)",' + header + "\n" + rows(T, 0.1 * SWING, SWING, 0.3 * np.sin(9 * T) * SWING, sign=","))
    assert read(path).recording.columns["accel"] == pytest.approx(SWING, abs=1e-5)
    path.write_text('"Time (s)",' + header + "\n" + rows(T, np.sin(T), SWING, np.cos(T), sign=","))
    assert "--map 'accel=Acceleration x (m/s^2)'" in refused(path)


def test_times_of_day_and_quoted_decimal_commas(tmp_path: Path) -> None:
    """A column of times is the time whatever its name; commas in quotes are decimal ones."""
    path = tmp_path / "log.csv"
    clock = [f"12:{59 + int(t // 60):02d}:{t % 60:06.3f}".replace(".", ",") for t in T]
    path.write_text(
        "Uhrzeit;Winkel (°)\n" + "".join(f"{c};{y:.3f}\n".replace(".", ",") for c, y in zip(clock, SWING, strict=True))
    )
    found = read(path).recording
    assert np.diff(found.time) == pytest.approx(1 / 30, abs=2e-3)
    assert found.start is None
    path.write_text('"Zeit (s)","Auslenkung (mm)"\n' + rows(T, 100 * SWING, sign='","').replace(".", ","))
    text = path.read_text().splitlines()
    path.write_text("\n".join([text[0], *(f'"{line}"' for line in text[1:])]) + "\n")
    assert read(path).recording.columns["position"] == pytest.approx(SWING / 10, abs=1e-6)


def test_cells_are_numbers_or_times() -> None:
    """With a decimal comma, or a day first; a comma that ends a number separates."""
    assert (number("1,5", True), number("1.5", True), number("1,", True), number("x", False)) == (1.5, 1.5, None, None)
    assert date("31.01.2026 12:00:01,5") == np.datetime64("2026-01-31T12:00:01.5")
    assert date("1/31/2026 12:00:00") == np.datetime64("2026-01-31T12:00:00")
    assert date("02:03.25") - date("0:00:00") == np.timedelta64(123_250, "ms")
    assert np.isnat(date("elbow"))


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Winkel", "position"), ("ángulo (°)", "position"), ("Vitesse (m/s)", None), ("Beschleunigung", "accel"),
        ("位移 (mm)", "displacement"), ("角度", "position"), ("Kraft [N]", "force"), ("posição", "position"),
    ],
)  # fmt: skip
def test_names_in_other_languages(name: str, column: str | None) -> None:
    """The usual words are translated; a time is one in any of them."""
    assert column_of(name) == column
    assert all(is_time(each) for each in ("Zeit [s]", "tiempo", "Temps (s)", "时间", "время", "t1", "Time (s) (4)"))


def test_lines_that_are_no_rows_are_left_out_and_counted(tmp_path: Path) -> None:
    """A serial port loses half a line, a program speaks in between; where one row in twenty is broken, it is none."""
    path = tmp_path / "serial.txt"
    text = rows(T, SWING, sign=",").splitlines()
    text[7], text[150] = text[7][:6], "calibrating"
    path.write_text("t,angle\n" + "\n".join(text) + "\n")
    found = read(path)
    assert found.recording.time.size == T.size - 2
    assert any(note.startswith("2 lines that are no rows were left out; line 9") for note in found.notes)
    path.write_text("t,angle\n" + "\n".join([*text * 3, *["9,x"] * 90]) + "\n")
    assert "line 9: found 1 cells separated by commas, expected 2 as in the header" in refused(path)


def test_arrays_and_json(tmp_path: Path) -> None:
    """NumPy's files, lists by name, a list of objects, and an object a line."""
    np.savez(tmp_path / "a.npz", tiempo=T, theta=SWING, g=9.81)
    np.save(tmp_path / "b.npy", np.column_stack([T, SWING]))
    held = [{"t": t, "angle": y} for t, y in zip(T.tolist(), SWING.tolist(), strict=True)]
    (tmp_path / "c.json").write_text(json.dumps({"run": {"time": T.tolist(), "angle": SWING.tolist()}, "by": "me"}))
    (tmp_path / "d.json").write_text(json.dumps(held))
    (tmp_path / "e.txt").write_text("".join(json.dumps(each) + "\n" for each in held))
    for path in sorted(tmp_path.iterdir()):
        found = read(path).recording
        np.testing.assert_allclose(found.columns["position"], SWING)
        np.testing.assert_allclose(found.time, T)
    np.savez(tmp_path / "a.npz", held=np.array([{}], dtype=object))
    assert "cannot be read as NumPy arrays" in refused(tmp_path / "a.npz")


@pytest.mark.parametrize(("lifted", "rows_used"), [(False, 300), (True, 300), (False, 120)])
def test_the_error_of_the_speed_of_a_swing_does_not_add_up(lifted: bool, rows_used: int, tmp_path: Path) -> None:
    """An offset of 0.05 rad/s, 0.5 rad in the recording, is taken off a swing of eight periods, or of three, also where
    a hand lifts the pendulum first; but not off the speed of a part that is driven, unless it is a gyroscope's."""
    angle = np.where((T < 4) & lifted, SWING[120] * np.clip(T, 0, 1), SWING)
    speed = np.gradient(angle, T) + 0.05
    path = tmp_path / "Raw Data.csv"
    for header in ("Gyroscope x (rad/s)", "Speed x (rad/s)", "Speed x (rad/s),torque", "Gyroscope x (rad/s),torque"):
        columns = (T, speed, np.cos(T))[: header.count(",") + 2]
        path.write_text(f"Time (s),{header}\n" + rows(*(each[:rows_used] for each in columns), sign=","))
        found = read(path)
        added = found.recording.columns["position"] - angle[:rows_used]
        is_taken_off = header != "Speed x (rad/s),torque"
        assert bool(np.ptp(added) < 0.03) == is_taken_off
        assert any("its swings move on" in note for note in found.notes) == is_taken_off


def test_runs_in_json(tmp_path: Path) -> None:
    """Of objects that hold lists of different lengths the longest run is read, beside settings; also a single one."""
    path = tmp_path / "response.json"
    long, short = ({"type": "chirp", "actions": list(each), "angle": list(2 * each)} for each in (SWING, SWING[:40]))
    path.write_text(json.dumps({"config": {"limits": [-0.6, 0.6]}, "data": [short, long, long]}))
    found = read(path, rate_hz=50)
    np.testing.assert_allclose(found.recording.columns["command"], SWING)
    np.testing.assert_allclose(found.recording.columns["position"], 2 * SWING)
    assert "data holds 3 runs: 1 is used, as in FILE#episode=1" in found.notes
    np.testing.assert_allclose(read(path, rate_hz=50, episode=0).recording.columns["command"], SWING[:40])
    assert f"{path}: found episode=3, expected 0 to 2" in refused(path, rate_hz=50, episode=3)
    path.write_text(json.dumps({"data": [long]}))
    np.testing.assert_allclose(read(path, rate_hz=50).recording.columns["position"], 2 * SWING)
    assert "found episode=1, expected 0, as the file holds one run" in refused(path, rate_hz=50, episode=1)
    path.write_text(json.dumps([long] * 40 + [short]))
    several = read_recordings([f"{path}#rate-hz=50"])
    assert [one.name for one in several] == [f"{path}#episode={40 * at // 29}" for at in range(30)]


@pytest.mark.parametrize("unit", ["Radians", "Rotations"])
def test_the_tests_of_sysid(unit: str, tmp_path: Path) -> None:
    """Of WPILib's tool: rows of time, voltage, position and velocity in turns, or of the two sides of a drivetrain;
    each test is a recording.  A file that is not as it says is other JSON."""
    turns, path = SWING / (2 * np.pi), tmp_path / "sysid_data.json"
    table = np.stack([T, 7 * np.cos(T), turns, np.gradient(turns, T)], axis=1)
    file = {"sysid": True, "test": "Simple", "units": unit, "unitsPerRotation": 2 * np.pi}
    path.write_text(json.dumps({**file, "fast-forward": table[:99].tolist(), "fast-backward": table.tolist()}))
    forward, backward = read_recordings([path])
    assert backward.columns["voltage"] == pytest.approx(7 * np.cos(T))
    assert backward.columns["position"] == pytest.approx(SWING)
    assert forward.columns["position"] == pytest.approx(SWING[:99])
    assert "fast-forward, fast-backward are the runs 0 to 1: 1 is used, as in FILE#episode=1" in read(path).notes
    sides = table[:, [0, 1, 1, 2, 2, 3, 3, 0, 0]] * [1, 1, 2, 1, 3, 1, 3, 1, 1]
    drive = {**file, "test": "Drivetrain", "units": "Meters", "unitsPerRotation": 0.5}
    path.write_text(json.dumps({**drive, "slow-forward": sides.tolist()}))
    assert "choose with --joint NAME (or FILE#joint=NAME) from left, right" in refused(path)
    right = read(path, joint="right").recording
    assert right.unit("position") == "m"
    assert right.columns["position"] == pytest.approx(1.5 * turns)
    assert right.columns["voltage"] == pytest.approx(14 * np.cos(T))
    path.write_text(json.dumps({**file, "slow-forward": table[:, :3].tolist()}))
    assert "none that is clearly a column" in refused(path)


def workbook(path: Path, days: float) -> None:
    """A workbook of two sheets: the second one is the longer, and its times are dates, or times of day for day 0; a
    note stands beside it, and its last angle is missing."""
    book = openpyxl.Workbook()
    sheet = book.create_sheet("second")
    sheet["A1"], sheet["A2"], sheet["C2"], sheet["H2"] = "a pendulum", "Uhr", "Winkel", "a note"
    for row, (t, y) in enumerate(zip(T.tolist(), SWING.tolist(), strict=False), start=3):
        sheet.cell(row, 1, days + t / 86400).number_format = "hh:mm:ss.000"
        if row < T.size + 2:
            sheet.cell(row, 3, y)
    book.save(path)


def test_a_workbook(tmp_path: Path) -> None:
    """The sheet with most rows, whose columns have gaps; days of a sheet are dates; what is no workbook is told."""
    path = tmp_path / "pendel.xlsx"
    workbook(path, 46053.5)
    found = read(path)
    assert (found.kind, found.recording.start) == ("workbook, sheet 2 of 2", datetime(2026, 1, 31, 12, tzinfo=UTC))
    np.testing.assert_allclose(found.recording.columns["position"], SWING[:-1], atol=1e-12)
    np.testing.assert_allclose(found.recording.time, T[:-1], atol=6e-4)
    assert not any("left out" in note for note in found.notes)
    workbook(path, 0.5)
    assert read(path).recording.start is None
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("run.csv", "t,q\n0,1\n")
    assert "found a ZIP archive without a sheet" in refused(path)


def test_workbooks_of_other_programs(tmp_path: Path) -> None:
    """Excel before 2007, and LibreOffice, which says how often a row is repeated."""
    book = xlwt.Workbook()
    sheet = book.add_sheet("run")
    for row, cells in enumerate([("t [s]", "angle [deg]"), *zip(T.tolist(), SWING.tolist(), strict=True)]):
        for column, cell in enumerate(cells):
            sheet.write(row, column, cell)
    book.save(tmp_path / "a.xls")
    _ods(tmp_path / "a.ods", "".join(_ods_row(t, y) for t, y in zip(T.tolist(), SWING.tolist(), strict=True)))
    for name in ("a.xls", "a.ods"):
        found = read(tmp_path / name).recording
        np.testing.assert_allclose(found.time, T)
        np.testing.assert_allclose(found.columns["position"], np.radians(SWING))


def _ods_row(*cells: float) -> str:
    each = (f'<table:table-cell office:value-type="float" office:value="{cell!r}"/>' for cell in cells)
    return f"<table:table-row>{''.join(each)}</table:table-row>"


def _ods(path: Path, rows: str) -> None:
    names = "".join(
        f'<table:table-cell office:value-type="string"><text:p>{name}</text:p></table:table-cell>'
        for name in ("t [s]", "angle [deg]")
    )
    below = '<table:table-row table:number-rows-repeated="1000000"><table:table-cell/></table:table-row>'
    space = " ".join(
        f'xmlns:{one}="urn:oasis:names:tc:opendocument:xmlns:{one}:1.0"' for one in ("table", "text", "office")
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        archive.writestr("META-INF/manifest.xml", "<manifest/>")
        archive.writestr(
            "content.xml",
            f"<office:document-content {space}><office:body><office:spreadsheet><table:table table:name='run'>"
            f"<table:table-row>{names}</table:table-row>{rows}{below}"
            "</table:table></office:spreadsheet></office:body></office:document-content>",
        )


@pytest.mark.slow
def test_workbooks_that_ask_for_all_memory_are_refused(tmp_path: Path) -> None:
    """Cells that are far apart, and a file of gigabytes behind a small archive: one line each."""
    path = tmp_path / "far.xlsx"
    book = openpyxl.Workbook()
    sheet = book.worksheets[0]
    sheet["A1"], sheet["XFD1048576"] = 1, 2
    book.save(path)
    assert "cannot be read as a workbook: memory allocation of 549755813888 bytes failed" in refused(path)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("xl/workbook.xml", "w") as file:
        for _ in range(41):
            file.write(bytes(10_000_000))
    assert "found 410 MB, expected at most 400" in refused(path)


@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_in_a_workbook_are_answered(data: st.DataObject, tmp_path: Path) -> None:
    """Bytes in place of others in a sheet: a recording, or RecordingError in one line."""
    row = _ods_row(0.0, 0.1)
    begin, end = sorted(data.draw(st.tuples(*[st.integers(0, len(row))] * 2)))
    _ods(tmp_path / "a.ods", _ods_row(0.5, 0.2) + row[:begin] + data.draw(st.text(max_size=20)) + row[end:])
    content = (tmp_path / "a.ods").read_bytes()
    (tmp_path / "b.ods").write_bytes(content[: data.draw(st.integers(4, len(content)))])
    for name in ("a.ods", "b.ods"):
        told = ""
        try:
            assert read(tmp_path / name).recording.time.size > 0
        except RecordingError as error:
            told = str(error)
        assert "\n" not in told


def test_what_moves_is_found_without_names(tmp_path: Path) -> None:
    """Of a telephone's gyroscope the axis that turns; of columns without names the only one that swings, not one that
    begins anew at half a turn, drifts, or is noise; of two runs side by side that which moves."""
    rng = np.random.default_rng(1)
    noise = rng.normal(0, 0.02, (4, T.size))
    path = tmp_path / "x.txt"
    speed = np.gradient(SWING, T)
    path.write_text("Time (s)\tGyroscope x (rad/s)\tGyroscope y (rad/s)\n" + rows(T, noise[0], speed))
    found = read(path)
    assert any("integrated from a speed" in note for note in found.notes)
    np.testing.assert_allclose(found.recording.columns["position"], SWING - SWING[0], atol=0.01)
    heading = (np.degrees(SWING) + 170 + 180) % 360 - 180
    path.write_text(rows(np.rint(1000 * T), heading, T + noise[1], np.degrees(SWING), noise[2], digits=4))
    np.testing.assert_allclose(read(path).recording.columns["position"], SWING, atol=1e-5)
    path.write_text("#Time A\tPos A\tTime B\tPos B\n#[s]\t[au]\t[s]\t[au]\n" + rows(T, noise[0], T + 0.01, 200 * SWING))
    found = read(path)
    np.testing.assert_allclose(found.recording.columns["position"], 200 * SWING, atol=1e-4)
    assert found.recording.time[0] == 0.01


def test_distances_and_times_in_long_or_uneven_steps(tmp_path: Path) -> None:
    """A sonar's distance is a displacement, its error is none; two columns without names, of which one ascends."""
    path = tmp_path / "x.txt"
    head = "Motion Sensor Data File\nTime (s)\tDistance (cm)\tDist Error (cm)\n"
    path.write_text(head + rows(T, 20 + SWING, 0 * T + 0.239))
    found = read(path).recording
    assert list(found.columns) == ["displacement"]
    np.testing.assert_allclose(found.columns["displacement"], 0.2 + 0.01 * SWING, atol=1e-7)
    uneven = np.cumsum(np.random.default_rng(2).choice([0.02, 0.1, 0.3], T.size))
    for times in (uneven, 15 * T):
        path.write_text(rows(times, SWING, sign=","))
        np.testing.assert_allclose(read(path).recording.time, times, atol=1e-4)
    films = [f"Video Analysis: {name}" for name in ("Time (s)", "X", "Y", "X Velocity", "Y Velocity")]
    path.write_text(",".join(films) + "\n" + rows(T, np.sin(SWING), -np.cos(SWING), 0 * T, 0 * T, sign=","))
    assert np.ptp(read(path).recording.columns["position"]) == pytest.approx(np.ptp(SWING), rel=0.01)
    path.write_text("t,theta,theta_dot,theta_double_dot\n" + rows(T, SWING, 0 * T, 0 * T, sign=","))
    np.testing.assert_allclose(read(path).recording.columns["position"], SWING, atol=1e-4)
    path.write_text(rows(uneven, uneven, sign=","))
    assert "none that is clearly a column" in refused(path)


def test_names_that_blanks_separate_stand_above_rows_of_tabs(tmp_path: Path) -> None:
    """As a spreadsheet saves a header that was typed into its first cell."""
    path = tmp_path / "pendulum.txt"
    path.write_text("time angle dt da\t\t\t\n" + rows(T, SWING, 0 * T + 0.017, 0 * T + 0.05))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-5)


def test_the_run_that_is_shown_while_it_is_measured_has_a_unit(tmp_path: Path) -> None:
    """A position in centimetres had been taken for an angle in rad."""
    path = tmp_path / "spring.csv"
    path.write_text('"Time (s) Monitor Run","Position (cm) Monitor Run"\n' + rows(T, 100 * SWING, sign=","))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-6)
    assert read(path).recording.metadata["position_unit"] == "m"


@pytest.mark.parametrize(
    ("header", "advice"),
    [
        ("y,u", "FILE#rate-hz=100,position=y"),
        ("Time,input signal,Motor Angular Velocity", "position=Motor Angular Velocity:rad/s"),
    ],
)
def test_the_advice_suits_what_a_file_has(header: str, advice: str, tmp_path: Path) -> None:
    """No times where no column ascends, and no angle in degrees for a velocity."""
    path = tmp_path / "motor.csv"
    columns = (T, np.sign(SWING), SWING)[3 - header.count(",") - 1 :]
    path.write_text(header + "\n" + rows(*columns, sign=","))
    assert advice in refused(path)


@pytest.mark.parametrize(
    ("title", "value"), [("h", 1 / 30), ("Ts", 1 / 30), ("Tinterval", 1 / 30), ("fs", 30.0), ("sample_rate", 30.0)]
)
def test_a_number_says_how_often_rows_were_sampled(title: str, value: float, tmp_path: Path) -> None:
    """Without times their step is a number of the file; one that cannot be (a height of 9 m), or two, are none."""
    scipy.io.savemat(tmp_path / "a.mat", {"theta": SWING, title: value, "g": 9.81})
    np.savez(tmp_path / "b.npz", **{"theta": SWING, title: value})
    (tmp_path / "c.json").write_text(json.dumps({"run": {"theta": SWING.tolist(), title: value}}))
    for path in sorted(tmp_path.iterdir()):
        found = read(path)
        np.testing.assert_allclose(found.recording.time, T)
        assert any(note.startswith("time: no times are given; 30 rows a second, as ") for note in found.notes)
    for others in ({"h": 9.0}, {"h": 0.01, "fs": 50.0}):
        scipy.io.savemat(tmp_path / "d.mat", {"theta": SWING, "u": SWING, **others})
        assert "and no times" in refused(tmp_path / "d.mat")


def test_joints_that_do_not_move_are_left_out(tmp_path: Path) -> None:
    """Of two encoders the one that counts, or moves most by far; if both do, one must be named."""
    path = tmp_path / "disk.csv"
    header = "Time (s),Angle, Ch 1+2 (rad),Angle, Ch 3+4 (rad)".replace("Angle, ", "Angle ")
    path.write_text(header + "\n" + rows(T, SWING, 0 * T, sign=","))
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-5)
    assert "taken is Ch 1+2, which moves most by far; not Ch 3+4" in found.notes
    path.write_text(header + "\n" + rows(T, 0.1 * SWING, SWING, sign=","))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-5)
    assert read(path, joint="Ch 1+2").recording.columns["position"] == pytest.approx(0.1 * SWING, abs=1e-5)
    path.write_text(header + "\n" + rows(T, 0.2 * SWING, SWING, sign=","))
    assert "found 2 joints, expected one; choose with --joint NAME" in refused(path)


def test_joints_that_never_change_are_left_out_of_several_that_move(tmp_path: Path) -> None:
    """So that the refusal lists only those that move."""
    path = tmp_path / "arm.csv"
    path.write_text("time,hip_pos,knee_pos,foot_pos\n" + rows(T, SWING, SWING, 0 * T, sign=","))
    assert "found 2 joints, expected one; choose with --joint NAME (or FILE#joint=NAME) from hip, knee" in refused(path)


def test_torques_of_several_kinds_are_of_the_one_angle(tmp_path: Path) -> None:
    """A kind of torque is no joint where an angle has none."""
    path = tmp_path / "gravity.csv"
    header = "Timestamp,Output Angle [deg],Gravity Torque [Nm],Friction Torque [Nm],Target Torque [Nm]"
    path.write_text(header + "\n" + rows(T, np.degrees(SWING), SWING, 0 * T, 2 * SWING, sign=","))
    found = read(path).recording.columns
    assert found["position"] == pytest.approx(SWING, abs=1e-5)
    assert found["torque"] == pytest.approx(2 * SWING, abs=1e-5)


def test_what_a_goal_asks_for_is_the_position(tmp_path: Path) -> None:
    """Its name is that of the goal without the word for it, whatever it says."""
    path = tmp_path / "tendon.csv"
    path.write_text("Time,Stroke_Ref,Stroke,Tension\n" + rows(T, SWING, 0.9 * SWING, T, sign=","))
    found = read(path).recording.columns
    assert found["command"] == pytest.approx(SWING, abs=1e-5)
    assert found["position"] == pytest.approx(0.9 * SWING, abs=1e-5)


def test_an_angle_is_the_position_before_a_place(tmp_path: Path) -> None:
    """Of the places and angles of a tracker, of which the first was read as the angle."""
    path = tmp_path / "tracker.csv"
    path.write_text("Time,Pos x,Angle x\n" + rows(T, 50 * T, SWING, sign=","))
    assert read(path).recording.columns["position"] == pytest.approx(SWING, abs=1e-5)


def test_empty_columns_without_a_name_are_none(tmp_path: Path) -> None:
    """An oscilloscope writes its settings beside the first rows."""
    settings_of = [","] * 300
    settings_of[:9:4] = ["Record Length,300", "Sample Interval,0.0333", "Vertical Units,V"]
    lines = rows(T, SWING, sign=",").splitlines()
    path = tmp_path / "scope.csv"
    path.write_text("".join(f"{left},,{right},\n" for left, right in zip(settings_of, lines, strict=True)))
    found = read(path).recording
    assert found.columns["position"] == pytest.approx(np.interp(found.time, T, SWING), abs=1e-4)


def test_what_a_name_says_last_is_its_quantity() -> None:
    """What is before is the joint, or what was measured."""
    columns = {
        "wrist_angle_effort": "torque", "elbow_angle_pos": "position", "q3_tau": "torque",
        "encoder_temp": "temperature", "Current Position": "position",
    }  # fmt: skip
    assert {name: column_of(name) for name in columns} == columns


@pytest.mark.parametrize("name", ["pi_time", "loop_time"])
def test_a_name_that_ends_in_time_is_one(name: str, tmp_path: Path) -> None:
    """Rows of a busy computer may stand at the same time."""
    path = tmp_path / "motor.csv"
    path.write_text(f"{name},angle,current\n" + rows(T.repeat(2)[:300], SWING, SWING, sign=","))
    assert read(path).recording.time[-1] == pytest.approx(T[149], abs=1e-5)


def test_milliseconds_with_fractions_are_no_seconds(tmp_path: Path) -> None:
    """Of stamps as floating-point numbers, whose steps would be half a minute."""
    path = tmp_path / "motor.csv"
    path.write_text("time,angle\n" + rows(1000 * T + 0.25, SWING, sign=","))
    assert read(path).recording.time[-1] - read(path).recording.time[0] == pytest.approx(T[-1], abs=1e-5)


def test_the_advised_times_ascend_in_their_unit(tmp_path: Path) -> None:
    """The command that the refusal gives reads the file; the number of the row is no time."""
    path = tmp_path / "log.csv"
    uneven = np.random.default_rng(0).exponential(33, T.size).cumsum()
    path.write_text("pos,load,stamped\n" + rows(SWING, SWING, uneven, sign=","))
    assert "choose their series, as in --map time=stamped:ms, or give the rows a second" in refused(path)
    assert read(path, "time=stamped:ms").recording.time[-1] == pytest.approx(uneven[-1] / 1000, abs=1e-5)
    path.write_text("row,pos,load\n" + rows(np.arange(300.0) // 2, SWING, SWING, sign=","))
    assert "and no times; give the rows a second, if there are 100: FILE#rate-hz=100" in refused(path)


def test_times_that_are_there_count_more_than_the_step_of_the_recorder(tmp_path: Path) -> None:
    """dSPACE keeps every sixth sample: its ``SamplingPeriod`` is that of all samples, and ``X`` holds the times."""
    path = tmp_path / "dspace.mat"
    signals = {"X": {"Data": T}, "Y": {"Data": SWING}, "Capture": {"SamplingPeriod": T[1] / 6}}
    scipy.io.savemat(path, {"run": signals})
    found = read(path, "position=run.Y.Data")
    assert found.clock == "run.X.Data [s]"
    np.testing.assert_allclose(found.recording.time, T)


def test_quantities_in_the_line_of_the_units(tmp_path: Path) -> None:
    """A servo drive's log names its channels ``Analog 1`` and ``Analog 2``, and below them what they are."""
    path = tmp_path / "trace.csv"
    header = "Axis1\nTime,Analog 1,Analog 2,Digital 1\nms,Servo motor speed,Torque,Not selected\n"
    path.write_text(header + rows(1e3 * T, 1e2 * SWING, SWING**3, 0 * T, sign=","))
    assert "--map 'position=Servo motor speed:rpm' (or :rad/s) integrates a speed" in "".join(read(path).notes)
    found = read(path, "position=Servo motor speed:rpm")
    assert found.recording.columns["torque"] == pytest.approx(SWING**3, abs=1e-4)
    assert np.gradient(found.recording.columns["position"], T)[5:-5] == pytest.approx(
        1e2 * SWING[5:-5] * 2 * np.pi / 60, abs=0.2
    )


def test_a_table_of_dates_only_is_refused_in_a_line(tmp_path: Path) -> None:
    """No series is left of which the numbers could suggest a unit."""
    path = tmp_path / "dates.csv"
    path.write_text("when;note\n2026-11-01 10:00:00;a\n2026-11-01 10:00:01;b\n")
    assert "found when, and none that is clearly a column; assign them, as in --map position=SERIES:deg" in refused(
        path
    )


def test_a_force_that_is_given_moves_along_a_line(tmp_path: Path) -> None:
    """``x`` without a unit is a place in m where a force drives it, whatever that is called."""
    path = tmp_path / "rack.mat"
    scipy.io.savemat(path, {"t": T, "x": SWING, "v": np.gradient(SWING, T), "F_fric": np.sign(SWING), "F": 2 * SWING})
    found = read(path, "force=F_fric")
    assert [(one.column, one.series, one.si) for one in found.columns] == [
        ("position", "x", "m"), ("force", "F_fric", "N"),
    ]  # fmt: skip


def test_rows_that_begin_with_a_time_of_day(tmp_path: Path) -> None:
    """The command that the refusal gives reads the file."""
    path = tmp_path / "log.txt"
    text = "".join(f"12:23:{10 + t:09.6f} {q:.4f} {u:.1f}\n" for t, q, u in zip(T, 100 * SWING, 0 * T, strict=True))
    path.write_text(text)
    assert "assign them, as in --map position=column2:deg" in refused(path)
    found = read(path, "position=column2:deg").recording
    np.testing.assert_allclose(found.time, T, atol=1e-5)
    assert found.columns["position"] == pytest.approx(np.radians(100 * SWING), abs=1e-5)


@pytest.mark.parametrize(
    ("name", "column"),
    [("phidot", None), ("theta_ddot", None), ("layout/data_offset", None), ("F", None), ("F_fric", None)],
)
def test_symbols(name: str, column: str | None) -> None:
    assert column_of(name) == column
    assert (speed_of(name) is not None) == (name == "phidot")


def test_the_number_of_the_row_is_not_advised_as_the_position(tmp_path: Path) -> None:
    """Neither as the time."""
    path = tmp_path / "log.csv"
    path.write_text("Sample Number,CHANNEL0,CHANNEL1\n" + rows(np.arange(300.0), SWING, SWING, sign=","))
    assert "assign them, as in 'FILE#rate-hz=100,position=CHANNEL0', if there are 100 rows a second" in refused(path)


def test_whole_milliseconds_of_a_thousand_rows_a_second(tmp_path: Path) -> None:
    """Of a microcontroller, which takes now and then two of them; they were seconds."""
    path = tmp_path / "counts.txt"
    stamps = 12912 + np.arange(300) + np.arange(300) // 5
    path.write_text("".join(f"{stamp}\t{2128 + 500 * q:.0f}\n" for stamp, q in zip(stamps, SWING, strict=True)))
    assert np.ptp(read(path).recording.time) == pytest.approx(0.358)


def test_the_number_of_the_row_is_no_time(tmp_path: Path) -> None:
    """It was one of seconds."""
    path = tmp_path / "rows.txt"
    path.write_text(rows(np.arange(1.0, 301), SWING, sign=" "))
    assert "position=column2', if there are 100 rows a second" in refused(path)


@pytest.mark.parametrize(
    ("first", "second", "column"), [("run_pos1_20", "run_tau1_20", "torque"), ("q", "u", "voltage")]
)
@pytest.mark.parametrize("is_swapped", [False, True])
def test_files_of_time_and_value_without_names_are_one_recording(
    first: str, second: str, column: str, is_swapped: bool, tmp_path: Path
) -> None:
    """Each has the times in its first column: the second has none again, and neither is a joint."""
    q, drive = tmp_path / f"{first}.t", tmp_path / f"{second}.t"
    q.write_text(rows(T, 0.5 * SWING))
    drive.write_text(rows(T, SWING))
    found = read(Path(f"{drive}+{q}" if is_swapped else f"{q}+{drive}"))
    assert {one.column: one.series for one in found.columns} == {"position": f"{first}[1]", column: f"{second}[1]"}
    np.testing.assert_allclose(found.recording.time, T, atol=1e-5)
    np.testing.assert_allclose(found.recording.columns["position"], 0.5 * SWING, atol=1e-5)
    assert not [note for note in found.notes if note.startswith(("not used", "taken is"))]


def test_files_whose_names_say_nothing_are_refused_with_the_whole_option(tmp_path: Path) -> None:
    one, two = tmp_path / "one.t", tmp_path / "two.t"
    one.write_text(rows(T, SWING))
    two.write_text(rows(T, 2 * SWING))
    told = refused(Path(f"{one}+{two}"))
    assert "assign them, as in --map 'position=one[1]', and a torque --map 'torque=two[1]'" in told
    found = read(Path(f"{one}+{two}"), "position=one[1]:deg", "torque=two[1]").recording
    np.testing.assert_allclose(found.columns["torque"], 2 * SWING, atol=1e-5)


ECP = " Sample   Time     Commanded Pos   Encoder 1 Pos   Control Effort\n\n"


@pytest.mark.parametrize(("before", "title"), [("[", ECP), ("", ECP), ("data = [", "%" + ECP), ("[", "")])
def test_a_matrix_with_brackets_and_semicolons_keeps_its_last_column(before: str, title: str, tmp_path: Path) -> None:
    """As the programs of ECP's plants write it: the drive, in the last column, was lost without a word."""
    path = tmp_path / "ecp.txt"
    lines = [
        f"{k:6d}{t:9.3f}{100 * k:12d}{1000 * y:14.0f}{np.cos(t):14.4f}"
        for k, (t, y) in enumerate(zip(T, SWING, strict=True))
    ]
    path.write_text(f"{title}{before}" + ";\n".join(lines) + ("];\n" if before else ";\n"))
    if not title:
        path.write_text("text\n" + path.read_text())
    names = [one.name for one in open_source(path).series]
    assert names == (["Sample", "Time", "Commanded Pos", "Encoder 1 Pos", "Control Effort"] if title else names)
    assert len(names) == 5
    found = read(path, f"position={names[3]}", f"torque={names[4]}", f"time={names[1]}")
    np.testing.assert_allclose(found.recording.columns["torque"], np.cos(T), atol=1e-4)
    assert not [note for note in found.notes if "no rows" in note]


def test_columns_of_words_are_not_left_out_silently(tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text(
        "t,angle,phase,empty\n" + "".join(f"{t:.3f},{y:.5f},swing,\n" for t, y in zip(T, SWING, strict=True))
    )
    assert [note for note in read(path).notes if "words" in note] == ["left out, as they hold words: phase"]


def test_what_rings_down_is_the_position_and_not_what_drove_it(tmp_path: Path) -> None:
    """A torsion pendulum that is driven, then left alone: the forcing stands still, which moves far more."""
    time = np.arange(1600) / 20
    is_driven = time < 25
    forcing = np.where(is_driven, 30 * np.sin(6 * time), 0.0)
    angle = np.where(is_driven, 0.3 * np.cos(6 * time), 0.3 * np.exp(-(time - 25) / 20) * np.cos(6 * time))
    path = tmp_path / "smorzamento.txt"
    path.write_text(rows(time, forcing, angle))
    found = read(path)
    assert found.recording.columns["position"] == pytest.approx(angle, abs=1e-5)
    assert found.columns[0].why == "it rings down, and column2 stands still"
    phase = np.where(is_driven, 90.0, 0.0)
    named = "Tempo\tForzante\tPendolo\tFase\n" + rows(time, forcing, angle, phase)
    path.write_text("--- Pendolo di torsione ---\n" + named.replace(".", ","))
    assert read(path).recording.columns["position"] == pytest.approx(angle, abs=1e-5)
    path.write_text(rows(time, angle, 30 * np.sin(6 * time)))
    assert "none that is clearly a column" in refused(path)


def test_rounded_times_without_a_name_may_stand_twice(tmp_path: Path) -> None:
    """Two sensors of 0.06 s write lines of their own, to 10 ms: each has a line where the other one's cell is empty."""
    stamps = np.sort(np.concatenate([0.06 * np.arange(200), 0.061 * np.arange(200)]))
    lines = [f"{stamp:.2f}\t{0.1 * np.cos(3 * stamp):.3f}" for stamp in stamps]
    lines[3::7] = [f"{line.partition(chr(9))[0]}\t" for line in lines[3::7]]
    path = tmp_path / "egen.txt"
    path.write_text("\n".join(lines) + "\n")
    found = read(path)
    assert found.clock == "column1 [s]"
    assert found.columns[0].series == "column2"


def test_a_time_that_stands_still_is_none(tmp_path: Path) -> None:
    """When a test began, beside the time, whose name has that of its data set before a colon."""
    path = tmp_path / "knee.csv"
    path.write_text("OSL:timestamp,angle,start_time\n" + rows(1744000602 + T, SWING, 0 * T, sign=",", digits=6))
    assert read(path).recording.time == pytest.approx(T, abs=1e-5)


def test_the_advice_takes_the_quickest_for_what_drives(tmp_path: Path) -> None:
    """A chirp that is in two columns, and the slow angle of the rotor between them: the first was the position."""
    time = np.arange(3000) / 1000
    chirp = np.sin(40 * time**2 + time)
    angle = np.cumsum(np.cumsum(chirp)) / 1e5
    path = tmp_path / "rotor.txt"
    path.write_text(rows(time, chirp, angle, chirp))
    assert "--map position=column3, and a torque --map torque=column2 " in refused(path)


def test_the_advice_without_times_has_the_input(tmp_path: Path) -> None:
    path = tmp_path / "motor.csv"
    path.write_text("input,output\n" + rows(np.sign(SWING), np.cumsum(np.sign(SWING)) / 30, sign=","))
    assert "'FILE#rate-hz=100,position=output,voltage=input'" in refused(path)


def test_a_measurement_of_labview_says_its_units_far_above_the_names(tmp_path: Path) -> None:
    """The label of the units stands in the head of the channels; two lines of the head and the names lie between."""
    path = tmp_path / "hammer.lvm"
    head = "LabVIEW Measurement\t\nSeparator\tTab\nTime\t16:58:49.09\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n"
    head += "Samples\t300\t300\t\nY_Unit_Label\tPounds\tg\t\nX_Dimension\tTime\tTime\t\nX0\t0.0E+0\t0.0E+0\t\n"
    head += "***End_of_Header***\t\t\t\nX_Value\tForce\tAcceleration\tComment\n"
    path.write_text(head + rows(T, 2 * SWING, SWING))
    found = read(path).recording
    assert found.columns["force"] == pytest.approx(2 * 4.4482216 * SWING, abs=1e-3)
    assert found.columns["accel"] == pytest.approx(9.80665 * SWING, abs=1e-3)


@pytest.mark.parametrize("header", ["t,x,y\n", ""])
def test_what_the_angle_of_a_film_is_made_of_does_not_drive_it(header: str, tmp_path: Path) -> None:
    """x and y, or two columns without names, are used by their angle: no note calls them unused."""
    path = tmp_path / "film.csv"
    path.write_text(header + rows(T, 0.4 * np.sin(SWING), -0.4 * np.cos(SWING), sign=",", digits=6))
    found = read(path)
    assert [one.series for one in found.columns] == ["angle(x, y)"]
    assert not any("used" in note for note in found.notes)
    axis = "x" if header else "column2"
    assert read(path, f"accel={axis}").columns[-1].series == axis


def test_a_refusal_with_several_accelerometers_says_how_to_assign_a_motion_too(tmp_path: Path) -> None:
    """An inertial sensor on a part that turns: its angles have names that say nothing, its accelerations several."""
    path = tmp_path / "imu.csv"
    header = "Time,sensPitch,sensRoll,xAcc,yAcc\n"
    path.write_text(header + rows(1e3 * T, SWING, SWING**2, 0.1 * SWING, -0.1 * SWING, sign=","))
    said = refused(path)
    assert "--map position=sensPitch" in said
    assert "accel: not taken, found xAcc, yAcc; choose one with --map accel=xAcc" in said


@pytest.mark.parametrize("empty", [",\n", ",\n,\n", "\n"])
def test_separators_alone_are_an_empty_line(empty: str, tmp_path: Path) -> None:
    """A sheet saves its empty row as separators: it is no first row of numbers, and the names stand below it."""
    path = tmp_path / "scope.csv"
    head = f"#Device Name: Discovery2,\n#Date Time: 2017-04-01 14:48::00.909,\n{empty}Time (s),Angle (deg)\n"
    path.write_text(head + rows(T, np.degrees(SWING), sign=","))
    found = read(path)
    assert found.clock == "Time (s) [s]"
    assert found.recording.columns["position"] == pytest.approx(SWING, abs=1e-5)


def test_the_times_of_ticks_need_their_numbers(tmp_path: Path) -> None:
    """A wheel that coasts down, with a mark that a sensor sees once a turn: the times [ms] alone are no motion."""
    turns = np.arange(200)
    times = 1e3 * (turns / 5 + (turns / 40) ** 2)
    path = tmp_path / "ticks.txt"
    path.write_text(rows(times, digits=2))
    assert "it holds times only" in refused(path)
    assert "write the numbers of the ticks beside them" in refused(path)
    path.write_text(rows(times, turns, sign=","))
    found = read(path, "position=column2:rev").recording
    assert found.columns["position"] == pytest.approx(2 * np.pi * turns)
    assert found.time == pytest.approx(times / 1e3)


@pytest.mark.parametrize(("size", "unit"), [(180.0, "deg/s"), (3.0, "rad/s")])
def test_a_refusal_suggests_the_axis_of_a_gyroscope_that_turns(size: float, unit: str, tmp_path: Path) -> None:
    """An aircraft on two threads: angles whose names say nothing come first, and an axis has three quarters of the
    variance, of a gyroscope without a unit."""
    path = tmp_path / "bifilar.csv"
    speed = size * np.cos(5 * T)
    header = "Time,sensPitch,xGyro,yGyro,ZGyro,xAcc,yAcc\n"
    path.write_text(header + rows(1e3 * T, SWING, 0.1 * speed, 0.05 * speed[::-1], speed, SWING, -SWING, sign=","))
    assert f"--map position=ZGyro:{unit}" in refused(path)
    path.write_text(header + rows(1e3 * T, SWING, speed, speed[::-1], speed, SWING, -SWING, sign=","))
    assert "--map position=sensPitch" in refused(path)


@pytest.mark.parametrize("name", ["angular_velocity", "Angular Velocity"])
def test_the_only_column_beside_the_time_is_no_angle_if_its_name_says_a_speed(name: str, tmp_path: Path) -> None:
    """An angular velocity was read as an angle, in degrees where it is large.  It is integrated, in rad/s, or in the
    unit that is given."""
    path = tmp_path / "wheel.csv"
    path.write_text(f"time,{name}\n" + rows(T, 4 * np.gradient(SWING, T), sign=","))
    for terms, unit in (([], 1.0), ([f"position={name}:deg/s"], np.pi / 180)):
        angle = read(path, *terms).recording.columns["position"]
        assert angle == pytest.approx(unit * 4 * (SWING - SWING[0]), abs=0.02)


def test_of_columns_that_ascend_the_first_is_the_time_if_it_does_so_most_evenly(tmp_path: Path) -> None:
    """Rows, a constant duty, µs, and the place of a cart that moves off: its steps are less even than those of the
    clock.  What counts the rows is not proposed as what drives it."""
    path = tmp_path / "cart.csv"
    count, place = np.arange(T.size), 0.2 * (T + np.exp(-5 * T) / 5)
    path.write_text("".join(f"{i},100,{5088 * i + i % 3},{x:.6f}\n" for i, x in zip(count, place, strict=True)))
    found = read(path, "position=column4:m")
    assert found.recording.time == pytest.approx(count * 5.088e-3, abs=1e-5)
    assert not any("column1 is not used" in note for note in found.notes)


@pytest.mark.parametrize("text", ["[" * 200_000, "a" * 80_000, "a: " * 30_000, " " * 200_000 + "x"])
def test_a_line_without_end_is_refused_at_once(text: str, tmp_path: Path) -> None:
    """Its one name was searched for words and units for minutes, as the time of that grows with the square of its
    length; the error does not repeat it."""
    path = tmp_path / "line.json"
    path.write_text(text)
    begun = time.process_time()
    assert len(refused(path)) < 1000
    assert time.process_time() - begun < 30


def test_times_that_no_recording_may_have_are_refused(tmp_path: Path) -> None:
    """They were written, and refused when they were read again."""
    path = tmp_path / "times.csv"
    path.write_text("t;angle [rad]\n0;1\n1e300;2\n")
    assert "found rows over 1e+" in refused(path)


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Motorspannung", "voltage"),
        ("Ankerstrom [A]", "current"),
        ("Sollposition", "command"),
        ("Istposition", "position"),
        ("Antriebsdrehmoment", "torque"),
        ("Sollgeschwindigkeit", None),
        ("Motordrehzahl", None),
    ],
)
def test_compounds_of_german_nouns(name: str, column: str | None) -> None:
    """A noun of several is what its last one is; a goal is no measurement."""
    assert column_of(name) == column
