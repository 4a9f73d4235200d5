"""MAT files of MATLAB and Octave, up to version 7, read by SciPy in a process of its own (matlab_child.py)."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.formats.source import MOST_SERIES, MOST_VALUES, Series, check_count, shown, too_many
from lostmotion.drivers.formats.table import Table

__all__ = ["open_matlab"]

MOST_BYTES = 8 * MOST_VALUES
LONGEST_S = 120.0
"""for a file of MOST_BYTES, compressed, some 10"""


def open_matlab(path: Path) -> Table:
    """All vectors of the usual length, by name; columns of matrices as ``name[0]``.  Raises RecordingError."""
    if path.stat().st_size > MOST_BYTES:
        raise RecordingError(
            f"{path}: found {path.stat().st_size / 1e6:.0f} MB, expected at most {MOST_BYTES / 1e6:.0f}; "
            "save fewer signals"
        )
    vectors = _vectors(path)
    if not vectors:
        raise RecordingError(
            f"{path}: found no vectors of numbers, expected signals; save objects such as timeseries as arrays: "
            "t = ts.Time; y = ts.Data; save('x.mat', 't', 'y', '-v7')"
        )
    if len(vectors) > MOST_SERIES:
        raise too_many(str(path), len(vectors), "vectors")
    lengths = [vector.size for vector in vectors.values()]
    usual = max(set(lengths), key=lambda length: (lengths.count(length) > 1, length))
    check_count(str(path), usual)
    series = [Series(name) for name, vector in vectors.items() if vector.size == usual]
    others = len(vectors) - len(series)
    notes = [f"{others} vectors that do not have {usual} values are left out"] if others else []

    def load(names: Sequence[str]) -> Mapping[str, NDArray[Any]]:
        return {name: vectors[name] for name in names}

    return Table(str(path), "MAT", series, load, notes)


def _vectors(path: Path) -> dict[str, NDArray[Any]]:
    """All vectors of numbers, by name.  Raises RecordingError."""
    needed("scipy.io", path)
    with path.open("rb") as file:
        start = file.read(128)
    if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
        raise RecordingError(
            f"{path}: found a MAT file of version 7.3 (HDF5), expected 7 or older; in MATLAB: save('x.mat', '-v7')"
        )
    command = [sys.executable, "-P", str(Path(__file__).with_name("matlab_child.py")), str(path)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, env=environment, timeout=LONGEST_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise RecordingError(f"{path}: SciPy was not done with it after {LONGEST_S:g} s; is it damaged?") from error
    if done.returncode != 0:
        message = done.stderr.decode(errors="replace").strip() or "SciPy crashed"
        raise RecordingError(
            f"{path}: cannot be read as a MAT file: {shown(' '.join(message.split()))}; is it damaged?"
        )
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        return {str(name): archive[f"arr_{index}"] for index, name in enumerate(archive["names"])}
