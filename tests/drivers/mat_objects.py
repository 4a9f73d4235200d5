"""MAT files with objects, as MATLAB saves them: SciPy writes none."""

from __future__ import annotations

import io
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.io

MATRIX, INT8 = 14, 1
OPAQUE, STRUCT, UINT8 = 17, 2, 9
NAMES = [
    "Name", "Data_", "TimeInfo", "Time_", "Start_", "Increment_", "Length", "tsdata", "timemetadata", "timeseries",
    "Data", "Simulink", "SimulationOutput",
]  # fmt: skip


def _element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def _matrix(value: object) -> bytes:
    """A numeric or cell array without a name, as an element."""
    file = io.BytesIO()
    scipy.io.savemat(file, {"x": value})
    whole = file.getvalue()[128:]
    assert whole[40:44] == b"\x01\0\x01\0"  # the name is x, in a short element
    return whole[:40] + b"\x01\0\0\0\0\0\0\0" + whole[48:]


def _opaque(name: str, system: str, kind: str, value: object) -> bytes:
    head = _element(6, struct.pack("<II", OPAQUE, 0))
    texts = b"".join(_element(INT8, text.encode()) for text in (name, system, kind))
    return _element(MATRIX, head + texts + _matrix(value))


def _reference(number: int, of: int) -> np.ndarray:
    return np.array([[0xDD000000], [2], [1], [1], [number], [of]], dtype=np.uint32)


def _block(*threes: tuple[str, int]) -> list[int]:
    """A block of properties: each by the place of its name, with that of its value."""
    numbers = [len(threes)]
    for name, place in threes:
        numbers += [NAMES.index(name) + 1, 1, place]
    return numbers + [0] * (len(numbers) % 2)


def save_timeseries(path: Path, variable: str, name: str, times: np.ndarray, values: np.ndarray) -> None:
    """A file with one timeseries; evenly spaced times are saved as their first one and their step."""
    is_even = bool(np.ptp(np.diff(times)) < 1e-9)
    own = [name, values, _reference(2, 1), np.zeros((0, 0)) if is_even else times[:, None]]
    own += [times[0], times[1] - times[0] if is_even else np.zeros((0, 0)), float(times.size)]
    order = ["Name", "Data_", "TimeInfo", "Time_", "Start_", "Increment_", "Length"]
    spot = {key: place for place, key in enumerate(order)}
    classes = [0, 0, 0, 0, 8, 9, 0, 0, 0, 10, 0, 0]
    objects = [0] * 6 + [2, 0, 0, 0, 1, 2] + [1, 0, 0, 0, 2, 1]
    blocks = [
        0,
        0,
        *_block(*((key, spot[key]) for key in order[:3])),
        *_block(*((key, spot[key]) for key in order[3:])),
    ]
    _save(path, (variable, "timeseries", _reference(1, 2)), own, (classes, objects, blocks))


def save_output(path: Path, variable: str, signals: Mapping[str, np.ndarray]) -> None:
    """A file with what a run of Simulink gave (``out``), whose signals are the fields of a structure."""
    place = NAMES.index("Simulink") + 1
    classes = [0, 0, 0, 0, place, place + 1, 0, 0]
    objects = [0] * 6 + [1, 0, 0, 0, 1, 1]
    blocks = [0, 0, *_block(("Data", 0))]
    held = {name: values[:, None] for name, values in signals.items()}
    _save(path, (variable, "Simulink.SimulationOutput", _reference(1, 1)), [held], (classes, objects, blocks))


def _save(
    path: Path, variable: tuple[str, str, np.ndarray], own: Sequence[object], tables: Sequence[Sequence[int]]
) -> None:
    """A file with one object: its variable's name, class and reference; its values; its classes, objects and blocks."""
    classes, objects, blocks = tables
    names = b"".join(one.encode() + b"\0" for one in NAMES)
    names += b"\0" * (-(40 + len(names)) % 8)
    parts = [np.array(part, "<i4").tobytes() for part in (classes, [], objects, blocks, [0] * 4)]
    starts = np.cumsum([40 + len(names), *(len(part) for part in parts)])
    table = struct.pack("<10i", 3, len(NAMES), *starts, 0, 0)[:40] + names + b"".join(parts)
    cells = np.empty((len(own) + 2, 1), dtype=object)
    cells[:, 0] = [np.frombuffer(table, np.uint8)[:, None], np.zeros((0, 0)), *own]
    inner = _element(6, struct.pack("<II", STRUCT, 0)) + _element(5, struct.pack("<ii", 1, 1)) + b"\x01\0\0\0\0\0\0\0"
    inner += struct.pack("<HHI", 5, 4, 5) + _element(INT8, b"MCOS\0") + _opaque("", "MCOS", "FileWrapper__", cells)
    hidden = np.frombuffer(b"\0\x01IM\0\0\0\0" + _element(MATRIX, inner), np.uint8)[None, :]
    file = io.BytesIO()
    scipy.io.savemat(file, {})
    name, kind, reference = variable
    path.write_bytes(file.getvalue()[:128] + _opaque(name, "MCOS", kind, reference) + _matrix(hidden))
