"""Fixtures that every folder of tests may use."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
LAB = ROOT / "tests" / "lab"
# Devices, services and browsers that run beside a test in real time: a busy machine makes them late.
REAL_TIME = tuple(ROOT / "tests" / name for name in ("conformance", "daemon", "drivers", "system", "web"))

# As the program does: a worker whose BLAS has threads takes up to ten times the processor time beside other workers.
for library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    """Before several workers start, all that they would compile at the same time is compiled once."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        from tests.compiled import compile_models

        compile_models()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Each of several workers begins with its share of the lab's tests, whole files together: they take more than half
    of the processor time, some of them a minute each, and none of them is to be left alone at the end.

    Relies on ``--dist worksteal``, by which each worker gets a stretch of the list at first, and loses the end of it to
    others that have nothing left.

    A test of devices or services that run in real time is tried once more where it fails, and named in the summary
    as RERUN: a thread that emulates a device answers late while the machine is busy with other tests.
    """
    for item in items:
        if any(folder in item.path.parents for folder in REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=1))
    count = int(getattr(config, "workerinput", {}).get("workercount", 1))
    if count > 1:
        items[:] = dealt(items, count)


def dealt(items: Sequence[pytest.Item], count: int) -> list[pytest.Item]:
    """The same tests, those of the lab dealt out by files to the beginnings of ``count`` equal stretches."""
    files: dict[Path, list[pytest.Item]] = {}
    rest: list[pytest.Item] = []
    for item in items:
        (files.setdefault(item.path, []) if LAB in item.path.parents else rest).append(item)
    share, done, order = len(items) // count, 0, list[pytest.Item]()
    for i in range(count):
        first = [item for file in list(files.values())[i::count] for item in file]
        more = max(share - len(first), 0) if i < count - 1 else len(rest)
        order += first + rest[done : done + more]
        done += more
    return order


@pytest.fixture(autouse=True)
def only_the_catalogue() -> Iterator[None]:
    """An effect of one's own that a test has registered is gone after it."""
    before = _registered()
    yield
    if more := _registered() - before:
        from lostmotion.model.effects import unregister

        for name in more:
            unregister(name)


def _registered() -> set[str]:
    """The effects' names, where the model has been imported."""
    effects = sys.modules.get("lostmotion.model.effects")
    return {effect.id for effect in effects.catalogue()} if effects else set()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real measurements; tests that need it are skipped where it is missing."""
    folder = Path(os.environ.get("LOSTMOTION_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("real measurements are not here; set LOSTMOTION_DATA to their folder")
    return folder
