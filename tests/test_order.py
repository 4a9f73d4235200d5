"""In which order several workers get the tests."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.conftest import LAB, ROOT, dealt


@pytest.mark.parametrize("count", [2, 3, 4])
def test_the_lab_is_dealt_to_the_beginnings(count: int) -> None:
    """Each test is there once; each worker's stretch begins with whole files of the lab."""
    paths = [LAB / f"test_{k}.py" for k in range(7) for _ in range(3)]
    paths += [ROOT / "tests" / "daemon" / f"test_{k}.py" for k in range(30) for _ in range(10)]
    items: list[Any] = [SimpleNamespace(path=path, name=str(number)) for number, path in enumerate(paths)]
    order = dealt(items, count)
    assert sorted(item.name for item in order) == sorted(item.name for item in items)
    share = len(items) // count
    stretches = [order[share * i : share * (i + 1) if i < count - 1 else None] for i in range(count)]
    assert all(stretch[0].path.parent == LAB for stretch in stretches)
    for stretch in stretches:
        often = Counter[Path](item.path for item in stretch if item.path.parent == LAB)
        assert set(often.values()) == {3}
