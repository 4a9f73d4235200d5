"""Reads and writes model files (TOML): base, effects and parameters.

    base = "play"
    effects = ["coulomb_friction"]
    [parameters]
    d = { value = 6e-5, unit = "m", low = 1e-6, high = 1e-3 }
    R1 = { value = 0.01, unit = "m", fixed = true }
    coulomb_friction.tau_c = { value = 1e-4, unit = "N m" }

Missing entries take the documented default: also the value of a parameter of which the file states bounds or that it
is free, and whether a parameter is fixed.  A user-defined effect is listed as "file.py:function", the file being
relative to the model file's folder; reading the model runs that file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec

from lostmotion.drivers import toml_text
from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.recording import replacing
from lostmotion.drivers.textfile import TextFileError, read_text, shortened
from lostmotion.drivers.toml_text import toml_value
from lostmotion.lab.errors import EffectFileError, ModelFileError
from lostmotion.lab.models.own import OwnEffect, is_reference, load_effect, reference
from lostmotion.lab.quantity import of_axis
from lostmotion.model import BASES, Model, ModelError, Parameter, build_model
from lostmotion.model.effects.registry import find

__all__ = ["ModelFile", "dumps", "load", "loads", "save"]

T = TypeVar("T", bound=msgspec.Struct)


@dataclass(frozen=True, slots=True)
class ModelFile:
    """The content of a model file.  parameters: those that the file states, by name, of effects as "effect.name"."""

    base: str
    effects: tuple[str, ...] = ()
    parameters: Mapping[str, Parameter] = field(default_factory=dict)

    def build(self, usual: Mapping[str, float] = MappingProxyType({})) -> Model:
        """The model.  Of parameters that the file does not state it has the usual values, or else the defaults; those
        that it states have it as their source.  Raises ModelError."""
        stated = {name: replace(one, source=one.source or "model file") for name, one in self.parameters.items()}
        return build_model(self.base, effects=self.effects, values={**usual, **stated})


class _File(msgspec.Struct, forbid_unknown_fields=True):
    base: str
    effects: list[str] = []
    parameters: dict[str, Any] = {}


class _Parameter(msgspec.Struct, forbid_unknown_fields=True):
    value: float | None = None
    unit: str | None = None
    low: float = -math.inf
    high: float = math.inf
    fixed: bool | None = None

    @property
    def states_something(self) -> bool:
        """Whether there is more than a unit."""
        return self.value is not None or self.fixed is not None or math.isfinite(self.low) or math.isfinite(self.high)


def load(path: str | Path) -> ModelFile:
    """Reads a model file; the name of a base stands for that base with its defaults.  Raises ModelFileError."""
    if str(path) in BASES and not Path(path).exists():
        return ModelFile(str(path))
    try:
        text = read_text(Path(path))
    except TextFileError as error:
        raise ModelFileError(f"{error}; expected a model file or a base ({', '.join(BASES)})") from error
    try:
        return loads(text, str(path), Path(path).parent)
    except ModelFileError as error:
        if Path(path).suffix.lower() == ".toml":
            raise
        raise ModelFileError(f"{error}; expected the model first, then the recordings") from error


def loads(text: str, where: str, folder: Path = Path()) -> ModelFile:
    """Reads a model given as text; ``where`` names it in messages, ``folder`` contains the user-defined effects.

    Raises ModelFileError.
    """
    try:
        file = _converted(toml_text.loads(text), _File)
        effects = tuple(load_effect(name, folder).id if is_reference(name) else name for name in file.effects)
        defaults = build_model(file.base, effects=effects).parameters
        is_joint = file.base == "joint"
        given = {name: _parameter(name, value, defaults, is_joint) for name, value in _flat(file.parameters)}
        model = ModelFile(file.base, effects, given)
        model.build()
    except (toml_text.TomlError, ModelError, EffectFileError) as error:
        raise ModelFileError(f"{where}: {shortened(error)}") from error
    return model


def dumps(model: ModelFile, folder: Path = Path()) -> str:
    """The text of a model file, one line for each parameter, in order; folder: that of the file, to which the files of
    user-defined effects are relative.  Reading it gives the same content.  Raises ModelError."""
    found = [(name, find(name)) for name in model.effects]
    effects = [reference(effect, folder) if isinstance(effect, OwnEffect) else name for name, effect in found]
    lines = [f"base = {toml_value(model.base)}", f"effects = {toml_value(effects)}"]
    if model.parameters:
        defaults = build_model(model.base, effects=model.effects).parameters
        lines += ["", "[parameters]"]
        lines += [f"{name} = {_table(value, defaults[name])}" for name, value in model.parameters.items()]
    return "\n".join(lines) + "\n"


def save(model: ModelFile, path: str | Path) -> None:
    """Writes a model file; an existing file is replaced atomically.  Raises ModelFileError where it cannot be
    written."""
    text = dumps(model, Path(path).parent)
    try:
        with replacing(path) as file:
            file.write(text)
    except RecordingError as error:
        raise ModelFileError(str(error)) from error


def _flat(parameters: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values of parameters.  Those of an effect are in a table with its name, or have a quoted
    "effect.name"."""
    for name, value in parameters.items():
        if isinstance(value, dict) and value and not value.keys() & set(_Parameter.__struct_fields__):
            yield from ((f"{name}.{inner}", item) for inner, item in value.items())
        else:
            yield name, value


def _converted(table: object, kind: type[T]) -> T:
    """The table as a value of this type.  Raises ModelError for unknown keys and wrong values."""
    known = msgspec.structs.fields(kind)
    if isinstance(table, dict) and (unknown := [key for key in table if key not in {field.name for field in known}]):
        raise ModelError(f"unknown key {unknown[0]!r}, expected some of {', '.join(field.name for field in known)}")
    try:
        return msgspec.convert(table, kind)
    except msgspec.ValidationError as error:
        raise ModelError(_told(str(error), table)) from error


def _told(message: str, table: Any) -> str:
    """A message of msgspec in our form: the key, what was found and what was expected."""
    what, _, path = message.partition(" - at `")
    if missing := re.match(r"Object missing required field `(.+)`", what):
        choice = f"; expected one of {', '.join(BASES)}" if missing[1] == "base" else ""
        return f"{missing[1]} is missing{choice}"
    expected = "a number, or a table such as { value = 1.5 }" if not path else toml_text.in_words(what)
    key = path.rstrip("`").removeprefix("$.") + ": " if path else ""
    return f"{key}found {toml_text.at(table, path)!r:.60}, expected {expected.removeprefix('Expected ')}"


def _parameter(name: str, given: object, defaults: Mapping[str, Parameter], is_joint: bool) -> Parameter:
    """The parameter that a file states; defaults: all parameters of the model; is_joint: whether its base also stands
    for an axis along a line, whose units are N for N m.  Raises ModelError."""
    if name not in defaults:
        raise ModelError(f"no parameter is called {name!r}; there are {', '.join(defaults)}")
    default = defaults[name]
    table = {"value": given} if isinstance(given, int | float) else given
    try:
        read = _converted(table, _Parameter)
        if not read.states_something:
            raise ModelError("value is missing")
        fixed = default.fixed if read.fixed is None else read.fixed
        of_line = of_axis(default.unit, is_linear=True) if is_joint else default.unit
        unit = default.unit if read.unit is None or read.unit == of_line else read.unit
        default.check_unit(unit)  # first: in the wrong unit the value is likely out of bounds as well
        parameter = Parameter(default.value if read.value is None else read.value, unit, read.low, read.high, fixed)
        default.updated(parameter)
    except ModelError as error:
        raise ModelError(f"{name}: {error}") from error
    return parameter


def _table(parameter: Parameter, default: Parameter) -> str:
    table: dict[str, object] = {"value": parameter.value}
    if parameter.unit:
        table["unit"] = parameter.unit
    if parameter.low > -math.inf:
        table["low"] = parameter.low
    if parameter.high < math.inf:
        table["high"] = parameter.high
    if parameter.fixed or parameter.fixed != default.fixed:
        table["fixed"] = parameter.fixed
    return toml_value(table)
