"""Where servos keep command, position and the rest, and a servo's state as far as its registers were seen.

A polled servo is asked for its whole state block; a listener sees only what its master asks for and writes.  Source: as
of ``servo_state.py`` and ``feetech.py``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from lostmotion.drivers.codec import feetech
from lostmotion.drivers.codec.servo_state import MODELS, Model, ServoState, decode_state

__all__ = ["ALL_MODELS", "POSITION", "Registers"]

Places = Mapping[str, tuple[int, int]]
"""address and size of values, by their names in ``ServoState``"""
COMMAND, POSITION, TRAJECTORY = "command", "position", "trajectory"
DYNAMIXEL: Mapping[int, Places] = {
    1: {COMMAND: (30, 2), POSITION: (36, 2), "velocity": (38, 2), "voltage": (42, 1), "temperature": (43, 1)},
    2: {
        COMMAND: (116, 4), "current": (126, 2), "velocity": (128, 4), POSITION: (132, 4), TRAJECTORY: (136, 8),
        "voltage": (144, 2), "temperature": (146, 1),
    },
}  # fmt: skip
"""the trajectory is what the servo follows while a profile is on: its speed and its position"""
SCS: Places = {
    COMMAND: (42, 2), POSITION: (56, 2), "velocity": (58, 2), "voltage": (62, 1), "temperature": (63, 1),
}  # fmt: skip
STS: Places = {**SCS, "current": (69, 2)}
ALL_MODELS: Mapping[str, Model] = MODELS | feetech.MODELS
FRESH_S = {"velocity": 0.1, "current": 0.1, "voltage": 60.0, "temperature": 60.0}
"""so long a value that is read beside the position is taken for the present one"""


class Registers:
    """What is known of one servo's registers, and since when."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._block = bytearray(model.block_size)
        self._places = _places(model)
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
        state = self._decoded()
        known = {
            name: getattr(state, name) if now - self._at.get(name, -math.inf) <= limit else math.nan
            for name, limit in FRESH_S.items()
        }
        return state._replace(command=state.command if self.has_command else state.position, **known)

    def _decoded(self) -> ServoState:
        if isinstance(self._model, feetech.FeetechModel):
            return feetech.decode_state(self._model, bytes(self._block))
        return decode_state(self._model, bytes(self._block))


def _places(model: Model) -> Places:
    if isinstance(model, feetech.FeetechModel):
        return STS if model.order == "<" else SCS
    return DYNAMIXEL[model.protocol]
