"""What the CANopen node answers (CiA 301): SDO uploads of its object dictionary, and NMT commands.  No I/O, no clock.

Frames sent unasked are in ``emcy.py``.  ``lostmotion.eds`` describes the same objects.  Why it is not canopen's
LocalNode: docs/decisions/0011-dependencies.md.
"""

from __future__ import annotations

import platform
import struct

from lostmotion import __version__
from lostmotion.daemon.sinks.emcy import EmcyNode, Frame
from lostmotion.drivers.codec.cia301 import BOOT_UP, EMCY, NMT, OPERATIONAL, PRE_OPERATIONAL, STOPPED, TPDO1
from lostmotion.drivers.codec.sdo import (
    NO_OBJECT,
    NO_SUBINDEX,
    READ_ONLY,
    REQUEST,
    RESPONSE,
    WRONG_VALUE,
    Abort,
    SdoServer,
)

__all__ = ["Node"]

NMT_NODE, NMT_SIZE = 0, 2
"""the node number that means all; bytes of a command"""
COMMANDS = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL, 129: BOOT_UP, 130: BOOT_UP}
ERRORS = (0x1003, 0)
PRODUCT = int.from_bytes(b"lm", "big")
STATE_MAP = (0x20000108, 0x20000208, 0x20000310, 0x20000410)
"""TPDO1 as mapping parameters: joint, health, severity, play"""
EVENT_DRIVEN = 255


class Node:
    """The node's NMT state and objects.  It starts by itself: after boot-up it is operational.

    Stopped it sends nothing but heartbeats; pre-operational no states of joints.
    """

    def __init__(self, emcy: EmcyNode, node_id: int, heartbeat_s: float) -> None:
        self.state = OPERATIONAL
        self._emcy, self._id = emcy, node_id
        self._heartbeat_ms = round(heartbeat_s * 1000)
        self._server = SdoServer(self._read, self._write)

    def receive(self, cob_id: int, data: bytes) -> tuple[list[Frame], bool]:
        """What a frame is answered with, and whether the joints' states are to be sent again."""
        if cob_id == NMT and len(data) == NMT_SIZE and data[1] in (NMT_NODE, self._id):
            return self._command(data[0])
        if cob_id == REQUEST + self._id and self.state != STOPPED and (answer := self._server.answer(data)):
            return [Frame(RESPONSE + self._id, answer)], False
        return [], False

    def _command(self, command: int) -> tuple[list[Frame], bool]:
        before, state = self.state, COMMANDS.get(command)
        if state is None:
            return [], False
        self.state = OPERATIONAL if state == BOOT_UP else state
        frames = [self._emcy.heartbeat(BOOT_UP)] if state == BOOT_UP else []
        if state == BOOT_UP or (before == STOPPED and state != STOPPED):
            frames += self._emcy.everything()
        return frames, self.state == OPERATIONAL and (state == BOOT_UP or before != OPERATIONAL)

    def _read(self, index: int, subindex: int) -> bytes:
        objects = self._objects()
        if index not in objects:
            raise Abort(NO_OBJECT)
        values = objects[index]
        if subindex >= len(values):
            raise Abort(NO_SUBINDEX)
        return values[subindex]

    def _write(self, index: int, subindex: int, data: bytes) -> None:
        """Only the error history can be written: 0 deletes it."""
        self._read(index, subindex)
        if (index, subindex) != ERRORS:
            raise Abort(READ_ONLY)
        if data != b"\0":
            raise Abort(WRONG_VALUE)
        self._emcy.history.clear()

    def _objects(self) -> dict[int, list[bytes]]:
        """All objects, their values by subindex."""
        node, emcy = self._id, self._emcy
        major, minor = (int(part) for part in __version__.split(".")[:2])
        joint, health, severity, play = struct.unpack("<BBHH", emcy.last_state)
        return {
            0x1000: [_u32(0)],
            0x1001: [bytes([emcy.register])],
            0x1003: _record(*(_u32(code | joint << 16) for code, joint in emcy.history)),
            0x1008: [b"lostmotion"],
            0x1009: [platform.machine().encode()],
            0x100A: [__version__.encode()],
            0x1014: [_u32(EMCY + node)],
            0x1017: [self._heartbeat_ms.to_bytes(2, "little")],
            0x1018: _record(_u32(0), _u32(PRODUCT), _u32(major << 16 | minor), _u32(0)),
            0x1200: _record(_u32(REQUEST + node), _u32(RESPONSE + node)),
            0x1800: _record(_u32(TPDO1 + node), bytes([EVENT_DRIVEN])),
            0x1A00: _record(*map(_u32, STATE_MAP)),
            0x2000: _record(bytes([joint]), bytes([health]), _u16(severity), _u16(play)),
        }


def _record(*values: bytes) -> list[bytes]:
    return [bytes([len(values)]), *values]


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def _u16(value: int) -> bytes:
    return value.to_bytes(2, "little")
