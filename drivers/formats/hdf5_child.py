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

TEXTS = (b"char", b"cell", b"string", b"function_handle")
"""MATLAB's classes that are stored as numbers, but are none"""
MOST_VALUES = 50_000_000
"""of all datasets; images have three dimensions and more, and are none of them"""


def main(path: str) -> int:
    """The exit status."""
    import h5py

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    try:
        with h5py.File(path, "r") as file:
            found = dict(_vectors(file, "", 0, [0]))
    except Exception as error:  # noqa: BLE001 - h5py raises almost anything on a damaged file
        sys.stderr.write(f"{type(error).__name__}: {error}")
        return 1
    write(found)
    return 0


def _vectors(group: Any, name: str, depth: int, count: list[int]) -> Iterator[tuple[str, NDArray[Any]]]:
    """Every dataset of numbers with more than one row, by its path with dots; the fields of records, and the columns of
    a matrix; and the rate of the rows, which may be an attribute.  Links are not followed.  count: of the numbers so
    far."""
    import h5py

    if depth > DEEPEST:
        return
    for key, value in group.attrs.items():
        if STEP.fullmatch(key) and np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf":
            yield key, np.reshape(value, 1)
    for key in group:
        inner = f"{name}.{key}" if name else str(key)
        if key.startswith("#") or not isinstance(group.get(key, getlink=True), h5py.HardLink):
            continue
        held = group[key]
        if isinstance(held, h5py.Group):
            yield from _vectors(held, inner, depth + 1, count)
        elif isinstance(held, h5py.Dataset) and held.attrs.get("MATLAB_class") not in TEXTS:
            yield from _columns(held, inner, count)


def _columns(held: Any, name: str, count: list[int]) -> Iterator[tuple[str, NDArray[Any]]]:
    fields = held.dtype.names
    kinds = {field: held.dtype[field].kind for field in fields} if fields else {"": held.dtype.kind}
    if held.shape is None or sum(length > 1 for length in held.shape) > 2 or not {*"iuf"} & {*kinds.values()}:
        return
    count[0] += held.size
    if count[0] > MOST_VALUES:
        raise ValueError(f"found more than {MOST_VALUES} numbers, expected fewer")
    for field, kind in kinds.items():
        if kind in "iuf":
            value = np.squeeze(held[field] if field else held[()])
            inner = f"{name}.{field}" if field else name
            if value.size > 1:
                yield from columns_of(value, inner)
            elif value.size == 1 and STEP.fullmatch(inner):
                yield inner, value.reshape(1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
