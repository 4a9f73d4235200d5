"""How long ``lostmotion fleet status`` takes when many robots live on one router.

    python -m bench.fleet [--robots 100]

Robots with six joints and 200 scores each, in four processes, each with a session, a database and queryables of its
own.
What the command takes as a whole, the start of Python included, stands beside what it waits for answers.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

from tests.daemon.zenoh_world import session

from bench.sinks import free_port
from lostmotion.daemon.commands.fleet_ask import Fleet, ask
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.records import JointRow, ScoreRow
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.daemon.store import Store

GOAL_S = 1.0
PROCESSES, JOINTS, SCORES, RUNS = 4, 6, 200, 7
COMMAND = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()", "fleet", "status", "--json"]


def main(arguments: Sequence[str] = ()) -> None:
    """Prints one row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--serve", nargs=3, metavar=("FOLDER", "ENDPOINT", "NAMES"), help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.serve:
        serve(Path(given.serve[0]), given.serve[1], given.serve[2].split(","))
        return
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as name, session("router", listen=[endpoint]), ExitStack() as stack:
        make(Path(name) / "template.db")
        names = [f"arm{k}" for k in range(given.robots)]
        for part in range(PROCESSES):
            mine = ",".join(names[part::PROCESSES])
            robots = [sys.executable, "-m", "bench.fleet", "--serve", name, endpoint, mine]
            stack.callback(subprocess.Popen(robots).kill)
        fleet = Fleet([endpoint], robots=names, timeout_s=5.0)
        while ask(fleet, "status").silent:
            time.sleep(1.0)
        answers = sorted(timed(lambda: ask(fleet, "status")) for _ in range(RUNS))
        commands = sorted(timed(lambda: run(endpoint, given.robots)) for _ in range(RUNS))
    print(f"{'robots':<10}{'joints':>8}{'all answers p50 s':>20}{'max s':>8}{'command p50 s':>16}{'goal':>8}")
    row = f"{given.robots:<10}{given.robots * JOINTS:>8}{answers[RUNS // 2]:>20.2f}{answers[-1]:>8.2f}"
    print(f"{row}{commands[RUNS // 2]:>16.2f}{GOAL_S:>8.2f}")


def make(path: Path) -> None:
    """A database of six joints."""
    now = datetime.now(UTC)
    with closing(Store(path, "arm")) as store:
        for joint in (f"j{k}" for k in range(JOINTS)):
            store.add(JointRow(joint))
            store.add(*(ScoreRow(joint, now - timedelta(minutes=k), 0.25, 3.0, 8.0, False) for k in range(SCORES)))


def serve(folder: Path, endpoint: str, names: Sequence[str]) -> None:
    """Some of the robots, until killed."""
    for name in names:
        shutil.copy(folder / "template.db", folder / f"{name}.db")
    options = ZenohOptions(mode="client", connect=[endpoint])
    sinks = [ZenohSink(name, options, folder / f"{name}.db") for name in names]
    threading.Event().wait()
    del sinks


def run(endpoint: str, robots: int) -> None:
    """The command as a user calls it; all robots have to be in its answer."""
    done = subprocess.run([*COMMAND, "--connect", endpoint], capture_output=True, check=True)
    assert len(json.loads(done.stdout)["robots"]) == robots


def timed(function: object) -> float:
    """How long a call takes [s]."""
    assert callable(function)
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


if __name__ == "__main__":
    main(sys.argv[1:])
