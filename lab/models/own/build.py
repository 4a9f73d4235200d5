"""Builds kernels for the solver from a user-defined function, compiled where numba can compile it, else in plain
Python.

A kernel gets arrays of signals, states and parameters; the code generated here passes their elements to the function.
"""

from __future__ import annotations

import dis
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from numba import njit, types

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own.arguments import Arguments
from lostmotion.lab.models.own.readable import READABLE, Entry
from lostmotion.model.kernel import OPTIONS, Kernel, python_kernel
from lostmotion.model.signals import TIME

__all__ = ["Built", "build"]

Lines = tuple[str, ...]
"""Lines of the body of a kernel."""
SHIFT_S = 1e-5
"""Half the time over which a rate is taken as a difference [s]."""


@dataclass(frozen=True)
class Built:
    """The function, compiled if possible; kernels: each with the number of the signal that it adds to; note: why the
    kernels are in plain Python, None where they are compiled."""

    function: Callable[..., Any]
    kernels: tuple[tuple[int, Kernel], ...]
    note: str | None


def build(name: str, function: Callable[..., Any], arguments: Arguments, entry: Entry) -> Built:
    """The kernels of a function that acts on ``entry``.  Raises EffectFileError where the compiler finds that it does
    not return numbers."""
    bodies = {entry.target: _value_lines(arguments)}
    if entry.rate is not None:
        bodies[entry.rate] = _rate_lines(arguments)
    if any(step.opname == "RAISE_VARARGS" for step in dis.get_instructions(function)):
        return _in_python(function, bodies, "it may raise an error, which compiled code cannot report")
    try:
        compiled = njit(**OPTIONS)(function)
        compiled.compile((types.float64,) * len(arguments.names))
    except Exception as error:  # noqa: BLE001 - numba refuses code in many ways, and Python runs it all the same
        return _in_python(function, bodies, _reason(error))
    _check_returned(name, compiled.nopython_signatures[0].return_type, len(arguments.states))
    kernels = tuple((target, Kernel(_kernel(_guarded(lines), compiled))) for target, lines in bodies.items())
    return Built(compiled, kernels, None)


def _in_python(function: Callable[..., Any], bodies: Mapping[int, Lines], note: str) -> Built:
    kernels = tuple((target, python_kernel(_kernel(lines, function))) for target, lines in bodies.items())
    return Built(function, kernels, note)


def _kernel(lines: Lines, function: Callable[..., Any]) -> Callable[..., float]:
    """The generated function; its text contains only checked names and slot numbers."""
    namespace: dict[str, Any] = {"function": function, "nan": math.nan}
    exec("\n    ".join(("def kernel(s, x, dx, p):", *lines)), namespace)
    made: Callable[..., float] = namespace["kernel"]
    return made


def _value_lines(arguments: Arguments) -> Lines:
    """The body of a kernel that returns the contribution and writes the derivatives of the states to dx."""
    call = f"function({', '.join(_slot(key, arguments) for key in arguments.names)})"
    if not arguments.states:
        return (f"return {call}",)
    derivatives = (f"dx[{i}] = found[{i + 1}]" for i in range(len(arguments.states)))
    return (f"found = {call}", *derivatives, "return found[0]")


def _rate_lines(arguments: Arguments) -> Lines:
    """The body of a kernel that returns the rate of the contribution: a central difference over a short time in which
    angles, lengths and time advance at their rates."""
    later, earlier = (
        f"function({', '.join(_moved(key, arguments, sign) for key in arguments.names)})" for sign in "+-"
    )
    return (f"return ({later} - {earlier}) / {2 * SHIFT_S!r}",)


def _guarded(lines: Lines) -> Lines:
    """The body with exceptions turned into NaN, as the solver would lose those of compiled code."""
    return ("try:", *(f"    {line}" for line in lines), "except Exception:", "    return nan")


def _slot(key: str, arguments: Arguments) -> str:
    """The array element of an argument."""
    if key in arguments.states:
        return f"x[{arguments.states.index(key)}]"
    if key in arguments.values:
        return f"p[{arguments.values.index(key)}]"
    return f"s[{READABLE[key].number}]"


def _moved(key: str, arguments: Arguments, sign: str) -> str:
    """The value of an argument ``SHIFT_S`` later ("+") or earlier ("-")."""
    slot = _slot(key, arguments)
    if key not in arguments.signals:
        return slot
    signal = READABLE[key]
    if signal.number == TIME:
        return f"{slot} {sign} {SHIFT_S!r}"
    return slot if signal.rate is None else f"{slot} {sign} {SHIFT_S!r} * s[{signal.rate}]"


def _check_returned(name: str, found: Any, states: int) -> None:
    """Raises EffectFileError unless the compiler found numbers, as many as expected, on every path."""
    parts: tuple[Any, ...] = tuple(found) if isinstance(found, types.UniTuple | types.Tuple) else (found,)
    if len(parts) == states + 1 and all(isinstance(part, types.Float | types.Integer) for part in parts):
        return
    expected = "a number" if not states else f"{states + 1} numbers: the contribution and each state's derivative"
    found = "nothing on some branch (None)" if isinstance(found, types.Optional) else f"{found}"
    raise EffectFileError(f"{name}: returns {found}, expected {expected}; does every branch return?")


def _reason(error: Exception) -> str:
    """The first relevant line of numba's message."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    informative = [line for line in lines if not line.startswith(("Failed in", "During:", "File "))]
    return f"numba cannot compile it: {(informative or lines or ['no reason given'])[0]}"
