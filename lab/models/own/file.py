"""Files with user-defined effects: ``file.py:function`` → an effect.

Loading a file runs it, like any Python program.  A file must be self-contained: it may import installed packages, not
other files beside it, because only its text is sent to the workers of a cluster.
"""

from __future__ import annotations

import linecache
import logging
import os
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.textfile import TextFileError, read_text
from lostmotion.lab.errors import EffectFileError
from lostmotion.lab.models.own.decorator import ORIGIN, Origin, OwnEffect
from lostmotion.model import ModelError
from lostmotion.model.effects import EffectInfo
from lostmotion.model.effects.registry import catalogue, find, register, unregister

__all__ = ["is_reference", "load_effect", "reference", "restored"]

log = logging.getLogger(__name__)


def is_reference(text: str) -> bool:
    """Whether a text names a function in a file, and not an effect of the catalogue."""
    return ":" in text or text.endswith(".py")


def load_effect(text: str, folder: Path = Path()) -> OwnEffect:
    """The effect that ``file.py:function`` names, the file being relative to the folder.  Raises EffectFileError."""
    if "\0" in text:
        raise EffectFileError(f"{text!r:.200}: found a NUL, expected the name of a file")
    file, _, name = text.rpartition(":")
    path = folder / (file or name)
    origin = Origin(path.resolve(), _text(path))
    if not file:
        one_of = _effects(_run(origin))
        raise EffectFileError(f"{text}: names no function, expected {text}:FUNCTION with one of {one_of}")
    found = restored(origin, name)
    if found.undefined:
        log.warning("%s: %s; such a motion cannot be simulated with it", origin.path.name, found.undefined)
    return found


def reference(effect: OwnEffect, folder: Path) -> str:
    """The reference to the effect in a model file in that folder; the inverse of ``load_effect``."""
    if effect.origin is None:
        return effect.id
    return f"{os.path.relpath(effect.origin.path, folder.resolve())}:{effect.id}"


def restored(origin: Origin, name: str) -> OwnEffect:
    """The effect from the text of its file; a registered one is not run again.  Others in the file are not registered,
    so that a search tries those only that were asked for.  Raises EffectFileError."""
    known = find(name)
    if isinstance(known, OwnEffect) and known.origin == origin:
        return known
    before = {effect.id: effect for effect in catalogue()}
    functions = _run(origin)
    if effect := _effect(functions, name):
        _withdraw([other for other in functions if other != name and _effect(functions, other)], before)
        return effect
    if callable(functions.get(name)):
        raise EffectFileError(f"{origin.path.name}: {name} is a plain function, expected @effect(…) above it")
    raise EffectFileError(f"{origin.path.name}: there is no function {name}; expected one of {_effects(functions)}")


def _withdraw(names: Sequence[str], before: Mapping[str, EffectInfo]) -> None:
    """Undoes the registration of these; before: the effects that were registered earlier."""
    for name in names:
        unregister(name)
        if isinstance(earlier := before.get(name), OwnEffect):
            register(earlier)


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except TextFileError as error:
        raise EffectFileError(f"{error}; expected a Python file with an effect") from error


def _effect(functions: dict[str, Any], name: str) -> OwnEffect | None:
    """The effect of that name among a file's functions, if any."""
    effect = find(name)
    return effect if isinstance(effect, OwnEffect) and functions.get(name) is effect.declared.function else None


def _effects(functions: dict[str, Any]) -> str:
    """The names of the effects that a file defines."""
    names = [name for name in functions if _effect(functions, name)]
    return ", ".join(names) or "none: no function in this file is decorated with @effect(…)"


def _run(origin: Origin) -> dict[str, Any]:
    """The names that the file defines; running it registers its effects.  Raises EffectFileError."""
    path = str(origin.path)
    module = ModuleType(origin.path.stem)
    vars(module).update({"__file__": path, ORIGIN: origin})
    linecache.cache[path] = (len(origin.text), None, origin.text.splitlines(keepends=True), path)  # where it is not
    try:
        exec(compile(origin.text, path, "exec"), vars(module))
    except SyntaxError as error:
        raise EffectFileError(f"{_place(origin, error.lineno)}: no valid Python: {error.msg}") from error
    except (LostmotionError, ModelError) as error:
        raise EffectFileError(f"{_place(origin, _line(path, error))}: {error}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # the user's file may raise any exception
        hint = "; expected only imports of installed packages, as an effect file is self-contained"
        hint = hint if isinstance(error, ImportError) else ""
        raise EffectFileError(f"{_place(origin, _line(path, error))}: {type(error).__name__}: {error}{hint}") from error
    return vars(module)


def _place(origin: Origin, line: int | None) -> str:
    return origin.path.name if line is None else f"{origin.path.name}, line {line}"


def _line(path: str, error: BaseException) -> int | None:
    """The last line of the file that was being run."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return lines[-1] if lines else None
