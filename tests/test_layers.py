"""Imports point down only: lab → model, detector, what drivers read files with; daemon → drivers, detector.

web stands above all of them."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "src" / "lostmotion"
FOLDERS = ("model", "detector", "drivers", "daemon", "lab", "web")
ALLOWED = {
    "model": {"model"},
    "detector": {"detector"},
    "drivers": {"drivers"},
    "daemon": {"daemon", "drivers", "detector"},
    "lab": {"lab", "model", "detector", "drivers"},
    "web": {"web", "daemon", "detector", "drivers"},
}
OF_DRIVERS = {"errors", "pipes", "recording", "recordings", "terminal", "textfile", "toml_text"}
"""what the lab may import of them"""
LAB = (
    ("errors", "policy", "quantity", "deadline"), ("parallel", "data"), ("results",), ("words", "models"),
    ("shooting",), ("observer",), ("fitting",), ("design",), ("selection",), ("discrepancy",), ("inverse", "gears"),
    ("comparison",), ("explanation", "estimate"), ("report",), ("commands",), ("cli", "__init__"),
)  # fmt: skip
"""the rooms of the lab from the lowest up"""
HEAVY = ("scipy", "numba", "matplotlib", "rich", "plotext", "pandas", "llvmlite")


@cache
def imports(path: Path) -> list[tuple[str, bool]]:
    """Every module that the file imports, and whether it does so at its top level."""
    tree = ast.parse(path.read_text())
    top = {id(node) for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)} - {
        id(inner)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in ast.walk(function)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(alias.name, id(node) in top) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.append((node.module or "", id(node) in top))
            found += [(f"{node.module}.{alias.name}", id(node) in top) for alias in node.names]
    return found


def sources(folder: str) -> list[Path]:
    """All Python files of a folder of the package."""
    return sorted((PACKAGE / folder).rglob("*.py"))


@pytest.mark.parametrize("folder", FOLDERS)
def test_imports_point_down(folder: str) -> None:
    """No file imports a folder above its own; cli.py alone may reach the lab, the simulated robot the model."""
    for path in sources(folder):
        for module, at_top in imports(path):
            parts = module.split(".")
            if parts[0] != "lostmotion" or len(parts) < 2 or parts[1] not in FOLDERS:
                continue
            target = parts[1]
            late = (path.name == "cli.py" and folder == "daemon" and target in {"lab", "web"}) or (
                path.name in ("simulated.py", "simulated_parts.py") and target == "model"
            )
            assert target in ALLOWED[folder] or (late and not at_top), f"{path} imports {module}"
            if folder == "lab" and target == "drivers" and len(parts) > 2:
                assert parts[2] in OF_DRIVERS, f"{path} imports {module}"


def test_rooms_of_the_lab_point_down() -> None:
    """No file of the lab imports a room above its own, or another one on its floor."""
    floor = {room: number for number, rooms in enumerate(LAB) for room in rooms}
    for path in sources("lab"):
        own = path.relative_to(PACKAGE / "lab").parts[0].removesuffix(".py")
        for module, _ in imports(path):
            parts = module.split(".")
            if parts[:2] == ["lostmotion", "lab"] and len(parts) > 2 and parts[2] in floor:
                assert parts[2] == own or floor[parts[2]] < floor[own], f"{path} imports {module}"


@pytest.mark.parametrize("folder", ["daemon", "detector", "drivers", "web"])
def test_service_stays_light(folder: str) -> None:
    """What the running service imports loads no SciPy, numba, matplotlib or rich at its top level."""
    for path in sources(folder):
        for module, at_top in imports(path):
            assert not (at_top and module.split(".")[0] in HEAVY), f"{path} imports {module} at its top level"
