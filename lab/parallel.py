"""Executors for the lab's parallel work: threads, processes, or a Dask cluster.

Threads are the default: the integrator releases the GIL, so they scale, and nothing is copied.  Effects in plain Python
hold the GIL and need processes.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import contextmanager, suppress
from contextvars import copy_context
from importlib import import_module
from itertools import chain, count
from multiprocessing import get_context
from typing import Any, TypeVar

from lostmotion.lab.deadline import bounded, is_over, remaining_s
from lostmotion.lab.errors import ExecutorError

__all__ = ["Threads", "cores", "each", "fair_share", "open_executor"]

R = TypeVar("R")
T = TypeVar("T")
CONNECT_S = 5.0
"""How long a scheduler may take to answer [s]."""
WORKERS_S = 10.0
"""How long its first worker may take to come [s]."""
EXPECTED = "expected threads:N, processes:N or dask=HOST:PORT"


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def open_executor(spec: str | None = None) -> Iterator[Executor]:
    """An executor for the time of a block; work that is still waiting when the block ends is dropped.

    spec: None: a thread for each core; "threads:N"; "processes:N"; "dask=HOST:PORT": the workers of the Dask cluster
    whose scheduler listens there.  What is sent to processes and clusters must be picklable, functions importable.
    Raises ExecutorError.
    """
    kind, _, rest = (spec or f"threads:{cores()}").replace("dask=", "dask:", 1).partition(":")
    count = int(rest) if rest.isdecimal() else 0
    if not (rest if kind == "dask" else kind in ("threads", "processes") and count):
        raise ExecutorError(f"found the executor {spec!r}, {EXPECTED}")
    try:
        with _cluster(rest) if kind == "dask" else _pool(kind, count) as executor:
            yield executor
    except (BrokenExecutor, CancelledError) as error:
        raise ExecutorError(
            f"{spec}: {str(error) or 'the work was dropped'}; did a worker stop, or run out of memory?"
        ) from error


def each(pool: Executor | None, work: Callable[[T], R], items: Sequence[T], first: int = 0) -> list[tuple[T, R]]:
    """Each item with the result of ``work``, which need not be picklable; items are left out when the time is up,
    except the first so many."""

    def begun(number: int, item: T) -> list[tuple[T, R]]:
        return [] if is_over() and number >= first else [(item, work(item))]

    run = pool.map if isinstance(pool, ThreadPoolExecutor) else map
    return list(chain.from_iterable(run(begun, count(), items)))


def fair_share(pool: Executor | None, tasks: int) -> float:
    """The share of the time that each of so many tasks of ``each`` may take, where all shall have the same."""
    return min((pool.threads if isinstance(pool, Threads) else 1) / max(tasks, 1), 1.0)


class Threads(ThreadPoolExecutor):
    """A thread pool whose tasks inherit the deadline of the search."""

    def __init__(self, threads: int) -> None:
        super().__init__(threads)
        self.threads = threads

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Runs the function in the caller's context."""
        return super().submit(copy_context().run, fn, *args, **kwargs)


class _Processes(ProcessPoolExecutor):
    """A process pool whose tasks inherit the deadline of the search."""

    def submit(self, fn: Callable[..., R], /, *args: Any, **kwargs: Any) -> Future[R]:
        """Runs the function with the time that is left."""
        return super().submit(bounded, remaining_s(), fn, *args, **kwargs)


@contextmanager
def _pool(kind: str, count: int) -> Iterator[Executor]:
    """A pool of threads or processes; these are spawned, as a process with threads must not fork."""
    pool: Executor
    if kind == "threads":
        pool = Threads(count)
    else:
        pool = _Processes(count, mp_context=get_context("spawn"), initializer=_leave_ctrl_c)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _leave_ctrl_c() -> None:
    """Ignores Ctrl-C, which a terminal sends to all processes: the parent handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    with _client(address) as client:
        _check_workers(client, address)
        executor: Executor = client.get_executor(pure=False)  # pure would look at all arguments for equal calls
        try:
            yield executor
        except import_module("distributed").KilledWorker as error:
            raise BrokenExecutor(str(error)) from error
        finally:
            with suppress(OSError):  # the scheduler is gone
                executor.shutdown(wait=False)


def _client(address: str) -> Any:
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise ExecutorError("dask= needs the package distributed; pip install 'lostmotion[cluster]'") from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors come as exceptions; no tracebacks
    try:
        return distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # its TimeoutError is an OSError
        raise ExecutorError(
            f"dask={address}: no scheduler answers: {error}; does dask scheduler run there, and is the port right?"
        ) from error


def _check_workers(client: Any, address: str) -> None:
    """Raises ExecutorError unless there are workers that have lostmotion; else a task would wait for ever."""
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        client.run(cores)
    except TimeoutError as error:
        raise ExecutorError(
            f"dask={address}: the scheduler has no workers, expected at least one; start dask worker"
        ) from error
    except ImportError as error:
        raise ExecutorError(f"dask={address}: a worker cannot load lostmotion: {error}; install it there") from error
