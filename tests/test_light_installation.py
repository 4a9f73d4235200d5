"""The service as it is installed on a robot with little room: without the model, the lab and pictures."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import time
import tomllib
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest

from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine
from tests.conftest import ROOT
from tests.daemon.test_service import hardware

LEFT_OUT = ("numba", "llvmlite", "scipy", "matplotlib", "mpl_toolkits", "PIL", "fontTools", "kiwisolver", "contourpy",
            "python_calamine")  # fmt: skip
MOST_RESIDENT = 65e6
"""of the service alone [byte]: 48 MB at its first scores, 59 after 15 s, 62 after two minutes, when it has learnt; a
busy machine is asked later than an idle one"""


def listed() -> set[str]:
    """The lines of requirements-robot.txt."""
    lines = (ROOT / "requirements-robot.txt").read_text().splitlines()
    return {line for line in lines if line and not line.startswith("#")}


@pytest.fixture(scope="module")
def light(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment variable by which Python finds all packages of this installation but those that are left out."""
    folder = tmp_path_factory.mktemp("packages")
    for entry in _site_packages():
        name = entry.name.partition(".")[0].partition("-")[0]
        if name not in LEFT_OUT and entry.suffix != ".pth" and not (folder / entry.name).exists():
            (folder / entry.name).symlink_to(entry)
    return os.environ | {"PYTHONPATH": f"{folder}:{ROOT / 'src'}", "LOSTMOTION_DEBUG": ""}


def _site_packages() -> list[Path]:
    folders = {Path(path) for path in [sysconfig.get_path("purelib"), *sys.path] if path.endswith("site-packages")}
    return [entry for folder in sorted(folders) for entry in folder.iterdir()]


def command(*arguments: str | Path) -> list[str]:
    """The program in a Python that sees no other packages than PYTHONPATH's (-S: no site-packages of its own)."""
    return [sys.executable, "-S", "-c", "from lostmotion.daemon.cli import main; main()", *map(str, arguments)]


def test_the_list_is_part_of_the_dependencies() -> None:
    """Same packages, same versions as in pyproject.toml; the rest is the model's, lab's, pictures', workbooks'."""
    declared = {
        line.strip() for line in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    }
    assert listed() <= declared
    assert {re.split("[>=]", line)[0] for line in declared - listed()} == {
        "numba",
        "scipy",
        "matplotlib",
        "python-calamine",
    }


@pytest.mark.slow
def test_the_list_needs_nothing_that_is_left_out() -> None:
    """No listed package pulls in a heavy one by its own dependencies."""
    left_out = {name.lower() for package in LEFT_OUT for name in packages_distributions().get(package, [package])}
    waiting, seen = [re.split("[>=]", line)[0] for line in listed()], set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        with suppress(PackageNotFoundError):  # not on this Python or system
            needed = [line for line in requires(name) or [] if "extra ==" not in line]
            waiting += [re.split(r"[ <>=!~;\[(]", line)[0].lower() for line in needed]
    assert not seen & left_out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["run"], "driver: the simulated robot needs the package numba, which is not installed here: "),
        (["lab", "compare", "play", "x.csv"], "this command needs the package "),
        (["simulate", "play", "-o", "x.csv"], "this command needs the package "),
        (["effects"], "this command needs the package "),
        (["import", "x.xls"], "x.xls: reading it needs the package python_calamine, which is not installed here: "),
    ],
)
def test_what_is_missing_is_told_with_the_line_that_installs_it(
    light: dict[str, str], tmp_path: Path, arguments: list[str], expected: str
) -> None:
    """One line, status 2; the pip is that of this Python."""
    (tmp_path / "x.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    done = subprocess.run(command(*arguments), cwd=tmp_path, env=light, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert expected in done.stderr
    packages = "python-calamine" if "import" in arguments else "numba scipy"
    assert done.stderr.endswith(f"{sys.executable} -m pip install {packages}\n")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("status",), "no database there"),
        (("alarms",), "no database there"),
        (("fleet", "status", "--connect", "tcp/127.0.0.1:1"), "nobody answers there"),
    ],
)
def test_who_only_reads_needs_no_simulated_robot(
    arguments: tuple[str, ...], expected: str, light: dict[str, str], tmp_path: Path
) -> None:
    """Without a configuration the database of the built-in one is read, or none, as its robot is not to run."""
    environment = light | {"HOME": str(tmp_path), "XDG_STATE_HOME": ""}
    done = subprocess.run(
        command(*arguments), cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert expected in done.stderr


def test_a_sink_without_its_package_is_refused(light: dict[str, str], tmp_path: Path) -> None:
    """[alarm.zenoh] on a computer without Zenoh: config check says what to install."""
    packages = tmp_path / "packages"
    packages.mkdir()
    for entry in Path(light["PYTHONPATH"].partition(":")[0]).iterdir():
        if "zenoh" not in entry.name:
            (packages / entry.name).symlink_to(entry.resolve())
    environment = light | {"PYTHONPATH": f"{packages}:{ROOT / 'src'}"}
    arguments = command("config", "check", ROOT / "examples/arm.toml")
    done = subprocess.run(arguments, env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "alarm.zenoh: [alarm.zenoh] needs the package zenoh, which is not installed here: " in done.stderr
    assert done.stderr.endswith("-m pip install eclipse-zenoh\n")


@pytest.mark.slow
def test_the_service_scores_hardware_and_stays_small(light: dict[str, str], tmp_path: Path) -> None:
    """An emulated servo and accelerometer are scored without the packages that are left out, within 65 MB; without
    masked arrays (3 MB) and the metadata of packages (1 MB), too."""
    motion = Motion(play=1.0)
    with Emulator(ServoLine.of("AX-12A", [1, 2], motion), CsvStream(motion)) as emulator:
        config = hardware(tmp_path, *emulator.paths)
        log = tmp_path / "log"
        with log.open("w") as sink:
            python, *arguments = command("run", "--config", config)
            process = subprocess.Popen([python, "-X", "importtime", *arguments], env=light, stderr=sink)
        try:
            end, scores = time.monotonic() + 120, []
            while len(scores) < 5 and time.monotonic() < end and process.poll() is None:
                time.sleep(0.5)
                asked = command("history", "elbow", "--config", config, "--json")
                told = subprocess.run(asked, env=light, capture_output=True, text=True, timeout=60)
                scores = json.loads(told.stdout)["scores"] if told.returncode == 0 else []
            pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
        finally:
            process.terminate()
            assert process.wait(60) == 0, log.read_text()
    assert len(scores) >= 5, log.read_text()
    assert not re.search(r"\| +(numpy\.ma|importlib\.metadata)$", log.read_text(), re.MULTILINE)
    print(f"{pages * os.sysconf('SC_PAGESIZE') / 1e6:.1f} MB resident")
    assert pages * os.sysconf("SC_PAGESIZE") < MOST_RESIDENT
