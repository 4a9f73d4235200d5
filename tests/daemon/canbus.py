"""Far ends of a CAN bus: an slcan adapter behind a pseudo-terminal, a socketcand server, and a bus that can go off."""

from __future__ import annotations

import math
import re
import socket
import threading
from typing import Any

import can
from can.interfaces.virtual import VirtualBus

JOINTS = ("shoulder", "elbow")


class SlcanAdapter:
    """A device for the emulator: keeps the frames that the host sends, as (identifier, data)."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []
        self._text = ""

    def receive(self, data: bytes, now: float) -> None:
        *lines, self._text = (self._text + data.decode(errors="replace")).split("\r")
        for line in lines:
            if found := re.fullmatch(r"t([0-9A-F]{3})(\d)([0-9A-F]*)", line):
                self.frames.append((int(found[1], 16), bytes.fromhex(found[3])))

    def due(self) -> float:
        return math.inf

    def emit(self, now: float) -> bytes:
        return b""

    def emergencies(self, node: int = 0x21) -> list[int]:
        """The error codes that the node has sent."""
        return [int.from_bytes(data[:2], "little") for number, data in self.frames if number == 0x80 + node]


class SocketcandServer:
    """Serves one client on loopback and keeps what it sends, until closed."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.text = ""
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        client, _ = self._listener.accept()
        with client:
            client.sendall(b"< hi >")
            while data := client.recv(4096).decode():
                self.text += data
                if "open" in data or "rawmode" in data:
                    client.sendall(b"< ok >")

    def close(self) -> None:
        self._listener.close()
        self._thread.join(5.0)


class FaultyBus(VirtualBus):
    """A virtual bus whose controller may be off, as Linux reports it: no room in the queue, or the network is down."""

    error_code: int | None = None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.error_code is not None:
            raise can.CanOperationError("Failed to transmit", self.error_code)
        super().send(msg, timeout)


def frame_of(network: can.BusABC, cob_id: int, timeout_s: float = 10.0) -> Any:
    """The next frame with that identifier."""
    while message := network.recv(timeout_s):
        if message.arbitration_id == cob_id:
            return message
    raise AssertionError(f"no frame 0x{cob_id:X} within {timeout_s} s")
