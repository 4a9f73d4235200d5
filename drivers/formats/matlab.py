"""MAT files of MATLAB and Octave: up to version 7 read by SciPy in a process of its own (matlab_child.py), later ones
as HDF5."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lostmotion.drivers.formats.child import vectors_of
from lostmotion.drivers.formats.clocks import on_one_clock
from lostmotion.drivers.formats.hdf5 import open_hdf5
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.vectors import check_size, table_of

__all__ = ["open_matlab"]


def open_matlab(path: Path) -> Table:
    """All vectors of the usual length, by name; columns of matrices as ``name[0]``.  Raises RecordingError."""
    with path.open("rb") as file:
        if b"MATLAB 7.3" in file.read(128):
            return open_hdf5(path)
    check_size(str(path), path.stat().st_size)
    needed("scipy.io", path)
    vectors, notes = on_one_clock(vectors_of("matlab_child.py", path, "a MAT file"))
    table = table_of(
        str(path), "MAT", vectors,
        "save objects such as timeseries as arrays: t = ts.Time; y = ts.Data; save('x.mat', 't', 'y', '-v7')",
    )  # fmt: skip
    return replace(table, notes=[*table.notes, *notes])
