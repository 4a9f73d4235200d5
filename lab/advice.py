"""What to record next, in words.  Nothing is simulated here yet."""

from __future__ import annotations

from collections.abc import Sequence

from lostmotion.lab.scoretest import Scores
from lostmotion.model import Model

__all__ = ["advice"]


def advice(named: Sequence[str], scores: Scores, model: Model) -> str:
    return ""
