"""MAT files of MATLAB and Octave, up to version 7, read by SciPy in a process of its own (matlab_child.py)."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.child import output_of
from lostmotion.drivers.formats.clocks import on_one_clock
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.vectors import check_size, table_of

__all__ = ["open_matlab"]


def open_matlab(path: Path) -> Table:
    """All vectors of the usual length, by name; columns of matrices as ``name[0]``.  Raises RecordingError."""
    check_size(str(path), path.stat().st_size)
    vectors, notes = on_one_clock(_vectors(path))
    table = table_of(
        str(path), "MAT", vectors,
        "save objects such as timeseries as arrays: t = ts.Time; y = ts.Data; save('x.mat', 't', 'y', '-v7')",
    )  # fmt: skip
    return replace(table, notes=[*table.notes, *notes])


def _vectors(path: Path) -> dict[str, NDArray[Any]]:
    """All vectors of numbers, by name.  Raises RecordingError."""
    needed("scipy.io", path)
    with path.open("rb") as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
        raise RecordingError(
            f"{path}: found a MAT file of version 7.3 (HDF5), expected 7 or older; in MATLAB: save('x.mat', '-v7')"
        )
    output = output_of("matlab_child.py", path, "a MAT file")
    with np.load(io.BytesIO(output), allow_pickle=False) as archive:
        return {str(name): archive[f"arr_{index}"] for index, name in enumerate(archive["names"])}
