"""Reads an HDF5 file in a process of its own, as HDF5's library may crash on a damaged one: MATLAB's since version 7.3,
and the datasets of robots' recordings.

Run as a program with the file's path; see matlab_child.py for what it writes.
"""

from __future__ import annotations

import resource
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.formats.matlab_child import DEEPEST, MOST_MEMORY, STEP, columns_of, write
from lostmotion.drivers.formats.source import MOST_VALUES

TEXTS = (b"char", b"cell", b"string", b"function_handle")
"""MATLAB's classes that are stored as numbers, but are none"""


def main(path: str) -> int:
    """The exit status."""
    import h5py

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    try:
        with h5py.File(path, "r") as file:
            held = list(_signals(file, "", 0))
            if (count := sum(one.size for _, one in held)) > MOST_VALUES:
                raise ValueError(f"found {count} numbers, expected at most {MOST_VALUES}")
            found = {name: vector for inner, one in held for name, vector in _columns(one, inner)}
    except Exception as error:  # noqa: BLE001 - h5py raises almost anything on a damaged file
        sys.stderr.write(f"{type(error).__name__}: {error}")
        return 1
    write(found)
    return 0


def _signals(group: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    """Every dataset of numbers, or of records, by its path with dots, but for images and the like; and attributes that
    are the rate of the rows.  Links are not followed."""
    import h5py

    if depth > DEEPEST:
        return
    yield from ((key, np.asarray(value)) for key, value in group.attrs.items() if STEP.fullmatch(key))
    for key in group:
        inner = f"{name}.{key}" if name else str(key)
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        held = group[key]
        if isinstance(held, h5py.Group):
            yield from _signals(held, inner, depth + 1)
        elif isinstance(held, h5py.Dataset) and held.shape is not None:
            is_text = held.attrs.get("MATLAB_class") in TEXTS
            if not is_text and held.dtype.kind in "iufV" and sum(length > 1 for length in held.shape) <= 2:
                yield inner, held


def _columns(held: Any, name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """The numbers of a dataset with more than one row, those of each field of records, and the columns of a matrix; a
    single number that is the rate of the rows."""
    for field in held.dtype.names or ("",):
        value = np.squeeze(held[field] if field else held[()])
        inner = f"{name}.{field}" if field else name
        if value.dtype.kind in "iuf" and value.size > 1:
            yield from columns_of(value, inner)
        elif value.dtype.kind in "iuf" and value.size == 1 and STEP.fullmatch(inner):
            yield inner, value.reshape(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
