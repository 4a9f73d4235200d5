"""Recordings that no sensor makes, through the commands that read them: an answer, or one line of what is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import Result
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.recording import read_recording
from tests.daemon.cli_world import call

HEADER = "time,command,accel\n"
ROWS = "".join(f"{i / 100},{i % 7},{i % 5}\n" for i in range(400))
DIGITS = "9" * 5000


def rows(time: str = "{t}", command: str = "{a}", accel: str = "{b}") -> str:
    """A recording whose cells are made by these patterns of t [s], a (0 to 6) and b (0 to 4)."""
    line = f"{time},{command},{accel}\n"
    return HEADER + "".join(line.format(t=i / 100, i=i, a=i % 7, b=i % 5) for i in range(400))


REFUSED = {
    "accel 1e308": (rows(accel="1e308"), "line 2: found '1e308' in the column 'accel', expected a finite number up to"),
    "command 1e308": (rows(command="-1e308"), "found '-1e308' in the column 'command', expected a finite number up to"),
    "time 1e308": (rows(time="{i}e305"), "in the column 'time', expected a finite number up to 1e+30"),
    "nanoseconds": (rows(time="17{i:03d}00000000000000"), 'if the times are in nanoseconds, write # time_unit = "ns"'),
    "times of 1e-300 s": (rows(time="{i}e-300"), "found times that are 1e-300 s apart, expected at least 1e-09 s"),
    "5000 digits": (f"# x = {DIGITS}\n{HEADER}{ROWS}", "line 1: found 'x = 999"),
    "hexadecimal": (f"# x = 0x{DIGITS}\n{HEADER}{ROWS}", "whole numbers of at most 64 bits"),
    "5000 lists": (f"# x = {'[' * 5000}{']' * 5000}\n{HEADER}{ROWS}", "nested too deeply, expected at most 64 levels"),
    "5000 parts": (f"# {'a.' * 5000}b = 1\n{HEADER}{ROWS}", "found a key of more than 64 parts"),
    "year 1": (f"# start = 0001-01-01T00:00:00+14:00\n{HEADER}{ROWS}", "found a time in the year 1"),
    "f_res 1e308": (
        f"# f_res_hz = 1e308\n{HEADER}{ROWS}",
        "# f_res_hz: found 1e+308, expected a number from 0 to 1e+12",
    ),
    "f_res nan": (f"# f_res_hz = nan\n{HEADER}{ROWS}", "# f_res_hz: found nan, expected a number from 0 to 1e+12"),
    "a line without end": (f"{HEADER}0,1,{'a' * 200_000}\n", "found a line of more than 100000 characters"),
}


def is_clean(result: Result) -> bool:
    """An answer, or one line that is no internal error."""
    told = result.stderr
    return result.exit_code in (0, 1) or (result.exit_code == 2 and told.count("\n") == 1 and "internal" not in told)


@pytest.mark.parametrize("name", REFUSED)
def test_an_absurd_recording_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    """score names the file, what was found and what was expected."""
    text, expected = REFUSED[name]
    (tmp_path / "rec.csv").write_text(text)
    result = call("score", tmp_path / "rec.csv")
    assert is_clean(result)
    assert result.stderr.startswith(f"lostmotion: {tmp_path / 'rec.csv'}: ")
    assert expected in result.stderr
    assert len(result.stderr) < 400


@pytest.mark.parametrize(
    "text",
    [
        rows(accel="{b}e-320"),
        rows(time="0"),
        rows(accel="{b}e30", command="{a}e30"),
        f"# resolution_rad = 1e12\n# range_ms2 = 1e-300\n{HEADER}{ROWS}",
        f"# f_res_hz = 1e12\n# zeta = 1e-300\n{HEADER}{ROWS}",
        f"# accel_unit = [1]\n# joint = {{ a = 1 }}\n{HEADER}{ROWS}",
        f"{HEADER}{ROWS}1e12,1,1\n",
    ],
)
def test_odd_values_are_answered_or_refused(text: str, tmp_path: Path) -> None:
    """Denormal numbers, one instant, the largest cells, metadata without sense, a gap of 30 000 years."""
    path = tmp_path / "rec.csv"
    path.write_text(text)
    for command in (["score"], ["score", "--json"], ["calibrate", "tap"], ["calibrate", "healthy"]):
        assert is_clean(call(*command, path))


def test_a_device_without_end_is_refused() -> None:
    """/dev/zero has no lines: as recording, configuration and database it is told, and not read for ever."""
    for arguments in (["score", "/dev/zero"], ["config", "check", "/dev/zero"], ["status", "--database", "/dev/zero"],
                      ["score", "/dev/null", "--config", "/dev/zero"]):  # fmt: skip
        result = call(*arguments)
        assert result.exit_code == 2
        assert result.stderr.startswith("lostmotion: /dev/")
        assert result.stderr.count("\n") == 1


def test_a_limit_beyond_the_database_is_refused() -> None:
    """SQLite counts with 64 bits."""
    result = call("history", "elbow", "--limit", "9" * 30)
    assert result.exit_code == 2
    assert "expected a whole number of at least 1" in result.stderr


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_file_is_a_recording_or_not(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Bytes in place of others, also what is no text: a recording, or RecordingError in one line."""
    file, text = tmp_path_factory.getbasetemp() / "any.csv", f'# x = [1]\n# y = "a"\n{HEADER}{ROWS[:300]}'.encode()
    begin, end = sorted(data.draw(st.tuples(*[st.integers(0, len(text))] * 2)))
    middle = data.draw(st.binary(max_size=20) | st.text("#[]{}=.,\"'\\\n0e9-ai", max_size=40).map(str.encode))
    file.write_bytes(text[:begin] + middle + text[min(end, begin + 30) :])
    told = ""
    try:
        read_recording(file)
    except RecordingError as error:
        told = str(error)
    assert "\n" not in told
