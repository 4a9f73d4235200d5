"""The description of an effect for a maintenance engineer: its name, what it means for the robot, where to look."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

__all__ = ["Words"]


@dataclass(frozen=True)
class Words:
    """sentence: a template of the parameters' intervals; look: what to look at on the robot; otherwise: the
    sentence for values that fail ``when``; read_as: parameters without a unit that are better read as an angle or a
    percentage."""

    name: str
    sentence: str
    look: str
    when: Callable[[Mapping[str, float]], bool] = lambda values: True
    otherwise: str = ""
    read_as: Mapping[str, Literal["tilt", "percent"]] = field(default_factory=dict)
