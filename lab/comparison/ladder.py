"""The ladder of errors on unseen data, effect by effect, from the result of explain."""

from __future__ import annotations

from lostmotion.lab.results import Explanation, Ladder, Rung

__all__ = ["ladder_of"]


def ladder_of(explanation: Explanation) -> Ladder:
    """A rung for the initial model, and one for each added effect."""
    own, error = explanation.base.model.effects, explanation.error
    rungs = [
        Rung((*own, *explanation.missing[:count]), rms, error.noise, error.unit)
        for count, rms in enumerate(explanation.descent)
    ]
    return Ladder(tuple(rungs), explanation)
