"""One function of one signature: how a term of the model meets the solver.  No physics, no integration.

``kernel(s, x, dx, p) -> contribution``: s are the signals (index them with the constants of signals.py; read only those
before the target), x the states of the effect, dx their derivatives to be set, p the term's parameters in the order in
which the term names them.  The returned contribution is added to the term's target.  Terms of one effect share x and
dx, and run in the order of their targets.

Kernels are compiled by numba when they are first needed, and cached on disk; a plain Python function works through the
same address by ctypes (slowly: about a microsecond a call).
"""

from __future__ import annotations

import ctypes
import threading
import zlib
from collections.abc import Callable, MutableSequence
from functools import cached_property, partial
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np
from numba import cfunc, njit, types

from lostmotion.model.lanes import LANES, POINTER, lane
from lostmotion.model.signals import LAYOUT

__all__ = [
    "OPTIONS",
    "Function",
    "Kernel",
    "Slots",
    "compiled",
    "jitted",
    "kernel",
    "python_kernel",
    "subroutine",
    "whole_power",
]

Slots = MutableSequence[float]
"""As a kernel sees it: something that is indexed and holds floats, without length or slices."""
Function = Callable[[Slots, Slots, Slots, Slots], float]
F = TypeVar("F", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
"""Division by zero gives inf, which the solver reports, instead of an exception that C would swallow; a multiplication
and an addition may be one instruction."""
INLINED = ("elementary.py", "kernel.py", "lanes.py", "rk4.py")
"""Sources of what is compiled into other functions."""
SIGNATURE = types.void(POINTER, POINTER, POINTER, POINTER, POINTER, types.int64)
_C_POINTER = ctypes.POINTER(ctypes.c_double)
_C_SIGNATURE = ctypes.CFUNCTYPE(None, *[_C_POINTER] * 5, ctypes.c_int64)


def _sources() -> str:
    """A checksum of the sources of ``INLINED``."""
    checksum = 0
    for name in INLINED:
        checksum = zlib.crc32((Path(__file__).parent / name).read_bytes(), checksum)
    return f"{checksum:08x}"


SOURCES = _sources()


class _Raised(threading.local):
    """What a Python kernel raised in this thread."""

    error: BaseException | None = None


class _Strided:
    """One lane of an array of lanes, for functions in Python."""

    __slots__ = ("_array", "_number")

    def __init__(self, array: Any, number: int) -> None:
        self._array, self._number = array, number

    def __getitem__(self, row: int) -> float:
        return float(self._array[row * LANES + self._number])

    def __setitem__(self, row: int, value: float) -> None:
        self._array[row * LANES + self._number] = value


def _of_lane(s: Any, x: Any, dx: Any, p: Any) -> float:
    """Stands for the function of a kernel in ``_loop``, of which each kernel has a copy with its own."""
    raise NotImplementedError


def _loop(s: Any, x: Any, dx: Any, p: Any, out: Any, count: int) -> None:
    if count == 1:
        out[0] = _of_lane(lane(s, 0), lane(x, 0), lane(dx, 0), lane(p, 0))
        return
    for number in range(count):
        out[number] = _of_lane(lane(s, number), lane(x, number), lane(dx, number), lane(p, number))


def _over_lanes(function: Function) -> Any:
    """The kernel for several lanes.  It is cached as code of the function's own file; signal numbers are compiled in,
    so another order of the signals must not find the old code."""
    own = function.__code__
    code = _loop.__code__.replace(co_filename=own.co_filename, co_firstlineno=own.co_firstlineno)
    names = {"_of_lane": jitted(function), "lane": lane, "range": range, "__name__": function.__module__}
    made = FunctionType(code, names, function.__name__)
    made.__qualname__, made.__module__ = f"{function.__qualname__}_{LAYOUT}", function.__module__
    return made


class Kernel:
    """A function that the solver calls by ``address``; what one in Python raises is NaN to the solver."""

    def __init__(self, function: Function, in_python: bool = False) -> None:
        self.function = function
        self._raised = _Raised()
        self._in_python = in_python

    @cached_property
    def _handle(self) -> Any:
        if self._in_python:
            return _C_SIGNATURE(self._lanes_in_python)
        return compiled(partial(cfunc, SIGNATURE, **OPTIONS), _over_lanes(self.function))

    @cached_property
    def address(self) -> int:
        """Where the machine code starts; compiles the function at the first call."""
        if self._in_python:
            return ctypes.cast(self._handle, ctypes.c_void_p).value or 0
        return int(self._handle.address)

    def _lanes_in_python(self, s: Any, x: Any, dx: Any, p: Any, out: Any, count: int) -> None:
        for number in range(count):
            out[number] = self._guarded(*(cast(Slots, _Strided(array, number)) for array in (s, x, dx, p)))

    def _guarded(self, s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
        if isinstance(self._raised.error, KeyboardInterrupt):  # the rest as fast as possible
            return float("nan")
        try:
            return float(self.function(s, x, dx, p))
        except BaseException as error:  # noqa: BLE001 - none, no Ctrl-C, gets through machine code; raised after it
            self._raised.error = error
            return float("nan")

    def take_error(self) -> BaseException | None:
        """What the function raised in this thread since the last time."""
        error, self._raised.error = self._raised.error, None
        return error


def kernel(function: Function) -> Kernel:
    """Decorator: a kernel that numba compiles when it is first needed."""
    return Kernel(function)


def python_kernel(function: Function) -> Kernel:
    """Decorator: a kernel that stays Python, for effects that numba cannot compile or that are still being tried."""
    return Kernel(function, in_python=True)


def compiled(decorator: Callable[..., Any], function: Callable[..., Any]) -> Any:
    """``decorator(cache=True)(function)``, or without a cache where no folder for it can be written (a hardened
    service).  The cache's name has a checksum of ``INLINED``: numba compares the function's own file only, and went on
    with code of the old ones."""
    function.__qualname__ = f"{function.__qualname__}_{SOURCES}"
    try:
        return decorator(cache=True)(function)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return decorator()(function)


def jitted(function: F) -> F:
    """Decorator: numba compiles the function into those that call it."""
    return cast(F, njit(forceinline=True, **OPTIONS)(function))


def subroutine(function: F) -> F:
    """Decorator: numba compiles the function once, and those that use it call it."""
    return cast(F, njit(**OPTIONS)(function))


@jitted
def whole_power(base: float, exponent: float) -> float:
    """base ** exponent for a whole exponent from 0 to 127 by repeated squaring, so that odd powers keep the sign.
    Without a branch, so that lanes are computed by vector instructions."""
    left = np.int32(exponent)
    result = 1.0
    for _ in range(7):
        result = result * base if left & 1 else result
        base = base * base
        left >>= 1
    return result
