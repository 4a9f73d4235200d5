"""The WitMotion driver against an emulated sensor."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.drivers.base import OscillatorOptions
from lostmotion.drivers.codec.witmotion import FULL_SCALE_MS2, WitFrame, encode
from lostmotion.drivers.emulator import Emulator, WitMotionStream
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.witmotion import WitMotionFormat
from tests.drivers.rigs import MOTION, OSCILLATOR, accelerometer, timed_block

COUNT = FULL_SCALE_MS2 / 32768


@pytest.mark.parametrize("sign", [1, -1])
def test_samples_are_those_of_the_sensor(sign: int) -> None:
    """Along y, and with its sign turned, the signal is the emulator's to a count, at its times to 12 ms, or to what a
    busy machine is late."""
    with Emulator(WitMotionStream(MOTION, 200, axis="y")) as emulator:
        sensor = accelerometer("witmotion", emulator.paths[0], 200, axis="y" if sign > 0 else "-y")
        sensor.open()
        got, late = timed_block(sensor, 200, 200.0)
        sensor.close()
    assert sensor.range_ms2 == pytest.approx(156.9, abs=0.1)
    assert (got.lost, got.broken) == (0, 0)
    table = MOTION.tip(200)
    first = int(np.argmin([np.abs(np.roll(table, -k)[:50] - sign * got.accel[:50]).max() for k in range(len(table))]))
    assert np.roll(table, -first)[: len(got.accel)] == pytest.approx(sign * got.accel, abs=COUNT)
    behind = (got.time - (np.arange(len(got.time)) + first) / 200 + 10) % 20 - 10
    assert np.abs(behind).max() < max(0.012, late(first))


def test_the_rate_is_measured() -> None:
    """A sensor set to 100 Hz where 200 are expected is told with the rate that was measured."""
    with Emulator(WitMotionStream(MOTION, 100)) as emulator:
        sensor = accelerometer("witmotion", emulator.paths[0], 200)
        sensor.open()
        (identity,) = sensor.identify()
        sensor.close()
    assert not identity.ok
    assert float(identity.found.split()[3]) == pytest.approx(100, rel=0.1)
    assert "likely cause: rate_hz is not what the sensor is set to" in identity.found
    assert identity.expected == "WitMotion sensor at 200 Hz"


@pytest.mark.parametrize("f_res", [100.0, 130.0])
def test_an_oscillator_too_fast_for_the_sensor_is_refused(f_res: float) -> None:
    """At 200 samples a second the bar must ring below 100 Hz."""
    with pytest.raises(DriverError, match="only frequencies below 100 Hz; expected a longer bar"):
        accelerometer("witmotion", "x", 200, oscillator=OscillatorOptions(f_res_hz=f_res))


def test_such_a_sensor_never_exceeds_200_hz() -> None:
    """rate_hz above what the device can do is a mistake in the settings."""
    with pytest.raises(DriverError, match="sends at most 200"):
        accelerometer("witmotion", "x", 1000, oscillator=OSCILLATOR)


def test_a_corrupted_frame_keeps_its_place() -> None:
    """Among acceleration frames a broken one becomes NaN; with other frames in between it is only counted."""
    form = WitMotionFormat("x")
    good = encode(WitFrame(0x51, (2048, 0, 0, 0)))
    readings = form.feed(good + good[:3] + b"\x00" + good[4:] + good)
    assert readings.broken == 1
    assert np.array(readings.accel) == pytest.approx([9.80665, np.nan, 9.80665], nan_ok=True)
    form.feed(encode(WitFrame(0x52, (0, 0, 0, 0))))
    assert form.feed(good[:3] + b"\x00" + good[4:] + good).accel == pytest.approx([9.80665])
