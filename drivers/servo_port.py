"""The port of a line of servos: a question at a time, its answer until a deadline, waiting instead of spinning.

What is asked, and what the bytes mean, is the affair of the driver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence

from lostmotion.drivers.base import BITS_PER_BYTE
from lostmotion.drivers.serial_port import Exchange, SerialPort

__all__ = ["ServoPort"]

LATENCY_S = 0.034
"""how long an answer may take beyond its bytes: twice the 16 ms of an FTDI adapter as shipped"""


class ServoPort:
    """A port on which servos only answer requests.  Every method may raise PortError."""

    def __init__(self, path: str, baudrate: int) -> None:
        self._port = SerialPort(path, baudrate)
        self._byte_s = BITS_PER_BYTE / baudrate
        self._deadline = 0.0
        self._received = b""
        self._quiet = False  # whether nothing but answers has come in

    def open(self) -> None:
        """Takes the port, and forgets an exchange that was cut off."""
        self._port.open()
        self._quiet = False
        self._received = b""

    def close(self) -> None:
        """Gives the port back."""
        self._port.close()

    def listen(self, seconds: float) -> bytes:
        """What comes in without being asked for."""
        end = time.monotonic() + seconds
        received = b""
        while not received and (left := end - time.monotonic()) > 0:
            received = self._port.read(left)
        return received

    def ask(
        self, exchanges: Sequence[Exchange], now: Callable[[], float], turns: Iterable[None] = (None,)
    ) -> tuple[list[tuple[float, bytes]], bool]:
        """Asks one servo after the other in each turn: the time ``now`` of each request, and what came in; whether all
        of that looks like answers: see ``SerialPort.converse``.

        What does not is the last one; ``receive`` has it, too, and what follows.  What came in before is forgotten
        only after an exchange that went another way: that costs a system call.
        """
        if not self._quiet:
            self.clear()
        length = exchanges[0].length
        answers, self._quiet = self._port.converse(exchanges, self._patience(length), now, turns)
        if not self._quiet:
            self._received = answers[-1][1]
            self._expect(length)
        return answers, self._quiet

    def receive(self) -> bytes:
        """What has come in; waits for it until the deadline, and is empty then, also if a stream never ends."""
        left = self._deadline - time.monotonic()
        if left <= 0:
            self._received = b""
            return b""
        data, self._received = self._received, b""
        return data or self._port.read(left)

    def clear(self) -> None:
        """Forgets what has come in."""
        self._quiet = False
        self._port.discard_input()
        self._received = b""

    def _expect(self, length: int) -> None:
        """An answer of so many bytes is expected from now on."""
        self._deadline = time.monotonic() + self._patience(length)

    def _patience(self, length: int) -> float:
        """How long an answer of so many bytes may take [s]."""
        return length * self._byte_s + LATENCY_S
