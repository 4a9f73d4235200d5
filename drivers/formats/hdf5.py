"""HDF5: MAT files since version 7.3, and the recordings of robots, read by h5py in a process of its own
(hdf5_child.py)."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from lostmotion.drivers.formats.child import vectors_of
from lostmotion.drivers.formats.clocks import on_one_clock
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.vectors import table_of

__all__ = ["open_hdf5"]


def open_hdf5(path: Path) -> Table:
    """All datasets of the usual length, by their paths with dots; columns of matrices as ``qpos[0]``.  Raises
    RecordingError."""
    needed("h5py", path)
    vectors, notes = on_one_clock(vectors_of("hdf5_child.py", path, "HDF5"))
    table = table_of(str(path), "HDF5", vectors, "save each signal as an array of numbers")
    return replace(table, notes=[*table.notes, *notes])
