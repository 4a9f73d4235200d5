"""Data logs of WPILib: what its format says, what SysId tests in them, and damage."""

from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.wpilog import WpilibLog, unit_of_entry
from lostmotion.drivers.recordings import read_recordings
from tests.drivers.test_formats import read, refused
from tests.drivers.wpilogs import CYCLE_S, HEADER, TESTS, Log, double, of_sysid

INTEGER_TEST = bytes.fromhex("20 00 1a 40420f 00 01000000 04000000 74657374 05000000 696e743634 00000000")
"""starts the entry ``test`` of type int64, as in the specification"""
INTEGER_3 = bytes.fromhex("20 01 08 40420f 0300000000000000")
"""its value 3 at one second, as there"""
FINISHED = bytes.fromhex("20 00 05 40420f 01 01000000")


def test_the_examples_of_the_specification(tmp_path: Path) -> None:
    """An entry that is started, has one value and is finished."""
    path = tmp_path / "spec.wpilog"
    path.write_bytes(HEADER + INTEGER_TEST + INTEGER_3 + FINISHED + INTEGER_3)
    log = WpilibLog.of(path)
    assert [(one.topic, one.kind, one.count) for one in log.channels] == [("test", "int64", 1)]
    assert list(log.messages(["test"])) == [("test", 10**9, struct.pack("<q", 3))]
    assert log.notes == []


@pytest.mark.parametrize(
    ("said", "unit"),
    [("Volt", "V"), ("Rotation per Second", "rev/s"), ("radians", "rad"), ("Meter per Second", "m/s"), ("Amps", "A"),
     ('{"source":"NT"}', ""), ("", "")],
)  # fmt: skip
def test_units_in_the_metadata(said: str, unit: str) -> None:
    """As WPILib names them; others are none."""
    assert unit_of_entry(said) == unit


def test_each_test_of_sysid_is_a_recording(tmp_path: Path) -> None:
    """By the state, which is logged after the numbers of its period, without what was logged between the tests, and
    without the one that was interrupted."""
    log, tests = of_sysid()
    path = tmp_path / "lift.wpilog"
    path.write_bytes(log.data)
    several = read_recordings([path], base="joint")
    assert [one.name for one in several] == [f"{path}#episode={at}" for at in range(4)]
    for one, (volts, turns) in zip(several, tests, strict=True):
        np.testing.assert_allclose(one.signal("voltage")[1], volts[1:])
        np.testing.assert_allclose(one.signal("position")[1], 2 * np.pi * turns[1:])
        assert np.diff(one.signal("voltage")[0]) == pytest.approx(CYCLE_S)
    whole = read(path)
    assert f"{', '.join(TESTS)} are the runs 0 to 3, as in FILE#episode=0" in whole.notes
    assert whole.recording.signal("position")[1].size == 4 * 100 + 5 + 5 * 50
    assert {"NT:/pose[0]", "NT:/pose[1]"} < set(" ".join(whole.notes).replace(",", " ").split())
    assert f"{path}: found episode=4, expected 0 to 3" in refused(path, episode=4)


def test_a_log_without_an_end(tmp_path: Path) -> None:
    """What comes before it is read, wherever it ends."""
    log, _ = of_sysid()
    path = tmp_path / "cut.wpilog"
    path.write_bytes(log.data[:-3])
    assert any("the file has no end" in note for note in read(path).notes)
    for end in range(13, 2000, 7):
        path.write_bytes(log.data[:end])
        with suppress(RecordingError):
            read(path)


def test_damaged_logs_are_refused_or_read(tmp_path: Path) -> None:
    """Another version, bytes at random, values of other lengths than their types have."""
    log, _ = of_sysid()
    path = tmp_path / "damaged.wpilog"
    path.write_bytes(log.data.replace(b"WPILOG\x00\x01", b"WPILOG\x00\x02", 1))
    assert "found another version of WPILib's data log, expected 1.0" in refused(path)
    path.write_bytes(HEADER)
    assert str(path) in refused(path)
    rng = np.random.default_rng(4)
    for _ in range(200):
        data = bytearray(log.data)
        for at in rng.integers(8, len(data), 20):
            data[at] = rng.integers(256)
        path.write_bytes(bytes(data))
        with suppress(RecordingError):
            read(path)
    short = Log()
    short.start("angle", "double")
    for k in range(100):
        short.append("angle", 0.01 * k, double(np.sin(0.1 * k))[: 8 if k % 10 else 5])
    path.write_bytes(short.data)
    assert "10 messages that could not be read were left out" in read(path).notes
