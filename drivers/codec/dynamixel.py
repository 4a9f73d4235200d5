"""Packets of the Dynamixel protocols 1.0 and 2.0: encoding, and decoding from a stream.

``servo_state.py`` decodes a servo's control table.  Source: ROBOTIS e-Manual, "DYNAMIXEL
Protocol 1.0" and "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from dataclasses import dataclass

from lostmotion.drivers.codec.stream import StreamDecoder

__all__ = [
    "BROADCAST",
    "PING",
    "READ",
    "STATUS",
    "SYNC_READ",
    "WRITE",
    "Packet",
    "Question",
    "crc16",
    "decoder",
    "encode",
]

PING, READ, WRITE, STATUS, SYNC_READ = 0x01, 0x02, 0x03, 0x55, 0x82
BROADCAST = 0xFE
MAX_LENGTH_1, MAX_LENGTH_2 = 250, 1024
"""the largest length byte, or word, that is taken for one; the SDK's limits"""

HEADER_1 = b"\xff\xff"
SUM_1 = 0xFD
"""of all bytes of a frame, modulo 256: the header's 0xFE and, with the checksum, 0xFF for the rest"""
HEADER_2 = b"\xff\xff\xfd\x00"
PATTERN = b"\xff\xff\xfd"


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet, whichever protocol.

    code: the instruction; in an answer the error byte (protocol 1.0) or STATUS (2.0, where the error is parameters[0]).
    """

    id: int
    code: int
    parameters: bytes = b""


class Question:
    """A read instruction of protocol 1.0, made once and asked often: ``request`` is its frame.

    The answer, which holds ``size`` parameters from ``address`` on, begins with ``start`` and is ``length`` bytes long.
    """

    def __init__(self, id: int, address: int, size: int) -> None:
        self.request = _encode_1(Packet(id, READ, bytes((address, size))))
        self.start = HEADER_1 + bytes((id, size + 2))
        self.length = size + 6

    def parameters(self, answer: bytes) -> bytes:
        """Those of a frame that is this answer and nothing else, whatever its error byte; else none."""
        whole = len(answer) == self.length and answer.startswith(self.start) and sum(answer) & 0xFF == SUM_1
        return answer[5:-1] if whole else b""


def encode(packet: Packet, protocol: int) -> bytes:
    """The frame of a packet in protocol 1 or 2.  Raises ValueError when it is too long."""
    return _encode_1(packet) if protocol == 1 else _encode_2(packet)


def decoder(protocol: int) -> StreamDecoder[Packet]:
    """A stream decoder for protocol 1 or 2."""
    if protocol == 1:
        return StreamDecoder(HEADER_1, _length_1, _decode_1)
    return StreamDecoder(HEADER_2, _length_2, _decode_2)


def _encode_1(packet: Packet) -> bytes:
    length = len(packet.parameters) + 2
    if length > MAX_LENGTH_1:
        raise ValueError(f"a packet of {length} bytes; protocol 1.0 takes {MAX_LENGTH_1}")
    body = bytes((packet.id, length, packet.code)) + packet.parameters
    return HEADER_1 + body + bytes((~sum(body) & 0xFF,))


def _length_1(buffer: bytearray, at: int) -> int | None:
    if len(buffer) - at < 4:
        return None
    if buffer[at + 2] == 0xFF or not 2 <= buffer[at + 3] <= MAX_LENGTH_1:
        return 0
    return buffer[at + 3] + 4


def _decode_1(frame: bytes) -> Packet | None:
    if sum(frame[2:]) & 0xFF != 0xFF:  # the checksum is the complement of the sum
        return None
    return Packet(frame[2], frame[4], frame[5:-1])


def _encode_2(packet: Packet) -> bytes:
    body = (bytes((packet.code,)) + packet.parameters).replace(PATTERN, PATTERN + b"\xfd")
    length = len(body) + 2
    if length > MAX_LENGTH_2:
        raise ValueError(f"a packet of {length} bytes; protocol 2.0 takes {MAX_LENGTH_2}")
    frame = HEADER_2 + bytes((packet.id,)) + length.to_bytes(2, "little") + body
    return frame + crc16(frame).to_bytes(2, "little")


def _length_2(buffer: bytearray, at: int) -> int | None:
    if len(buffer) - at < 7:
        return None
    length = buffer[at + 5] | buffer[at + 6] << 8
    return length + 7 if 3 <= length <= MAX_LENGTH_2 else 0


def _decode_2(frame: bytes) -> Packet | None:
    if crc16(frame[:-2]) != int.from_bytes(frame[-2:], "little"):
        return None
    body = frame[7:-2].replace(PATTERN + b"\xfd", PATTERN)
    return Packet(frame[4], body[0], body[1:])


def _crc_row(byte: int) -> int:
    register = byte << 8
    for _ in range(8):
        register = (register << 1) ^ (0x8005 if register & 0x8000 else 0)
    return register & 0xFFFF


CRC_TABLE = tuple(_crc_row(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x8005, initial value 0, not reflected (CRC-16/BUYPASS), as protocol 2.0 has it."""
    crc = 0
    for byte in data:
        crc = (crc << 8 & 0xFFFF) ^ CRC_TABLE[crc >> 8 ^ byte]
    return crc
