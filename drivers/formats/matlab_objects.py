"""The timeseries objects of a MAT file, which MATLAB saves in a hidden variable of bytes and SciPy leaves as they are.

The bytes are a MAT file of one cell array (``FileWrapper__``).  Its first cell holds names, and tables of 32-bit
integers: classes, by the place of their names; objects, by their class and their block of properties; and these blocks,
each a property by the place of its name and that of its value in the other cells.  MathWorks does not publish this; it
is known from files.  Imports nothing of lostmotion.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIDDEN", "object_of", "outputs", "timeseries"]

HIDDEN = "__function_workspace__"
"""SciPy's name of the hidden variable"""
UNNAMED, NAMED = b"\x01\0\0\0\0\0\0\0", b"\x01\0\x01\0x\0\0\0"
"""an array's empty name, and x, as elements of a MAT file"""
NAME_AT = 40
REFERENCE = 0xDD000000
"""the first of the integers of a reference to an object: this, the number of dimensions, the dimensions, the objects,
and their class"""
VALUE = 1
"""the kind of a property whose value is in a cell"""

Array = NDArray[Any]


def timeseries(hidden: Array, names: Mapping[int, str]) -> Iterator[tuple[str, Array, Array]]:
    """The name, the times (N,) and the values (N, ...) of each timeseries.  names: of variables, by the object they
    are, to which a unit in brackets at the end of ``Name`` is added; others have their ``Name``.  Raises almost
    anything where the bytes are others than expected."""
    objects = _objects(_cells(hidden.tobytes()))
    for number, (kind, own) in enumerate(objects):
        if kind != "timeseries" or (values := own.get("Data_", own.get("Data"))) is None:
            continue
        values, times = np.asarray(values), _times(own, objects)
        if times.size > 1 and times.size in values.shape:
            first = np.moveaxis(values, values.shape.index(times.size), 0)
            own_name = _text(own.get("Name"))
            unit = "".join(re.findall(r"\s*[\[(][^\])]+[\])]$", own_name))
            name = f"{names[number]}{unit}" if number in names else own_name or f"timeseries{number}"
            yield name, times, np.squeeze(first)


def outputs(hidden: Array, names: Mapping[int, str]) -> Iterator[tuple[str, Any]]:
    """The name of the variable, and the signals by their names, of each ``Simulink.SimulationOutput``, but for those
    that are objects themselves, as timeseries are.  Raises almost anything where the bytes are others than expected."""
    for number, (kind, own) in enumerate(_objects(_cells(hidden.tobytes()))):
        if kind == "SimulationOutput":
            yield names.get(number, kind), _plain(own.get("Data"))


def _plain(value: Any) -> Any:
    """The fields of a structure by name, down to arrays of numbers; None for all else."""
    if not isinstance(value, np.ndarray):
        return None
    if value.dtype.names:
        return {field: _plain(value[field].flat[0]) for field in value.dtype.names if value.size}
    is_reference = object_of(value) != 0
    return np.squeeze(value) if value.dtype.kind in "iuf" and not is_reference else None


def object_of(reference: Array) -> int:
    """The number of the object that a variable or a property is; 0 for none."""
    numbers = np.ravel(reference)
    is_one = numbers.dtype.kind == "u" and numbers.size == 6 and int(numbers[0]) == REFERENCE
    return int(numbers[4]) if is_one else 0


def _cells(hidden: bytes) -> Sequence[Any]:
    """The cells of the file that the bytes are."""
    import scipy.io

    body = hidden[8:]
    if body[NAME_AT : NAME_AT + 8] == UNNAMED:
        body = body[:NAME_AT] + NAMED + body[NAME_AT + 8 :]
    file: Any = io.BytesIO(b"MATLAB 5.0 MAT-file".ljust(124) + hidden[:4] + body)
    wrapper = scipy.io.loadmat(file, variable_names=["x"])["x"]["MCOS"].flat[0]
    return list(np.ravel(wrapper["arr"].flat[0]))


def _objects(cells: Sequence[Any]) -> Sequence[tuple[str, Mapping[str, Any]]]:
    """The class and the properties of each object, from number 1 on; none at 0."""
    table = np.asarray(cells[0], dtype=np.uint8).tobytes()
    count, *at = (int(number) for number in np.frombuffer(table[4:40], "<i4"))
    names = ["", *(name.decode() for name in table[40 : at[0]].split(b"\0")[:count])]

    def part(index: int) -> Array:
        return np.frombuffer(table[at[index] : at[index + 1]], "<i4")

    blocks = list(_blocks(part(3)))
    classes = [names[row[1]] for row in part(0).reshape(-1, 4)]
    found = []
    for row in part(2).reshape(-1, 6):
        held = blocks[row[4]] if row[4] < len(blocks) else []
        found.append((classes[row[0]], {names[name]: cells[value + 2] for name, kind, value in held if kind == VALUE}))
    return found


def _blocks(numbers: Array) -> Iterator[list[tuple[int, int, int]]]:
    """Blocks of properties, each a count and as many threes, and filled up to eight bytes."""
    at = 0
    while at < numbers.size:
        many = int(numbers[at])
        threes = numbers[at + 1 : at + 1 + 3 * many].reshape(-1, 3)
        yield [(int(name), int(kind), int(value)) for name, kind, value in threes]
        at += (1 + 3 * many + 1) // 2 * 2


def _times(own: Mapping[str, Any], objects: Sequence[tuple[str, Mapping[str, Any]]]) -> Array:
    """The times (N,) of a timeseries: as they are, or by their first one and their step."""
    held = objects[object_of(np.asarray(own.get("TimeInfo", 0)))][1] or own
    times = np.ravel(held.get("Time_", held.get("Time", [])))
    if times.size:
        return times
    first, step, many = (float(np.ravel(held.get(key, 0)).sum()) for key in ("Start_", "Increment_", "Length"))
    return first + step * np.arange(int(many))


def _text(value: Any) -> str:
    return str(np.ravel(value)[0]) if value is not None and np.size(value) else ""
