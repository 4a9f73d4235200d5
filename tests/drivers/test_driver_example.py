"""The example package of a third party's driver: installed by pip, tested by its own tests, used by commands."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from lostmotion.drivers import conformance
from lostmotion.drivers.conformance import ConformanceError, Subject
from tests.conftest import ROOT

EXAMPLE = ROOT / "examples" / "lostmotion-driver-example"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the example, and what pip makes of it in ``installed``."""
    folder = tmp_path_factory.mktemp("example") / "copy"
    shutil.copytree(EXAMPLE, folder)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run([*pip, "--target", "installed", "."], cwd=folder, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    shutil.rmtree(folder / "lostmotion_driver_example")  # what runs is what was installed
    return folder


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python with the package installed, in the example's folder."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment(folder), capture_output=True, text=True, timeout=300)


def environment(folder: Path) -> dict[str, str]:
    """Where Python finds the package, and lostmotion."""
    return os.environ | {"PYTHONPATH": f"{folder / 'installed'}:{ROOT / 'src'}", "NO_COLOR": "1"}


def lostmotion(folder: Path, *arguments: str) -> str:
    """What a command prints."""
    done = python(folder, "-c", "from lostmotion.daemon.cli import main; main()", *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def sending(folder: Path) -> Iterator[str]:
    """The controller sends to two free ports; the configuration that names them."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        ports = []
        for free in (one, two):
            free.bind(("127.0.0.1", 0))
            ports.append(str(free.getsockname()[1]))
    text = (folder / "robot.toml").read_text()
    (folder / "here.toml").write_text(text.replace("5005", ports[0]).replace("5006", ports[1]))
    command = [sys.executable, "-m", "lostmotion_driver_example.gateway", *ports]
    controller = subprocess.Popen(command, cwd=folder, env=environment(folder))
    try:
        yield "here.toml"
    finally:
        controller.kill()
        controller.wait()


@pytest.mark.slow
def test_its_own_tests_pass(folder: Path) -> None:
    """Twelve checks of the conformance suite and one test of its own."""
    done = python(folder, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "tests")
    assert done.returncode == 0, done.stdout
    assert "13 passed" in done.stdout


@pytest.mark.slow
def test_the_service_runs_on_it(folder: Path, sending: str) -> None:
    """config check takes the file, run scores the emulated play, history has the scores."""
    assert (
        json.loads(lostmotion(folder, "config", "check", sending, "--json"))["joints"][0]["driver"] == "example_gateway"
    )
    lostmotion(folder, "run", "--config", sending, "--duration", "10")
    scores = json.loads(lostmotion(folder, "history", "elbow", "--config", sending, "--json"))["scores"]
    assert len(scores) >= 5
    assert sum(score["impact"] for score in scores) >= len(scores) / 2


@pytest.mark.slow
def test_a_driver_that_breaks_a_rule_is_told() -> None:
    """The simulated robot passes; the same with commands said to lie on a coarse grid do not."""
    subject = Subject("simulated", joints=[{}])
    conformance.check_resolution(subject)
    bus = subject.make()
    bus.resolution_rad = 0.5  # type: ignore[union-attr]

    class Coarse(Subject):
        def make(self):  # type: ignore[no-untyped-def]
            return bus

    with pytest.raises(ConformanceError, match=r"off the grid of 0\.5 rad"):
        conformance.check_resolution(Coarse("simulated", joints=[{}]))
