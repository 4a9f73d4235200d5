"""Probes one serial port: what it sends unasked, then what answers requests, within a time."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from lostmotion.drivers.errors import PortError
from lostmotion.drivers.probe import servos, streams
from lostmotion.drivers.probe.servos import FoundServo
from lostmotion.drivers.probe.streams import Chatter, FoundSensor
from lostmotion.drivers.serial_port import SerialPort

__all__ = ["LONGEST_S", "Look", "look"]

LONGEST_S = 90.0
"""for one port; servos at two baud rates with an adapter as shipped take 40"""
ALIKE = 3
"""at so many baud rates the same servos answer: the port does not care for baud rates (USB inside, or an emulator)"""
LISTENING = 0.1
"""share of the work that goes to listening, where nothing is received"""

Step = Callable[[float], None]


class _TimeOver(Exception):  # noqa: N818 - an ending, not an error
    """The port has had its time."""


@dataclass(frozen=True, slots=True)
class Look:
    """What was found on a port; error: why it could not be looked into; complete: False when the time was over before
    all was asked."""

    servos: tuple[FoundServo, ...] = ()
    sensor: FoundSensor | None = None
    chatter: Chatter | None = None
    error: str = ""
    complete: bool = True


def look(path: str, progress: Step, longest_s: float = LONGEST_S) -> Look:
    """Listens first; only a silent port is asked.  progress: gets the share of the work that is done."""
    end = time.monotonic() + longest_s

    def step(share: float) -> None:
        if time.monotonic() > end:
            raise _TimeOver
        progress(share)

    try:
        found = streams.probe(path, step)
    except PortError as error:
        return Look(error=str(error))
    except _TimeOver:
        return Look(complete=False)
    if isinstance(found, FoundSensor):
        return Look(sensor=found)
    return Look(chatter=found) if found is not None else _ask(path, step)


def _cares_not(found: list[FoundServo]) -> tuple[FoundServo, ...]:
    """The servos at the first of the baud rates, where all have answered alike at ALIKE of them; else none."""
    rates = dict.fromkeys(servo.baudrate for servo in found)
    groups = [[replace(servo, baudrate=0) for servo in found if servo.baudrate == rate] for rate in rates]
    if len(groups) < ALIKE or any(group != groups[0] for group in groups):
        return ()
    return tuple(found[: len(groups[0])])


def _ask(path: str, step: Step) -> Look:
    found, last = list[FoundServo](), ""
    for i, baudrate in enumerate(servos.RATES):

        def part(share: float, i: int = i) -> None:
            step(LISTENING + (1 - LISTENING) * (i + share) / len(servos.RATES))

        port = SerialPort(path, baudrate)
        try:
            port.open()
            found += servos.servos_at(port, part)
            if once := _cares_not(found):
                return Look(once)
        except PortError as error:  # not every adapter has every baud rate
            last = str(error)
        except _TimeOver:
            return Look(tuple(found), complete=False)
        finally:
            with suppress(PortError):
                port.close()
    return Look(tuple(found), error="" if found else last)
