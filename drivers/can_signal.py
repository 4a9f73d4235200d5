"""Driver of an accelerometer that sends raw CAN frames: bits at a place of a frame, given as such or by a DBC file.

Without a DBC file nothing but the bus is needed.  A DBC file is read by cantools when the driver is made, and only
locates the bits: a service without such a file does not carry the 16 MB of that package.
"""

from __future__ import annotations

from lostmotion.drivers.base import Accelerometer, AccelerometerOptions, Driver, RobotOptions
from lostmotion.drivers.can_accelerometer import CanAccelerometer
from lostmotion.drivers.canopen_options import SignalLayout, SignalOptions
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.codec.signal import Layout, SignalError, layout_of
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.packages import is_there, missing
from lostmotion.drivers.units import STANDARD_GRAVITY

__all__ = ["DRIVER"]

UNITS = {"m/s^2": 1.0, "m/s²": 1.0, "m/s2": 1.0, "m/s/s": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000,
         "G": STANDARD_GRAVITY, "": 1.0}  # fmt: skip
"""m/s² of what DBC files write; of a signal without a unit ``scale`` alone sets it"""


def _make(options: AccelerometerOptions, robot: RobotOptions, clock: Clock) -> Accelerometer:
    assert isinstance(options, SignalOptions)
    try:
        layout = _from_dbc(options) if options.dbc else _given(options)
        counter = _place(layout.id, options.counter) if options.counter else None
    except SignalError as error:
        raise DriverError(f"accelerometer {options.name}: signal: {error}") from error
    return CanAccelerometer(options, layout, counter, options.range_ms2, clock)


def _given(options: SignalOptions) -> Layout:
    if options.id is None:
        raise DriverError(f"accelerometer {options.name}: no frame is named; expected id = 0x181, or dbc = a file")
    return _place(options.id, options.signal, options.scale, options.offset)


def _place(id: int, place: SignalLayout, scale: float = 1.0, offset: float = 0.0) -> Layout:
    return layout_of(id, place.start_bit, place.length, place.byte_order == "big", place.signed, scale, offset)


def _from_dbc(options: SignalOptions) -> Layout:
    """The place of the signal in the file, in m/s² by its unit."""
    where = f"accelerometer {options.name}.dbc"
    if not is_there("cantools"):
        raise DriverError(f"{where}: {missing('cantools', 'a DBC file')}")
    import cantools

    try:
        database = cantools.database.load_file(options.dbc)
    except Exception as error:
        raise DriverError(f"{where}: {options.dbc} cannot be read as DBC: {error!s:.120}") from error
    messages = {message.name: message for message in getattr(database, "messages", ())}
    if options.message not in messages:
        raise DriverError(f"{where}: found no message {options.message!r}, expected one of {', '.join(messages)}")
    message = messages[options.message]
    signals = {signal.name: signal for signal in message.signals}
    if options.dbc_signal not in signals:
        raise DriverError(f"{where}: found no signal {options.dbc_signal!r}, expected one of {', '.join(signals)}")
    signal = signals[options.dbc_signal]
    if signal.is_float or (signal.unit or "") not in UNITS:
        what = "a floating-point signal" if signal.is_float else f"the unit {signal.unit!r}"
        raise DriverError(f"{where}: found {what}, expected a whole number in m/s^2, g or mg")
    factor = UNITS[signal.unit or ""] * options.scale
    big = signal.byte_order == "big_endian"
    scale, offset = float(signal.scale) * factor, float(signal.offset) * factor + options.offset
    return layout_of(message.frame_id, signal.start, signal.length, big, signal.is_signed, scale, offset)


DRIVER = Driver(
    name="can",
    summary="accelerometer that sends raw CAN frames, described by hand or by a DBC file",
    accelerometer=_make,
    accelerometer_options=SignalOptions,
    shares=True,
)
