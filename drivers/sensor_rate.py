"""How accelerometers that send on their own accord are listened to, and whether their rate is the configured one."""

from __future__ import annotations

from lostmotion.drivers.base import AccelerometerOptions, Identity
from lostmotion.drivers.errors import DriverError

__all__ = ["LISTEN_S", "LOOK_S", "RATE_TOLERANCE", "SILENCE_S", "WAIT_S", "check_rate", "rate_identity"]

WAIT_S = 0.25
"""how long a reading waits for samples [s]"""
LOOK_S = 0.1
"""how often the arrival of a sample is looked at [s]: it costs a wake-up; of each half second the quickest counts"""
LISTEN_S, SILENCE_S = 0.6, 2.5
"""how long to measure a rate; how long to wait for the first sample (a microcontroller may boot when opened) [s]"""
RATE_TOLERANCE = 0.1


def check_rate(options: AccelerometerOptions) -> None:
    """Raises DriverError when the rate is too low for the oscillator."""
    oscillator, rate = options.oscillator.f_res_hz, options.rate_hz
    if not 0 < oscillator < rate / 2:
        raise DriverError(
            f"accelerometer {options.name}: the oscillator rings at {oscillator:g} Hz, but {rate:g} samples/s show"
            f" only frequencies below {rate / 2:g} Hz; expected a longer bar or a faster sensor"
        )


def rate_identity(
    name: str, what: str, rate_hz: float, wanted_hz: float, expected: str, cause: str, more: str = ""
) -> Identity:
    """The identity of a sensor that sends at a rate [Hz]; cause: the likely one of another rate than the wanted one;
    more: what else was found."""
    found = f"{what} at {rate_hz:.0f} Hz{more}"
    if abs(rate_hz / wanted_hz - 1) <= RATE_TOLERANCE:
        return Identity(name, found, expected, True)
    why = f"; likely cause: {cause}"
    return Identity(name, found + why, expected, False, f"{what} at about {float(f'{rate_hz:.1g}'):g} Hz{why}")
