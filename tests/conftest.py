"""Fixtures that every folder of tests may use."""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import hypothesis
import pytest

ROOT = Path(__file__).parent.parent
# Devices, services and browsers that run beside a test in real time: a busy machine makes them late.
FILES = ("bench/test_faults.py", "test_light_installation.py", "test_package.py")
LATE = ("conformance", "daemon", "drivers", "system", "web", *FILES)
REAL_TIME = tuple(ROOT / "tests" / name for name in LATE)
RERUNS = 3
BROWSERS = [Path("/usr/bin") / name for name in ("chromium-headless-shell", "chromium")]
CHROMIUM = next(filter(Path.exists, BROWSERS), BROWSERS[-1])
"""The same engine without windows takes half of the processor time."""

# A busy machine takes a second for what it does in a millisecond at other times.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

# As the program does: a worker whose BLAS has threads takes up to ten times the processor time beside other workers.
for library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    """Before several workers start, all that they would compile at the same time is compiled once.

    Ctrl-C, which tests send to programs, is heard by them also where a shell has begun all this in the background.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        from tests.compiled import compile_models, compile_tests

        with compile_tests():
            compile_models()


def pytest_collection_finish() -> None:
    """What has been loaded stays: searches for garbage, 0.2 s each beside all tests, pass over it."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _no_handler_is_left() -> Iterator[None]:
    """A service that ran in this process wrote its log to a standard error that is closed after its test."""
    yield
    kept = [one for one in logging.root.handlers if not type(one).__module__.startswith("lostmotion.")]
    logging.root.handlers[:] = kept


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The tests in the order in which several workers are quickest.

    A test of devices or services that run in real time is tried again where it fails, and named in the summary as
    RERUN: the drivers of a service in another process wait for an emulated servo no longer than for a real one, which
    a machine that is busy with other tests makes late.
    """
    for item in items:
        if in_real_time(item.path):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS, reruns_delay=2))
    count = int(getattr(config, "workerinput", {}).get("workercount", 1))
    if count > 1:
        items[:] = dealt(items, count)


@cache
def in_real_time(path: Path) -> bool:
    """Whether a file's tests wait for devices, services or browsers, instead of computing."""
    return any(path.is_relative_to(folder) for folder in REAL_TIME)


def dealt(items: Sequence[pytest.Item], count: int) -> list[pytest.Item]:
    """The same tests in ``count`` stretches, each of which begins with slow tests, of files as whole as they are, those
    with the longest time limit first: a test of minutes that comes last has a core to itself.

    Those of the first third compute, those of the others wait, mostly: together they take two thirds of the time that
    they need one after the other (a simulation with the measured times: 535 s instead of 692 on two cores).  Relies on
    ``--dist worksteal``, by which each worker gets a stretch of the list at first, as long as that of the others, and
    loses the end of it to others that have nothing left.
    """
    slow: dict[Path, list[pytest.Item]] = {}
    quick: list[pytest.Item] = []
    for item in items:
        (slow.setdefault(item.path, []) if item.get_closest_marker("slow") else quick).append(item)
    slow = dict(sorted(slow.items(), key=lambda one: -max(map(limit, one[1]))))
    waits = {path: in_real_time(path) for path in slow}
    computing = max(count // 3, 1)
    stretches = deal([tests for path, tests in slow.items() if not waits[path]], computing)
    stretches += deal([tests for path, tests in slow.items() if waits[path]], count - computing)
    order: list[pytest.Item] = []
    for k, stretch in enumerate(stretches):
        more = max((len(items) - len(order)) // (count - k) - len(stretch), 0)
        order += stretch + quick[:more]
        del quick[:more]
    return order + quick


def limit(item: pytest.Item) -> float:
    """The time limit of a test [s], 0 for the usual one."""
    marker = item.get_closest_marker("timeout")
    return float(marker.args[0]) if marker else 0.0


def deal(files: Sequence[Sequence[pytest.Item]], count: int) -> list[list[pytest.Item]]:
    """The files' tests dealt round."""
    return [[item for file in files[k::count] for item in file] for k in range(count)]


@contextmanager
def only_the_catalogue() -> Iterator[None]:
    """An effect of one's own that is registered within the block is gone after it."""
    before = _registered()
    yield
    if more := _registered() - before:
        from lostmotion.model.effects import unregister

        for name in more:
            unregister(name)


@pytest.fixture(autouse=True, scope="module")
def _no_effect_of_a_module_is_left() -> Iterator[None]:
    """Not one of its fixtures' either, which are set up before the first test that asks for them."""
    with only_the_catalogue():
        yield


@pytest.fixture(autouse=True)
def _no_effect_of_a_test_is_left() -> Iterator[None]:
    with only_the_catalogue():
        yield


def _registered() -> set[str]:
    """The effects' names, where the model has been imported."""
    effects = sys.modules.get("lostmotion.model.effects")
    return {effect.id for effect in effects.catalogue()} if effects else set()


Measurements = Callable[..., Path]


@pytest.fixture(scope="session")
def real_data() -> Measurements:
    """The folder of real measurements, or one in it by its name; a test that needs a missing one is skipped."""

    def folder(name: str = "") -> Path:
        path = Path(os.environ.get("LOSTMOTION_DATA", ROOT.parent / "shared" / "data")) / name
        if not path.is_dir():
            pytest.skip(f"real measurements {name} are not here; set LOSTMOTION_DATA to their folder")
        return path

    return folder
