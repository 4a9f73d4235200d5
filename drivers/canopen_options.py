"""Keys of devices on a CANopen bus, and of signals on any CAN bus.  Opens nothing."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from lostmotion.drivers.base import AccelerometerOptions, JointOptions, Port

__all__ = ["CanopenJointOptions", "CanopenSensorOptions", "PdoOptions", "SignalLayout", "SignalOptions"]

Node = Annotated[int, msgspec.Meta(ge=1, le=127)]
CobId = Annotated[int, msgspec.Meta(ge=1, le=0x7FF)]
CanId = Annotated[int, msgspec.Meta(ge=0, le=0x1FFFFFFF)]
Bitrate = Annotated[int, msgspec.Meta(gt=0)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
Given = dict[str, str | int | float | bool]


class PdoOptions(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One PDO: its identifier, and what it holds as in 0x1A00 or 0x1600 of the drive: 0x60640020 is object 0x6064,
    subindex 0, 32 bits."""

    cob_id: CobId
    map: list[int]


class CanopenJointOptions(JointOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """port, interface, bitrate, options: the bus (``can_port.CanOptions``); node: of the drive.

    The mapping of its PDOs: pdo; or eds, a file of it (EDS, DCF); or sdo, which lets it be read from the drive.
    counts_per_turn: of 0x6064 for one turn of the motor; gear_ratio: turns of the motor for one of the joint, negative
    where it turns the other way; rated_torque_nm, rated_current_a: of which 0x6077 and 0x6078 are thousandths; command:
    0x6062 ("demand"), 0x607A ("target"), or what is mapped, in this order; heartbeat_s: a drive that sends heartbeats
    is gone when none came for so long [s].
    """

    port: Port
    interface: str = "socketcan"
    bitrate: Bitrate | None = None
    options: Given = msgspec.field(default_factory=dict)
    node: Node
    pdo: list[PdoOptions] = msgspec.field(default_factory=list)
    eds: str = ""
    sdo: bool = False
    counts_per_turn: Positive | None = None
    gear_ratio: float | None = None
    velocity_unit: Literal["counts/s", "rpm"] = "counts/s"
    rated_torque_nm: Positive | None = None
    rated_current_a: Positive | None = None
    command: Literal["auto", "demand", "target"] = "auto"
    heartbeat_s: Positive = 3.0


class CanopenSensorOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bus, node and mapping, by pdo or eds, as of a joint; object, subindex: the process value of a CiA 404 device
    (0x7130: 16 bits, 0x9130: 32); scale: m/s² per unit, negative to turn its sign; range_ms2: the largest acceleration
    that the sensor can show [m/s²]."""

    port: Port
    interface: str = "socketcan"
    bitrate: Bitrate | None = None
    options: Given = msgspec.field(default_factory=dict)
    node: Node
    pdo: list[PdoOptions] = msgspec.field(default_factory=list)
    eds: str = ""
    object: Annotated[int, msgspec.Meta(ge=0x1000, le=0xFFFF)] = 0x7130
    subindex: Annotated[int, msgspec.Meta(ge=0, le=255)] = 1
    scale: float = 1.0
    range_ms2: Positive = math.inf


class SignalLayout(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bits of a frame as a DBC file counts them, those of each byte from its lowest: start_bit is the lowest bit of a
    "little" one, the highest of a "big" one."""

    start_bit: Annotated[int, msgspec.Meta(ge=0, le=63)] = 0
    length: Annotated[int, msgspec.Meta(ge=1, le=64)] = 16
    byte_order: Literal["little", "big"] = "little"
    signed: bool = True


class SignalOptions(AccelerometerOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The bus; then the signal: id (of 29 bits from 0x800 on), signal, scale [m/s² per unit], offset [m/s²], and
    counter, bits that go up by one with each frame; or dbc, a file, message and dbc_signal in it, whose unit is m/s², g
    or mg; range_ms2: the largest acceleration that the sensor can show [m/s²]."""

    port: Port
    interface: str = "socketcan"
    bitrate: Bitrate | None = None
    options: Given = msgspec.field(default_factory=dict)
    id: CanId | None = None
    signal: SignalLayout = SignalLayout()
    scale: float = 1.0
    offset: float = 0.0
    counter: SignalLayout | None = None
    dbc: str = ""
    message: str = ""
    dbc_signal: str = ""
    range_ms2: Positive = math.inf
