"""Feetech servos on one line, byte for byte.  Lines, faults and protocol 1.0's frames are in ``servos.py``."""

from __future__ import annotations

from struct import unpack

from lostmotion.drivers.codec.dynamixel import BROADCAST, PING, Packet
from lostmotion.drivers.codec.feetech import (
    IDENTITY,
    MODELS,
    NUMBER,
    FeetechModel,
    number_bytes,
    signed,
)
from lostmotion.drivers.emulator.motion import Motion
from lostmotion.drivers.emulator.servos import ServoLine, VirtualServo

__all__ = ["FeetechLine", "VirtualFeetech"]

FIRMWARE = b"\x03\x0a"
ID_ADDRESS = 5


class VirtualFeetech(VirtualServo):
    """One servo: what a Feetech servo's control table holds."""

    def __init__(self, model: FeetechModel, id: int, motion: Motion, ahead: float = 0.0) -> None:
        self._kind = model
        super().__init__(model, id, motion, ahead)

    def answer(self, packet: Packet, now: float) -> Packet | None:
        """As any servo, but for SCS, which answer no ping for all."""
        if packet.id == BROADCAST and packet.code == PING and self._kind.order == ">":
            return None
        return super().answer(packet, now)

    def _label(self) -> None:
        self._table[IDENTITY : IDENTITY + NUMBER] = FIRMWARE + bytes((self._kind.order == ">",))
        self._table[NUMBER:ID_ADDRESS] = number_bytes(self._kind)
        self._table[ID_ADDRESS] = self.id

    def _goal(self, parameters: bytes) -> tuple[int, int] | None:
        if len(parameters) != 3:
            return None
        address, goal = unpack(f"{self._kind.order}BH", parameters)
        return address, signed(goal)


class FeetechLine(ServoLine):
    """All Feetech servos on one line; STS and SMS obey a sync read."""

    @staticmethod
    def _servo(model: str, id: int, motion: Motion, ahead: float) -> VirtualServo:
        return VirtualFeetech(MODELS[model], id, motion, ahead)
