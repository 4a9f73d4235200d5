"""A servo's state as far as its registers were seen.

A polled servo is asked for its whole state block; a listener sees only what its master asks for and writes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.drivers.codec import feetech
from lostmotion.drivers.codec.servo_state import COMMAND, MODELS, POSITION, TRAJECTORY, Model, ServoState

__all__ = ["ALL_MODELS", "Registers"]

ALL_MODELS: Mapping[str, Model] = MODELS | feetech.MODELS
FRESH_S = {"velocity": 0.1, "current": 0.1, "voltage": 60.0, "temperature": 60.0}
"""so long a value that is read beside the position is taken for the present one"""


class Registers:
    """What is known of one servo's registers, and since when."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._block = bytearray(model.block_size)
        self._places = model.control_table
        self._at: dict[str, float] = {}
        """when a value was last seen [s], by its name"""

    def update(self, address: int, data: bytes, time: float) -> set[str]:
        """Takes registers that were answered or written; the names of the values among them."""
        names = set()
        for name, (at, size) in self._places.items():
            if address <= at and at + size <= address + len(data):
                start = at - self._model.address
                self._block[start : start + size] = data[at - address : at - address + size]
                self._at[name] = time
                names.add(name)
        if POSITION in names and TRAJECTORY in self._places and TRAJECTORY not in names:
            start, size = self._places[TRAJECTORY][0] - self._model.address, self._places[TRAJECTORY][1]
            self._block[start : start + size] = bytes(size)  # of another moment: the goal is nearer to the truth
        return names

    @property
    def has_command(self) -> bool:
        """Whether a goal was seen."""
        return COMMAND in self._at

    def state(self, now: float) -> ServoState:
        """The state as far as it is known and fresh, else NaN; the command is the position until a goal was seen."""
        state = self._model.decode(bytes(self._block))
        known = {
            name: getattr(state, name) if now - self._at.get(name, -math.inf) <= limit else math.nan
            for name, limit in FRESH_S.items()
        }
        return state._replace(command=state.command if self.has_command else state.position, **known)
