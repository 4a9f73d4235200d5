"""The table of drivers that the suite runs on.  A new driver is one more row."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from lostmotion.drivers.base import Accelerometer, ServoBus
from lostmotion.drivers.conformance import Subject
from lostmotion.drivers.emulator import (
    CanopenLine,
    CsvStream,
    Device,
    Emulator,
    FeetechLine,
    IioEmulator,
    IioSensor,
    MasteredLine,
    Motion,
    ServoLine,
    TextStream,
    WitMotionStream,
)
from lostmotion.drivers.emulator.ros2 import Ros2Robot

__all__ = ["CASES", "Case", "Rig", "make", "plugged", "subject"]

MOTION = Motion(play=1.0)
Options = Mapping[str, Any]


def _silent_servos(model: str, kind: type[ServoLine] = ServoLine) -> ServoLine:
    line = kind.of(model, [1, 2], MOTION)
    for servo in line.servos.values():
        servo.silent = True
    return line


@dataclass(frozen=True)
class Case:
    """One driver in one role.

    joints, or else accelerometer: the keys of its tables beside name, driver and port.  hardware: makes the device on
    the port, silent: one of the same kind that gives no data; None for a driver that needs no device, whose port is a
    recording in ``recording`` if it reads one.  port: the key that says where the device is.
    """

    id: str
    driver: str
    joints: Sequence[Options] = ()
    accelerometer: Options = field(default_factory=dict)
    hardware: Callable[[], Device | IioSensor] | None = None
    silent: Callable[[], Device | IioSensor] = lambda: TextStream(b"")
    robot: Options = field(default_factory=dict)
    reads_recording: bool = False
    port: str = "port"
    network: Callable[[], Ros2Robot] | None = None
    """makes the robot on a network that the driver connects to"""


ADXL345 = {
    "sampling_frequency_available": "100 200 400 800 1600 3200",
    "trigger/current_trigger": "",
    **{f"scan_elements/in_timestamp_{what}": "" for what in ("en", "index", "type")},
}
TIP = {"accelerometer": "tip"}
OSCILLATOR = {"oscillator": {"f_res_hz": 58.0}}
SLCAN = {"interface": "slcan"}
DRIVE = {"counts_per_turn": 10_000, "gear_ratio": 50, **SLCAN, **TIP}
SENSOR_NODE = 0x20


def _drive(node: int) -> Options:
    pdo = [
        {"cob_id": 0x180 + node, "map": [0x60410010, 0x60640020]},
        {"cob_id": 0x200 + node, "map": [0x60400010, 0x607A0020]},
    ]
    return {"node": node, "pdo": pdo, **DRIVE}


CASES = (
    Case(
        "canopen-given",
        "canopen",
        joints=[_drive(1), _drive(2)],
        hardware=lambda: CanopenLine([1, 2], MOTION),
    ),
    Case(
        "canopen-sdo",
        "canopen",
        joints=[{"node": 1, "sdo": True, **SLCAN, **TIP}, {"node": 2, "sdo": True, **SLCAN, **TIP}],
        hardware=lambda: CanopenLine([1, 2], MOTION),
    ),
    Case(
        "canopen-sensor",
        "canopen",
        accelerometer={
            "node": SENSOR_NODE,
            "rate_hz": 1000.0,
            "scale": 0.005,
            **SLCAN,
            **OSCILLATOR,
            "pdo": [{"cob_id": 0x180 + SENSOR_NODE, "map": [0x71300110]}],
        },
        hardware=lambda: CanopenLine([1, 2], MOTION, sensor=SENSOR_NODE),
    ),
    Case(
        "can",
        "can",
        accelerometer={"id": 0x180 + SENSOR_NODE, "rate_hz": 1000.0, "scale": 0.005, **SLCAN, **OSCILLATOR},
        hardware=lambda: CanopenLine([1, 2], MOTION, sensor=SENSOR_NODE),
    ),
    Case(
        "dynamixel-ax",
        "dynamixel",
        joints=[{"model": "AX-12A", "id": 1, **TIP}, {"model": "AX-12A", "id": 2, **TIP}],
        hardware=lambda: ServoLine.of("AX-12A", [1, 2], MOTION),
        silent=lambda: _silent_servos("AX-12A"),
    ),
    Case(
        "dynamixel-x",
        "dynamixel",
        joints=[{"model": "XL330-M288", "id": 1, **TIP}, {"model": "XL330-M288", "id": 2, **TIP}],
        hardware=lambda: ServoLine.of("XL330-M288", [1, 2], MOTION),
        silent=lambda: _silent_servos("XL330-M288"),
    ),
    Case(
        "feetech-sts",
        "feetech",
        joints=[{"model": "STS3215", "id": 1, **TIP}, {"model": "STS3215", "id": 2, **TIP}],
        hardware=lambda: FeetechLine.of("STS3215", [1, 2], MOTION),
        silent=lambda: _silent_servos("STS3215", FeetechLine),
    ),
    Case(
        "feetech-scs",
        "feetech",
        joints=[{"model": "SCS0009", "id": 1, **TIP}, {"model": "SCS0009", "id": 2, **TIP}],
        hardware=lambda: FeetechLine.of("SCS0009", [1, 2], MOTION),
        silent=lambda: _silent_servos("SCS0009", FeetechLine),
    ),
    Case(
        "tap-dynamixel",
        "tap",
        joints=[{"model": "XL330-M288", "id": 1, **TIP}, {"model": "XL330-M288", "id": 2, **TIP}],
        hardware=lambda: MasteredLine(ServoLine.of("XL330-M288", [1, 2], MOTION)),
    ),
    Case(
        "tap-feetech",
        "tap",
        joints=[{"model": "STS3215", "id": 1, **TIP}, {"model": "STS3215", "id": 2, **TIP}],
        hardware=lambda: MasteredLine(FeetechLine.of("STS3215", [1, 2], MOTION)),
    ),
    Case(
        "witmotion",
        "witmotion",
        accelerometer={"rate_hz": 200.0, **OSCILLATOR},
        hardware=lambda: WitMotionStream(MOTION, 200),
    ),
    Case(
        "csv_serial-stamped",
        "csv_serial",
        accelerometer={"rate_hz": 1000.0, "time_column": 0, "range_ms2": 160.0, **OSCILLATOR},
        hardware=lambda: CsvStream(MOTION, 1000),
    ),
    Case(
        "csv_serial-values",
        "csv_serial",
        accelerometer={"rate_hz": 1000.0, **OSCILLATOR},
        hardware=lambda: CsvStream(MOTION, 1000, stamps=False),
    ),
    Case(
        "iio-stamped",
        "iio",
        accelerometer={"device": "adxl355", "rate_hz": 1000.0, **OSCILLATOR},
        hardware=lambda: IioSensor(MOTION),
        silent=lambda: IioSensor(MOTION, dead=True),
        port="root",
    ),
    Case(
        "iio-without-time",
        "iio",
        accelerometer={"device": "adxl345", "rate_hz": 800.0, **OSCILLATOR},
        hardware=lambda: IioSensor(MOTION, 800, "adxl345", "le:s19/32>>0", files=ADXL345),
        silent=lambda: IioSensor(MOTION, 800, "adxl345", "le:s19/32>>0", dead=True, files=ADXL345),
        port="root",
    ),
    Case(
        "ros2-joints",
        "ros2",
        joints=[TIP, {"reference": "/controller_state", **TIP}],
        network=lambda: Ros2Robot(MOTION),
    ),
    Case(
        "ros2-accelerometer",
        "ros2",
        # Slower than the others: its emulator serialises each message, which a busy machine does 350 times a second.
        accelerometer={"rate_hz": 200.0, "topic": "/imu", "range_ms2": 160.0, **OSCILLATOR},
        network=lambda: Ros2Robot(MOTION, joints_hz=10.0, imu_hz=200.0),
    ),
    Case("simulated-joints", "simulated", joints=[TIP]),
    Case("simulated-accelerometer", "simulated", accelerometer={"rate_hz": 1000.0, **OSCILLATOR}),
    Case("replay-joints", "replay", joints=[TIP], reads_recording=True),
    Case("replay-accelerometer", "replay", accelerometer={"rate_hz": 1000.0, **OSCILLATOR}, reads_recording=True),
)


@dataclass(frozen=True)
class Rig:
    """A driver made but not opened, and the emulator behind it, if any."""

    driver: ServoBus | Accelerometer
    names: tuple[str, ...]
    emulator: Emulator | IioEmulator | None
    subject: Subject


@contextmanager
def plugged(case: Case, folder: Path, device: Device | IioSensor | None = None) -> Iterator[Rig]:
    """The driver of a case with its device, or another one, on the port."""
    with ExitStack() as stack:
        emulator, port = None, ""
        if case.hardware is not None:
            made = device or case.hardware()
            here = IioEmulator(made, folder) if isinstance(made, IioSensor) else Emulator(made, link=folder / "tty")
            emulator, port = stack.enter_context(here), here.paths[0]
        elif case.reads_recording:
            port = str(_recording(folder / "recording.csv"))
        elif case.network is not None:
            robot = stack.enter_context(case.network())
            case = replace(case, robot={"connect": list(robot.paths)})
        driver, names = make(case, port)
        stack.callback(driver.close)
        yield Rig(driver, names, emulator, subject(case, port))


def make(case: Case, port: str) -> tuple[ServoBus | Accelerometer, tuple[str, ...]]:
    """The driver of a case on a port, and the names of its joints or sensor."""
    about = subject(case, port)
    return about.make(), about.names


def subject(case: Case, port: str) -> Subject:
    """A case on a port, as the checks for any driver take it."""
    joints = [{"port": port, **joint} for joint in case.joints]
    accelerometer = {} if joints else {case.port: port, **case.accelerometer}
    return Subject(case.driver, joints, accelerometer, case.robot)


def _recording(path: Path) -> Path:
    """Ten seconds of a joint at 100 Hz and its tip at 1 kHz, in the project's format."""
    time = np.arange(10_000) / 1000
    tip = MOTION.tip(1000)
    rows = [
        f"{t:.4f},{MOTION.goal(t):.6f},{MOTION.position(t):.6f},{tip[i]:.4f}"
        if i % 10 == 0
        else f"{t:.4f},,,{tip[i]:.4f}"
        for i, t in enumerate(time)
    ]
    path.write_text("\n".join(["time,command,position,accel", *rows]) + "\n")
    assert math.isfinite(tip[0])
    return path
