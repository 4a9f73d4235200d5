"""The demo's script, with a command that does nothing in place of lostmotion: its folder goes, or stays where asked."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from tests.conftest import ROOT


def demo(folder: Path, **settings: str) -> subprocess.CompletedProcess[str]:
    """A run of the script; what it leaves of temporary folders is in ``folder``/tmp."""
    (folder / "bin").mkdir(exist_ok=True)
    (folder / "tmp").mkdir(exist_ok=True)
    (folder / "bin" / "lostmotion").write_text("#!/bin/sh\n")
    (folder / "bin" / "lostmotion").chmod(0o755)
    given = os.environ | {"BIN": str(folder / "bin"), "TMPDIR": str(folder / "tmp")} | settings
    return subprocess.run(["sh", ROOT / "examples" / "demo.sh"], env=given, capture_output=True, text=True, check=False)


def test_the_demo_takes_its_files_away(tmp_path: Path) -> None:
    """Nothing is left in the temporary folder, and the last line tells how to keep the files."""
    done = demo(tmp_path)
    assert done.returncode == 0
    assert not list((tmp_path / "tmp").iterdir())
    assert "DEMO_DIR=/tmp/demo make demo keeps them" in done.stdout


def test_the_demo_keeps_its_files_where_asked(tmp_path: Path) -> None:
    """The configuration stays in the folder that was named; one that exists is not written into."""
    kept = tmp_path / "kept"
    done = demo(tmp_path, DEMO_DIR=str(kept))
    assert (done.returncode, [path.name for path in kept.iterdir()]) == (0, ["robot.toml"])
    assert str(kept) in done.stdout
    again = demo(tmp_path, DEMO_DIR=str(kept))
    assert (again.returncode, again.stderr.count("\n")) == (2, 1)
    assert f"found {kept}" in again.stderr
    nowhere = demo(tmp_path, DEMO_DIR=str(tmp_path / "none" / "kept"))
    assert (nowhere.returncode, nowhere.stderr.count("\n")) == (2, 1)
    assert "one that exists" in nowhere.stderr
