"""Adds an effect to a model: from the catalogue by its id, or a user-defined one from a file.  Nothing is fitted
here."""

from __future__ import annotations

from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from lostmotion.lab.errors import ModelFileError
from lostmotion.lab.models.modelfile import ModelFile, load, save
from lostmotion.lab.models.own import OwnEffect, is_reference, load_effect
from lostmotion.model import ModelError, Parameter, catalogue
from lostmotion.model.effects import Effect, get_effect

__all__ = ["Added", "add"]


@dataclass(frozen=True)
class Added:
    """A model file with one more effect, and its parameters by their names in the model."""

    model: ModelFile
    effect: Effect
    parameters: dict[str, Parameter]

    @property
    def note(self) -> str | None:
        """Why the effect runs in plain Python, where it does."""
        return self.effect.note if isinstance(self.effect, OwnEffect) else None

    def document(self) -> dict[str, Any]:
        """The keys of ``lab add --json``."""
        parameters = {
            name: {"value": p.value, "unit": p.unit, "low": p.low, "high": p.high, "fixed": p.fixed,
                   "meaning": p.meaning}
            for name, p in self.parameters.items()
        }  # fmt: skip
        return {
            "base": self.model.base,
            "effects": list(self.model.effects),
            "added": self.effect.id,
            "acts_on": self.effect.acts_on.value,
            "equation": self.effect.equation,
            "parameters": parameters,
            "note": self.note,
        }


def add(model: str | Path, effect: str, output: str | Path) -> Added:
    """Writes ``output``: the model file (or base) with the effect and its parameters at their defaults.

    effect: an id, or ``file.py:function`` relative to the current folder.  Raises ModelFileError for an effect that is
    unknown, there already, or not for this base; EffectFileError for a user-defined one that cannot be used.
    """
    before = load(model)
    found = load_effect(effect) if is_reference(effect) else _known(effect, before.base)
    if found.id in before.effects:
        raise ModelFileError(f"{model}: {found.id} is already there; active effects: {', '.join(before.effects)}")
    try:
        own = {f"{found.id}.{name}": parameter for name, parameter in found.parameters_on(before.base).items()}
    except ModelError as error:
        raise ModelFileError(f"{model}: {error}") from error
    after = ModelFile(before.base, (*before.effects, found.id), {**before.parameters, **own})
    save(after, output)
    return Added(after, found, own)


def _known(name: str, base: str) -> Effect:
    """The effect of the catalogue with that id."""
    ids = [info.id for info in catalogue()]
    if name in ids:
        return get_effect(name)
    near = get_close_matches(name, ids, n=1, cutoff=0.5)
    on_base = ", ".join(info.id for info in catalogue() if base in info.bases)
    hint = f"did you mean {near[0]}?" if near else f"on {base} there are {on_base}, or your own as file.py:function"
    raise ModelFileError(f"no effect is called {name!r}; {hint}")
