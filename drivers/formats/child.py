"""Readers that may crash on a damaged file, or ask for all memory, run in a process of their own: hdf5_child.py,
matlab_child.py, workbook_child.py.

Each is run as a program with the file's path, and writes what it read to stdout.  What is wrong is a line on stderr and
exit status 1.  It imports little of lostmotion, to start quickly, and limits its own memory.
"""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.source import in_words

__all__ = ["output_of", "vectors_of"]

LONGEST_S = 120.0
"""for a file of 400 MB, compressed, some 10"""


def output_of(program: str, path: Path, kind: str) -> bytes:
    """What the program wrote.  kind: what the file is read as, for people.  Raises RecordingError."""
    command = [sys.executable, "-P", str(Path(__file__).with_name(program)), str(path)]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "RUST_BACKTRACE": "0"}
    try:
        done = subprocess.run(command, capture_output=True, env=environment, timeout=LONGEST_S, check=False)
    except subprocess.TimeoutExpired as error:
        raise RecordingError(
            f"{path}: its reader was not done with it after {LONGEST_S:g} s; is it damaged?"
        ) from error
    if done.returncode != 0:
        message = done.stderr.decode(errors="replace").partition("note: ")[0].strip() or "its reader crashed"
        raise RecordingError(f"{path}: cannot be read as {kind}: {in_words(message)}; is it damaged?")
    return done.stdout


def vectors_of(program: str, path: Path, kind: str) -> dict[str, NDArray[Any]]:
    """The vectors that the program wrote (``matlab_child.write``), by name; see ``output_of``."""
    with np.load(io.BytesIO(output_of(program, path, kind)), allow_pickle=False) as archive:
        return {str(name): archive[f"arr_{index}"] for index, name in enumerate(archive["names"])}
