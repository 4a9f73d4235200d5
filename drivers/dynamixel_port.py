"""A port as dynamixel-sdk's packet handlers want it, that waits instead of spinning.

The SDK's own ``PortHandler`` reads with a timeout of 0 and so burns a core until the answer is there; it keeps time by
a clock that may step, knows a few baud rates only, and does not survive unplugging.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from lostmotion.drivers.serial_port import Exchange, SerialPort

__all__ = ["BusPort"]

BITS_PER_BYTE = 10
LATENCY_S = 0.034
"""how long an answer may take beyond its bytes: the SDK's figure, twice the 16 ms of an FTDI adapter as shipped"""


class BusPort:
    """What ``Protocol1PacketHandler`` and ``Protocol2PacketHandler`` of dynamixel-sdk 4.1.0 call.

    Every method may raise PortError.
    """

    def __init__(self, path: str, baudrate: int) -> None:
        self.is_using = False
        self._port = SerialPort(path, baudrate)
        self._byte_s = BITS_PER_BYTE / baudrate
        self._deadline = 0.0
        self._received = b""
        self._quiet = False  # whether nothing but answers has come in

    def open(self) -> None:
        """Takes the port, and forgets an exchange that was cut off."""
        self._port.open()
        self.is_using = self._quiet = False
        self._received = b""

    def close(self) -> None:
        """Gives the port back."""
        self._port.close()

    def listen(self, seconds: float) -> bytes:
        """What comes in without being asked for."""
        end = time.monotonic() + seconds
        heard = b""
        while not heard and (left := end - time.monotonic()) > 0:
            heard = self._port.read(left)
        return heard

    def ask(self, exchanges: Sequence[Exchange], now: Callable[[], float]) -> tuple[list[tuple[float, bytes]], bool]:
        """Asks one servo after the other: the time ``now`` of each request, and what came in; whether all of that looks
        like answers: see ``SerialPort.converse``.

        What does not is the last one; ``readPort`` has it, too, and what follows.  What came in before is forgotten
        only after an exchange that went another way: that costs a system call.
        """
        if not self._quiet:
            self.clearPort()
        length = exchanges[0].length
        heard, self._quiet = self._port.converse(exchanges, self._patience(length), now)
        if not self._quiet:
            self._received = heard[-1][1]
            self.setPacketTimeout(length)
        return heard, self._quiet

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name, as those below
        """Forgets what has come in."""
        self._quiet = False
        self._port.discard_input()
        self._received = b""

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
        self._deadline = time.monotonic() + self._patience(packet_length)

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the answer should have come by now."""
        return time.monotonic() >= self._deadline

    def _patience(self, length: int) -> float:
        """How long an answer of so many bytes may take [s]."""
        return length * self._byte_s + LATENCY_S
