"""docs/history.md: every command and every block of Python on the page, over a year of scores."""

from __future__ import annotations

import io
import json
import os
import re
import shlex
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from lostmotion.daemon.records import WindowRow
from lostmotion.daemon.store import Store
from tests.conftest import ROOT
from tests.daemon.cli_world import START, call, fill

PAGE = (ROOT / "docs" / "history.md").read_text()
MODULES = {"sqlite-utils": "sqlite_utils.cli", "datasette": "datasette.cli"}


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A folder with an elbow's history, whose scores rise by 6 a year from 1, and a raw window that rings at 60 Hz."""
    path = tmp_path_factory.mktemp("history")
    fill(path / "history.db")
    store = Store(path / "history.db", "arm1")
    times = np.arange(250) / 1000
    wave = np.exp(-5 * times) * np.sin(2 * np.pi * 60 * times)
    store.add(WindowRow("elbow", START, True, 1000.0, 2e-4, wave.astype(np.float32)))
    store.close()
    before = Path.cwd()
    os.chdir(path)
    yield
    os.chdir(before)


def section(title: str) -> str:
    """The text below a heading."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE)
    assert found, title
    return found[1]


def commands(text: str) -> list[list[str]]:
    """Those of the console blocks, as a shell would take them apart."""
    blocks = re.findall(r"```console\n(.*?)```", text, flags=re.DOTALL)
    return [shlex.split(command) for block in blocks for command in re.split(r"^\$ ", block, flags=re.MULTILINE)[1:]]


def run(command: list[str]) -> str:
    """What a command of the page prints; it must succeed."""
    program, *arguments = command
    if program == "lostmotion":
        result = call(*arguments)
    else:
        module = pytest.importorskip(MODULES[program], reason=f"{program} is not installed: pip install {program}")
        result = CliRunner().invoke(module.cli, arguments)
    assert result.exit_code == 0, f"{command}\n{result.output}{result.exception}"
    return result.stdout


def python(text: str) -> list[str]:
    """The lines that the blocks of Python print, one block after another."""
    printed = io.StringIO()
    with redirect_stdout(printed):
        exec("\n".join(re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)), {})
    return printed.getvalue().splitlines()


def test_sqlite_utils() -> None:
    """A copy is whole; joints, months, the loudest windows, alarms, and a time by whole microseconds."""
    (copy,) = commands(PAGE.split("## ")[0])
    run(copy)
    copied = [
        part.replace("history.db", "copy.db") for part in commands(section("On the command line: sqlite-utils"))[0]
    ]
    joints, months, loudest, alarms, since = (
        run(command) for command in commands(section("On the command line: sqlite-utils"))
    )
    assert run(copied) == joints
    assert re.search(r"^elbow +WARNING +half of the windows$", joints, re.MULTILINE)
    assert re.search(r"^elbow +2026-01 +17 +1.24 +0$", months, re.MULTILINE)
    lines = months.splitlines()
    assert "\n".join(lines[:4]) in PAGE
    assert loudest.splitlines()[1].startswith("elbow,2026-12-30T10:10:12.000000Z,6.97,3.4377")
    assert [(alarm["joint"], alarm["cause"]) for alarm in json.loads(alarms)] == [("elbow", "play")]
    assert json.loads(since) == [{"windows": 33, "score": pytest.approx(6.49, abs=1e-9)}]


def test_datasette() -> None:
    """The newest scores, a query of one's own, alarms as CSV; the command that serves them is one that exists."""
    newest, highest, alarms = (run(command) for command in commands(section("In a browser: Datasette")))
    assert [row["score"] for row in json.loads(newest)] == pytest.approx([6.97, 6.94, 6.91, 6.88, 6.85])
    assert json.loads(highest) == [{"joint": "elbow", "highest": 6.97}, {"joint": "shoulder", "highest": 1.5}]
    assert alarms.splitlines()[0].startswith("joint,severity,state,raised")
    (served,) = re.findall(r"^    (datasette .*)$", PAGE, re.MULTILINE)
    assert json.loads(run([*shlex.split(served), "--get", "/-/settings.json"]))["sql_time_limit_ms"] == 10000


def test_pandas() -> None:
    """Medians of months, the slope that was put in, and the bar's 60 Hz from the raw window."""
    pytest.importorskip("pandas", reason="pandas is not installed: pip install pandas")
    *months, slope, frequency = python(section("In a notebook: pandas"))
    assert re.search(r"2026-12-01 00:00:00\+00:00 +6\.7\d* +3\.4377", months[-1])
    assert slope == "6.00 a year"
    assert frequency == "60 Hz"


def test_duckdb() -> None:
    """Two joints' files at once, and the month in which the level was passed."""
    pytest.importorskip("duckdb", reason="duckdb is not installed: pip install duckdb")
    pytest.importorskip("pyarrow", reason="pyarrow is not installed: pip install 'lostmotion[parquet]'")
    text = section("Over years and robots: DuckDB")
    for command in commands(text):
        run(command)
    *table, first = python(text)
    (elbow,) = [line for line in table if "arm1-elbow" in line]
    assert [cell.strip() for cell in elbow.strip("│ ").split("│")][1:4] == ["2026", "200", "6.373"]
    assert first == "[('2026-07', 0.9411764705882353)]"
