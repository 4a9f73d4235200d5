"""docs/lab.md: its files, commands and Python, as a reader would use them, and what it promises of the outcome."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from lostmotion.lab.models.modelfile import load
from tests.conftest import ROOT
from tests.lab.shown import check_page
from tests.test_readme import in_folder

PAGE = (ROOT / "docs" / "lab.md").read_text()

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def test_tutorial_finds_the_friction(tmp_path: Path) -> None:
    """Every command prints lines as shown; the friction of 0.15 N m is found, and the Python lines find it as well,
    here in the first thirds of the recordings.  All recordings are shorter."""
    assert "record --config arm.toml --duration 8 " in PAGE
    check_page(
        PAGE.replace("--duration 8 ", "--duration 4 ").replace("--duration 4 --rate", "--duration 3 --rate"), tmp_path
    )
    assert load(tmp_path / "better.toml").build().parameters["coulomb_friction.tau_c"].value == pytest.approx(
        0.15, rel=0.02
    )
    assert "<html" in (tmp_path / "rubbing.html").read_text()
    (script,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "notebook.py").write_text(script)
    for path in tmp_path.glob("rec*.csv"):
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(lines[: len(lines) // 3]))
    done = in_folder(f"{sys.executable} notebook.py", tmp_path)
    assert done.stdout.startswith("missing ('coulomb_friction',)"), done.stderr


def test_example_script_runs(tmp_path: Path) -> None:
    """examples/lab.py names the hidden friction and writes its report; here its recordings are half as long."""
    script = (ROOT / "examples" / "lab.py").read_text()
    assert "np.arange(0.0, 6.0, 0.01)" in script
    (tmp_path / "lab.py").write_text(script.replace("np.arange(0.0, 6.0, 0.01)", "np.arange(0.0, 3.0, 0.01)"))
    done = in_folder(f"{sys.executable} lab.py", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "coulomb_friction" in done.stdout
    assert (tmp_path / "lab.html").stat().st_size > 10_000
