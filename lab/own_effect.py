"""An effect of the user's own: one decorated Python function becomes a term of the model.

    @effect(acts_on="joint", parameters={"tau_t": Parameter(1e-4, "N m", 0, 1e-2)})
    def stiff_grease(omega, tau_t):
        "-tau_t tanh(omega/0.1)"
        return -tau_t * math.tanh(omega / 0.1)

The names of the arguments say what the function gets: its parameters, its own states, signals (readable.py), or
parameters of the base.  Here the function is understood and checked; compiling is in own_kernel.py, files are in
effectfile.py.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.own_kernel import Arguments, Built, build
from lostmotion.lab.readable import ENTRIES, READABLE, Entry, bases_with, before
from lostmotion.lab.trial import fastest_rate, try_out
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
    """The file that an effect comes from, and its text, which goes along where the file does not: to a worker."""

    path: Path
    text: str


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnEffect(Effect):
    """An effect from a function of the user's.

    origin: None for one that was made in a notebook; note: why it runs in plain Python, or None when it is compiled.
    """

    function: Callable[..., Any]
    states_named: tuple[str, ...]
    origin: Origin | None
    note: str | None = field(default=None)

    def __reduce__(self) -> tuple[Any, ...]:
        """To another process goes the text, or else the function: compiled code means nothing there."""
        if self.origin is None:
            return own_effect, (self.function, self.acts_on, dict(self.parameters), self.bases, self.states_named)
        from lostmotion.lab.effectfile import restored

        return restored, (self.origin, self.id)


def effect(
    acts_on: str,
    *,
    parameters: Mapping[str, Parameter],
    bases: Iterable[str] | None = None,
    states: Iterable[str] = (),
) -> Callable[[F], F]:
    """Decorator: the function is an effect from now on, under its own name.  It stays callable as it was.

    acts_on: "joint": returns a torque [N m]; "oscillator": a force [N]; "sensor": an acceleration on top of the reading
    [m/s²]; "command": an angle on top of theta_1 [rad]; "contact": a length on top of the gap [m].  parameters: by
    name, each ``Parameter(start, unit, low, high)``.  bases: all that have what the function needs, when left out.
    states: names of own states, which begin at 0; the function then returns the contribution and each state's
    derivative, as a tuple.  The first line of its docstring is the equation.  Raises EffectFileError.
    """

    def decorate(function: F) -> F:
        own_effect(function, acts_on, parameters, bases, tuple(states))
        return function

    return decorate


def own_effect(
    function: Callable[..., Any],
    acts_on: str,
    parameters: Mapping[str, Parameter],
    bases: Iterable[str] | None,
    states: tuple[str, ...],
) -> OwnEffect:
    """The function as an effect, registered in the place of an earlier one of its name.  Raises EffectFileError."""
    name = _name(function)
    where = _acts_on(name, acts_on)
    entry = ENTRIES[where]
    _check_parameters(name, parameters)
    arguments = _arguments(name, function, parameters, states)
    _check_causal(name, where, entry, arguments)
    if states and entry.rate is not None:
        raise EffectFileError(f"{name}: acts on the {where} and has states, expected none there; only what acts on "
                              "joint, oscillator or sensor may have its own")  # fmt: skip
    on = _bases(name, entry, arguments, bases)
    try_out(name, function, arguments, {**BASES[on[0]].parameters, **parameters})
    built = build(name, function, arguments, entry)
    found = _effect(name, function, where, parameters, arguments, on, built)
    if isinstance(find(name), OwnEffect):
        unregister(name)
    register(found)
    return found


def _effect(
    name: str,
    function: Callable[..., Any],
    where: ActsOn,
    parameters: Mapping[str, Parameter],
    arguments: Arguments,
    on: tuple[str, ...],
    built: Built,
) -> OwnEffect:
    first, _, rest = (inspect.getdoc(function) or "").partition("\n")
    terms = tuple(Term(target, kernel, arguments.values) for target, kernel in built.kernels)
    called = built.function
    return OwnEffect(
        id=name,
        equation=first or f"{name}({', '.join(arguments.names)})",
        summary=rest.strip().partition("\n")[0] or "an effect of the user's own",
        acts_on=where,
        parameters=dict(parameters),
        bases=on,
        terms=dict.fromkeys(on, terms),
        states=(None,) * len(arguments.states),
        rate=lambda values, operating: fastest_rate(called, where, arguments, values, operating),
        function=function,
        states_named=arguments.states,
        origin=getattr(function, "__globals__", {}).get(ORIGIN),
        note=built.note,
    )


def _name(function: Callable[..., Any]) -> str:
    if not inspect.isfunction(function) or not function.__name__.isidentifier():
        raise EffectFileError(f"@effect stands on {function!r}, expected a function with a name (def …)")
    name = function.__name__
    found = find(name)
    if found is not None and not isinstance(found, OwnEffect):
        raise EffectFileError(f"{name}: the catalogue has an effect of that name; give the function another one")
    return name


def _acts_on(name: str, given: str) -> ActsOn:
    if given not in set(ActsOn):
        raise EffectFileError(f"{name}: acts_on is {given!r}, expected one of {', '.join(ActsOn)}")
    return ActsOn(given)


def _check_parameters(name: str, parameters: Mapping[str, Parameter]) -> None:
    wanted = "Parameter(start, unit, low, high)"
    if not isinstance(parameters, Mapping) or not parameters:
        raise EffectFileError(
            f"{name}: found no parameters, expected at least one, by name: {wanted}, by which a fit tells its size"
        )
    for key, parameter in parameters.items():
        if not isinstance(parameter, Parameter):
            raise EffectFileError(f"{name}: parameter {key} is {parameter!r}, expected {wanted}")
        if not abs(parameter.low) + abs(parameter.high) < float("inf"):
            raise EffectFileError(
                f"{name}: parameter {key} has no bounds, expected {wanted}; a fit looks for it between them"
            )
        if key in READABLE:
            raise EffectFileError(f"{name}: parameter {key} has the name of a signal; give it another one")


def _arguments(
    name: str, function: Callable[..., Any], parameters: Mapping[str, Parameter], states: tuple[str, ...]
) -> Arguments:
    """What each argument of the function is."""
    signature = inspect.signature(function).parameters
    plain = inspect.Parameter.POSITIONAL_OR_KEYWORD
    for argument in signature.values():
        if argument.kind is not plain or argument.default is not inspect.Parameter.empty:
            raise EffectFileError(
                f"{name}: found the argument {argument}, expected plain names, without * and defaults"
            )
    unused = [key for key in (*parameters, *states) if key not in signature]
    if unused:
        raise EffectFileError(f"{name}: {unused[0]} is declared but is no argument of the function; is it misspelt?")
    of_bases = {key for base in BASES.values() for key in base.parameters}
    known = {*parameters, *states, *READABLE, *of_bases}
    for key in signature:
        if key not in known:
            near = get_close_matches(key, sorted(known), n=1)
            hint = f"; did you mean {near[0]}?" if near else f"; signals are {', '.join(READABLE)}"
            raise EffectFileError(f"{name}: the argument {key} is neither a parameter nor a signal{hint}")
    return Arguments(tuple(signature), tuple(parameters), states)


def _check_causal(name: str, where: ActsOn, entry: Entry, arguments: Arguments) -> None:
    allowed = before(entry.target)
    for key in arguments.signals:
        if key not in allowed:
            raise EffectFileError(
                f"{name}: reads {key}, which follows from {entry.meaning} that it gives (acts_on {where}); "
                f"expected only {', '.join(allowed)}"
            )


def _bases(name: str, entry: Entry, arguments: Arguments, given: Iterable[str] | None) -> tuple[str, ...]:
    """Those that have the target, the signals and the parameters that the function names."""
    numbers = {entry.target, *(READABLE[key].number for key in arguments.signals)}
    possible = tuple(base for base in bases_with(numbers) if set(arguments.of_base) <= set(BASES[base].parameters))
    if not possible:
        raise EffectFileError(f"{name}: no base has all that it acts on and reads: {', '.join(arguments.names)}")
    if given is None:
        return possible
    wanted = (given,) if isinstance(given, str) else tuple(given)
    wrong = [base for base in wanted if base not in possible]
    if wrong or not wanted:
        raise EffectFileError(f"{name}: bases are {wanted}, expected some of {', '.join(possible)}")
    return wanted
