"""In which order several workers get the tests."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.conftest import ROOT, dealt, in_real_time


def made(folder: str, files: int, slow: int, quick: int) -> list[Any]:
    """So many tests in each of so many files."""
    return [
        SimpleNamespace(
            path=ROOT / "tests" / folder / f"test_{file}.py",
            name=f"{folder} {file} {k}",
            get_closest_marker={"slow": k < slow or None}.get,
        )
        for file in range(files)
        for k in range(slow + quick)
    ]


@pytest.mark.parametrize("count", [2, 3, 4, 6])
def test_slow_ones_are_dealt_to_the_beginnings(count: int) -> None:
    """Each test is there once; each worker's stretch begins with all its slow tests, those of a file together: the
    first third has those that compute, the others those that wait."""
    items = made("lab", 7, 3, 10) + made("daemon", 13, 2, 20)
    order = dealt(items, count)
    assert sorted(item.name for item in order) == sorted(item.name for item in items)
    left = order
    for k in range(count):
        share = len(left) // (count - k)  # as --dist worksteal does
        stretch, left = left[:share], left[share:]
        slow = [item for item in stretch if item.get_closest_marker("slow")]
        assert slow == stretch[: len(slow)]
        assert {in_real_time(item.path) for item in slow} == {k >= max(count // 3, 1)}
        files = [item.path for item in slow]
        assert all(
            files.count(path) == (2 if in_real_time(item.path) else 3) for item, path in zip(slow, files, strict=True)
        )
        assert sum(path != before for path, before in zip(files[1:], files, strict=False)) == len(set[Path](files)) - 1
    assert left == []
