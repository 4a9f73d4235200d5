"""What a port sends unasked: data of a sensor, or other bytes.  Listening at all baud rates; no byte is sent.

The bytes are taken apart by the drivers' own codecs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.codec import dynamixel, witmotion
from lostmotion.drivers.codec.csv_line import CsvDecoder
from lostmotion.drivers.serial_port import SerialPort

__all__ = ["RATES", "Chatter", "FoundSensor", "probe"]

RATES = (
    115_200, 9_600, 460_800, 921_600, 230_400, 1_000_000, 57_600, 38_400, 19_200, 2_000_000, 500_000, 250_000,
)  # fmt: skip
"""[bit/s]; WitMotion sends at 9600 as shipped, microcontrollers' programs mostly at 115200"""
SILENCE_S = 2.5
"""a microcontroller may boot when its port is opened; a GPS receiver speaks once a second"""
LOOK_S, MEASURE_S = 1.0, 2.0
"""how long to listen at a baud rate; and for the rate of the readings"""
GLITCH = 3
"""so many bytes and fewer are made by the opening of a port"""
LEAST, SHARE = 4, 0.8
"""readings, and their share of what came in, for a sensor to be believed"""
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
UNIT_TOLERANCE = 0.3
USUAL_HZ = (10, 20, 25, 50, 100, 125, 200, 250, 400, 500, 800, 1000, 1600, 2000, 3200, 4000)
USUAL_WITHIN = 0.03


@dataclass(frozen=True, slots=True)
class FoundSensor:
    """An accelerometer that ``driver`` reads; options: keys of its table beside port, baud rate and rate; told: a
    summary of its readings; columns: how many a line has, 0 where there are none."""

    driver: str
    baudrate: int
    rate_hz: float
    options: dict[str, str | int]
    told: str
    columns: int = 0


@dataclass(frozen=True, slots=True)
class Chatter:
    """Bytes of no sensor: how many a second, the share of them that a person could read, the first ones, at the baud
    rate where that share was largest; protocol: of servos that somebody else talks to, 0 where the bytes are none."""

    baudrate: int
    bytes_per_s: float
    printable: float
    begins: bytes
    protocol: int = 0


@dataclass(slots=True)
class _Capture:
    """Chunks, and when each came in [s]; ``seconds`` were listened for."""

    seconds: float
    chunks: list[tuple[float, bytes]] = field(default_factory=list)

    @property
    def data(self) -> bytes:
        return b"".join(chunk for _, chunk in self.chunks)


Step = Callable[[float], None]


def probe(path: str, step: Step) -> FoundSensor | Chatter | None:
    """What sends on a port; None where nothing does.  Raises PortError."""
    first = _listen(path, RATES[0], SILENCE_S, stop=GLITCH + 1)
    if len(first.data) <= GLITCH:
        return None
    best: Chatter | None = None
    for i, baudrate in enumerate(RATES):
        step(i / len(RATES))
        capture = _listen(path, baudrate, LOOK_S)
        if _is_witmotion(capture.data) or _table(capture.data) is not None:
            return _measured(path, baudrate) or _chatter(baudrate, capture)
        chatter = _chatter(baudrate, capture)
        if chatter.protocol:
            return chatter
        if best is None or chatter.printable > best.printable:
            best = chatter
    return best


def _listen(path: str, baudrate: int, seconds: float, stop: int | None = None) -> _Capture:
    """All that comes in, or what has come in as soon as it is ``stop`` bytes."""
    port, capture, count = SerialPort(path, baudrate), _Capture(seconds), 0
    port.open()
    try:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0 and (stop is None or count < stop):
            if data := port.read(left):
                capture.chunks.append((time.monotonic(), data))
                count += len(data)
    finally:
        port.close()
    return capture


def _measured(path: str, baudrate: int) -> FoundSensor | None:
    capture = _listen(path, baudrate, MEASURE_S)
    return _witmotion(baudrate, capture) if _is_witmotion(capture.data) else _csv(baudrate, capture)


def _is_witmotion(data: bytes) -> bool:
    frames = [frame for frame in witmotion.WitDecoder().feed(data) if frame is not None]
    accelerations = sum(frame.kind == witmotion.ACCELERATION for frame in frames)
    return accelerations >= LEAST and len(frames) * witmotion.FRAME_SIZE >= SHARE * len(data)


def _witmotion(baudrate: int, capture: _Capture) -> FoundSensor:
    stream = witmotion.WitDecoder()
    counts, values = [], list[tuple[int, ...]]()
    for _, chunk in capture.chunks:
        found = [frame.values for frame in stream.feed(chunk) if frame and frame.kind == witmotion.ACCELERATION]
        counts.append(len(found))
        values += found
    means = witmotion.to_ms2(np.array(values, np.float64)[:, :3]).mean(0)
    description = "at rest or in the mean x {:.1f}, y {:.1f}, z {:.1f} m/s²".format(*means)
    return FoundSensor("witmotion", baudrate, _rate(capture, counts), {"axis": "x"}, description)


def _table(data: bytes) -> FloatArray | None:
    """The lines of numbers, shape (rows, columns); None where most of what came in is something else."""
    stream = CsvDecoder()
    rows = [row for row in stream.feed(data) if row is not None]
    good = [row for row in rows if len(row) == len(rows[-1])]
    if len(good) < LEAST or len(good) < SHARE * (len(rows) + stream.broken):
        return None
    return np.array(good, np.float64)


def _csv(baudrate: int, capture: _Capture) -> FoundSensor | None:
    table = _table(capture.data)
    if table is None:
        return None
    stream = CsvDecoder()
    rate = _rate(capture, [sum(row is not None for row in stream.feed(chunk)) for _, chunk in capture.chunks])
    clock = _clock(table, len(table) / rate)
    options: dict[str, str | int] = {}
    if clock is not None:
        column, unit = clock
        span = (table[-1, column] - table[0, column]) * UNITS[unit]
        rate = _usual((len(table) - 1) / span)
        options |= {"time_column": column, "time_unit": unit}
    others = [i for i in range(table.shape[1]) if clock is None or i != clock[0]]
    if not others:
        return None
    column = max(others, key=lambda i: float(table[:, i].std()))
    options["column"] = column
    low, middle, high = np.quantile(table[:, column], (0, 0.5, 1))
    description = f"column {column} from {low:.4g} to {high:.4g}, median {middle:.4g}"
    return FoundSensor("csv_serial", baudrate, rate, options, description, table.shape[1])


def _clock(table: FloatArray, seconds: float) -> tuple[int, str] | None:
    """Which column is the sensor's own time, and in which unit: it ascends by as much as the host's clock."""
    for column, values in enumerate(table.T):
        if (np.diff(values) > 0).all():
            for unit, factor in UNITS.items():
                if abs((values[-1] - values[0]) * factor / seconds - 1) < UNIT_TOLERANCE:
                    return column, unit
    return None


def _rate(capture: _Capture, counts: Sequence[int]) -> float:
    """Readings a second: those after the first chunk, which may have waited."""
    times = [when for when, _ in capture.chunks]
    span = times[-1] - times[0]
    return _usual(sum(counts[1:]) / span) if span > 0 else sum(counts) / capture.seconds


def _usual(rate_hz: float) -> float:
    """A rate that sensors are set to, where the measured one is close to it."""
    nearest = min(USUAL_HZ, key=lambda usual: abs(usual / rate_hz - 1))
    return float(nearest if abs(nearest / rate_hz - 1) < USUAL_WITHIN else f"{rate_hz:.3g}")


def _chatter(baudrate: int, capture: _Capture) -> Chatter:
    data = capture.data
    printable = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in data) / max(len(data), 1)
    return Chatter(baudrate, len(data) / capture.seconds, printable, data[:24], _servo_protocol(data))


def _servo_protocol(data: bytes) -> int:
    """1 or 2 where most of the bytes are frames of that protocol, else 0."""
    for protocol in (2, 1):
        packets = [packet for packet in dynamixel.decoder(protocol).feed(data) if packet is not None]
        size = sum(len(dynamixel.encode(packet, protocol)) for packet in packets)
        if len(packets) >= LEAST and size >= SHARE * len(data):
            return protocol
    return 0
