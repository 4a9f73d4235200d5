"""Classifies the arguments of a user-defined function, and checks them: parameters, states, signals that the effect may
read, and parameters of the base.  The function is not called here."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own.readable import ENTRIES, READABLE, Entry, bases_with, before
from lostmotion.model import BASES, Parameter
from lostmotion.model.effects import ActsOn

__all__ = ["Arguments", "Declared"]

WANTED = "Parameter(start, unit, low, high)"
"""What a parameter has to look like, for messages."""


@dataclass(frozen=True, eq=False)
class Declared:
    """A function with the arguments of its decorator, see ``effect``; bases: None for all that are possible."""

    function: Callable[..., Any]
    acts_on: str
    parameters: Mapping[str, Parameter]
    bases: tuple[str, ...] | None
    states: tuple[str, ...]

    @property
    def name(self) -> str:
        """The function's name, which is the effect's id."""
        return self.function.__name__

    @property
    def entry(self) -> Entry:
        """The signal on which the effect acts.  Raises EffectFileError for an unknown name."""
        if self.acts_on not in set(ActsOn):
            raise EffectFileError(f"{self.name}: acts_on is {self.acts_on!r}, expected one of {', '.join(ActsOn)}")
        return ENTRIES[ActsOn(self.acts_on)]

    def arguments(self) -> Arguments:
        """The role of each argument.  Raises EffectFileError for an invalid parameter or argument."""
        self._check_parameters()
        signature = inspect.signature(self.function).parameters
        for argument in signature.values():
            if argument.kind is not argument.POSITIONAL_OR_KEYWORD or argument.default is not argument.empty:
                raise EffectFileError(
                    f"{self.name}: found the argument {argument}, expected plain names, without * and defaults"
                )
        for key in (*self.parameters, *self.states):
            if key not in signature:
                raise EffectFileError(
                    f"{self.name}: {key} is declared but is no argument of the function; is it misspelt?"
                )
        units = tuple(parameter.unit for parameter in self.parameters.values())
        found = Arguments(tuple(signature), tuple(self.parameters), units, self.states)
        self._check_known(found)
        self._check_causal(found)
        return found

    def on(self, arguments: Arguments) -> tuple[str, ...]:
        """The bases that have the target of the effect and all signals and parameters that it reads.  Raises
        EffectFileError where there are none."""
        numbers = {self.entry.target, *(READABLE[key].number for key in arguments.signals)}
        of_base = set(arguments.of_base)
        possible = tuple(base for base in bases_with(numbers) if of_base <= set(BASES[base].parameters))
        if not possible:
            raise EffectFileError(
                f"{self.name}: no base has all that it acts on and reads: {', '.join(arguments.names)}"
            )
        if self.bases is not None and not (self.bases and set(self.bases) <= set(possible)):
            raise EffectFileError(f"{self.name}: bases are {self.bases}, expected some of {', '.join(possible)}")
        return possible if self.bases is None else self.bases

    def _check_parameters(self) -> None:
        if not self.parameters:
            raise EffectFileError(
                f"{self.name}: found no parameters, expected at least one {WANTED}, which gives a fit its scale"
            )
        for key, parameter in self.parameters.items():
            if not isinstance(parameter, Parameter):
                raise EffectFileError(f"{self.name}: parameter {key} is {parameter!r}, expected {WANTED}")
            if not (math.isfinite(parameter.low) and math.isfinite(parameter.high)):
                raise EffectFileError(
                    f"{self.name}: parameter {key} has no bounds, expected {WANTED}; a fit looks for it between them"
                )
            if key in READABLE:
                raise EffectFileError(f"{self.name}: parameter {key} has the name of a signal; give it another one")

    def _check_known(self, arguments: Arguments) -> None:
        known = {*READABLE, *(key for base in BASES.values() for key in base.parameters)}
        for key in arguments.of_base:
            if key not in known:
                near = get_close_matches(key, sorted(known | set(arguments.own)), n=1)
                hint = f"; did you mean {near[0]}?" if near else f"; signals are {', '.join(READABLE)}"
                raise EffectFileError(f"{self.name}: the argument {key} is neither a parameter nor a signal{hint}")

    def _check_causal(self, arguments: Arguments) -> None:
        entry, allowed = self.entry, before(self.entry.target)
        if self.states and entry.rate is not None:
            raise EffectFileError(
                f"{self.name}: acts on the {self.acts_on} and has states, expected none there; "
                "only what acts on joint, oscillator or sensor may have its own"
            )
        for key in arguments.signals:
            if key not in allowed:
                raise EffectFileError(
                    f"{self.name}: reads {key}, which follows from {entry.meaning} that it gives "
                    f"(acts_on {self.acts_on}); expected only {', '.join(allowed)}"
                )


@dataclass(frozen=True, slots=True)
class Arguments:
    """The arguments of a function.  names: all of them, in order; own, units: its parameters and their units;
    states."""

    names: tuple[str, ...]
    own: tuple[str, ...]
    units: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def signals(self) -> tuple[str, ...]:
        """The arguments that are signals."""
        return tuple(key for key in self.names if key in READABLE and key not in self.states)

    @property
    def of_base(self) -> tuple[str, ...]:
        """The arguments that are parameters of the base."""
        return tuple(key for key in self.names if key not in {*self.own, *self.states, *READABLE})

    @property
    def values(self) -> tuple[str, ...]:
        """The arguments that are constant during a motion, which a kernel gets as p."""
        return (*self.own, *self.of_base)
