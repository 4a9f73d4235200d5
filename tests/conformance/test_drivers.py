"""One suite over every driver: what the service relies on, whatever the device."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.base import AccelBlock, ServoReading
from lostmotion.drivers.conformance import CHECKS, Subject, collect
from lostmotion.drivers.emulator import TextStream
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.registry import get_driver, names
from lostmotion.drivers.serial_port import SerialPort
from tests.conformance.cases import CASES, Case, Rig, make, plugged
from tests.drivers.rigs import wait_long

HARDWARE = [case for case in CASES if case.hardware is not None]
LINES = [case for case in HARDWARE if case.port == "port"]
every_driver = pytest.mark.parametrize("case", CASES, ids=lambda case: case.id)
every_device = pytest.mark.parametrize("case", HARDWARE, ids=lambda case: case.id)

every_line = pytest.mark.parametrize("case", LINES, ids=lambda case: case.id)


@pytest.fixture
def rig(case: Case, tmp_path: Path) -> Iterator[Rig]:
    """The driver with its device on the port, not yet open."""
    with plugged(case, tmp_path) as made:
        yield made


@every_driver
@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_what_holds_for_any_driver(check: Callable[[Subject], None], rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """The checks that packages of others run, too: identity, times, values, resolution, opening again, unknown keys."""
    wait_long(monkeypatch)
    check(rig.subject)


def test_the_table_has_every_driver() -> None:
    """Each driver of ours has its rows here, and its name in the registry is its own."""
    assert {case.driver for case in CASES} == {name for name in names() if not name.startswith("example")}
    for name in {case.driver for case in CASES}:
        assert get_driver(name).name == name
        assert get_driver(name).summary


@every_device
def test_reading_without_data_returns_soon(case: Case, tmp_path: Path) -> None:
    """A device that says nothing: a read returns within half a second where the machine is not busy, with nothing in
    it."""
    with plugged(case, tmp_path, case.silent()) as rig:
        rig.driver.open()
        spans = []
        for _ in range(5):
            start = time.monotonic()
            reading = rig.driver.read()
            spans.append(time.monotonic() - start)
            assert len(reading.samples if isinstance(reading, ServoReading) else reading.time) == 0
        assert min(spans) < 0.5
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
    """A second driver on the same port is told that it is busy, and the first goes on.  On a bus both hear, in this
    process: a serial adapter is still busy to whoever opens its port anew, as another process would.  A network
    interface such as can0 would not be; that is the kernel's, and there is none here."""
    assert rig.emulator is not None
    rig.driver.open()
    second, _ = make(case, rig.emulator.paths[0])
    if get_driver(case.driver).shares:
        second.open()
        assert len(collect(second, 0.1)) >= 5
        with pytest.raises(PortError, match="is busy; likely cause"):
            SerialPort(rig.emulator.paths[0], 115200).open()
    else:
        with pytest.raises(PortError, match="is busy; likely cause"):
            second.open()
    second.close()
    assert len(collect(rig.driver, 0.1)) >= 5


@every_device
def test_unplugged_and_plugged_in_again(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pulling the plug raises PortError; opened again at the same path, data flow, and times go on ascending."""
    wait_long(monkeypatch)
    assert rig.emulator is not None
    rig.driver.open()
    before = last_time(collect(rig.driver, 0.3))
    rig.emulator.unplug()
    with pytest.raises(PortError, match="went away"):
        collect(rig.driver, 1.0)
    with pytest.raises(PortError, match="does not exist"):
        rig.driver.open()
    rig.emulator.plug()
    rig.driver.open()
    assert all(identity.ok for identity in rig.driver.identify())
    assert last_time(collect(rig.driver, 0.3)) > before


@pytest.mark.slow
@every_line
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
        for reading in collect(rig.driver, 0.3):
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
