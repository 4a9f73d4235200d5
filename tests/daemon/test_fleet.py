"""``lostmotion fleet``: several robots on one router, some of which do not answer."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest

from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.sinks.zenoh import ZenohSink
from tests.daemon.cli_world import SIMULATED, call, fill, is_one_line
from tests.daemon.conftest import free_endpoint, wait_until
from tests.daemon.zenoh_world import Router, session


@pytest.fixture
def fleet(tmp_path: Path, endpoint: str) -> Iterator[str]:
    """A router, the robots arm1 and arm2 with a database each, and mute, who lives and never answers."""
    with ExitStack() as stack:
        router = stack.enter_context(session("router", listen=[endpoint]))
        for robot in ("arm1", "arm2"):
            fill(tmp_path / f"{robot}.db", 20)
            options = ZenohOptions(mode="client", connect=[endpoint])
            sink = stack.enter_context(closing(ZenohSink(robot, options, tmp_path / f"{robot}.db")))
            wait_until(lambda sink=sink: sink.is_open)
        token = router.liveliness().declare_token("lostmotion/mute/alive")
        wait_until(lambda: len(list(router.liveliness().get("lostmotion/*/alive"))) == 3)
        yield endpoint
        token.undeclare()


@pytest.fixture
def endpoints() -> list[str]:
    """Three TCP ports of this host that nobody uses."""
    return [free_endpoint() for _ in range(3)]


def document(*arguments: str) -> Any:
    """The JSON document that a call prints, and nothing else."""
    return json.loads(call(*arguments, "--json").stdout)


def test_status_of_all_robots(fleet: str) -> None:
    """Each robot's status in its own words; who is alive or expected and does not answer is named: exit status 1."""
    found = document("fleet", "status", "--connect", fleet, "--timeout", "1", "--robots", "arm1,arm9")
    assert [robot["joints"][0]["name"] for robot in found["robots"]] == ["elbow", "elbow"]
    assert [alarm["severity"] for alarm in found["robots"][0]["joints"][0]["alarms"]] == ["warning"]
    assert (found["silent"], found["errors"]) == (["arm9", "mute"], [])
    result = call("fleet", "status", "--connect", fleet, "--timeout", "1")
    assert result.exit_code == 1
    assert "mute: did not answer" in result.stdout.splitlines()
    assert "play warning (active)" in result.stdout


@pytest.mark.parametrize("command", [["status"], ["history", "elbow", "--limit", "1"]])
def test_tables_have_the_quantities_of_one_robot(fleet: str, command: list[str]) -> None:
    """Score, level, play and severity, as ``lostmotion status`` and ``history`` print them: 1 mrad is 3.4'."""
    head, _, row, *_ = call("fleet", *command, "--connect", fleet, "--timeout", "1").stdout.splitlines()
    names = ("score", "level", "play", "severity")
    assert [name for name in head.split() if name in names] == list(names)
    assert [cell for cell in row.split() if cell in ("6.70", "4.00", "3.4'")] == ["6.70", "4.00", "3.4'", "3.4'"]


BELL = "\x1b]0;taken over\x07"
"""what renames the window of a terminal that obeys it"""


def test_a_terminal_obeys_no_robot(endpoint: str) -> None:
    """What another robot calls itself and its joints is text: control characters are written out, a row is a line."""
    alarm = {"joint": f"elbow{BELL}", "cause": "play", "severity": "warning", "state": "active",
             "raised": "2026-01-01T00:00:00Z", "reason": f"much\n[red]{BELL}[/red] \u202eback"}  # fmt: skip
    answer = json.dumps({"schema": 1, "alarms": [alarm]})
    with session("peer", listen=[endpoint]) as robot:
        key = "lostmotion/evil/alarms"
        queryable = robot.declare_queryable(key, lambda query: query.reply(key, answer))
        result = call("fleet", "alarms", "--connect", endpoint, "--timeout", "2")
        queryable.undeclare()
    assert len(result.stdout.splitlines()) == 3, result.output
    assert r"elbow\x1b]0;taken over" in result.stdout
    assert r"much [red]\x1b]0;taken over" in result.stdout
    assert r"[/red] \u202eback" in result.stdout


@pytest.mark.parametrize(
    ("command", "key", "answer"),
    [(["status"], "status", {"joints": [{"name": 5}]}), (["status"], "status", {}),
     (["alarms"], "alarms", {"alarms": 5}), (["history", "elbow"], "elbow/history", {"scores": [{"time": "noon"}]})],
)  # fmt: skip
def test_a_robot_that_answers_nonsense_hides_no_other(
    fleet: str, command: list[str], key: str, answer: dict[str, Any]
) -> None:
    """It is named with what is wrong, and the others are shown."""
    with session("client", connect=[fleet]) as robot:
        full = f"lostmotion/evil/{key}"
        text = json.dumps({"schema": 1} | answer)
        queryable = robot.declare_queryable(full, lambda query: query.reply(full, text))
        result = call("fleet", *command, "--connect", fleet, "--timeout", "2")
        queryable.undeclare()
    assert result.exit_code == 1, result.stderr
    assert "arm1 " in result.stdout
    assert "evil: found another answer than was asked for (" in result.stdout


def test_a_key_that_cannot_be_read_is_named(tmp_path: Path, endpoint: str) -> None:
    """Zenoh alone says that it is unable to connect."""
    key, config = tmp_path / "arm1.key", tmp_path / "robot.json5"
    tls = {"connect_private_key": str(key), "enable_mtls": True}
    config.write_text(json.dumps({"mode": "client", "transport": {"link": {"tls": tls}}}))
    options = ("--zenoh", str(config), "--connect", endpoint.replace("tcp/", "tls/"), "--timeout", "1")
    assert is_one_line(call("fleet", "status", *options), f"connect_private_key {key}: No such file or directory")


def test_history_of_a_joint_of_all_robots(fleet: str) -> None:
    """The newest scores of both robots; a joint that a robot lacks is its error."""
    found = document("fleet", "history", "elbow", "--connect", fleet, "--timeout", "1", "--limit", "2")
    assert [(robot["robot"], len(robot["scores"])) for robot in found["robots"]] == [("arm1", 2), ("arm2", 2)]
    lacking = document("fleet", "history", "knee", "--connect", fleet, "--timeout", "1")
    assert [error["robot"] for error in lacking["errors"]] == ["arm1", "arm2"]
    assert "knee" in lacking["errors"][0]["error"]
    assert lacking["silent"] == ["mute"]
    text = call("fleet", "history", "elbow", "--connect", fleet, "--timeout", "1", "--until", "2026-06-01").stdout
    assert "arm2    2026-05-" in text


def test_trend_of_a_joint_of_all_robots(fleet: str, tmp_path: Path) -> None:
    """Each robot's trend is what `trend` says beside its database; a history that is too short is its robot's error."""
    asked = ("--connect", fleet, "--timeout", "2", "--of", "score")
    found = document("fleet", "trend", "elbow", *asked)
    alone = document("trend", "elbow", "--of", "score", "--database", str(tmp_path / "arm1.db"))
    assert found["robots"] == [{"robot": "arm1"} | alone, {"robot": "arm2"} | alone]
    assert (found["joint"], found["silent"], found["errors"]) == ("elbow", ["mute"], [])
    short = document("fleet", "trend", "elbow", *asked, "--since", "2026-12-20")
    assert [error["robot"] for error in short["errors"]] == ["arm1", "arm2"]
    assert "found no scores of 'elbow'" in short["errors"][0]["error"]
    text = call("fleet", "trend", "elbow", *asked).stdout
    assert "arm2    score [-]      20" in text
    assert "rising" in text


def test_all_answered(tmp_path: Path, endpoint: str) -> None:
    """When everybody answers the exit status is 0; a robot that listens itself needs no router, and its configuration
    says where it is."""
    fill(tmp_path / "arm1.db", 20)
    config = tmp_path / "robot.toml"
    config.write_text(SIMULATED + f'[alarm.zenoh]\nlisten = ["{endpoint}"]\n')
    with closing(ZenohSink("arm1", ZenohOptions(listen=[endpoint]), tmp_path / "arm1.db")) as sink:
        wait_until(lambda: sink.is_open)
        result = call("fleet", "status", "--config", config)
    assert result.exit_code == 0
    assert "arm1" in result.stdout


def test_every_endpoint_is_asked(tmp_path: Path, endpoints: list[str]) -> None:
    """Two robots that listen themselves, and an address where nobody does: both are shown, the address is named, exit
    status 1; without that address 0, and with nothing but that address 2."""
    first, second, nobody = endpoints
    with ExitStack() as stack:
        for robot, own in (("arm1", first), ("arm2", second)):
            fill(tmp_path / f"{robot}.db", 20)
            options = ZenohOptions(listen=[own])
            sink = stack.enter_context(closing(ZenohSink(robot, options, tmp_path / f"{robot}.db")))
            wait_until(lambda sink=sink: sink.is_open)
        both = ("--connect", first, "--connect", second)
        result = call("fleet", "status", *both, "--json")
        assert result.exit_code == 0
        assert [robot["robot"] for robot in json.loads(result.stdout)["robots"]] == ["arm1", "arm2"]
        result = call("fleet", "alarms", *both, "--connect", nobody, "--json")
        assert result.exit_code == 1
        found = json.loads(result.stdout)
        assert [(robot["robot"], len(robot["alarms"])) for robot in found["robots"]] == [("arm1", 1), ("arm2", 1)]
        assert [one["endpoint"] for one in found["unreachable"]] == [nobody]
        assert f"{nobody}: nobody answers there" in call("fleet", "alarms", *both, "--connect", nobody).stdout
        file = tmp_path / "operator.json5"
        file.write_text(json.dumps({"mode": "peer", "connect": {"endpoints": [first, nobody, second]}}))
        found = document("fleet", "status", "--zenoh", str(file))
        assert [robot["robot"] for robot in found["robots"]] == ["arm1", "arm2"]
        assert [one["endpoint"] for one in found["unreachable"]] == [nobody]
    assert is_one_line(call("fleet", "status", "--connect", nobody), nobody, "nobody answers there")


def test_robots_that_share_a_name_are_told_apart(tmp_path: Path, endpoints: list[str]) -> None:
    """Both are shown, and the name is an error; a robot that is known to two endpoints is one robot."""
    routers, options = endpoints[:2], ("--connect", endpoints[0], "--connect", endpoints[1])
    with ExitStack() as stack:
        stack.enter_context(session("router", listen=routers[:1]))
        stack.enter_context(session("router", listen=routers[1:], connect=routers[:1]))
        for number, own in enumerate(routers, 1):
            fill(tmp_path / f"{number}.db", 20)
            if number == 2:
                wait_until(lambda: len(document("fleet", "status", *options)["robots"]) == 1)
                assert document("fleet", "status", *options)["errors"] == []
            arm = ZenohOptions(mode="client", connect=[own])
            stack.enter_context(closing(ZenohSink("arm", arm, tmp_path / f"{number}.db")))
        wait_until(lambda: len(document("fleet", "status", *options)["robots"]) == 2)
        result = call("fleet", "alarms", "--connect", routers[0])
    assert result.exit_code == 1
    assert "arm: 2 robots answer to this name" in result.stdout


def test_an_answer_of_another_version(endpoint: str) -> None:
    """What is no document of this schema is the error of its robot."""
    with session("router", listen=[endpoint]) as router:
        for robot, text in (("old", "{"), ("new", '{"schema": 99, "robot": "new", "joints": [7]}')):
            key = f"lostmotion/{robot}/status"
            router.declare_queryable(key, lambda query, key=key, text=text: query.reply(key, text))
        found = document("fleet", "status", "--connect", endpoint, "--timeout", "1")
    assert [error["robot"] for error in found["errors"]] == ["new", "old"]
    assert "schema 1" in found["errors"][0]["error"]


def test_nobody_there(endpoint: str) -> None:
    """What is no address, no router, and a router without robots: one line each."""
    assert is_one_line(call("fleet", "status", "--connect", "here"), "--connect: found 'here', expected protocol/")
    assert is_one_line(
        call("fleet", "status", "--connect", endpoint), endpoint, "nobody answers", "(connection refused)"
    )
    unknown = "tcp/no-such-host.invalid:7447"
    assert is_one_line(call("fleet", "status", "--connect", unknown), "(the host no-such-host.invalid is not known)")
    with session("router", listen=[endpoint]):
        assert is_one_line(call("fleet", "status", "--connect", endpoint, "--timeout", "0.5"), "no robot there")


def test_a_router_that_hangs(tmp_path: Path, endpoint: str) -> None:
    """It is waited for no longer than --timeout says."""
    with closing(Router(tmp_path, endpoint)) as router:
        router.hang()
        begin = time.monotonic()
        assert is_one_line(call("fleet", "status", "--connect", endpoint, "--timeout", "0.5"), "nobody answers there")
        assert time.monotonic() - begin < 8  # Zenoh alone takes 10 s


def test_a_config_file_of_zenoh(fleet: str, tmp_path: Path) -> None:
    """--zenoh takes mode and endpoints from Zenoh's own file."""
    file = tmp_path / "operator.json5"
    file.write_text(f'{{ mode: "client", connect: {{ endpoints: ["{fleet}"] }} }}')
    assert len(document("fleet", "status", "--zenoh", str(file), "--timeout", "1")["robots"]) == 2
    file.write_text("{ mode: ")
    assert is_one_line(call("fleet", "status", "--zenoh", file), "operator.json5: no valid configuration")
