"""``lostmotion alarms``: with a service that runs, and without one."""

from __future__ import annotations

import json
import re
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.migrations import CURRENT, MIGRATIONS
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmState, Cause, Request, Severity, Verb
from lostmotion.daemon.requests import RequestError, ask
from lostmotion.daemon.store import Store
from tests.daemon.cli_world import START, call, fill, is_one_line
from tests.daemon.cli_world import start as start_program
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A year of the robot arm1 whose elbow has an active alarm."""
    path = tmp_path / "h.db"
    fill(path, 20)
    return path


def states(path: Path) -> list[AlarmState]:
    """The states of all alarms that are not normal."""
    with open_readonly(path) as reader:
        return [alarm.state for alarm in reader.alarms(living=True)]


def document(*arguments: str | Path) -> Any:
    """The JSON document that a call prints, and nothing else."""
    return json.loads(call(*arguments, "--json").stdout)


def test_a_locked_database_is_told(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a service, what cannot be written is no success: exit 2 and the cause; the alarm stays as it was."""
    monkeypatch.setattr("lostmotion.daemon.database.BUSY_S", 0.05)
    with closing(sqlite3.connect(database)) as other:
        other.execute("BEGIN IMMEDIATE")
        assert is_one_line(call("alarms", "ack", "elbow", "--database", database), "another program holds the database")
    assert states(database) == [AlarmState.ACTIVE]


def test_a_lock_is_no_matter_for_sudo(database: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While a service runs and another program holds the database locked: that is said, and nobody is sent to root."""
    monkeypatch.setattr("lostmotion.daemon.requests.BUSY_S", 0.05)
    with closing(Store(database, "arm1")), closing(sqlite3.connect(database)) as other:
        other.execute("BEGIN IMMEDIATE")
        refused = call("alarms", "ack", "elbow", "--database", database)
    assert is_one_line(
        refused, "another program holds the database locked; close it (database is locked), and try again"
    )
    assert "sudo" not in refused.stderr


@pytest.mark.parametrize("version", [1, 2])
def test_alarms_of_a_database_that_is_not_migrated_yet(tmp_path: Path, version: int) -> None:
    """A new program beside a service of an older version: `status --fail` and `alarms` see the alarm that stands."""
    path = tmp_path / "old.db"
    with closing(sqlite3.connect(path)) as db:
        db.executescript("".join(MIGRATIONS[:version]) + f"PRAGMA user_version = {version};")
        db.execute("INSERT INTO joint (id, name, health, reason) VALUES (1, 'elbow', 'WARNING', 'much')")
        for moments in ((1_000_000, None, None), (2_000_000, None, 4_000_000)):
            row = (1, "play", "warning", *moments, "much")
            db.execute(f"INSERT INTO alarm VALUES (NULL, {', '.join('?' * len(row))})", row)
        db.commit()
    told = call("status", "--database", path, "--fail")
    assert told.exit_code == 1
    assert "alarm: elbow: warning: much" in told.stdout
    (alarm,) = document("alarms", "--database", path)["alarms"]
    assert (alarm["state"], alarm["raised"]) == ("active", "1970-01-01T00:00:01.000000Z")
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA user_version").fetchone()[0] == version


def test_list_is_what_alarms_does(database: Path) -> None:
    """`alarms` and `alarms list` print the same; JSON has all times and states."""
    assert call("alarms", "--database", database).stdout == call("alarms", "list", "--database", database).stdout
    text = call("alarms", "--database", database).stdout
    assert re.search(r"elbow +play +warning +active +2026-01-01 00:00:00.0 +- +- +half of the windows", text)
    assert document("alarms", "--database", database) == {
        "robot": "arm1",
        "alarms": [
            {
                "joint": "elbow", "cause": "play", "severity": "warning", "state": "active",
                "raised": "2026-01-01T00:00:00.000000Z", "acknowledged": None, "cleared": None, "shelved_until": None,
                "reason": "half of the windows",
            }
        ],
    }  # fmt: skip


def test_acknowledge_without_a_service(database: Path) -> None:
    """The program does it itself: the alarm stays active for status --fail, and a second time nothing happens."""
    found = document("alarms", "ack", "elbow", "--database", database)
    assert found == {"joint": "elbow", "done": True, "answer": "elbow: play acknowledged"}
    assert states(database) == [AlarmState.ACKNOWLEDGED]
    again = call("alarms", "ack", "elbow", "--database", database)
    assert (again.exit_code, again.stdout) == (1, "elbow: nothing to be acknowledged\n")
    assert call("status", "--database", database, "--fail").exit_code == 1
    assert "UTC, acknowledged)" in call("status", "--database", database).stdout
    with open_readonly(database) as reader:
        assert reader.transitions()[-1][1].by


def test_shelved_alarms_count_for_nobody(database: Path) -> None:
    """A shelved alarm is in no status and lets --fail pass, until it is unshelved."""
    assert call("alarms", "shelve", "elbow", "--for", "2d", "--database", database).exit_code == 0
    (alarm,) = document("alarms", "--database", database)["alarms"]
    assert alarm["state"] == "shelved"
    assert call("status", "--database", database, "--fail").exit_code == 0
    assert document("status", "--database", database)["joints"][0]["alarms"] == []
    assert "shelved until" in call("status", "--database", database).stdout
    assert call("alarms", "unshelve", "elbow", "--database", database).exit_code == 0
    assert call("status", "--database", database, "--fail").exit_code == 1
    assert document("status", "--database", database)["joints"][0]["alarms"][0]["state"] == "active"


def test_wrong_calls_are_one_line(database: Path) -> None:
    """An unknown joint, a time that is none, a command that is none: what was found and expected."""
    assert is_one_line(call("alarms", "ack", "knee", "--database", database), "knee", "elbow, shoulder")
    assert is_one_line(call("alarms", "shelve", "elbow", "--for", "soon", "--database", database), "soon", "8h")
    assert is_one_line(call("alarms", "shelve", "elbow", "--for", "0h", "--database", database), "above 0")
    assert is_one_line(call("alarms", "shelve", "elbow", "--for", "3y", "--database", database), "a year at most")
    assert is_one_line(call("alarms", "forget", "--database", database), "forget")
    assert is_one_line(call("alarms", "list", "--database", database.parent / "none.db"), "none.db")


def test_a_request_to_a_database_of_another_version(database: Path) -> None:
    """A service of an older version has no table of requests: one line says that it has to be restarted."""
    with closing(sqlite3.connect(database)) as db:
        db.execute("PRAGMA user_version = 2")
    with pytest.raises(RequestError, match=rf"version 2, expected {CURRENT}; .*restart it"):
        ask(database, Request(0, "elbow", Verb.ACK), START)


@pytest.mark.slow
def test_people_and_a_running_service(tmp_path: Path, start: Callable[..., Running]) -> None:
    """While the service runs it alone writes alarms: it acknowledges and shelves for the asking program, which gets
    the answer; `watch` sees it happen; a kill and a restart change nothing."""
    path, database = tmp_path / "fake.toml", tmp_path / "history.db"
    path.write_text(fake_config(tmp_path, joints=["elbow", "impostor"]))
    service = start(path)
    service.wait_for("alarm joint=impostor")
    wait_until(lambda: database.exists() and states(database) == [AlarmState.ACTIVE])
    watching = watch(tmp_path, database)
    assert call("alarms", "ack", "impostor", "--database", database).stdout == "impostor: device acknowledged\n"
    assert "event=acknowledged" in service.wait_for("by=")
    service.process.kill()
    service.process.wait()
    service = start(path)
    service.wait_for("started")
    assert states(database) == [AlarmState.ACKNOWLEDGED]
    assert call("alarms", "shelve", "impostor", "--for", "2s", "--database", database).exit_code == 0
    assert states(database) == [AlarmState.SHELVED]
    wait_until(lambda: states(database) == [AlarmState.ACTIVE])
    assert service.stop(signal.SIGTERM) == 0
    lines = watching.communicate(timeout=60)[0].splitlines()
    assert [json.loads(line)["event"] for line in lines] == ["acknowledged", "shelved", "unshelved"]
    assert len({json.loads(line)["id"] for line in lines}) == 3


def test_watching_goes_on_in_a_new_database(tmp_path: Path, database: Path) -> None:
    """A service has moved the database aside: what is in the new one is told."""
    watching = watch(tmp_path, database)
    database.rename(tmp_path / "aside.db")
    news = raised("elbow", Cause.DEVICE, Severity.ERROR, "gone", START)
    with closing(Store(database, "arm1")) as store:
        store.add(news)
    assert json.loads(watching.stdout.readline())["id"] == news.id
    watching.kill()
    watching.communicate()


@pytest.mark.slow
def test_a_joint_that_leaves_the_configuration(tmp_path: Path, start: Callable[..., Running]) -> None:
    """Its alarm does not stand for ever: it has returned, and can still be acknowledged."""
    path, database = tmp_path / "fake.toml", tmp_path / "history.db"
    path.write_text(fake_config(tmp_path, joints=["elbow", "impostor"]))
    service = start(path)
    service.wait_for("alarm joint=impostor")
    assert service.stop(signal.SIGTERM) == 0
    path.write_text(fake_config(tmp_path))
    service = start(path)
    service.wait_for("alarm joint=impostor cause=device severity=error event=cleared")
    wait_until(lambda: states(database) == [AlarmState.RETURNED])
    assert call("alarms", "ack", "impostor", "--database", database).exit_code == 0
    assert states(database) == []
    assert service.stop(signal.SIGTERM) == 0


def watch(folder: Path, database: Path) -> Any:
    """`alarms watch` in a process of its own, already looking."""
    process = start_program("alarms", "watch", "--json", "--duration", "8", "--database", database, folder=folder)
    wait_until(lambda: f"{database}" in " ".join(open_files(process.pid)))
    return process


def open_files(pid: int) -> list[str]:
    """What files a process has open."""
    return [str(link.resolve()) for link in Path(f"/proc/{pid}/fd").iterdir()]
