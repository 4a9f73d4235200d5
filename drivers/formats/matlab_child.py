"""Reads a MAT file in a process of its own: SciPy's reader may crash on a damaged one, or ask for all memory.

Run as a program with the file's path; it writes an NPZ archive to stdout: ``names``, and a vector for each, ``arr_0``
and so on.  What is wrong is a line on stderr and exit status 1.  Imports nothing of lostmotion, to start quickly,
unless there are objects.
"""

from __future__ import annotations

import io
import re
import resource
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEEPEST", "MOST_MEMORY", "STEP", "columns_of", "write"]

MOST_MEMORY = 4_000_000_000
DEEPEST = 16
WIDEST = 64
"""columns of a matrix that are signals side by side"""
STEP = re.compile(
    r"(?:.*\.)?(?:(?P<step>dt|t_?s|h|t_?sample|t_?interval|sampl(?:e|ing)_?(?:time|period|interval))"
    r"|f_?s|fps|(?:sampl(?:e|ing)|actual|scan)_?(?:rate|frequency|freq)|(?:action|command|control|sampl(?:e|ing))_?(?:rate_?)?hz)",
    re.IGNORECASE,
)  # fmt: skip
"""the name of a number that is the time of a row, or the rows a second"""


def main(path: str) -> int:
    """The exit status."""
    import scipy.io

    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    try:
        held = scipy.io.loadmat(path, simplify_cells=True, appendmat=False)
        found = dict(_vectors(held, "", 0)) | dict(_of_objects(path, held.get("__function_workspace__")))
    except Exception as error:  # noqa: BLE001 - SciPy raises almost anything on a damaged file
        sys.stderr.write(f"{type(error).__name__}: {error}")
        return 1
    write(found)
    return 0


def write(found: Mapping[str, NDArray[Any]]) -> None:
    """Writes vectors by name to stdout."""
    archive = io.BytesIO()
    np.savez(archive, *found.values(), names=np.array(list(found), dtype=str))
    sys.stdout.buffer.write(archive.getbuffer())


def _vectors(value: Any, name: str, depth: int) -> Iterator[tuple[str, NDArray[Any]]]:
    """Everything of numbers with more than one row, by name; the signals of a Simulink scope by their labels."""
    if depth > DEEPEST:
        return
    if isinstance(value, list):
        for index, inner in enumerate(value[:WIDEST]):
            label = inner.get("label") if isinstance(inner, Mapping) else None
            if isinstance(label, str) and label and "values" in inner:
                yield from _vectors(inner["values"], f"{name}.{label}", depth + 1)
            else:
                yield from _vectors(inner, f"{name}[{index}]", depth + 1)
        return
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1)
        return
    if isinstance(value, int | float | np.number) and STEP.fullmatch(name):
        yield name, np.array([value])
    if not isinstance(value, np.ndarray):
        return
    if value.dtype == object:
        for index, inner in enumerate(value.ravel()[:WIDEST]):
            yield from _vectors(inner, f"{name}[{index}]", depth + 1)
    elif value.dtype.kind in "iuf" and value.size > 1:
        yield from columns_of(np.squeeze(value), name)


def _of_objects(path: str, hidden: NDArray[Any] | None) -> Iterator[tuple[str, NDArray[Any]]]:
    """The times and values of timeseries, and what a run of Simulink gave, by the names of their variables; none where
    they cannot be read."""
    if hidden is None:
        return
    from scipy.io import loadmat
    from scipy.io.matlab import varmats_from_mat

    from lostmotion.drivers.formats.matlab_objects import object_of, outputs, timeseries

    with Path(path).open("rb") as file:  # SciPy calls all objects by one name, and keeps the last one only
        each = [loadmat(cast(Any, one)).get("None") for _, one in varmats_from_mat(file)]
    opaque = [one.flat[0] for one in each if one is not None and one.size]
    names = {object_of(one["arr"]): one["s0"].decode() for one in opaque}
    with suppress(Exception):
        for name, times, values in timeseries(hidden, names):
            yield f"{name}.time", times
            yield from columns_of(values, f"{name}.signals.values")
        for name, value in outputs(hidden, names):
            yield from _vectors(value, name, 0)


def columns_of(value: NDArray[Any], name: str) -> Iterator[tuple[str, NDArray[Any]]]:
    """A vector, or the columns of a matrix, its shorter side, by name."""
    if value.ndim == 1:
        yield name, value
    elif value.ndim == 2:
        tall = value if value.shape[0] >= value.shape[1] else value.T
        if tall.shape[1] <= WIDEST:
            yield from ((f"{name}[{index}]", tall[:, index]) for index in range(tall.shape[1]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
