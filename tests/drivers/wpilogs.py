"""Data logs of WPILib, written as the specification of the format has it, for tests."""

from __future__ import annotations

import struct

import numpy as np

__all__ = ["CYCLE_S", "HEADER", "TESTS", "Log", "double", "of_sysid"]

HEADER = bytes.fromhex("5750494c4f47 0001 00000000")
CYCLE_S, TESTS = 0.02, ("quasistatic-forward", "quasistatic-reverse", "dynamic-forward", "dynamic-reverse")


class Log:
    """Writes a data log, as the specification has it."""

    def __init__(self, extra: bytes = b"") -> None:
        self.data = HEADER[:8] + struct.pack("<I", len(extra)) + extra
        self._numbers: dict[str, int] = {}

    def record(self, number: int, time_us: int, held: bytes) -> None:
        """Number, length and time in as few bytes as they need."""
        parts = [part.to_bytes(max((part.bit_length() + 7) // 8, 1), "little") for part in (number, len(held), time_us)]
        lengths = [len(part) - 1 for part in parts]
        self.data += bytes([lengths[0] | lengths[1] << 2 | lengths[2] << 4]) + b"".join(parts) + held

    def start(self, name: str, kind: str, metadata: str = "") -> None:
        """A new entry."""
        self._numbers[name] = number = len(self._numbers) + 1
        texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (name, kind, metadata))
        self.record(0, 0, struct.pack("<BI", 0, number) + texts)

    def append(self, name: str, time_s: float, held: bytes) -> None:
        """A record of an entry."""
        self.record(self._numbers[name], round(time_s * 1e6), held)


def double(*values: float) -> bytes:
    """As they are written."""
    return struct.pack(f"<{len(values)}d", *values)


def of_sysid() -> tuple[Log, list[tuple[np.ndarray, np.ndarray]]]:
    """A mechanism that SysId tests four times, with pauses, and the volts and turns of each test; other entries come
    between, and the third test is interrupted at first."""
    log, found = Log(b"of a test"), list[tuple[np.ndarray, np.ndarray]]()
    log.start("voltage-arm-lift", "double", "Volt")
    log.start("position-arm-lift", "double", "Rotations")
    log.start("sysid-test-state-lift", "string")
    log.start("DS:enabled", "boolean")
    log.start("NT:/pose", "double[]")
    time = 2.0
    for test in (*TESTS[:2], "interrupted", *TESTS[2:]):
        count, sign = (5 if test == "interrupted" else 100), -1 if "reverse" in test else 1
        volts = sign * (np.full(count, 7.0) if "dynamic" in test else 0.02 * np.arange(1.0, count + 1))
        turns = np.cumsum(volts) * CYCLE_S / 2
        for volt, turn in zip(volts, turns, strict=True):
            time += CYCLE_S
            log.append("voltage-arm-lift", time, double(volt))
            log.append("position-arm-lift", time + 1e-4, double(turn))
            log.append("NT:/pose", time, double(1.0, turn))
            log.append("DS:enabled", time, b"\x01")
            log.append("sysid-test-state-lift", time + 2e-4, (TESTS[2] if count == 5 else test).encode())
        log.append("sysid-test-state-lift", time + 3e-4, b"none")
        found += [(volts, turns)] * (count > 5)
        for _ in range(50):
            time += CYCLE_S
            log.append("position-arm-lift", time, double(turns[-1]))
    return log, found
