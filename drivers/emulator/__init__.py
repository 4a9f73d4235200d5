"""Devices that answer byte by byte on a pseudo-terminal, so that the real drivers run end to end without hardware.

    from lostmotion.drivers.emulator import Emulator, Motion, ServoLine, CsvStream

    motion = Motion(play=1.0)
    with Emulator(ServoLine.of("AX-12A", [1, 2, 3], motion), CsvStream(motion, 1000)) as emulator:
        servos, accelerometer = emulator.paths

``python -m lostmotion.drivers.emulator --help`` does the same from a shell.
"""

from lostmotion.drivers.emulator.canopen import CanopenLine, VirtualDrive
from lostmotion.drivers.emulator.feetech import FeetechLine, VirtualFeetech
from lostmotion.drivers.emulator.iio import IioEmulator, IioSensor
from lostmotion.drivers.emulator.mastered import MasteredLine, Tap, TappedLine
from lostmotion.drivers.emulator.motion import Motion, Taps
from lostmotion.drivers.emulator.server import Device, Emulator
from lostmotion.drivers.emulator.servos import ServoLine, VirtualServo
from lostmotion.drivers.emulator.streams import CsvStream, TextStream, WitMotionStream

__all__ = [
    "CanopenLine",
    "CsvStream",
    "Device",
    "Emulator",
    "FeetechLine",
    "IioEmulator",
    "IioSensor",
    "MasteredLine",
    "Motion",
    "ServoLine",
    "Tap",
    "TappedLine",
    "Taps",
    "TextStream",
    "VirtualDrive",
    "VirtualFeetech",
    "VirtualServo",
    "WitMotionStream",
]
