"""Lanes: several simulations side by side, so that one instruction advances several of them.  No physics here.

An array of lanes holds ``LANES`` numbers for each of its rows, one for each simulation.  A kernel is written for one
simulation; the loop over lanes that is compiled around it has a constant stride, which LLVM turns into vector
instructions where the kernel has no branches and calls no library.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, overload, register_model

__all__ = ["LANES", "POINTER", "VECTOR", "address", "batches", "call", "intrinsic_function", "lane", "offset"]

LANES = 16
"""Most simulations side by side: a fit of gears has 5 to 16 (an initial state, its changes and those of parameters)."""
VECTOR = 8
"""Several lanes are computed in multiples of this number: loops over fewer have no vector instructions."""
POINTER: Any = cast(Any, types).CPointer(types.float64)


def batches(count: int) -> Iterator[slice]:
    """Runs in parts of at most ``LANES``, a multiple of ``VECTOR`` where that is possible.  None is left alone: it
    would be rounded otherwise than those beside which finite differences need it."""
    many = -(-count // LANES)
    size = -(-count // many // VECTOR) * VECTOR if many > 1 else count
    while many > 1 and count % size == 1:
        size -= 1
    return (slice(first, min(first + size, count)) for first in range(0, count, size))


intrinsic_function: Callable[[Callable[..., Any]], Callable[..., Any]] = intrinsic


class _Lane(types.Type):
    """One lane of an array of lanes: ``lane[i]`` is the number in row i."""


_LANE: Any = cast(Any, _Lane)("Lane")


@register_model(_Lane)
class _LaneModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.DoubleType().as_pointer())  # type: ignore[no-untyped-call]


def _element(builder: Any, pointer: Any, row: Any) -> Any:
    return builder.gep(pointer, [builder.mul(row, ir.Constant(row.type, LANES))])


@intrinsic_function
def lane(context: Any, pointer: Any, number: Any) -> Any:
    """The lane of this number of the array at the pointer."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.gep(args[0], [args[1]])

    return _LANE(pointer, number), codegen


@intrinsic_function
def offset(context: Any, pointer: Any, number: Any) -> Any:
    """The pointer, so many numbers further."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.gep(args[0], [args[1]])

    return POINTER(pointer, number), codegen


@intrinsic_function
def _read(context: Any, one: Any, row: Any) -> Any:
    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.load(_element(builder, *args))

    return types.float64(one, row), codegen


@intrinsic_function
def _write(context: Any, one: Any, row: Any, value: Any) -> Any:
    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        number = context.cast(builder, args[2], signature.args[2], types.float64)
        builder.store(number, _element(builder, *args[:2]))
        return context.get_dummy_value()

    return types.void(one, row, value), codegen


@overload(operator.getitem)
def _getitem(one: Any, row: Any) -> Any:
    def read(one: Any, row: Any) -> Any:
        return _read(one, row)

    return read if isinstance(one, _Lane) else None


@overload(operator.setitem)
def _setitem(one: Any, row: Any, value: Any) -> Any:
    def write(one: Any, row: Any, value: Any) -> Any:
        return _write(one, row, value)

    return write if isinstance(one, _Lane) else None


@intrinsic_function
def call(context: Any, function: Any, s: Any, x: Any, dx: Any, p: Any, out: Any, count: Any) -> Any:
    """Calls the kernel at an address for ``count`` lanes, which begin at these pointers."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [ir.DoubleType().as_pointer()] * 5 + [ir.IntType(64)])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.uint64, *[POINTER] * 5, types.int64), codegen


@intrinsic_function
def address(context: Any, array: Any, index: Any) -> Any:
    """A pointer to array[index]."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.gep(data, [args[1]])

    return cast(Any, types).CPointer(array.dtype)(array, index), codegen
