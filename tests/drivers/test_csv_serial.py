"""The driver of printed numbers against an emulated microcontroller."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from lostmotion.drivers.base import OscillatorOptions
from lostmotion.drivers.csv_serial import CsvFormat, CsvSerialOptions
from lostmotion.drivers.emulator import CsvStream, Emulator, TextStream
from tests.drivers.rigs import MOTION, accelerometer, block, timed_block, until


def form(**options: object) -> CsvFormat:
    """The format with some options, past its first line."""
    oscillator = OscillatorOptions(f_res_hz=58)
    given: dict[str, Any] = {"name": "tip", "driver": "csv_serial", "port": "none", "rate_hz": 1000} | options
    made = CsvFormat(CsvSerialOptions(oscillator=oscillator, **given))
    made.feed(b"cut\n")
    return made


class MillisStream(CsvStream):
    """A microcontroller that prints ``millis(),value``."""

    def _sample(self, index: int) -> bytes:
        micros, _, value = super()._sample(index).partition(b",")
        return b"%d,%b" % (int(micros) // 1000, value)


def test_millis_at_800_hz_loses_nothing() -> None:
    """Stamps of 0, 1, 2, 3, 5 ms: no sample is told lost or broken, and the times are 1.25 ms apart."""
    with Emulator(MillisStream(MOTION, 800)) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 800, time_column=0, time_unit="ms")
        sensor.open()
        got = block(sensor, 950)
        sensor.close()
    assert (got.lost, got.broken) == (0, 0)
    assert np.isfinite(got.accel).all()
    assert np.median(np.abs(np.diff(got.time) - 1.25e-3)) < 2e-5


class OddClock(CsvStream):
    """A microcontroller whose first column is what ``clock`` makes of the microseconds."""

    def __init__(self, clock: Callable[[int], int]) -> None:
        super().__init__(MOTION, 800)
        self._clock = clock

    def _sample(self, index: int) -> bytes:
        micros, _, value = super()._sample(index).partition(b",")
        return b"%d,%b" % (self._clock(int(micros)), value)


def test_millis_in_microseconds_loses_nothing() -> None:
    """``millis() * 1000`` at 800 Hz gives 0, 1000, 2000, 3000, 5000 µs: every fifth sample was counted as lost and the
    windows were not scored."""
    with Emulator(OddClock(lambda micros: micros // 1000 * 1000)) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 800, time_column=0)
        sensor.open()
        sensor.identify()
        got = block(sensor, 950)
        sensor.close()
    assert (got.lost, got.broken) == (0, 0)
    assert np.median(np.abs(np.diff(got.time) - 1.25e-3)) < 2e-5


@pytest.mark.parametrize(
    ("clock", "said"),
    [
        (lambda micros: 0, "whose times stand still or run back"),
        (lambda micros: 2**31 - micros % 2**31, "whose times stand still or run back"),
        (lambda micros: micros // 1000, "whose times go on too slowly"),
        (lambda micros: micros * 1000 % 2**32, "whose times go on too fast"),
    ],
)
def test_a_column_that_is_no_clock_is_told_as_such(clock: Callable[[int], int], said: str) -> None:
    """Times that stand still, run back or have another unit are the cause that is told, where all lines were called
    broken, or the sensor silent."""
    with Emulator(OddClock(clock)) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 800, time_column=0)
        sensor.open()
        (found,) = sensor.identify()
        sensor.close()
    assert not found.ok
    assert (
        found.gist
        == f"lines of numbers {said}; likely cause: time_column is not the sensor's clock, or time_unit is another one"
    )


@pytest.mark.parametrize("stamps", [True, False])
def test_a_kilohertz_comes_through_whole(stamps: bool) -> None:
    """1 kHz with or without the sensor's clock: all samples in order, evenly spaced, at their times to 12 ms, or to
    what a busy machine is late."""
    with Emulator(CsvStream(MOTION, 1000, stamps=stamps, ppm=200)) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0 if stamps else None)
        sensor.open()
        got, late = timed_block(sensor, 800)
        sensor.close()
    assert (got.lost, got.broken) == (0, 0)
    table = MOTION.tip(1000)
    start = round(got.time[0] * 1000)
    near = [k % len(table) for k in range(start - 100, start + 100)]
    first = min(near, key=lambda k: np.abs(np.roll(table, -k)[:50] - got.accel[:50]).max())
    assert np.roll(table, -first)[: len(got.accel)] == pytest.approx(got.accel, abs=1e-4)
    behind = (got.time - (np.arange(len(got.time)) + first) / 1000 + 10) % 20 - 10
    assert np.abs(behind).max() < max(0.012, late(first))
    assert np.median(np.diff(got.time)) == pytest.approx(0.001, rel=0.01)


def test_lost_samples_and_garbage_are_counted() -> None:
    """Seven samples lost and one line of noise: 7 lost, 1 broken, and the signal has its gap as NaN."""
    stream = CsvStream(MOTION, 1000)
    with Emulator(stream) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0)
        sensor.open()
        block(sensor, 200)
        emulator.order(lambda: (stream.skip(7), stream.insert(b"\x80rubbish,\n")))
        got = block(sensor, 400)
        sensor.close()
    assert (got.lost, got.broken) in {(7, 1), (6, 1)}
    assert np.isnan(got.accel).sum() == 7
    assert np.diff(got.time).min() > 0


def test_a_noisy_line_is_told_in_the_same_words_at_each_look() -> None:
    """Three bytes of ten are lost: the rate of what is left differs each time, what an alarm tells does not."""
    stream = CsvStream(MOTION, 1000)
    stream.lossy = 0.3
    with Emulator(stream) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0)
        sensor.open()
        looks = [sensor.identify()[0] for _ in range(4)]
        sensor.close()
    assert len({look.found for look in looks}) > 1
    assert {look.gist.partition(";")[0] for look in looks} == {"lines of numbers, many of them broken"}


def test_the_microcontroller_restarts() -> None:
    """When its clock begins anew the times go on ascending and stay near the host's."""
    stream = CsvStream(MOTION, 1000)
    with Emulator(stream) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0)
        sensor.open()
        before = block(sensor, 200)
        stream.clock_us -= 3_000_000_000
        begun = time.monotonic()
        after = block(sensor, 400)
        ended = time.monotonic()
        sensor.close()
    assert np.diff(np.concatenate([before.time, after.time])).min() > 0
    assert begun - 0.5 < after.time[-1] < ended + 0.5


def test_micros_begins_again_after_71_minutes() -> None:
    """The counter of 32 bits passes 0 while samples come: none is lost or broken, and the times go on evenly."""
    stream = CsvStream(MOTION, 1000)
    with Emulator(stream) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0)
        sensor.open()
        block(sensor, 200)

        def is_set_anew() -> bool:
            """Whether the clock, 1.2 s before 0, was heard in time: the first reading at it costs one sample."""
            stream.clock_us = 2**32 - 1_200_000 - round(time.monotonic() * 1e6)
            block(sensor, 200)
            return stream.clock_us + round(time.monotonic() * 1e6) < 2**32

        until(is_set_anew)
        got = block(sensor, 1500)
        assert stream.clock_us + round(time.monotonic() * 1e6) > 2**32
        sensor.close()
    assert (got.lost, got.broken) == (0, 0)
    assert np.abs(np.diff(got.time) - 1e-3).max() < 5e-4


def test_columns_scale_and_range() -> None:
    """The chosen column times scale is m/s²; a reading beyond the range is a broken one."""
    made = form(time_column=1, time_unit="ms", column=2, scale=-9.81, range_ms2=20.0)
    readings = made.feed(b"7,1000,1.0\n7,1001,3.0\n7,1002,-2.0\n")
    assert readings.accel == pytest.approx([-9.81, math.nan, 19.62], nan_ok=True)
    assert readings.stamps == pytest.approx([1.0, 1.001, 1.002])
    assert readings.broken == 1
    assert made.wraps == pytest.approx(2**32 / 1000)


@pytest.mark.parametrize("options", [{"column": 5}, {"column": -4}, {"time_column": 4}])
def test_a_column_that_is_not_there_makes_lines_broken(options: dict[str, int]) -> None:
    """Lines too short for the chosen column give no reading and are counted."""
    readings = form(**options).feed(b"1,2,3\n1,2,3\n")
    assert readings.broken == 2
    assert np.isnan(readings.accel).all()


def test_nan_lines_are_broken() -> None:
    """A device that prints nan or inf gives NaN and counts."""
    readings = form().feed(b"1.5\nnan\n-inf\n2.5\n")
    assert readings.accel == pytest.approx([1.5, math.nan, math.nan, 2.5], nan_ok=True)
    assert readings.broken == 2


class Noisy:
    """Prints 150 lines a second, one at a time, of which every third is garbled."""

    def __init__(self) -> None:
        self._lines = itertools.cycle((b"1.5\n", b"1.5\n", b"1.?\n"))
        self._due = time.monotonic()

    def receive(self, data: bytes, now: float) -> None:
        """It does not listen."""

    def due(self) -> float:
        """When the next line goes out [s]."""
        return self._due

    def emit(self, now: float) -> bytes:
        """The next line."""
        self._due += 1 / 150
        return next(self._lines)


def test_a_noisy_line_is_told_when_the_device_is_asked() -> None:
    """A third of the lines broken is too much, though 100 good ones a second are as expected."""
    with Emulator(Noisy()) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 100, oscillator=OscillatorOptions(f_res_hz=20))
        sensor.open()
        (identity,) = sensor.identify()
        sensor.close()
    assert "broken of" in identity.found
    assert "lines of numbers, many of them broken; likely cause" in identity.gist
    assert not identity.ok


@pytest.mark.slow
def test_a_silent_port_is_told_as_such() -> None:
    """Nothing at all within 2.5 s is another finding than foreign bytes."""
    with Emulator(TextStream(b"")) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000)
        sensor.open()
        (identity,) = sensor.identify()
        sensor.close()
    assert not identity.ok
    assert identity.found == "nothing in 2.5 s; likely cause: unpowered, or another port"


@pytest.mark.parametrize("stamps", [True, False])
def test_an_overrun_that_the_device_tells_is_counted_once(stamps: bool) -> None:
    """``#lost 7`` and seven samples missing: 7 lost and none broken, by the stamps' gap or, without stamps, by the
    line."""
    stream = CsvStream(MOTION, 1000, stamps=stamps)
    with Emulator(stream) as emulator:
        sensor = accelerometer("csv_serial", emulator.paths[0], 1000, time_column=0 if stamps else None)
        sensor.open()
        block(sensor, 200)
        emulator.order(lambda: (stream.skip(7), stream.insert(b"#lost 7\n")))
        got = block(sensor, 400)
        sensor.close()
    assert (got.lost, got.broken) == (7, 0)
    assert np.isnan(got.accel).sum() == 7
    assert np.diff(got.time).min() > 0


def test_a_scale_of_zero_is_refused() -> None:
    """It would make every reading zero, which looks like a dead sensor."""
    with pytest.raises(ValueError, match="scale: found 0, expected m/s² per unit"):
        form(scale=0.0)
