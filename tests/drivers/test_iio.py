"""The driver of the kernel's accelerometers against an emulated sysfs and character device."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lostmotion.daemon import config
from lostmotion.drivers.base import Accelerometer
from lostmotion.drivers.emulator import IioEmulator, IioSensor
from lostmotion.drivers.errors import DriverError, PortError
from lostmotion.drivers.iio import IioOptions
from lostmotion.drivers.timeline import Timeline
from tests.conftest import ROOT
from tests.drivers.rigs import MOTION, accelerometer, block, timed_block


@pytest.fixture
def sensor(tmp_path: Path) -> Iterator[IioEmulator]:
    """An ADXL355 at 1 kHz."""
    with IioEmulator(IioSensor(MOTION), tmp_path) as emulator:
        yield emulator


def driver(emulator: IioEmulator, rate_hz: float = 1000.0, **options: Any) -> Accelerometer:
    """The driver of the emulated device."""
    return accelerometer("iio", "", rate_hz, **{"device": "adxl355", "root": str(emulator.root), **options})


@pytest.mark.parametrize("clock", ["monotonic", "realtime"])
@pytest.mark.parametrize("kind", ["be:s20/32>>12", "le:s19/32>>4"])
def test_a_kilohertz_comes_through_whole(
    tmp_path: Path, clock: str, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1 kHz by either clock of the kernel: all samples in order, at their times to 1 µs (by realtime 20 ms, or what a
    busy machine is late)."""
    if clock == "realtime":
        monkeypatch.setattr("lostmotion.drivers.iio_sysfs.Settings.put_if_allowed", lambda *_: None)
    with IioEmulator(IioSensor(MOTION, type=kind), tmp_path) as emulator:
        tip = driver(emulator)
        tip.open()
        got, late = timed_block(tip, 500)
        assert emulator.now("current_timestamp_clock") == clock
        tip.close()
    assert (got.lost, got.broken) == (0, 0)
    table = MOTION.tip(1000)
    start = round(got.time[0] * 1000)
    reach = range(start - 200, start + 200)
    first = min(reach, key=lambda k: np.abs(np.roll(table, -(k % len(table)))[:100] - got.accel[:100]).max())
    expected = table[(first + np.arange(len(got.time))) % len(table)]
    assert got.accel == pytest.approx(expected, abs=1e-4)
    near = 1e-6 if clock == "monotonic" else max(0.02, late(first))
    assert np.abs(got.time - (first + np.arange(len(got.time))) / 1000).max() < near


def test_an_overrun_is_counted(sensor: IioEmulator) -> None:
    """Seven samples that the kernel dropped are a gap of seven NaN and seven lost ones."""
    tip = driver(sensor)
    tip.open()
    block(tip, 200)
    sensor.sensor.skip = 7
    got = block(tip, 400)
    tip.close()
    assert got.lost == 7
    assert np.isnan(got.accel).sum() == 7
    assert np.diff(got.time).min() > 0


def test_all_settings_are_put_back(sensor: IioEmulator) -> None:
    """Elements, rate, trigger, buffer and clock are as they were found once the driver is closed."""
    files = [path for path in sensor.folder.rglob("*") if path.is_file()]
    before = {path: path.read_text().strip() for path in files}
    tip = driver(sensor)
    tip.open()
    during = {path.relative_to(sensor.folder).as_posix(): path.read_text().strip() for path in files}
    tip.close()
    assert {path: path.read_text().strip() for path in files} == before
    assert during["sampling_frequency"] == "1000"
    assert during["trigger/current_trigger"] == "adxl355-dev0"
    assert (during["scan_elements/in_accel_x_en"], during["scan_elements/in_temp_en"]) == ("1", "0")
    assert (during["buffer/enable"], during["buffer/length"]) == ("1", "2000")


def test_a_buffer_left_running_is_taken_over(sensor: IioEmulator, caplog: pytest.LogCaptureFixture) -> None:
    """A program that was killed left the buffer on: that is told, and measuring begins anew."""
    (sensor.folder / "buffer/enable").write_text("1\n")
    tip = driver(sensor)
    tip.open()
    block(tip, 100)
    tip.close()
    assert "left running by a program that has ended" in caplog.text
    assert sensor.now("buffer/enable") == "0"


def test_the_mount_matrix_turns_the_axes(tmp_path: Path) -> None:
    """The board's y is the sensor's -x: its axis "-y" gives what the sensor feels along x."""
    files = {"in_mount_matrix": "0, 1, 0; -1, 0, 0; 0, 0, 1"}
    with IioEmulator(IioSensor(MOTION, files=files), tmp_path) as emulator:
        tip = driver(emulator, axis="-y")
        tip.open()
        got = block(tip, 500)
        tip.close()
    index = np.rint(got.time * 1000).astype(int) % 20_000
    assert got.accel == pytest.approx(MOTION.tip(1000)[index], abs=1e-4)


@pytest.mark.parametrize("wanted", ["adxl355", "bar", "0", "iio:device0"])
def test_a_device_is_found_by_name_label_or_index(tmp_path: Path, wanted: str) -> None:
    """Each of the three names it; another word is told with what there is."""
    with IioEmulator(IioSensor(MOTION, files={"label": "bar"}), tmp_path) as emulator:
        tip = driver(emulator, device=wanted)
        tip.open()
        assert tip.identify()[0].ok
        tip.close()
        with pytest.raises(PortError, match=r"'bmi160' does not exist \(there is adxl355 \(iio:device0, label bar\)\)"):
            driver(emulator, device="bmi160").open()


def test_a_rate_that_is_not_offered_names_the_nearest(sensor: IioEmulator) -> None:
    """800 Hz of a sensor that has 1000 and 500: the nearest is named, and the buffer stays off."""
    with pytest.raises(DriverError, match=r"rate_hz is 800; adxl355 \(iio:device0\) offers 1000 next to it"):
        driver(sensor, 800).open()
    assert sensor.now("buffer/enable") == "0"


def test_without_a_trigger_it_is_told_how_to_make_one(tmp_path: Path) -> None:
    """A sensor without interrupt, and a trigger that is not there: the two commands that make a timer."""
    with IioEmulator(IioSensor(MOTION), tmp_path) as emulator:
        (emulator.folder.parent / "trigger0/name").write_text("bmi160-dev1\n")
        with pytest.raises(
            PortError, match=r"no trigger of its own \(there is bmi160-dev1\).*modprobe iio-trig-hrtimer"
        ):
            driver(emulator).open()
        with pytest.raises(
            PortError, match=r"there is no trigger 'tick'.*mkdir /sys/kernel/config/iio/triggers/hrtimer"
        ):
            driver(emulator, trigger="tick").open()
        timer = emulator.folder.parent / "trigger0"
        (timer / "name").write_text("tick\n")
        (timer / "sampling_frequency").write_text("100\n")
        tip = driver(emulator, 800.0, trigger="tick")
        tip.open()
        assert (timer / "sampling_frequency").read_text() == "800"
        assert emulator.now("sampling_frequency") == "1000"
        tip.close()
        assert (timer / "sampling_frequency").read_text() == "100"


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.EACCES, "may not be used by this user .*udev rule"),
        (errno.EBUSY, "is busy; likely cause: another program reads this sensor's buffer"),
        (errno.ENODEV, "went away .*unplugged"),
        (errno.EINVAL, "was refused by the kernel's driver: Invalid argument"),
    ],
)
def test_what_a_kernel_refuses_is_told(
    sensor: IioEmulator, number: int, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The errors that the kernel gives for its character device, as a person needs them."""
    opened = os.open

    def refuse(path: Any, flags: int, *rest: Any, **more: Any) -> int:
        if str(path) == str(sensor.node) and flags & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(number, os.strerror(number))
        return opened(path, flags, *rest, **more)

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(PortError, match=told):
        driver(sensor).open()


def test_a_kernel_without_buffer_support(tmp_path: Path) -> None:
    """A device that can only be asked for single values is told with the kernel's option."""
    sensor = IioSensor(MOTION, files={"buffer/enable": ""})
    with IioEmulator(sensor, tmp_path) as emulator:
        tip = driver(emulator)
        with pytest.raises(DriverError, match=r"has no buffer; .*CONFIG_IIO_TRIGGERED_BUFFER"):
            tip.open()


def test_a_port_is_no_key_of_iio() -> None:
    """iio has a device instead of a port."""
    with pytest.raises(DriverError, match="found port '/dev/ttyUSB0', expected device"):
        accelerometer("iio", "/dev/ttyUSB0", 1000.0, device="adxl355")


def test_robot_times_are_kept_over_a_long_gap() -> None:
    """Stamps that are robot times stay as they are, also after a gap of five seconds, which costs one sample."""
    line = Timeline(1e-3, float("inf"), is_robot_time=True)
    line.stamped([1.0, 1.001], [0.0, 0.0], 1.002)
    got = line.stamped([6.0, 6.001, 6.002], [1.0, 2.0, 3.0], 6.003)
    assert got.time == pytest.approx([6.001, 6.002], abs=1e-9)
    assert (got.lost, got.broken) == (0, 1)


def test_the_example_is_valid() -> None:
    """examples/iio.toml names an ADXL355 and nothing is noted about it."""
    found = config.loads((ROOT / "examples/iio.toml").read_text(), "iio.toml")
    assert found.notes == ()
    (options,) = found.accelerometers
    assert isinstance(options, IioOptions)
    assert (options.device, options.rate_hz) == ("adxl355", 1000)
