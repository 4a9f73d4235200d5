"""Machines for the tests: one with lostmotion's wheel installed as a layer for all, and ways to begin from there."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.system import image
from tests.system.machine import Machine
from tests.wheel import build_wheel

Boot = Callable[[], Machine]


@pytest.fixture(scope="session")
def layers(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    """The image, and above it what installing the wheel adds, without a network."""
    if reason := image.missing():
        pytest.skip(reason)
    return with_wheel(image.image(), tmp_path_factory.mktemp("wheel"))


def with_wheel(base: Path, folder: Path) -> tuple[Path, ...]:
    """An image, and above it what installing the wheel adds."""
    wheel = build_wheel(folder)
    machine = Machine(folder / "wheel", base)
    machine.boot()
    target = f"/opt/{wheel.name}"
    machine.copy(wheel, target)
    machine.run(f"{image.VENV}/bin/pip", "install", "--no-index", "--quiet", target)
    machine.run(f"{image.VENV}/bin/python", "-c", "import lostmotion.daemon.service")  # compiled once for all machines
    machine.power_off()
    return base, machine.disk


@pytest.fixture(scope="module")
def boot(layers: tuple[Path, ...], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Boot]:
    """Starts a machine that has the command lostmotion, and no service yet."""
    numbers, started = itertools.count(), list[Machine]()

    def begin() -> Machine:
        started.append(Machine(tmp_path_factory.mktemp("machine") / str(next(numbers)), *layers))
        started[-1].boot()
        return started[-1]

    yield begin
    for machine in started:
        machine.destroy()
