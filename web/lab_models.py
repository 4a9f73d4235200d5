"""Model files that come from a browser: which base and effects they name; none may name a file to be run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lostmotion.daemon.paths import expanded
from lostmotion.drivers import toml_text
from lostmotion.drivers.errors import LostmotionError

__all__ = ["BASES", "Head", "ModelRefusedError", "head", "own_effects"]

BASES = {
    "play": "gears with play, a bar and an accelerometer: recordings of command and accel or position",
    "servo": "a servo that holds a joint: recordings of command and position",
    "joint": "a joint under a torque, or swinging freely: recordings of torque and position",
    "oscillator": "the bar alone: recordings of force, displacement or accel",
}
"""the bases of a model, and what has to be recorded for them"""


class ModelRefusedError(LostmotionError):
    """The text is no model file, or asks for more than a browser may; status: of HTTP."""

    status = 422


@dataclass(frozen=True, slots=True)
class Head:
    """Base and effects of a model; an effect from a file by its function's name."""

    base: str
    effects: tuple[str, ...]


def own_effects(references: Sequence[str], folder: Path) -> dict[str, str]:
    """The owner's effects by their name: ``file.py:function``, the file without doubt.  Raises ModelRefusedError or
    PathError."""
    found = {}
    for reference in references:
        file, _, name = reference.rpartition(":")
        if not file or not name.isidentifier():
            raise ModelRefusedError(f"web.own_effects: found {reference!r}, expected file.py:function")
        found[name] = f"{(folder / expanded('web.own_effects', file)).resolve()}:{name}"
    return found


def head(text: str, folder: Path, allowed: Mapping[str, str]) -> Head:
    """What a model file in that folder names.  The lab would run any file that stands among its effects: those that the
    owner does not allow are refused.  Raises ModelRefusedError."""
    try:
        tables: Any = toml_text.loads(text)
    except toml_text.TomlError as error:
        raise ModelRefusedError(f"the model is no TOML: {error}") from error
    base, effects = tables.get("base"), tables.get("effects", [])
    if base not in BASES:
        raise ModelRefusedError(f"the model: found base = {base!r:.60}, expected one of {', '.join(BASES)}")
    if not isinstance(effects, list) or not all(isinstance(name, str) for name in effects):
        raise ModelRefusedError('the model: found effects that are no list of names, expected ["coulomb_friction"]')
    return Head(base, tuple(_name(effect, folder, allowed) for effect in effects))


def _name(effect: str, folder: Path, allowed: Mapping[str, str]) -> str:
    if effect.isidentifier():
        return effect
    file, _, name = effect.rpartition(":")
    if file and "\0" not in effect and allowed.get(name) == f"{(folder / file).resolve()}:{name}":
        return name
    raise ModelRefusedError(
        f"the model: found the effect {effect[:80]!r}, which is a file; only web.own_effects may be used from here"
    )
