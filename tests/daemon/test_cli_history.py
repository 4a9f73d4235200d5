"""status, history and trend over a database that the store itself has filled."""

from __future__ import annotations

import csv
import io
import json
import math
import os
import re
import sys
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest
from pyarrow import parquet

from lostmotion.daemon.commands import output
from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.records import (
    Cause,
    DeviceRow,
    Health,
    JointRow,
    Origin,
    Origins,
    ScoreRow,
    Severity,
    micros,
)
from lostmotion.daemon.store import Store
from lostmotion.daemon.timekeeper import ClockRow
from lostmotion.daemon.times import TimeError, ago, parse, span
from tests.daemon.cli_world import HARDWARE, SIMULATED, START, call, fill, is_one_line, shown
from tests.daemon.conftest import wait_until
from tests.drivers.test_recorder import room_for


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A year of the robot arm1."""
    path = tmp_path_factory.mktemp("database") / "h.db"
    fill(path)
    return path


def document(*arguments: str | Path) -> Any:
    """The JSON document that a call prints, and nothing else."""
    result = call(*arguments, "--json")
    assert result.exit_code == 0, result.stderr
    return json.loads(result.stdout)


def test_status_json(database: Path) -> None:
    """The keys are those of the interface, NaN is null, times are UTC with Z."""
    status = document("status", "--database", database)
    assert list(status) == ["robot", "joints"]
    elbow, shoulder = status["joints"]
    keys = ["name", "health", "score", "level", "play", "severity", "last_window", "alarms"]
    assert list(elbow) == keys
    numbers = [6.97, 4.0, 0.001, 0.001]
    assert [elbow[key] for key in keys[:7]] == ["elbow", "WARNING", *numbers, "2026-12-30T10:10:12.000000Z"]
    assert [alarm["reason"] for alarm in elbow["alarms"]] == ["half of the windows"]
    assert (shoulder["score"], shoulder["play"], shoulder["alarms"]) == (None, None, [])


def test_status_for_people(database: Path) -> None:
    """The table shows health and play in arc-minutes, and the newest windows as the reason, where the alarm keeps that
    for which it was raised; without a terminal it has no colours."""
    text = call("status", "--database", database).stdout
    assert re.search(r"elbow +WARNING .*play: 100% of the last 20 windows above the level, median 1.7 x level", text)
    assert "WARNING" in text
    assert "3.4'" in text
    assert "nan" not in text
    assert "alarm: elbow: warning: half of the windows (raised 2026-01-01 00:00:00.0 UTC)" in text
    assert "\x1b" not in text


def test_the_windows_of_a_reason_are_those_of_the_configuration(database: Path, tmp_path: Path) -> None:
    """``[alarm] windows`` counts for status as it does for the service."""
    config = tmp_path / "robot.toml"
    config.write_text(HARDWARE.replace("history.db", str(database)) + "[alarm]\nwindows = 3\n")
    assert "play: 100% of the last 3 windows above the level" in call("status", "--config", config).stdout


def test_a_reason_keeps_its_trend(tmp_path: Path) -> None:
    """An alarm that the trend raised has windows below the level: status says what the trend is, too."""
    share, trend = "0% of the last 20 windows above the level", "at its limit in 20 days as its trend goes"
    why = f"play: {share}, median 0.25 x level, {trend}"
    with closing(Store(tmp_path / "h.db", "arm1")) as store:
        for k in range(20):
            store.add(ScoreRow("elbow", START + timedelta(seconds=k), 0.25, 2.0, 4.0, False))
        store.add(JointRow("elbow", Health.DEGRADED, why, START))
        store.add(raised("elbow", Cause.PLAY, Severity.DEGRADED, why, START))
    said = call("status", "--database", tmp_path / "h.db").stdout
    assert "median 0.5 x level, at its limit in 20 days as its trend goes" in re.sub(r"\s+", " ", said)


def test_status_fail(database: Path, tmp_path: Path) -> None:
    """`--fail` is status 1 while an alarm is active, else 0."""
    assert call("status", "--database", database, "--fail").exit_code == 1
    Store(tmp_path / "calm.db", "arm1").close()
    assert call("status", "--database", tmp_path / "calm.db", "--fail").exit_code == 0


def test_status_says_when_nobody_watches(database: Path) -> None:
    """A line when no service holds the database, none while one does; that look keeps no service out."""
    assert "no service is running" in call("status", "--database", database).stdout
    with closing(Store(database, "arm1")):
        assert "no service is running" not in call("status", "--database", database).stdout


@pytest.mark.parametrize(("ahead_s", "words"), [(-7 * 3600.0, "7 h behind"), (95e6, "3.0 y ahead of"), (5.0, "")])
def test_status_says_when_the_clock_has_stepped(tmp_path: Path, ahead_s: float, words: str) -> None:
    """The service goes on with its own time until a step is confirmed; "3.0 y ago" would be a riddle."""
    with closing(Store(tmp_path / "h.db", "arm1")) as store:
        store.add(ClockRow(micros(datetime.now(UTC)) + round(ahead_s * 1e6), 0))
        store.flush()
        wait_until(lambda: store.waiting() == 0)
        text = call("status", "--database", tmp_path / "h.db").stdout
    assert ("the clock has stepped" in text) == bool(words)
    assert words in " ".join(text.split())


def test_history_without_scores_names_the_newest(database: Path) -> None:
    """As where the clock has stepped by years, and --since 1d finds nothing."""
    text = call("history", "elbow", "--database", database, "--since", "2100-01-01").stdout
    assert re.search(r"no scores of elbow in that time; the newest is of 20\d\d-\d\d-\d\d \d\d:", text)


def test_status_counts_lost_samples_beside_those_that_were_read(database: Path) -> None:
    """More may be lost than was read."""
    with closing(Store(database, "arm1")) as store:
        store.add(DeviceRow("tip", START, "reading", "", 1262, lost=1340, late=8, broken=0, silent=0, overwritten=0))
    assert "device tip: reading; 1340 lost, 8 late; 1262 samples read" in call("status", "--database", database).stdout


def test_status_says_when_the_disk_is_full(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is shown is then older than what the service has measured."""
    full = os.statvfs_result((4096, 4096, 1000, 10, 0, 100, 10, 10, 0, 255))
    with closing(Store(database, "arm1")):
        assert "is full" not in call("status", "--database", database).stdout
        monkeypatch.setattr(os, "statvfs", lambda _: full)
        told = call("status", "--database", database).stdout
    assert f"the disk of {database} is full: what the service has measured since then" in told


def test_history_json(database: Path) -> None:
    """The keys are those of the interface, the oldest score comes first."""
    history = document("history", "elbow", "--database", database)
    assert list(history) == ["joint", "scores"]
    assert len(history["scores"]) == 200
    first = {"time": "2026-01-01T00:00:00.000000Z", "score": 1.0, "level": 4.0, "impact": False, "play": 0.001}
    sizes = {"play_low": 0.0009, "play_high": 0.0011, "severity": 0.001, "severity_low": 0.0008, "severity_high": 0.002}
    assert history["scores"][0] == first | sizes | {"quality": "ok"}
    assert list(history["scores"][0])[:4] == ["time", "score", "level", "impact"]
    assert document("history", "shoulder", "--database", database)["scores"][-1]["score"] is None


def test_history_bounds(database: Path) -> None:
    """since <= time < until; a limit keeps the newest."""
    step = 365.25 / 200
    since, until = START + timedelta(days=10 * step), START + timedelta(days=20 * step)
    bounds = ["--since", since.isoformat(), "--until", until.isoformat()]
    scores = document("history", "elbow", "--database", database, *bounds)["scores"]
    assert [score["score"] for score in scores] == pytest.approx([1 + 6 * k / 200 for k in range(10, 20)])
    newest = document("history", "elbow", "--database", database, *bounds, "--limit", "3")["scores"]
    assert newest == scores[-3:]


def test_history_csv(database: Path) -> None:
    """CSV has the keys of JSON as its header and empty cells for what is unknown."""
    text = call("history", "shoulder", "--database", database, "--csv", "--limit", "1").stdout
    (row,) = csv.DictReader(io.StringIO(text))
    assert row["time"] == "2026-12-30T10:10:12.000000Z"
    assert (row["score"], row["level"], row["impact"], row["play"], row["quality"]) == ("", "4.0", "false", "", "gap")


def test_history_table(database: Path) -> None:
    """People see a bar, a mark at impacts and the play in arc-minutes."""
    lines = call("history", "elbow", "--database", database, "--limit", "2").stdout.splitlines()
    assert lines[-1].split() == ["2026-12-30", "10:10:12.0", "6.97", "█" * 12, "4.00", "impact", "3.4'", "3.4'", "ok"]


def test_a_long_table_looks_the_same(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Tables with many rows, which are drawn in a quicker way, have the same columns, lines and bars."""
    drawn = call("history", "elbow", "--database", database).stdout
    monkeypatch.setattr(output, "MOST_IN_COLOUR", 10)
    quick = call("history", "elbow", "--database", database).stdout
    assert quick.splitlines() == [line.rstrip() for line in drawn.splitlines()]


def test_history_parquet(database: Path, tmp_path: Path) -> None:
    """Another program reads the same numbers, with types, UTC times, null for unknown, robot and joint."""
    file = tmp_path / "elbow.parquet"
    said = call("history", "elbow", "--database", database, "--limit", "20", "--parquet", file).stdout
    assert said == f"{file}: 20 scores of elbow\n"
    scores = document("history", "elbow", "--database", database, "--limit", "20")["scores"]
    table = parquet.read_table(file)
    assert table.schema.metadata == {b"robot": b"arm1", b"joint": b"elbow"}
    assert [f"{time:%Y-%m-%dT%H:%M:%S.%fZ}" for time in table["time"].to_pylist()] == [row["time"] for row in scores]
    for name in ("score", "level", "impact", "play", "play_high", "severity", "severity_high", "quality"):
        assert table[name].to_pylist() == [row[name] for row in scores]
    call("history", "shoulder", "--database", database, "--limit", "1", "--parquet", file)
    assert parquet.read_table(file)["score"].to_pylist() == [None]
    refused = call("history", "elbow", "--database", database, "--parquet", tmp_path / "none" / "x.parquet")
    assert is_one_line(refused, "lostmotion:", "x.parquet: cannot be written: No such file or directory; is there a")


def test_parquet_without_its_library(database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line says what to install; the other forms do not need it."""
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    result = call("history", "elbow", "--database", database, "--parquet", tmp_path / "x.parquet")
    assert is_one_line(result, "--parquet needs the package pyarrow", "pip install pyarrow")
    assert call("history", "elbow", "--database", database, "--csv", "--limit", "1").exit_code == 0


def test_unknown_joint_names_the_known(database: Path) -> None:
    """A wrong joint is one line that names the right ones."""
    for command in ("history", "trend"):
        assert is_one_line(call(command, "knee", "--database", database), "knee", "elbow, shoulder")


def test_missing_database(tmp_path: Path) -> None:
    """No database: the path, and the likely cause."""
    for command in (["status"], ["history", "elbow"], ["trend", "elbow"]):
        result = call(*command, "--database", tmp_path / "none.db")
        assert is_one_line(result, "none.db", "lostmotion run")
    assert is_one_line(call("status", "--database", "none.db"), "in the working folder")


def test_damaged_database(database: Path, tmp_path: Path) -> None:
    """Half a database is one line, not a traceback."""
    damaged = tmp_path / "damaged.db"
    damaged.write_bytes(database.read_bytes()[:8192] + b"\x5a" * 50_000)
    assert is_one_line(call("history", "elbow", "--database", damaged), "database", "damaged")


def test_configuration_names_the_database(database: Path, tmp_path: Path) -> None:
    """--config F reads the database of F; --database beats it."""
    config = tmp_path / "robot.toml"
    config.write_text(SIMULATED.replace("history.db", str(database)))
    assert document("status", "--config", config)["robot"] == "arm1"
    assert is_one_line(call("status", "--config", config, "--database", tmp_path / "no.db"), "no.db")


def test_users_database_is_the_default(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without options and without a system-wide configuration it is the one of `lostmotion run`."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr("lostmotion.daemon.commands.where.ETC", tmp_path / "none.toml")
    fill(tmp_path / "lostmotion" / "history.db", 5)
    assert document("history", "elbow")["joint"] == "elbow"


def test_installed_configuration_is_the_default(
    database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a robot with a service, its configuration is meant: its database, its limit of the play, its devices."""
    config = tmp_path / "lostmotion.toml"
    monkeypatch.setattr("lostmotion.daemon.commands.where.ETC", config)
    config.write_text(HARDWARE.replace("history.db", str(database)) + "[alarm]\nplay_error = 0.002\n")
    assert document("status")["robot"] == "arm1"
    assert document("trend", "elbow", "--of", "play")["level"] == pytest.approx(0.002)
    doctor = call("doctor", "--json")
    assert doctor.exit_code == 1
    assert "no-such-port" in doctor.stdout


def test_reading_while_the_service_writes(tmp_path: Path) -> None:
    """A database that is open for writing can be read."""
    fill(tmp_path / "h.db", 5)
    writing = Store(tmp_path / "h.db", "arm1")
    try:
        assert len(document("history", "elbow", "--database", tmp_path / "h.db")["scores"]) == 5
    finally:
        writing.close()


def test_a_limit_of_an_angle_has_a_unit(database: Path) -> None:
    """60' and 1deg are the angles that the output has; 60 rad are none."""
    levels = [document("trend", "elbow", "--database", database, "--level", one)["level"] for one in ("60'", "1deg")]
    assert levels == pytest.approx([math.pi / 180] * 2)
    for level, why in (("60", "found a limit of 60 rad"), ("60x", "expected a number above 0"), ("-1", "above 0")):
        refused = call("trend", "elbow", "--database", database, "--level", level)
        assert refused.exit_code == 2
        assert why in refused.stderr


def test_trend_json(database: Path) -> None:
    """A line of slope 6 a year is found as such, with its significance and the time at which it met the level."""
    trend = document("trend", "elbow", "--of", "score", "--database", database, "--level", "8.97")
    assert trend["slope"]["per_month"] == pytest.approx(0.5, rel=1e-6)
    assert trend["slope"]["low"] <= 0.5000001
    assert trend["slope"]["high"] >= 0.4999999
    assert trend["mann_kendall"]["direction"] == "rising"
    assert trend["mann_kendall"]["tau"] == pytest.approx(1.0)
    assert trend["current"] == pytest.approx(6.97)
    assert trend["time_to_limit"]["likely_s"] == pytest.approx(2 / 6 * 365.25 * 86400, rel=1e-6)
    assert (trend["count"], trend["level"], trend["change_points"]) == (200, 8.97, [])


@pytest.fixture(scope="module")
def warm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A year of a joint whose play grows from 5 to 15 mrad, whose scores are only larger in warm hours, and of a
    configuration to which 20 mrad is an error."""
    folder = tmp_path_factory.mktemp("warm")
    store, rng = Store(folder / "h.db", "arm1"), np.random.default_rng(4)
    for k in range(800):
        share, warmth = k / 800, rng.normal(0, 5) + 8 * k / 800
        score = 5 * np.exp(0.03 * warmth + rng.normal(0, 0.1))
        play = math.nan if k % 4 else 0.005 + 0.01 * share + rng.normal(0, 0.0005)
        time = START + timedelta(days=365 * share)
        store.add(ScoreRow("elbow", time, 0.25, score, 8.0, False, play, excitation=20.0, temperature=35 + warmth))
    store.close()
    (folder / "r.toml").write_text(SIMULATED.replace("history.db", f"{folder}/h.db") + "[alarm]\nplay_error = 0.02\n")
    return folder


def test_trend_of_the_play(warm: Path) -> None:
    """Of 200 sizes: 10 mrad a year, in rad as JSON, against the configuration's limit, in arc-minutes for people."""
    told = document("trend", "elbow", "--of", "play", "--config", warm / "r.toml")
    assert (told["count"], told["level"]) == (200, 0.02)
    assert told["slope"]["per_month"] * 12 == pytest.approx(0.01, rel=0.05)
    assert told["time_to_limit"]["likely_s"] == pytest.approx(0.5 * 365 * 86400, rel=0.1)
    text = call("trend", "elbow", "--of", "play", "--config", warm / "r.toml").stdout
    assert "elbow: 200 plays" in text
    assert "level 68.75'" in text
    assert re.search(r"slope +\+3\d\.\d' per year", text)
    assert "+34" in text
    assert is_one_line(call("trend", "elbow", "--of", "play", "--database", warm / "h.db"), "--level")


@pytest.fixture(scope="module")
def wearing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A year of a joint whose severity grows from 2 to 12 mrad while its score falls; rows of the first tenth are from
    before there were severities."""
    folder = tmp_path_factory.mktemp("wearing")
    store, rng = Store(folder / "h.db", "arm1"), np.random.default_rng(6)
    for k in range(800):
        share = k / 800
        severity = (0.002 + 0.01 * share) * math.exp(rng.normal(0, 0.3)) if k >= 80 else math.nan
        time = START + timedelta(days=365 * share)
        store.add(ScoreRow("elbow", time, 0.25, 17 - 10 * share, 8.0, True, severity=severity))
        store.add(ScoreRow("wrist", time, 0.25, 17 - 10 * share, 8.0, True, severity=severity if k > 700 else math.nan))
    store.close()
    (folder / "r.toml").write_text(SIMULATED.replace("history.db", f"{folder}/h.db"))
    return folder


def test_trend_is_that_of_the_severity(wearing: Path) -> None:
    """10 mrad a year against an error at 17.5 mrad, reached in about 200 days, in rad as JSON; arc-minutes, and
    micrometres on the simulated robot's gear of 10 mm, for people; the falling score is there when it is asked for."""
    told = document("trend", "elbow", "--config", wearing / "r.toml")
    assert (told["of"], told["count"], told["level"]) == ("severity", 720, 0.0175)
    assert told["slope"]["per_month"] * 12 == pytest.approx(0.01, rel=0.1)
    assert told["time_to_limit"]["likely_s"] == pytest.approx(0.55 * 365 * 86400, rel=0.25)
    text = call("trend", "elbow", "--config", wearing / "r.toml").stdout
    assert "elbow: 720 severities" in text
    found = re.search(
        r"wear           from ([\d.]+)' \(([\d.]+) µm\) to ([\d.]+)' \(([\d.]+) µm\) on a gear of 10 mm", text
    )
    assert found
    assert [float(found[k]) for k in (1, 3)] == pytest.approx([12.0, 39.5], rel=0.15)
    assert float(found[4]) == pytest.approx(math.radians(float(found[3]) / 60) * 1e4, abs=0.6)
    assert "µm" not in call("trend", "elbow", "--database", wearing / "h.db").stdout
    assert document("trend", "elbow", "--of", "score", "--config", wearing / "r.toml")["slope"]["per_month"] < 0


def test_trend_falls_back_to_the_score(wearing: Path) -> None:
    """Where most rows have no severity yet the score counts, and a line says so; not when it was asked for."""
    told = document("trend", "wrist", "--config", wearing / "r.toml")
    assert (told["of"], told["count"]) == ("score", 800)
    lines = call("trend", "wrist", "--config", wearing / "r.toml").stdout.splitlines()
    assert lines[0] == "too few of these scores have a severity: the trend is that of scores"
    assert "too few" not in call("trend", "wrist", "--of", "score", "--config", wearing / "r.toml").stdout


@pytest.mark.parametrize(
    ("days", "growth", "told"),
    [(30.0, 0.0, "no rise is found"), (60 / 86400, 1.0, "the history is shorter than 7 days")],
)
def test_a_limit_that_nobody_can_foresee(tmp_path: Path, days: float, growth: float, told: str) -> None:
    """A month without a rise, and a rise within a minute, which is not that of wear: no time until the limit is told,
    in words or in JSON, and the reason is."""
    store = Store(tmp_path / "h.db", "arm1")
    for k, factor in enumerate(np.exp(0.2 * np.random.default_rng(1).standard_normal(60))):
        severity = 2.5e-3 * factor * (1 + growth * k / 60)
        time = START + timedelta(days=days * k / 60)
        store.add(ScoreRow("elbow", time, 0.25, 50.0, 8.0, True, severity=severity))
    store.close()
    text = call("trend", "elbow", "--database", tmp_path / "h.db").stdout
    assert re.search(rf"^limit +no forecast: {told}$", text, re.MULTILINE)
    assert "reached in" not in text
    assert not re.search("^forecast", text, re.MULTILINE)
    trend = document("trend", "elbow", "--database", tmp_path / "h.db")
    assert (trend["time_to_limit"], trend["forecast"], trend["no_forecast"]) == (None, None, told)


def test_a_limit_is_foreseen_by_the_slope_since_the_last_change(tmp_path: Path) -> None:
    """A rise of 200 days that has stopped: the history rises, and the limit is not reached at the slope since then."""
    store = Store(tmp_path / "h.db", "arm1")
    for k, noise in enumerate(1e-5 * np.random.default_rng(2).standard_normal(300)):
        severity = 1e-3 + 1e-5 * min(k, 200) - 1e-6 * max(k - 200, 0) + noise
        store.add(ScoreRow("elbow", START + timedelta(days=k), 0.25, 50.0, 8.0, True, severity=severity))
    store.close()
    text = call("trend", "elbow", "--database", tmp_path / "h.db").stdout
    assert re.search("^trend +rising", text, re.MULTILINE)
    assert re.search("^limit +not reached at the slope since then", text, re.MULTILINE)


def test_the_trend_of_the_impacts_of_another_joint_is_told(tmp_path: Path) -> None:
    """Where the impacts are most probably of the elbow the trend of the shoulder says so, and that of the elbow not."""
    fill(tmp_path / "h.db", 50)
    with closing(Store(tmp_path / "h.db", "arm1")) as store:
        store.add(Origins((Origin({"elbow": 0.99, "shoulder": 0.01}, 100),)))
    told = "impacts        most probably of elbow (99%): this trend is not the wear of shoulder\n"
    assert told in call("trend", "shoulder", "--database", tmp_path / "h.db").stdout
    assert "impacts" not in call("trend", "elbow", "--database", tmp_path / "h.db").stdout


def test_trend_is_freed_of_warmth(warm: Path) -> None:
    """Scores that rise by 3 % a °C in a year that grows warmer: JSON tells the dependence, and no trend is left."""
    told = document("trend", "elbow", "--config", warm / "r.toml")
    assert told["normalised"] == {"temperature": pytest.approx(0.03, abs=0.003)}
    assert told["mann_kendall"]["p_value"] > 0.01
    assert "% a °C: values at the median" in call("trend", "elbow", "--config", warm / "r.toml").stdout


def test_trend_leaves_out_unknown_scores(database: Path) -> None:
    """NaN counts for nothing; a constant history has no trend and never gets there."""
    trend = document("trend", "shoulder", "--database", database)
    assert (trend["count"], trend["slope"]["per_month"], trend["time_to_limit"]) == (199, 0.0, None)
    assert trend["mann_kendall"]["direction"] == "none"


def test_trend_in_the_terminal(database: Path) -> None:
    """Words first, then a plot with level and dates; no escape codes without a terminal."""
    text = call("trend", "elbow", "--of", "score", "--database", database).stdout
    assert "slope          +6 per year" in text
    assert "limit          reached" in text
    assert "level 4" in text
    assert text.count("•") > 30
    assert "2026-01-01" in text
    assert "\x1b" not in text


@pytest.mark.parametrize("columns", ["1", "10"])
def test_trend_in_a_terminal_of_a_few_columns(monkeypatch: pytest.MonkeyPatch, database: Path, columns: str) -> None:
    """The plot has a least width, which such a terminal wraps."""
    monkeypatch.setenv("COLUMNS", columns)
    result = call("trend", "elbow", "--of", "score", "--database", database)
    assert result.exit_code == 0, result.stderr
    assert "•" in result.stdout


@pytest.mark.parametrize(("term", "is_coloured"), [("xterm", True), ("dumb", False)])
def test_trend_in_a_terminal_without_colours(
    monkeypatch: pytest.MonkeyPatch, database: Path, term: str, is_coloured: bool
) -> None:
    """TERM=dumb gets no escape codes, neither in the words nor in the plot."""
    monkeypatch.delenv("NO_COLOR", raising=False)
    text = shown(os.environ | {"TERM": term}, "trend", "elbow", "--of", "score", "--database", database)
    assert "slope" in text
    assert ("\x1b" in text) is is_coloured


def test_a_score_beyond_all_bounds_is_short() -> None:
    """A row stays readable with a score of 1e300, which another program or robot may have written."""
    assert [output.number(score) for score in (math.nan, 2.345, 999_999.0, 9e300)] == [
        "-",
        "2.35",
        "999999.00",
        "9e+300",
    ]


def test_trend_picture(database: Path, tmp_path: Path) -> None:
    """--png writes a picture of some size; stdout still is one JSON document."""
    picture = tmp_path / "trend.PNG"
    document("trend", "elbow", "--database", database, "--png", picture)
    content = picture.read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(content[16:20], "big") >= 1000
    refused = call("trend", "elbow", "--database", database, "--png", tmp_path / "none" / "x.png")
    assert is_one_line(refused, "x.png: cannot be written: No such file or directory; is there a folder")


def test_the_legend_of_a_plot_is_below_it(database: Path) -> None:
    """No box lies on the curve: the rows of the plot have its frame, curve and level only."""
    lines = call("trend", "elbow", "--database", database).stdout.splitlines()
    assert lines[-1].strip().startswith("• median   ⢕ Theil-Sen   ─ level 60.16")
    assert sum("┌" in line for line in lines) == 1


def test_the_level_of_a_picture_is_rounded_as_in_the_terminal(database: Path, tmp_path: Path) -> None:
    """The limit of a severity, 17.5 mrad, is 60.16 arc-minutes in the legend."""
    picture = tmp_path / "wear.svg"
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        assert call("trend", "elbow", "--database", database, "--png", picture).exit_code == 0
    assert re.findall(r"level [\d.]+", picture.read_text()) == ["level 60.16"]


@pytest.mark.parametrize("words", [("trend", "elbow", "--png"), ("history", "elbow", "--parquet")])
def test_a_full_disk_leaves_the_earlier_file(database: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    """What cannot be written whole is not there at all, and what it was to replace still is."""
    path = tmp_path / "out" / "wear.png"
    path.parent.mkdir()
    call(*words, path, "--database", database)
    earlier = path.read_bytes()
    with room_for(100):
        result = call(*words, path, "--database", database)
    assert is_one_line(result, f"{path}: cannot be written: File too large"), result.stderr
    assert [*path.parent.iterdir()] == [path]
    assert path.read_bytes() == earlier


def test_a_full_disk_leaves_no_empty_file(tmp_path: Path) -> None:
    """A new file of lines would be in the way of the next try."""
    path = tmp_path / "bar.toml"
    words = ("calibrate", "bar", "--diameter", "3mm", "--length", "90mm", "-o", path)
    with room_for(10):
        assert is_one_line(call(*words), f"{path}: cannot be written: File too large")
    assert not path.exists()
    assert call(*words).exit_code == 0


def test_trend_picture_in_other_forms(database: Path, tmp_path: Path) -> None:
    """The suffix names the form; one that is none is refused before anything is printed."""
    for suffix, start in ((".svg", b"<?xml"), (".pdf", b"%PDF")):
        picture = tmp_path / f"trend{suffix}"
        document("trend", "elbow", "--database", database, "--png", picture)
        assert picture.read_bytes().startswith(start)
    refused = call("trend", "elbow", "--database", database, "--png", tmp_path / "x.xyz")
    assert is_one_line(refused, "x.xyz", ".png, .svg, .pdf")


def test_swapped_times(database: Path) -> None:
    """A period that ends before it begins is a wrong call, not an empty answer."""
    for command in ("history", "trend"):
        result = call(command, "elbow", "--database", database, "--since", "30d", "--until", "31d")
        assert is_one_line(result, "--until", "--since", "swapped")


def test_trend_of_nothing(database: Path) -> None:
    """Too little history is one line that says how much there is."""
    few = ["--since", "2026-12-28T20:00"]
    assert is_one_line(call("trend", "elbow", "--database", database, *few), "elbow", "at least 3")
    assert is_one_line(call("trend", "elbow", "--database", database, "--since", "2027-06-01"), "no scores")


def test_times_as_people_type_them() -> None:
    """Lengths before now, ISO 8601 with and without a zone; all else is refused."""
    now = datetime(2026, 7, 1, 12, tzinfo=UTC)
    assert parse("30d", now) == now - timedelta(days=30)
    assert parse("1.5h", now) == now - timedelta(minutes=90)
    assert parse("2026-01-31", now) == datetime(2026, 1, 31, tzinfo=UTC)
    assert parse("2026-01-31T12:00:00Z", now) == datetime(2026, 1, 31, 12, tzinfo=UTC)
    assert parse("2026-01-31T12:00+02:00", now) == datetime(2026, 1, 31, 10, tzinfo=UTC)
    for text in ("", "30", "3 moons", "2026-13-01", "99999999y"):
        with pytest.raises(TimeError, match="expected one such as"):
            parse(text, now)


def test_times_as_people_read_them() -> None:
    """The largest unit of which there are at least two; the future is said as such."""
    now = datetime(2026, 7, 1, 12, tzinfo=UTC)
    assert [span(s) for s in (3, 119, 120, 86400, 5 * 86400.0, 400 * 86400.0)] == [
        "3 s", "119 s", "2 min", "24 h", "5.0 d", "13 months",
    ]  # fmt: skip
    assert ago(now - timedelta(seconds=3), now) == "3 s ago"
    assert ago(now + timedelta(minutes=5), now) == "in 5 min"
