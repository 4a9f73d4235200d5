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
from collections.abc import Callable, MutableSequence
from functools import cached_property
from typing import Any, TypeVar, cast

from numba import cfunc, njit, types

from lostmotion.model.signals import LAYOUT

__all__ = [
    "OPTIONS",
    "POINTER",
    "Function",
    "Kernel",
    "Slots",
    "compiled",
    "jitted",
    "kernel",
    "python_kernel",
    "whole_power",
]

Slots = MutableSequence[float]
"""As a kernel sees it: something that is indexed and holds floats, without length or slices."""
Function = Callable[[Slots, Slots, Slots, Slots], float]
F = TypeVar("F", bound=Callable[..., Any])

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
"""Division by zero gives inf, which the solver reports, instead of an exception that C would swallow; a multiplication
and an addition may be one instruction."""
POINTER: Any = cast(Any, types).CPointer(types.float64)
SIGNATURE = types.float64(POINTER, POINTER, POINTER, POINTER)
_C_POINTER = ctypes.POINTER(ctypes.c_double)
_C_SIGNATURE = ctypes.CFUNCTYPE(ctypes.c_double, _C_POINTER, _C_POINTER, _C_POINTER, _C_POINTER)


class _Raised(threading.local):
    """What a Python kernel raised in this thread."""

    error: BaseException | None = None


class Kernel:
    """A function that the solver calls by ``address``; what one in Python raises is NaN to the solver."""

    def __init__(self, function: Function, in_python: bool = False) -> None:
        self.function = function
        self._raised = _Raised()
        self._in_python = in_python

    @cached_property
    def _handle(self) -> Any:
        if self._in_python:
            return _C_SIGNATURE(self._guarded)
        # Signal numbers are compiled in: another order of the signals must not find the old code in the cache.
        self.function.__qualname__ = f"{self.function.__qualname__}_{LAYOUT}"
        return compiled(lambda **options: cfunc(SIGNATURE, **OPTIONS, **options)(self.function))

    @cached_property
    def address(self) -> int:
        """Where the machine code starts; compiles the function at the first call."""
        if self._in_python:
            return ctypes.cast(self._handle, ctypes.c_void_p).value or 0
        return int(self._handle.address)

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


def compiled(build: Callable[..., Any]) -> Any:
    """``build(cache=True)``, or without a cache where no folder for it can be written (a hardened service)."""
    try:
        return build(cache=True)
    except RuntimeError:  # numba: "cannot cache function: no locator available"
        return build()


def jitted(function: F) -> F:
    """Decorator: numba compiles the function into those that call it."""
    return cast(F, njit(forceinline=True, **OPTIONS)(function))


@jitted
def whole_power(base: float, exponent: int) -> float:
    """base ** exponent for a whole exponent >= 0 by repeated squaring, so that odd powers keep the sign."""
    result = 1.0
    while exponent > 0:
        if exponent & 1:
            result *= base
        base *= base
        exponent >>= 1
    return result
