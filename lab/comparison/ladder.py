"""The error falling: what explain found as a ladder of effects, on data that the fit has not seen."""

from __future__ import annotations

from lostmotion.lab.results import Explanation, Ladder, Rung

__all__ = ["ladder_of"]


def ladder_of(explanation: Explanation) -> Ladder:
    """A rung for the model as it was, and one for each effect that was added."""
    own, error = explanation.base.model.effects, explanation.error
    rungs = [
        Rung((*own, *explanation.missing[:count]), rms, error.noise, error.unit)
        for count, rms in enumerate(explanation.descent)
    ]
    return Ladder(tuple(rungs), explanation)
