"""How long a sub-step may be: the choice from the rates that the base and every effect state.  No integration here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from lostmotion.model.assemble import scope
from lostmotion.model.base import Base, Operating
from lostmotion.model.effects.base import Effect
from lostmotion.model.errors import ModelError
from lostmotion.model.pieces import Pieces
from lostmotion.model.signals import INERTIA

__all__ = ["operating", "pick"]

SHARE = 0.25
"""Sub-step times fastest rate.  RK4 is stable to about 2.8; a quarter keeps an impact's error near 1e-4."""
LONGEST_S, LONGEST = 4e-3, 0.4
"""Seconds, or of the time between two samples where that is longer: a day's recording needs no steps of 4 ms."""
MOST_STEPS = 50_000_000


def operating(base: Base, values: Mapping[str, float], pieces: Pieces) -> Operating:
    """What is known before a first run."""
    inertia = base.presets.get(INERTIA, math.nan)
    return Operating(pieces.speed, pieces.acceleration, None, values[inertia] if isinstance(inertia, str) else inertia)


def pick(
    base: Base,
    effects: Sequence[Effect],
    values: Mapping[str, float],
    before: Operating,
    watched: float | None,
    length: float,
    interval: float = 0.0,
) -> float:
    """The sub-step [s]: 4 ms (0.4 of the interval between samples, if that is longer) halved until a quarter of the
    fastest rate's time is not exceeded.

    Halves, so that a small change of a parameter leaves the step as it is and the result stays smooth.  Raises
    ModelError where the length [s] would take more than 50 million steps.
    """
    now = replace(before, watched=watched)
    rates = [base.rate(scope(values), now)]
    rates += [effect.rate(scope(values, effect), now) for effect in effects if effect.rate]
    longest = max(LONGEST_S, LONGEST * interval)
    substep = longest * 0.5 ** max(0, math.ceil(math.log2(longest * max(rates) / SHARE)))
    if length / substep > MOST_STEPS:
        raise ModelError(
            f"the fastest rate is {max(rates):.3g} 1/s, which would take {length / substep:.2g} steps; "
            "a stiffness, damping or friction is very large for the inertia that it acts on"
        )
    return substep
