"""User-defined effects: a decorated Python function becomes a term of the model.

    @effect(acts_on="joint", parameters={"tau_t": Parameter(1e-4, "N m", 0, 1e-2)})
    def stiff_grease(omega, tau_t):
        "-tau_t tanh(omega/0.1)"
        return -tau_t * math.tanh(omega / 0.1)

The names of the arguments select what the function gets: its parameters, its states, signals (readable.py), or
parameters of the base.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own.arguments import Arguments, Declared
from lostmotion.lab.models.own.build import Built, build
from lostmotion.lab.models.own.steepness import fastest_rate, sign_width
from lostmotion.lab.models.own.trial import try_out
from lostmotion.model import BASES, Parameter
from lostmotion.model.base import Term
from lostmotion.model.effects import ActsOn, Effect, register, unregister
from lostmotion.model.effects.registry import find

__all__ = ["ORIGIN", "Origin", "OwnEffect", "effect", "own_effect"]

F = TypeVar("F", bound=Callable[..., Any])
ORIGIN = "__lostmotion_origin__"
"""The global name under which a file's functions find their Origin."""


@dataclass(frozen=True)
class Origin:
    """The file that an effect comes from, and its text, which is sent to workers that do not have the file."""

    path: Path
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnEffect(Effect):
    """An effect from a user-defined function.

    origin: None for one that was made in a notebook; note: why it runs in plain Python, or None when it is compiled;
    undefined: where it has no finite value, in words, "" if it has one at all points that were tried.
    """

    declared: Declared
    origin: Origin | None
    note: str | None
    undefined: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the text, or else the function, as compiled code is not valid in another process."""
        if self.origin is None:
            return own_effect, (self.declared,)
        from lostmotion.lab.models.own.file import restored

        return restored, (self.origin, self.id)


def effect(
    acts_on: str,
    *,
    parameters: Mapping[str, Parameter],
    bases: Iterable[str] | None = None,
    states: Iterable[str] = (),
) -> Callable[[F], F]:
    """Decorator: registers the function as an effect under its name.  It stays callable.

    acts_on: "joint": returns a torque [N m]; "oscillator": a force [N]; "sensor": an acceleration on top of the reading
    [m/s²]; "command": an angle on top of theta_1 [rad]; "contact": a length on top of the gap [m].  parameters: by
    name, each ``Parameter(start, unit, low, high)``.  bases: by default all that have what the function needs.  states:
    names of its states, which begin at 0; the function then returns the contribution and each state's derivative, as a
    tuple.  The first line of its docstring is the equation.  Raises EffectFileError.
    """

    def decorate(function: F) -> F:
        if not inspect.isfunction(function) or not function.__name__.isidentifier():
            raise EffectFileError(f"@effect stands on {function!r}, expected a function with a name (def …)")
        on = (bases,) if isinstance(bases, str) else None if bases is None else tuple(bases)
        found = own_effect(Declared(function, acts_on, dict(parameters), on, tuple(states)))
        if found.origin is None and found.undefined:  # in a notebook; that of a file is told by who loads it
            warnings.warn(found.undefined, stacklevel=2)
        return function

    return decorate


def own_effect(declared: Declared) -> OwnEffect:
    """Registers the declared effect, in place of an earlier one of its name.  Raises EffectFileError."""
    name = declared.name
    earlier = find(name)
    if earlier is not None and not isinstance(earlier, OwnEffect):
        raise EffectFileError(f"{name}: the catalogue has an effect of that name; give the function another one")
    entry, arguments = declared.entry, declared.arguments()
    on = declared.on(arguments)
    undefined = try_out(name, declared.function, arguments, {**BASES[on[0]].parameters, **declared.parameters})
    found = _effect(declared, arguments, on, build(name, declared.function, arguments, entry), undefined)
    unregister(name)
    register(found)
    return found


def _effect(declared: Declared, arguments: Arguments, on: tuple[str, ...], built: Built, undefined: str) -> OwnEffect:
    function, where = declared.function, ActsOn(declared.acts_on)
    first, _, rest = (inspect.getdoc(function) or "").partition("\n")
    terms = tuple(Term(target, kernel, arguments.values) for target, kernel in built.kernels)
    return OwnEffect(
        id=declared.name,
        equation=first or f"{declared.name}({', '.join(arguments.names)})",
        summary=rest.strip().partition("\n")[0] or f"{declared.name.replace('_', ' ')}, an effect of the user's own",
        acts_on=where,
        parameters=declared.parameters,
        bases=on,
        terms=dict.fromkeys(on, terms),
        states=(None,) * len(arguments.states),
        rate=lambda values, operating: fastest_rate(built.function, where, arguments, values, operating),
        sign_width=lambda values, speed: sign_width(built.function, where, arguments, values, speed),
        declared=declared,
        origin=function.__globals__.get(ORIGIN),
        note=built.note,
        undefined=undefined,
    )
