"""Which Dynamixel models there are, and what the bytes of their state block mean in SI units.

``dynamixel.py`` has the packets.  Source: ROBOTIS e-Manual, control tables of the AX, MX and X series.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from struct import Struct
from typing import NamedTuple

__all__ = [
    "ADDRESS",
    "COMMAND",
    "MODELS",
    "POSITION",
    "TRAJECTORY",
    "ControlTable",
    "Model",
    "ServoState",
    "model_name",
]

RPM = 2 * math.pi / 60
MILLI = 1e-3

BLOCK_1 = Struct("<hHHhHHBB")
"""from 30: goal, moving speed, torque limit, position, speed, load, voltage, temperature"""
BLOCK_2 = Struct("<iHBBhhiiiiHB")
"""from 116: goal, tick, moving, its status, PWM, current, velocity, position, both trajectories, voltage, heat"""
ADDRESS = {1: 30, 2: 116}
"""where the state block begins, by protocol"""
BLOCK = {1: BLOCK_1, 2: BLOCK_2}

ControlTable = Mapping[str, tuple[int, int]]
"""address and size of the values of a state, by their names in ``ServoState``"""
COMMAND, POSITION, TRAJECTORY = "command", "position", "trajectory"
CONTROL_TABLES: Mapping[int, ControlTable] = {
    1: {COMMAND: (30, 2), POSITION: (36, 2), "velocity": (38, 2), "voltage": (42, 1), "temperature": (43, 1)},
    2: {
        COMMAND: (116, 4), "current": (126, 2), "velocity": (128, 4), POSITION: (132, 4), TRAJECTORY: (136, 8),
        "voltage": (144, 2), "temperature": (146, 1),
    },
}  # fmt: skip
"""the trajectory is what the servo follows while a profile is on: its speed and its position"""
DIRECTION = 0x400
"""bit 10 of a speed of protocol 1.0 is its sign (set: clockwise, negative), bits 0-9 the magnitude"""


class ServoState(NamedTuple):
    """A state block in SI units: command and position [rad], velocity [rad/s], current [A], voltage [V],
    temperature [°C].

    There is no torque: AX and MX report a "load" that is the drive's own effort, not measured, so it would be a guess.
    """

    command: float
    position: float
    velocity: float
    voltage: float
    temperature: float
    current: float = math.nan


@dataclass(frozen=True, slots=True)
class Model:
    """One kind of servo.

    number: model number (address 0); protocol: 1 or 2; step: rad per count; centre: the count of 0 rad; speed: rad/s
    per count; ampere: A per count of the present current, NaN where the servo reports none.
    """

    name: str
    number: int
    protocol: int
    step: float
    centre: int
    speed: float
    ampere: float = math.nan

    @property
    def block_size(self) -> int:
        """Bytes of the state block."""
        return BLOCK[self.protocol].size

    @property
    def address(self) -> int:
        """Where the state block begins."""
        return ADDRESS[self.protocol]

    @property
    def syncs(self) -> bool:
        """Whether it obeys a sync read."""
        return self.protocol == 2

    @property
    def control_table(self) -> ControlTable:
        """Where the servo keeps the values of its state."""
        return CONTROL_TABLES[self.protocol]

    def decode(self, block: bytes) -> ServoState:
        """The state block of ``block_size`` bytes in SI units.  Raises struct.error for another size."""
        if self.protocol == 1:
            goal, _, _, position, speed, _, voltage, temperature = BLOCK_1.unpack(block)
            velocity, current = (DIRECTION - speed if speed & DIRECTION else speed), math.nan
        else:
            goal, *_, current, velocity, position, drift, trajectory, voltage, temperature = BLOCK_2.unpack(block)
            # With a profile switched on the servo follows its trajectory, not the goal; without one both read 0.
            goal = trajectory if trajectory or drift else goal
        return ServoState(
            (goal - self.centre) * self.step,
            (position - self.centre) * self.step,
            velocity * self.speed,
            voltage * 0.1,
            float(temperature),
            current * self.ampere,
        )

    def encode(self, state: ServoState) -> bytes:
        """The state block that a servo without a profile would show; the inverse of ``decode`` but for
        rounding."""
        goal = round(state.command / self.step) + self.centre
        position = round(state.position / self.step) + self.centre
        velocity = round(state.velocity / self.speed)
        voltage, temperature = round(state.voltage * 10), round(state.temperature)
        if self.protocol == 1:
            speed = min(abs(velocity), DIRECTION - 1) | (DIRECTION if velocity < 0 else 0)
            return BLOCK_1.pack(goal, 0, 1023, position, speed, 0, voltage, temperature)
        current = 0 if math.isnan(state.current) or math.isnan(self.ampere) else round(state.current / self.ampere)
        return BLOCK_2.pack(goal, 0, 1, 0, 0, current, velocity, position, 0, 0, voltage, temperature)


def _ax(name: str, number: int) -> Model:
    return Model(name, number, 1, math.radians(300 / 1024), 512, 0.111 * RPM)


def _mx(name: str, number: int) -> Model:
    return Model(name, number, 1, math.tau / 4096, 2048, 0.114 * RPM)


def _x(name: str, number: int, ampere: float = math.nan) -> Model:
    return Model(name, number, 2, math.tau / 4096, 2048, 0.229 * RPM, ampere)


MODELS = {
    model.name: model
    for model in (
        _ax("AX-12A", 12),
        _ax("AX-12W", 300),
        _ax("AX-18A", 18),
        _mx("MX-28", 29),
        _mx("MX-64", 310),
        _mx("MX-106", 320),
        _x("MX-28-2", 30),
        _x("MX-64-2", 311, 3.36 * MILLI),
        _x("MX-106-2", 321, 3.36 * MILLI),
        _x("XL330-M077", 1190, MILLI),
        _x("XL330-M288", 1200, MILLI),
        _x("XL430-W250", 1060),
        _x("XC430-W150", 1070),
        _x("XC430-W240", 1080),
        _x("XM430-W210", 1030, 2.69 * MILLI),
        _x("XM430-W350", 1020, 2.69 * MILLI),
        _x("XM540-W150", 1130, 2.69 * MILLI),
        _x("XM540-W270", 1120, 2.69 * MILLI),
        _x("XH430-W210", 1010, 2.69 * MILLI),
        _x("XH430-W350", 1000, 2.69 * MILLI),
    )
}
"""The models by name; "-2" is an MX with the firmware of protocol 2.0."""


def model_name(number: int, models: Mapping[str, Model] = MODELS) -> str:
    """A model number as a person reads it."""
    name = next((model.name for model in models.values() if model.number == number), "unknown model")
    return f"{name} (model number {number})"
