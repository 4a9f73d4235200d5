"""The package as people get it: the wheel built from the sdist, installed into an environment of its own."""

from __future__ import annotations

import json
import sys
import tarfile
import venv
from pathlib import Path

import pytest

from tests.wheel import build_wheel, run

pytestmark = pytest.mark.slow


def installed(folder: Path) -> Path:
    """An environment that has the wheel installed, with this environment's dependencies in reach."""
    wheel = build_wheel(folder)
    venv.create(folder / "env")
    pip = (sys.executable, "-m", "pip", "--python", str(folder / "env/bin/python"))
    run(*pip, "install", "--no-compile", "--no-deps", "--no-index", wheel, cwd=folder)
    (packages,) = (folder / "env/lib").glob("python*/site-packages")
    here = [path for path in sys.path if path.endswith("site-packages")]
    (packages / "dependencies.pth").write_text("\n".join(here) + "\n")
    return folder / "env"


def test_wheel_is_whole_and_runs_the_simulated_robot(tmp_path: Path) -> None:
    """The installed command scores the simulated robot with no source tree in reach; types and licence came along."""
    environment = installed(tmp_path)
    where = run(
        environment / "bin/python", "-c", "import lostmotion.daemon as d; print(d.__path__[0])", cwd=tmp_path
    ).strip()
    assert where.startswith(str(environment))
    lostmotion = environment / "bin/lostmotion"
    # Not optimised, the machine code takes half of the time to make: 12 s of the processor's instead of 21.
    run(lostmotion, "run", "--duration", "6", cwd=tmp_path, HOME=str(tmp_path), NUMBA_OPT="0")
    history = json.loads(run(lostmotion, "history", "elbow", "--json", cwd=tmp_path, HOME=str(tmp_path)))
    assert history["joint"] == "elbow"
    assert len(history["scores"]) >= 3
    (package,) = environment.glob("lib/python*/site-packages/lostmotion")
    assert (package / "py.typed").is_file()
    assert (package / "daemon/simulated.toml").is_file()
    assert (package / "systemd/lostmotion.service").is_file()
    assert (package / "docs/installing.md").is_file()
    assert list(package.parent.glob("lostmotion-*.dist-info/licenses/LICENSE"))
    (licences,) = package.parent.glob("lostmotion-*.dist-info/licenses")
    assert (licences / "lab/report/assets/uPlot.LICENSE.txt").is_file()
    assert "License-Expression: Apache-2.0 AND MIT\n" in (licences.parent / "METADATA").read_text()
    with tarfile.open(next(tmp_path.glob("*.tar.gz"))) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    wanted = ("docs/installing.md", "docs/figures/fig1.png", "tests/test_package.py", "tests/daemon/conftest.py",
              "examples/arm.toml", "bench/__main__.py", "Makefile", "SECURITY.md")  # fmt: skip
    assert not set(wanted) - names
