"""A port as dynamixel-sdk's packet handlers want it, that waits instead of spinning.

The SDK's own ``PortHandler`` reads with a timeout of 0 and so burns a core until the answer is there; it keeps time by
a clock that may step, knows a few baud rates only, and does not survive unplugging.
"""

from __future__ import annotations

import time

from lostmotion.drivers.servo_port import ServoPort

__all__ = ["BusPort"]


class BusPort(ServoPort):
    """What ``Protocol1PacketHandler`` and ``Protocol2PacketHandler`` of dynamixel-sdk 4.1.0 call.

    Every method may raise PortError.
    """

    def __init__(self, path: str, baudrate: int) -> None:
        super().__init__(path, baudrate)
        self.is_using = False

    def open(self) -> None:
        """Takes the port, and forgets an exchange that was cut off."""
        super().open()
        self.is_using = False

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name, as those below
        """Forgets what has come in."""
        self.clear()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Sends a packet."""
        return self._port.write(bytes(packet))

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Up to ``length`` bytes; waits for them until the deadline, and no longer if a stream never ends."""
        if length <= 0:  # the SDK asks for less than nothing after a packet with a wrong length
            return b""
        if len(self._received) < length:
            left = self._deadline - time.monotonic()
            if left <= 0:
                self._received = b""
                return b""
            self._received += self._port.read(left)
        data, self._received = self._received[:length], self._received[length:]
        return data

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """An answer of so many bytes is expected from now on."""
        self._expect(packet_length)

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the answer should have come by now."""
        return time.monotonic() >= self._deadline
