"""The same numbers wherever the work runs: here one by one, on threads, on spawned processes, on a Dask cluster."""

from __future__ import annotations

import os
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.comparison.residual_analysis import predict
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.errors import ExecutorError
from lostmotion.lab.models.own import load_effect
from lostmotion.lab.parallel import cores, open_executor
from lostmotion.model import HandWaved, Model, build_model
from lostmotion.model.effects import unregister

EFFECT = """
from lostmotion.lab import Parameter, effect

@effect("joint", parameters={"b": Parameter(4e-4, "N m s/rad", 0, 1)}, states=["z"])
def creeping(omega, z, b):
    return -b * z, (omega - z) / 0.02
"""
Task = tuple[Model, Experiment]


def misfit(task: Task) -> float:
    """What a fit asks for again and again: root mean square of measured minus modelled [m/s²]."""
    model, experiment = task
    return float(np.sqrt(np.mean(predict(model, experiment).residual("accel") ** 2)))


def stopping(number: int) -> int:
    """Ends the worker that it runs in."""
    os._exit(number)


@pytest.fixture
def tasks(tmp_path: Path) -> Iterator[list[Task]]:
    """A recording against models with an effect of one's own, whose file is gone before the work begins."""
    file = tmp_path / "creeping.py"
    file.write_text(EFFECT)
    load_effect(f"{file}:creeping")
    file.unlink()
    model = build_model("play", ["creeping", "sensor_lag"])
    times = np.arange(501) / 1000
    trajectory = model.simulate(HandWaved(seed=2), times)
    recording = Recording(times, {"command": trajectory["command"], "accel": trajectory["accel"]}, {})
    (experiment,) = experiments(model, [recording])
    yield [(model.replace({"creeping.b": b}), experiment) for b in (1e-4, 2e-4, 4e-4, 8e-4)]
    unregister("creeping")


def test_threads_give_what_one_by_one_gives(tasks: list[Task]) -> None:
    """Bit by bit, in the order of the tasks, with the true value's error far below the others'."""
    alone = [misfit(task) for task in tasks]
    with open_executor() as executor:
        found = list(executor.map(misfit, tasks))
    assert found == alone
    assert alone[2] < 0.1 * min(alone[0], alone[1], alone[3])


@pytest.mark.slow
def test_processes_give_what_one_by_one_gives(tasks: list[Task]) -> None:
    """In processes that began with nothing: models, recordings and the effect's text are all sent."""
    with open_executor("processes:2") as executor:
        assert list(executor.map(misfit, tasks)) == pytest.approx([misfit(task) for task in tasks], rel=1e-12)


@pytest.mark.slow
def test_cluster_gives_what_one_by_one_gives(tasks: list[Task], monkeypatch: pytest.MonkeyPatch) -> None:
    """On a Dask worker, through the same calls; once they are gone, that is told instead of waiting for ever."""
    distributed = pytest.importorskip("distributed", reason="needs lostmotion[cluster]")
    given = {"processes": True, "threads_per_worker": 1, "dashboard_address": None, "host": "127.0.0.1"}
    with distributed.LocalCluster(n_workers=1, **given) as cluster:
        spec = f"dask={cluster.scheduler_address}"
        with open_executor(spec) as executor:
            found = list(executor.map(misfit, tasks))
        cluster.scale(0)
        monkeypatch.setattr("lostmotion.lab.parallel.WORKERS_S", 0.3)
        while cluster.scheduler_info["workers"]:
            time.sleep(0.05)
        with pytest.raises(ExecutorError, match="the scheduler has no workers"), open_executor(spec):
            pass
    assert found == pytest.approx([misfit(task) for task in tasks], rel=1e-12)


@pytest.mark.slow
def test_a_worker_that_dies_is_told() -> None:
    """One line instead of a wait for ever."""
    with (
        pytest.raises(ExecutorError, match=r"processes:1: .*; did a worker stop"),
        open_executor("processes:1") as pool,
    ):
        list(pool.map(stopping, [1]))


@pytest.mark.parametrize("spec", ["threads", "threads:0", "threads:x", "processes:-1", "mpi:4", "dask", "dask=", ""])
def test_unknown_executor_is_one_line(spec: str) -> None:
    """What is possible is said, whatever was asked; nothing at all means threads."""
    if not spec:
        with open_executor(spec) as executor:
            assert executor.submit(max, 1, 2).result() == 2
        return
    with pytest.raises(ExecutorError, match="expected threads:N, processes:N or dask=HOST:PORT"), open_executor(spec):
        pass


def test_scheduler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """A port where nothing answers, and a machine without the package."""
    pytest.importorskip("distributed", reason="needs lostmotion[cluster]")
    monkeypatch.setattr("lostmotion.lab.parallel.CONNECT_S", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(ExecutorError, match=f"dask=127.0.0.1:{port}: no scheduler answers"):
        open_executor(f"dask=127.0.0.1:{port}").__enter__()
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ExecutorError, match=r"needs the package distributed; pip install 'lostmotion\[cluster\]'"):
        open_executor(f"dask=127.0.0.1:{port}").__enter__()


def test_cores_are_those_of_this_process() -> None:
    """A process that is held to one core uses one."""
    assert 1 <= cores() <= (os.cpu_count() or 1)
    if hasattr(os, "sched_setaffinity"):
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(before)})
        try:
            assert cores() == 1
        finally:
            os.sched_setaffinity(0, before)
