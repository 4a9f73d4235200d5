"""One suite over every driver: what the service relies on, whatever the device."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock, ServoReading
from lostmotion.drivers.emulator import TextStream
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.registry import get_driver, names
from tests.conformance.cases import CASES, Case, Rig, make, plugged

HARDWARE = [case for case in CASES if case.hardware is not None]
every_driver = pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
every_device = pytest.mark.parametrize("case", HARDWARE, ids=lambda case: case.id)


@pytest.fixture
def rig(case: Case, tmp_path: Path) -> Iterator[Rig]:
    """The driver with its device on the port, not yet open."""
    with plugged(case, tmp_path) as made:
        yield made


def collect(rig: Rig, seconds: float = 0.6) -> list[ServoReading | AccelBlock]:
    """All readings of some seconds, at least five."""
    end, found = time.monotonic() + seconds, list[ServoReading | AccelBlock]()
    while time.monotonic() < end or len(found) < 5:
        found.append(rig.driver.read())
    return found


@every_driver
def test_the_device_is_who_it_should_be(rig: Rig) -> None:
    """identify names every joint or sensor once, tells what was found and expected, and is content."""
    rig.driver.open()
    identities = rig.driver.identify()
    assert [identity.name for identity in identities] == list(rig.names)
    assert all(identity.ok and identity.found and identity.expected for identity in identities)


@every_driver
def test_times_ascend(rig: Rig) -> None:
    """Over all readings the times of each joint and of each sensor ascend strictly; those in a reading are in order."""
    rig.driver.open()
    times: dict[str, list[float]] = {name: [] for name in rig.names}
    for reading in collect(rig):
        if isinstance(reading, AccelBlock):
            times[rig.names[0]] += reading.time.tolist()
        else:
            assert [s.time for s in reading.samples] == sorted(s.time for s in reading.samples)
            for sample in reading.samples:
                times[sample.joint].append(sample.time)
    for name in rig.names:
        assert len(times[name]) >= 20
        assert np.diff(times[name]).min() > 0


@every_driver
def test_values_are_si(rig: Rig) -> None:
    """Angles within a turn, speeds a servo can have, volts and °C of a working servo; a tip within the sensor's range
    that is not dead: its noise alone shows."""
    rig.driver.open()
    readings = collect(rig, 1.0)
    samples = [s for r in readings if isinstance(r, ServoReading) for s in r.samples]
    for sample in samples:
        assert abs(sample.command) < math.tau
        assert math.isnan(sample.position) or abs(sample.position - sample.command) < 0.2
        assert math.isnan(sample.velocity) or abs(sample.velocity) < 20
        assert math.isnan(sample.voltage) or 3 < sample.voltage < 30
        assert math.isnan(sample.temperature) or 0 < sample.temperature < 90
    blocks = [r for r in readings if isinstance(r, AccelBlock)]
    if blocks:
        accel = np.concatenate([block.accel for block in blocks])
        assert all(block.time.shape == block.accel.shape for block in blocks)
        assert 0.01 < np.nanmax(np.abs(accel)) <= min(rig.driver.range_ms2, 157)  # type: ignore[union-attr]
    assert samples or blocks


@every_driver
def test_the_step_of_the_command_is_told(case: Case, rig: Rig) -> None:
    """A bus tells the resolution of its command: commands lie on that grid, 0 is continuous, NaN is unknown."""
    if not case.joints:
        assert rig.driver.range_ms2 > 0  # type: ignore[union-attr]
        return
    rig.driver.open()
    step = rig.driver.resolution_rad  # type: ignore[union-attr]
    commands = np.array([s.command for r in collect(rig) if isinstance(r, ServoReading) for s in r.samples])
    assert math.isnan(step) or step >= 0
    if step > 0:
        assert np.abs(commands / step - np.rint(commands / step)).max() < 1e-6


@every_driver
def test_closing_twice_and_opening_again(rig: Rig) -> None:
    """close may be called before opening and twice; afterwards open and read work again."""
    rig.driver.close()
    rig.driver.open()
    rig.driver.read()
    rig.driver.close()
    rig.driver.close()
    rig.driver.open()
    assert len(collect(rig, 0.1)) >= 5


@every_driver
def test_unknown_keys_are_refused(case: Case) -> None:
    """A misspelt key in a table is an error, not ignored."""
    row = get_driver(case.driver)
    kind = row.joint_options if case.joints else row.accelerometer_options
    given = {
        "name": "a",
        "driver": case.driver,
        "port": "/dev/ttyUSB0",
        **(case.joints[0] if case.joints else case.accelerometer),
    }
    msgspec.convert(given, kind)
    with pytest.raises(msgspec.ValidationError, match="bodrate"):
        msgspec.convert({**given, "bodrate": 1}, kind)


def test_the_table_has_every_driver() -> None:
    """Each driver of ours has its rows here, and its name in the registry is its own."""
    assert {case.driver for case in CASES} == {name for name in names() if not name.startswith("example")}
    for name in {case.driver for case in CASES}:
        assert get_driver(name).name == name
        assert get_driver(name).summary


@every_device
def test_reading_without_data_returns_soon(case: Case, tmp_path: Path) -> None:
    """A device that says nothing: every read returns within half a second, with nothing in it."""
    with plugged(case, tmp_path, case.silent()) as rig:
        rig.driver.open()
        spans = []
        for _ in range(5):
            start = time.monotonic()
            reading = rig.driver.read()
            spans.append(time.monotonic() - start)
            assert len(reading.samples if isinstance(reading, ServoReading) else reading.time) == 0
        assert sorted(spans)[2] < 0.5
    if isinstance(reading, ServoReading):
        assert reading.silent == rig.names


@every_device
def test_a_missing_port_and_a_closed_one(case: Case, tmp_path: Path) -> None:
    """Opening a port that does not exist, and reading or identifying before open or after close, raise PortError."""
    missing, _ = make(case, str(tmp_path / "ttyUSB9"))
    with pytest.raises(PortError, match="does not exist"):
        missing.open()
    with plugged(case, tmp_path) as rig:
        for action in (rig.driver.read, rig.driver.identify):
            with pytest.raises(PortError, match="is not open"):
                action()
        rig.driver.open()
        rig.driver.close()
        with pytest.raises(PortError, match="is not open"):
            rig.driver.read()


@every_device
def test_a_port_has_one_owner(rig: Rig, case: Case) -> None:
    """A second driver on the same port is told that it is busy, and the first goes on; on a bus both hear."""
    assert rig.emulator is not None
    rig.driver.open()
    second, _ = make(case, rig.emulator.paths[0])
    if get_driver(case.driver).shares:
        second.open()
        assert len(collect(Rig(second, rig.names, None), 0.1)) >= 5
    else:
        with pytest.raises(PortError, match="is busy; likely cause"):
            second.open()
    second.close()
    assert len(collect(rig, 0.1)) >= 5


@every_device
def test_unplugged_and_plugged_in_again(rig: Rig) -> None:
    """Pulling the plug raises PortError; opened again at the same path, data flow, and times go on ascending."""
    assert rig.emulator is not None
    rig.driver.open()
    before = last_time(collect(rig, 0.3))
    rig.emulator.unplug()
    with pytest.raises(PortError, match="went away"):
        collect(rig, 1.0)
    with pytest.raises(PortError, match="does not exist"):
        rig.driver.open()
    rig.emulator.plug()
    rig.driver.open()
    assert all(identity.ok for identity in rig.driver.identify())
    assert last_time(collect(rig, 0.3)) > before


@every_device
def test_another_device_on_the_port(case: Case, tmp_path: Path) -> None:
    """A GPS receiver is not taken for the device: no identity is right, each tells what was seen, and the gist of it,
    which is the same whatever bytes come in; no data come out."""
    with plugged(case, tmp_path, TextStream(b"other bytes\r\n")) as rig:
        rig.driver.open()
        other = rig.driver.identify()
    with plugged(case, tmp_path, TextStream()) as rig:
        rig.driver.open()
        identities = rig.driver.identify()
        assert [(each.gist, each.found) for each in identities] != [(each.gist, each.found) for each in other]
        assert [each.gist for each in identities] == [each.gist for each in other]
        assert all("likely cause: another device" in each.gist for each in identities)
        assert [identity.ok for identity in identities] == [False] * len(rig.names)
        assert all("$GPGGA" in identity.found and "likely cause" in identity.found for identity in identities)
        for reading in collect(rig, 0.3):
            if isinstance(reading, ServoReading):
                assert reading.samples == ()
            else:
                assert np.isnan(reading.accel).all()


def last_time(readings: list[ServoReading | AccelBlock]) -> float:
    """The newest time in some readings [s]."""
    return max(
        time
        for r in readings
        for time in (r.time.tolist() if isinstance(r, AccelBlock) else [s.time for s in r.samples])
    )
