"""Fixtures that every folder of tests may use."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# As the program does: a worker whose BLAS has threads takes up to ten times the processor time beside other workers.
for library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")


def pytest_configure(config: pytest.Config) -> None:
    """Before several workers start, all that they would compile at the same time is compiled once."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        from tests.compiled import compile_models

        compile_models()


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
