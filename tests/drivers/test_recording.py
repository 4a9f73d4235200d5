"""The CSV format: what is written reads back the same, and what is wrong is said in one line."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lostmotion.drivers.codec.recording_csv import ROWS_AT_ONCE
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.recording import Recording, merge, read_recording, write_recording
from lostmotion.drivers.recordings import read_recordings
from lostmotion.drivers.units import COLUMN_UNITS
from tests.conftest import Measurements

numbers = st.floats(-1e30, 1e30) | st.just(float("nan"))
words = st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=8)
toml_values = st.recursive(
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | words
    | st.datetimes(datetime(2, 1, 1), datetime(9998, 12, 31), timezones=st.just(UTC)),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=5,
)
metadata = st.dictionaries(words.filter(lambda key: not key.endswith("_unit")), toml_values, max_size=4)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording: at least one column of the format, without which it is anybody's table, some of others, any
    metadata."""
    times = [us / 1e6 for us in sorted(draw(st.lists(st.integers(-(10**15), 10**15), min_size=1, max_size=8)))]
    rows = len(times)
    known = draw(st.lists(st.sampled_from([c for c in COLUMN_UNITS if c != "time"]), unique=True, min_size=1))
    unknown = draw(st.lists(st.text("BDHJKL", min_size=1, max_size=4), unique=True, max_size=2))
    columns = {name: np.array(draw(st.lists(numbers, min_size=rows, max_size=rows))) for name in known}
    extra = {name: draw(st.lists(words, min_size=rows, max_size=rows)) for name in unknown}
    return Recording(np.array(times), columns, draw(metadata), extra)


@pytest.mark.slow
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150, deadline=None)
@given(recordings())
def test_round_trip_loses_nothing(tmp_path: Path, recording: Recording) -> None:
    """Numbers come back bit by bit, and so do unknown columns and metadata of every TOML type."""
    path = tmp_path / "rec.csv"
    write_recording(recording, path)
    back = read_recording(path)
    assert np.array_equal(back.time, recording.time)
    assert list(back.columns) == list(recording.columns)
    for name, values in recording.columns.items():
        assert np.array_equal(back.columns[name], values, equal_nan=True), name
    assert back.extra == recording.extra
    assert back.metadata == recording.metadata
    assert [entry.name for entry in tmp_path.iterdir()] == ["rec.csv"]


def read_text(tmp_path: Path, text: str | bytes) -> Recording:
    """The recording that a file of this text is."""
    path = tmp_path / "rec.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_recording(path)


def test_empty_cells_are_not_sampled(tmp_path: Path) -> None:
    """Each signal has its own instants: those at which its cell holds a number."""
    recording = read_text(tmp_path, "time,command,accel\n0,0.5,1\n0.001,,2\n0.002, ,nan\n0.003,0.75,\n")
    times, values = recording.signal("command")
    assert times.tolist() == [0.0, 0.003]
    assert values.tolist() == [0.5, 0.75]
    assert recording.signal("accel")[1].tolist() == [1.0, 2.0]
    assert recording.duration == 0.003


def test_known_units_become_si(tmp_path: Path) -> None:
    """Inches, kips, degrees, g and milliseconds are converted, and the metadata then name the SI unit."""
    units = {"time": "ms", "command": "in", "position": "deg", "accel": "g", "force": "kip", "torque": "V"}
    head = "".join(f'# {name}_unit = "{unit}"\n' for name, unit in units.items())
    recording = read_text(tmp_path, f"{head}time,command,position,accel,force,torque\n1,2,180,1,1,3\n")
    assert recording.time[0] == pytest.approx(1e-3)
    values = {name: float(column[0]) for name, column in recording.columns.items()}
    assert values == pytest.approx(
        {"command": 0.0508, "position": np.pi, "accel": 9.80665, "force": 4448.2216152605, "torque": 3.0}
    )
    assert recording.metadata["force_unit"] == "N"
    assert recording.foreign_units == {"command": "m", "torque": "V"}


def test_si_recording_is_converted_once(tmp_path: Path) -> None:
    """A converted recording that is written and read again keeps its values."""
    first = read_text(tmp_path, '# force_unit = "kip"\ntime,force\n0,0.25\n')
    write_recording(first, tmp_path / "again.csv")
    assert read_recording(tmp_path / "again.csv").columns["force"][0] == first.columns["force"][0]


def test_unknown_columns_are_kept(tmp_path: Path) -> None:
    """A column that the format does not know stays as text, commas and quotes included."""
    recording = read_text(tmp_path, 'time,accel,note\n0,1,"bumped, twice"\n1,2,\n')
    assert recording.extra == {"note": ["bumped, twice", ""]}


def test_one_row_is_a_recording(tmp_path: Path) -> None:
    """One row is enough, with or without a newline behind it, with Windows line ends and a byte order mark."""
    for text in ("time,accel\n2.5,9\n", "time,accel\n2.5,9", "\ufefftime,accel\r\n2.5,9\r\n\r\n"):
        recording = read_text(tmp_path, text)
        assert (recording.time.tolist(), recording.duration) == ([2.5], 0.0)
        assert recording.columns["accel"].tolist() == [9.0]
        assert recording.truncated == 0


@pytest.mark.parametrize("rest", ["0.002", "0.002,", "0.002,1.5e", "0.002,-", "0.002,0.1,4e-", '0.002,"'])
def test_cut_last_line_is_left_out_and_counted(tmp_path: Path, rest: str) -> None:
    """A recorder that was killed leaves half a line: all before it is read."""
    recording = read_text(tmp_path, f"time,command,accel\n0.000,0.1,4\n0.001,,5\n{rest}")
    assert recording.time.tolist() == [0.0, 0.001]
    assert recording.columns["accel"].tolist() == [4.0, 5.0]
    assert recording.truncated == 1


@pytest.mark.parametrize("rest", ["1.", "\n\n"])
def test_the_end_is_found_wherever_it_falls(rest: str, tmp_path: Path) -> None:
    """A cut line, or blank ones, right where one portion of the reading ends are no error either."""
    path = tmp_path / "rec.csv"
    path.write_text("time,accel\n" + "0,1\n" * (ROWS_AT_ONCE - 1) + rest)
    recording = read_recording(path)
    assert len(recording.time) == ROWS_AT_ONCE - 1
    assert recording.truncated == (rest == "1.")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "found no header"),
        ("# a = 1\n", "found no header"),
        ("time,accel\n", "a header and no rows"),
        ("0,1\n1,2\n", "found column1, column2, and none that is clearly a column"),
        ("# a = 1\nuhr;laut\n1;2\n", "found uhr, laut, and none that is clearly a column; nothing in it changes"),
        ("time,a,b\n0,1,2\n1,2,3\n", "found time, a, b, and none that is clearly a column"),
        ("time,accel,accel\n0,1,2\n", "line 1: found the column 'accel' twice"),
        (f"time,{','.join(f'c{k}' for k in range(15_000))},c7\n", "line 1: found the column 'c7' twice"),
        ("time,accel\n0,1\n1,x7\n2,3\n", "line 3: found 'x7' in the column 'accel', expected a finite number"),
        ("time,accel\n0,1\n1,-inf\n2,3\n", "line 3: found '-inf' in the column 'accel', expected a finite number"),
        ("time,accel\n0,1\n1,1e999\n2,3\n", "line 3: found '1e999' in the column 'accel', expected a finite"),
        ('time,accel\n0,1\n1,"2\n2,3\n3,4\n', "line 3: found unexpected end of data, expected comma-separated"),
        ('time,accel\n0,1\n1,"2\n2,3\n3,4', "line 3: found unexpected end of data, expected comma-separated"),
        ('time,note\n0,"a\n1,"b"\n2,c\n', "line 2: found ',' expected after '\"', expected comma-separated"),
        ('time,"accel\n0,1\n1,2\n', "line 1: found unexpected end of data"),
        ("time,accel\n0,1\n1,2,3\n2,3\n", "line 3: found 3 cells, expected 2"),
        ("time,accel\n0,1\n1\n2,3\n", "line 3: found 1 cells, expected 2"),
        ("time,accel\n0,1\n\n2,3\n", "line 3: found 0 cells, expected 2"),
        ("time,accel\n0,1\nnan,2\n", "line 3: found the time nan, expected seconds"),
        ("time,accel\n0,1\ninf,2\n", "line 3: found 'inf' in the column 'time', expected a finite number"),
        ("# a = 1\ntime,accel\n0,1\n2,2\n1,3\n", "line 5: found the time 1.0 after 2.0, expected rows in time order"),
        ("# a = 1\n# b = oops\ntime\n0\n", "line 2: found 'b = oops', expected key = value in TOML"),
        ("# a = 1\n# a = 2\ntime\n0\n", "a key there twice"),
        (b"\x7fELF\x02\x01\x00\xff\xfe", "found the byte 0xff, expected UTF-8 text"),
        (b"\x00\x01\x02\x03\n\x00\n", "expected one called 'time'"),
        ('time,accel\n0,"' + "9" * 140000 + "\n", "found a line of more than 100000 characters, expected a recording"),
    ],
)
def test_bad_files_are_told_in_one_line(tmp_path: Path, text: str | bytes, message: str) -> None:
    """The message names the file, the line, what was found and what was expected."""
    with pytest.raises(RecordingError) as caught:
        read_text(tmp_path, text)
    told = str(caught.value)
    assert message in told
    assert told.startswith(str(tmp_path / "rec.csv"))
    assert "\n" not in told


def test_missing_file_and_folder(tmp_path: Path) -> None:
    """A path that cannot be read or written is an error of one line, and nothing is left behind."""
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_recording(tmp_path / "none.csv")
    with pytest.raises(RecordingError, match="found a folder with nothing in it"):
        read_recording(tmp_path)
    recording = Recording(np.zeros(1), {})
    with pytest.raises(RecordingError, match="cannot be written: No such file"):
        write_recording(recording, tmp_path / "none" / "rec.csv")
    with pytest.raises(RecordingError, match="cannot be written: No space left"):
        write_recording(recording, "/dev/full")


def test_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    """A recording that cannot be written whole replaces nothing."""
    path = tmp_path / "rec.csv"
    path.write_text("time\n7\n")
    with pytest.raises(TypeError):
        write_recording(Recording(np.zeros(1), {}, {"what": object()}), path)
    assert path.read_text() == "time\n7\n"
    assert list(tmp_path.iterdir()) == [path]


def test_missing_signal_names_those_that_are_there(tmp_path: Path) -> None:
    """A column that is not there, or never sampled, is an error that says what was recorded."""
    recording = read_text(tmp_path, "time,command,accel,torque\n0,1,2,\n")
    for column in ("force", "torque"):
        with pytest.raises(RecordingError, match=f"found samples of command, accel, expected '{column}'"):
            recording.signal(column)


def test_merge_keeps_time_order_and_every_sample() -> None:
    """Two sources become rows in time order; only samples of different sources share a row."""
    servo = (np.array([0.0, 0.01, 0.01]), {"command": np.array([1.0, 2.0, 3.0])})
    accel = (np.array([0.005, 0.01]), {"accel": np.array([7.0, 8.0])})
    times, columns = merge(servo, accel)
    assert times.tolist() == [0.0, 0.005, 0.01, 0.01]
    np.testing.assert_array_equal(columns["command"], [1.0, np.nan, 2.0, 3.0])
    np.testing.assert_array_equal(columns["accel"], [np.nan, 7.0, 8.0, np.nan])


ascending = st.lists(st.integers(0, 20), max_size=12).map(lambda ticks: np.array(sorted(ticks), dtype=float))


@given(ascending, ascending)
def test_merge_loses_nothing(first: Any, second: Any) -> None:
    """Each source is found again in the merged rows, in its own order."""
    sources = [(first, {"command": np.arange(len(first)) + 0.5}), (second, {"accel": np.arange(len(second)) + 0.5})]
    times, columns = merge(*sources)
    assert (np.diff(times) >= 0).all()
    for source_times, values in sources:
        for name, column in values.items():
            sampled = ~np.isnan(columns[name])
            assert np.array_equal(columns[name][sampled], column)
            assert np.array_equal(times[sampled], source_times)


def test_start_may_be_a_toml_datetime(tmp_path: Path) -> None:
    """Metadata have TOML's types."""
    recording = read_text(tmp_path, "# start = 2026-01-31T12:00:00Z\n# a.b = [1, 2]\n# a.c = 'x'\ntime\n0\n")
    assert recording.metadata == {"start": datetime(2026, 1, 31, 12, tzinfo=UTC), "a": {"b": [1, 2], "c": "x"}}


@pytest.mark.slow
def test_real_recordings(real_data: Measurements) -> None:
    """Every real recording reads, in SI; of three servos in another program's CSV one has to be chosen."""
    for needed in ("friction_backlash_30lb", "silverbox"):
        real_data(needed)
    read = {
        path.relative_to(real_data()): read_recording(path)
        for path in sorted(real_data().glob("*/*.csv"))
        if path.parent.name != "held_servo_play"
    }
    backlash = read[Path("friction_backlash_30lb/1Hz_30lb_1in.csv")]
    assert backlash.foreign_units == {"command": "m"}
    assert np.ptp(backlash.columns["command"]) == pytest.approx(2 * 0.0254, rel=0.05)
    assert len(backlash.time) == 7169
    assert read[Path("silverbox/arrow_test.csv")].foreign_units == {"force": "V", "displacement": "V"}
    held = real_data("held_servo_play") / "sts3215.csv"
    with pytest.raises(RecordingError, match="found 3 joints, expected one; choose with --joint NAME"):
        read_recording(held)
    servo = read_recording(f"{held}#joint=5,position=pos (5)*0.00153398,command=target pos (5)*0.00153398")
    assert servo.metadata["start"] == datetime(2025, 11, 9, 9, 27, 3, 748000, tzinfo=UTC)
    assert np.ptp(servo.columns["command"]) == pytest.approx(200 * 0.00153398)
    assert servo.columns["position"].size == 273


def test_angles_and_torques_in_two_files_are_one_recording(tmp_path: Path) -> None:
    """Three hundred samples in two tables without a column in common, read as one recording."""
    time = np.arange(300) / 100
    for name, values in (("position", np.sin(time)), ("torque", np.cos(time))):
        write_recording(Recording(time, {name: values}), tmp_path / f"{name}.csv")
    paths = [tmp_path / f"{name}.csv" for name in ("position", "torque")]
    (found,) = read_recordings(paths)
    assert list(found.columns) == ["position", "torque"]
    assert len(read_recordings(paths[:1] * 2)) == 2
