"""A history of many scores is read and printed piece by piece: the same text, in little memory."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import pytest

from lostmotion.daemon.commands import output
from lostmotion.daemon.reader import Bounds, open_readonly
from lostmotion.daemon.records import from_micros
from lostmotion.drivers.terminal import column_widths, records
from tests.daemon.cli_world import START, fill, in_terminal

MEASURED = """
import re, sys
from pathlib import Path
from lostmotion.daemon.cli import main
try:
    main()
finally:
    sys.stderr.write(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
"""
"""the program, and the most memory it has had [kB]: ru_maxrss would count what the process that starts it has"""


def memory_mb(*arguments: object) -> float:
    """The most memory that a call of the program has [MB]."""
    command = [sys.executable, "-c", MEASURED, *map(str, arguments)]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=True)
    return int(done.stderr) / 1024


@pytest.mark.slow
@pytest.mark.parametrize("form", ["--json", "--csv"])
def test_memory_does_not_grow_with_the_history(tmp_path: Path, form: str) -> None:
    """100 000 scores take at most 35 MB more than ten do; all at once they took 237 MB as JSON, 85 MB as CSV."""
    fill(tmp_path / "history.db", 1)
    with closing(sqlite3.connect(tmp_path / "history.db")) as db, db:
        db.execute(
            "WITH RECURSIVE k(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM k WHERE n < 100000)"
            " INSERT INTO score (joint_id, time_us, duration_us, score, level, impact, play)"
            " SELECT joint_id, time_us + 1000000 * n, 250000, n / 7.0, 8.0, 0, n / 7e6"
            " FROM k, score WHERE joint_id = (SELECT id FROM joint WHERE name = 'elbow')"
        )
    ask = ("history", "elbow", form, "--database", tmp_path / "history.db")
    assert memory_mb(*ask) < memory_mb(*ask, "--limit", 10) + 35


@pytest.mark.parametrize(
    "bounds",
    [(None, None, None), (None, None, 11), (None, None, 1000), (START + timedelta(days=99), None, 12),
     (START + timedelta(days=30), START + timedelta(days=99), None), (START + timedelta(days=999), None, 5)],
)  # fmt: skip
def test_batches_are_the_same_scores(tmp_path: Path, bounds: Bounds) -> None:
    """Whatever the bounds, the batches put together are what one question brings."""
    fill(tmp_path / "history.db", 50)
    with open_readonly(tmp_path / "history.db") as reader:
        batches = list(reader.batches("elbow", bounds, size=4))
        assert all(len(batch) == 4 for batch in batches[:-1])
        times = [from_micros(row[0]) for batch in batches for row in batch]
        assert times == [score.time for score in reader.scores("elbow", *bounds)]
        assert [score.time for scores in reader.stream("elbow", bounds) for score in scores] == times


def test_what_is_written_meanwhile_is_not_waited_for(tmp_path: Path) -> None:
    """A reader that is slower than the service ends all the same: with the newest score there was when it began."""
    fill(tmp_path / "history.db", 20)
    with open_readonly(tmp_path / "history.db") as reader, closing(sqlite3.connect(tmp_path / "history.db")) as db:
        count = 0
        for rows in reader.batches("elbow", (None, None, None), size=1):
            count += 1
            assert count <= 20
            with db:
                db.execute(
                    "INSERT INTO score (joint_id, time_us, duration_us, score, level, impact)"
                    " SELECT joint_id, max(time_us) + 1000000, 250000, 1.0, 8.0, 0 FROM score WHERE joint_id ="
                    " (SELECT joint_id FROM score WHERE time_us = ? LIMIT 1)",
                    [rows[-1][0]],
                )
    assert count == 20


@pytest.mark.parametrize("batches", [[], [[{"a": 1, "b": "x\ny"}]], [[{"a": 1}, {"a": None}], [], [{"a": [2, {}]}]]])
def test_json_in_batches_is_the_same_text(batches: list[list[object]], capsys: pytest.CaptureFixture[str]) -> None:
    """The document is that of all rows at once, letter by letter."""
    output.print_json({"joint": "[]", "rows": [row for batch in batches for row in batch]})
    whole = capsys.readouterr().out
    output.print_json_list({"joint": "[]"}, "rows", batches)
    assert capsys.readouterr().out == whole
    json.loads(whole)


def test_a_table_in_batches_is_the_same_text(capsys: pytest.CaptureFixture[str]) -> None:
    """Where the first batch has the widest cells; a wider cell widens its column from its batch on."""
    rows = [["x" * 9, f"{k}"] for k in range(1000, 2000)]
    output.print_table(("name", "k"), rows, right=("k",))
    whole = capsys.readouterr().out
    assert output.print_long_table(("name", "k"), iter([rows[:600], rows[600:900], rows[900:]]), right=("k",))
    assert capsys.readouterr().out == whole
    output.print_long_table(("name", "k"), iter([[["x", "1"]], [["xxxxxx", "22"]]]))
    assert capsys.readouterr().out.splitlines() == ["name   k", "────────", "x      1", "xxxxxx   22"]


def test_a_short_table_of_one_batch_is_that_of_a_few_rows(capsys: pytest.CaptureFixture[str]) -> None:
    """And one of none is told apart from it."""
    output.print_table(("a",), [["1"]])
    whole = capsys.readouterr().out
    assert output.print_long_table(("a",), iter([[["1"]]]))
    assert capsys.readouterr().out == whole
    assert not output.print_long_table(("a",), iter([]))


def test_a_row_is_one_line_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    """A cell of 300 characters is neither wrapped nor cut, and no line ends in blanks."""
    output.print_table(("joint", "why"), [["elbow", "word " * 60], ["[red]wrist[/red]", "-"]])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2:] == ["elbow   " + ("word " * 60).rstrip(), "wrist   -"]
    assert lines[0] == "joint   why"


def test_a_narrow_terminal_wraps_between_words() -> None:
    """In 160 columns nothing is wrapped; in 30 the gaps close and the time wraps at its blank; in 12 words would
    break."""
    columns, row = ("joint", "raised", "reason"), ["elbow", "2026-11-25 19:32:54", "half of the windows above"]
    assert column_widths(columns, [row], 160) == ([5, 19, 25], 3)
    assert column_widths(columns, [row], 30) == ([5, 11, 12], 1)
    assert column_widths(columns, [row], 12) is None


def test_a_table_that_does_not_fit_is_lines_of_name_and_value() -> None:
    """Names in one column, values wrapped between words beside them; an empty cell has no line."""
    columns, rows = ("joint", "raised", "reason"), [["elbow", "now", "half of the windows above"], ["wrist", "", "-"]]
    assert records(columns, rows, 24) == [
        "joint   elbow",
        "raised  now",
        "reason  half of the",
        "        windows above",
        "",
        "joint   wrist",
        "reason  -",
    ]


@pytest.mark.parametrize(("width", "first"), [(100, "time (UTC)"), (56, "time"), (40, "time (UTC)  2026")])
def test_history_fits_its_terminal(tmp_path: Path, width: int, first: str) -> None:
    """With its bar, without it, and a line for each value; no line is longer than the terminal, no word broken."""
    path = tmp_path / "history.db"
    fill(path, count=3)
    told = in_terminal(width, "history", "elbow", "--database", path)
    lines = told.splitlines()
    assert lines[0].startswith(first)
    assert ("█" in told) == (width == 100)
    assert max(map(len, lines)) <= width
    assert {"4.00", "severity", "impact", "quality"} <= set(told.split())
