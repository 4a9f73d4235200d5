"""The wheel as people get it: built from the source distribution, in a copy of the tree."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from tests.conftest import ROOT

__all__ = ["build_wheel", "run"]

NOT_SOURCE = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info", "build", "dist")


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Standard output of a command that must succeed, with nothing of this environment but the given variables."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def build_wheel(folder: Path) -> Path:
    """The wheel, in that folder.

    It is built from a copy: setuptools writes beside the source, where other tests and other runs are at work.
    """
    shutil.copytree(ROOT, folder / "tree", symlinks=True, ignore=NOT_SOURCE)
    build = ("-m", "build", "--no-isolation", "--outdir", folder)
    run(sys.executable, *build, "--sdist", folder / "tree", cwd=folder)
    (sdist,) = folder.glob("*.tar.gz")
    run("tar", "xzf", sdist, cwd=folder)
    source = folder / sdist.name.removesuffix(".tar.gz")
    run(sys.executable, *build, "--wheel", source, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    return wheel
