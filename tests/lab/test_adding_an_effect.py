"""docs/adding-an-effect.md: its files and commands, as a reader would use them, and what it promises of the outcome."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from lostmotion.lab.models.modelfile import load
from lostmotion.lab.models.own import load_effect
from lostmotion.lab.models.own.readable import ENTRIES, READABLE
from lostmotion.model.effects import unregister
from tests.conftest import ROOT
from tests.lab.shown import check_page, shown_files

PAGE = (ROOT / "docs" / "adding-an-effect.md").read_text()


def test_effect_of_the_page_is_the_example() -> None:
    """The page and examples/ show the same file."""
    assert shown_files(PAGE)["tight_spot.py"] == (ROOT / "examples" / "tight_spot_effect.py").read_text()


def test_page_names_all_that_can_be_read() -> None:
    """Its tables hold every signal and every place where an effect may act."""
    for name in (*READABLE, *(f'"{entry}"' for entry in ENTRIES)):
        assert f"`{name}`" in PAGE


@pytest.mark.slow
def test_own_states_and_notebook(tmp_path: Path) -> None:
    """The page's friction that winds up, in a file, compiles; the notebook's lines run after it."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "own.py").write_text("from lostmotion.lab import Parameter, effect\n" + "\n".join(blocks[1:]))
    try:
        effect = load_effect("own.py:winding", tmp_path)
        assert effect.note is None
        assert effect.declared.function.__globals__["trajectory"].states.shape == (500, 3)
    finally:
        unregister("winding")


@pytest.mark.slow
def test_commands_of_the_page_find_the_spot(tmp_path: Path) -> None:
    """Every command succeeds and prints what is shown; the fit finds the spot's three numbers."""
    check_page(PAGE, tmp_path)
    try:
        found = load(tmp_path / "found.toml").build().parameters
    finally:
        unregister("tight_spot")
    assert found["tight_spot.tau_t"].value == pytest.approx(0.6, rel=0.02)
    assert found["tight_spot.where"].value == pytest.approx(0.1, abs=0.002)
    assert found["tight_spot.width"].value == pytest.approx(0.06, rel=0.05)
