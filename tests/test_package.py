"""The package as people get it: the wheel built from the sdist, installed into an environment of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from tests.conftest import ROOT

# One worker builds: two at once would write the same egg-info.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("package")]


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Standard output of a command that must succeed, with nothing of this environment but the given variables."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an environment that has the wheel installed, with this environment's dependencies in reach."""
    folder = tmp_path_factory.mktemp("package")
    build = ("-m", "build", "--no-isolation", "--outdir", folder)
    run(sys.executable, *build, "--sdist", ROOT, cwd=folder)
    (sdist,) = folder.glob("*.tar.gz")
    run("tar", "xzf", sdist, cwd=folder)
    source = folder / sdist.name.removesuffix(".tar.gz")
    run(sys.executable, *build, "--wheel", source, cwd=folder)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env", with_pip=True)
    run(folder / "env/bin/pip", "install", "--no-deps", "--no-index", wheel, cwd=folder)
    (packages,) = (folder / "env/lib").glob("python*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "env"


def test_wheel_runs_the_simulated_robot(installed: Path, tmp_path: Path) -> None:
    """The installed command scores the simulated robot and tells its history, with no source tree in reach."""
    where = run(
        installed / "bin/python", "-c", "import lostmotion.daemon as d; print(d.__path__[0])", cwd=tmp_path
    ).strip()
    assert where.startswith(str(installed))
    lostmotion = installed / "bin/lostmotion"
    run(lostmotion, "run", "--duration", "6", cwd=tmp_path, HOME=str(tmp_path))
    history = json.loads(run(lostmotion, "history", "elbow", "--json", cwd=tmp_path, HOME=str(tmp_path)))
    assert history["joint"] == "elbow"
    assert len(history["scores"]) >= 3


def test_wheel_carries_types_and_defaults(installed: Path) -> None:
    """py.typed, the default configuration and the licence are in the installed package."""
    (package,) = installed.glob("lib/python*/site-packages/lostmotion")
    assert (package / "py.typed").is_file()
    assert (package / "daemon/simulated.toml").is_file()
    assert list(package.parent.glob("lostmotion-*.dist-info/licenses/LICENSE"))
