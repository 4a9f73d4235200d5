"""Driver of ROBOTIS Dynamixel servos: AX and MX on protocol 1.0, X and MX on protocol 2.0, also mixed on one line.

It only reads; it never moves a servo.  The schedule of requests is in ``servo_line.py``, the port in
``dynamixel_port.py``, models and units in ``codec/servo_state.py``.  Packets are made and checked by dynamixel-sdk, but
for the one question that is put to each servo of protocol 1.0 at every poll: a sync read, which 1.0 has not, would ask
all at once.
"""

from __future__ import annotations

from collections.abc import Sequence

from dynamixel_sdk import COMM_RX_TIMEOUT, COMM_SUCCESS, Protocol1PacketHandler, Protocol2PacketHandler

from lostmotion.drivers.base import Driver, JointOptions, RobotOptions, ServoBus
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec.servo_state import ADDRESS, MODELS, model_name
from lostmotion.drivers.dynamixel_port import BusPort
from lostmotion.drivers.servo_line import LineBus, LineOptions, Reply, Servo, line_bytes

__all__ = ["DRIVER", "DynamixelOptions"]

PACKET_ID, PACKET_DATA = 4, 9
"""where the SDK's list of a status packet of protocol 2.0 holds them"""


class DynamixelOptions(LineOptions, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Keys of a joint with a Dynamixel servo; see ``servo_line.LineOptions``."""

    def line_bytes(self) -> int:
        """An answer, and the question where the servo obeys no sync read."""
        return line_bytes(MODELS[self.model]) if self.model in MODELS else 0


class DynamixelBus(LineBus):
    """All Dynamixel servos on one port; see ``servo_line.LineBus``.  Those of protocol 2.0 obey a sync read."""

    def __init__(self, joints: Sequence[DynamixelOptions], clock: Clock) -> None:
        """Raises DriverError for an unknown model, an id used twice or different baud rates."""
        self._port = BusPort(joints[0].port, joints[0].baudrate)
        self._handlers = {1: Protocol1PacketHandler(), 2: Protocol2PacketHandler()}
        super().__init__(joints, MODELS, self._port, clock)

    def _found(self, servo: Servo) -> str | None:
        """The model number that answers at this id and the protocol it speaks, its own one first."""
        own = servo.model.protocol
        for protocol in (own, 3 - own):
            number, result, _ = self._handlers[protocol].ping(self._port, servo.id)
            if result == COMM_SUCCESS:
                return self._description(number, protocol)
        return None

    def _description(self, number: int, protocol: int) -> str:
        return f"{model_name(number)}, protocol {protocol}.0"

    def _search(self, servo: Servo) -> Sequence[int]:
        data: Sequence[int]
        data, _, _ = self._handlers[1].readRx(self._port, servo.id, servo.model.block_size)
        return data

    def _read_alone(self, servo: Servo) -> Sequence[int]:
        data: Sequence[int]
        data, _, _ = self._handlers[2].readTxRx(self._port, servo.id, ADDRESS[2], servo.model.block_size)
        return data

    def _sync_read(self, missing: dict[int, Servo], replies: list[Reply]) -> None:
        """The SDK's group reader is no use: with one silent servo it gives 0 for all, without error."""
        servos = list(missing.values())
        handler, now, size = self._handlers[2], self._clock.now(), servos[0].model.block_size
        handler.syncReadTx(self._port, ADDRESS[2], size, list(missing), len(missing), False)
        for _ in servos:
            packet, result = handler.rxPacket(self._port, False)
            if result == COMM_RX_TIMEOUT:
                break
            if result == COMM_SUCCESS and (servo := missing.pop(packet[PACKET_ID], None)):
                self._take(servo, now, packet[PACKET_DATA : PACKET_DATA + size], replies)


def _make(joints: Sequence[JointOptions], robot: RobotOptions, clock: Clock) -> ServoBus:
    return DynamixelBus([joint for joint in joints if isinstance(joint, DynamixelOptions)], clock)


DRIVER = Driver(
    name="dynamixel",
    summary="ROBOTIS Dynamixel AX, MX (protocol 1.0 and 2.0) and X series",
    servo=_make,
    joint_options=DynamixelOptions,
)
