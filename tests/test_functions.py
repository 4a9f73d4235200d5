"""No function, and no file of the lab, is too long to be read at once."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "lostmotion"
FOLDERS = ("model", "detector", "drivers", "daemon", "lab", "web")
MOST, MOST_OF_A_FILE = 40, 350
ONE_PIECE = {"model/solve.py:_integrate"}
"""Cut in two, gears take 1.15 to 2.8 times as long (numba counts references to every array in each step)."""


@pytest.mark.parametrize("folder", FOLDERS)
def test_functions_are_short(folder: str) -> None:
    """Forty lines with their docstrings, but for one whose parts were measured to be slower."""
    long = set()
    for path in (PACKAGE / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > MOST:
                    long.add(f"{path.relative_to(PACKAGE).as_posix()}:{node.name}")
    assert long == {name for name in ONE_PIECE if name.startswith(f"{folder}/")}


def test_files_of_the_lab_are_short() -> None:
    """350 lines at most."""
    lines = {
        path.relative_to(PACKAGE).as_posix(): path.read_text().count("\n") for path in (PACKAGE / "lab").rglob("*.py")
    }
    assert [name for name, count in lines.items() if count > MOST_OF_A_FILE] == []
