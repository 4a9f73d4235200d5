"""Every command that the README shows is run, in the order in which it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

README = ROOT / "README.md"


def commands(text: str) -> list[str]:
    """The lines after ``$ `` in the console blocks, continued ones joined."""
    blocks = re.findall(r"```console\n(.*?)```", text, flags=re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    return [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]


def in_folder(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command as a newcomer's shell would run it, with a home of its own."""
    environment = {
        "HOME": str(folder),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": "",
        "NO_COLOR": "1",
        "OPENBLAS_NUM_THREADS": "1",  # as the page says: a script takes several times the processor time without it
    }
    return subprocess.run(command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=500)


@pytest.mark.slow
def test_every_command_of_the_readme_runs(tmp_path: Path) -> None:
    """Each command of the README succeeds; the make targets exist (they would run this test again)."""
    shown = commands(README.read_text())
    assert len(shown) >= 8
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for command in shown:
        if command.startswith("make "):
            done = subprocess.run(["make", "-n", *command.split()[1:]], cwd=ROOT, capture_output=True, text=True)
        else:
            done = in_folder(command, tmp_path)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


@pytest.mark.slow
def test_library_example_of_the_readme_runs(tmp_path: Path) -> None:
    """The Python blocks of the README run one after another and print what they promise to print."""
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)
    assert blocks
    script = tmp_path / "readme.py"
    script.write_text("\n".join(blocks))
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()
