"""States of sinks: from what a sink says to the database, `status` and the metrics."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import JointRow, ScoreRow, SinkRow, SinkRows, Transition
from lostmotion.daemon.sink_states import SinkStates
from lostmotion.daemon.store import Store
from tests.daemon.cli_world import call

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


class Silent:
    """A sink of another package that does not tell its state."""

    def score(self, row: ScoreRow) -> None: ...
    def alarm(self, transition: Transition, again: bool = False) -> None: ...
    def health(self, row: JointRow) -> None: ...
    def close(self) -> None: ...


@dataclass
class Telling(Silent):
    """One that does."""

    problem: str = ""


def test_a_change_is_a_row() -> None:
    """The first look, going down, another reason, and coming back each give one; the last error stays."""
    sink = Telling()
    states = SinkStates({"zenoh": sink, "other": Silent()})
    at = [NOON + timedelta(seconds=k) for k in range(6)]
    unknown = SinkRow("other", None, at[0], "")
    assert states.look(at[0]) == [SinkRows((SinkRow("zenoh", True, at[0], ""), unknown))]
    assert states.look(at[1]) == []
    sink.problem = "gone"
    assert states.look(at[2]) == [SinkRows((SinkRow("zenoh", False, at[2], "gone"), unknown))]
    sink.problem = "still gone"
    assert states.look(at[3]) == [SinkRows((SinkRow("zenoh", False, at[2], "still gone"), unknown))]
    sink.problem = ""
    assert states.look(at[4]) == [SinkRows((SinkRow("zenoh", True, at[4], "still gone"), unknown))]
    assert states.look(at[5]) == []


def test_no_sinks_are_a_row_too() -> None:
    """A configuration without sinks takes those of the one before out of the database."""
    states = SinkStates({})
    assert states.look(NOON) == [SinkRows(())]
    assert states.look(NOON) == []


def test_status_shows_them(tmp_path: Path) -> None:
    """One line for each, and the same in JSON; none without sinks."""
    path = tmp_path / "history.db"
    now = datetime.now(UTC)
    rows = [SinkRow("zenoh", False, now - timedelta(minutes=7), "nobody answers"),
            SinkRow("can", True, now - timedelta(hours=3), "bus off"),
            SinkRow("chat", None, now, "")]  # fmt: skip
    with closing(Store(path, "arm1")) as store:
        store.add(JointRow("elbow"), SinkRows(tuple(rows)))
    with open_readonly(path) as reader:
        assert reader.sinks() == rows
    told = call("status", "--database", path).stdout
    assert "sink zenoh: down for 7 min: nobody answers\n" in told
    assert "sink can: up for 3 h; last error: bus off\n" in told
    assert "sink chat: its state is unknown\n" in told
    sinks = json.loads(call("status", "--database", path, "--json").stdout)["sinks"]
    assert [(sink["name"], sink["up"], sink["error"]) for sink in sinks] == [
        ("zenoh", False, "nobody answers"),
        ("can", True, "bus off"),
        ("chat", None, ""),
    ]
    with closing(Store(path, "arm1")) as store:
        store.add(SinkRows(()))
    assert "sinks" not in json.loads(call("status", "--database", path, "--json").stdout)
