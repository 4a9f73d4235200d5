"""Accelerometers on a CAN bus: raw frames, a DBC file, a counter, CiA 404's process value; and what is told instead."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from lostmotion.drivers.errors import DriverError
from tests.drivers.canbus import bus, library_robot, sensor
from tests.drivers.rigs import block, until

DBC = """VERSION ""

NS_ :

BS_:

BU_: Sensor Monitor

BO_ 385 Acceleration: 8 Sensor
 SG_ Tip : 7|16@0- (0.5,0) [-16384|16383.5] "mg" Monitor
 SG_ Heat : 16|8@1+ (1,0) [0|255] "degC" Monitor
"""


@pytest.fixture
def channel(request: pytest.FixtureRequest) -> str:
    """A virtual bus of this test's own."""
    return str(request.node.name)


@contextmanager
def sending(
    channel: str, data: Callable[[int], bytes | None], id: int = 0x181, rate_hz: float = 1000.0
) -> Iterator[None]:
    """Frames of this identifier in bursts of 10 ms, number i with ``data(i)``, until the block ends."""
    stop = threading.Event()

    def run() -> None:
        with can.Bus(channel, interface="virtual") as out:
            begin, i = time.monotonic(), 0
            while not stop.wait(0.01):
                while i < (time.monotonic() - begin) * rate_hz:
                    if (content := data(i)) is not None:
                        out.send(can.Message(arbitration_id=id, data=content, is_extended_id=id > 0x7FF))
                    i += 1

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def test_raw_frames(channel: str) -> None:
    """Identity by rate, values by scale and offset, all that were sent, evenly spaced on the whole."""
    with sending(channel, lambda i: struct.pack("<Bh", 7, i % 1000 - 500)):
        tip = sensor("can", channel, id=0x181, scale=0.01, offset=1.0, signal={"start_bit": 8})
        tip.open()
        (who,) = tip.identify()
        assert who.ok, who
        got = block(tip, 1600)
        tip.close()
    raw = np.rint((got.accel - 1.0) / 0.01).astype(int)
    assert np.all((np.diff(raw) - 1) % 1000 == 0)
    assert np.median(np.diff(got.time)) == pytest.approx(1e-3, rel=0.1)
    assert tip.range_ms2 == pytest.approx(327.67)
    assert got.lost == 0


def test_a_dbc_file_tells_where_the_bits_are(channel: str, tmp_path: Path) -> None:
    """A big-endian signal in mg, as cantools reads it from the file, in m/s²; what is not there is named."""
    (tmp_path / "tip.dbc").write_text(DBC)
    keys: dict[str, Any] = {"dbc": str(tmp_path / "tip.dbc"), "message": "Acceleration", "dbc_signal": "Tip"}
    with sending(channel, lambda i: struct.pack(">hBxxxxx", -2000, 30)):
        tip = sensor("can", channel, **keys)
        tip.open()
        got = block(tip, 500)
        tip.close()
    assert got.accel == pytest.approx(-9.80665)
    for wrong, words in (
        ({"message": "Tilt"}, "found no message 'Tilt', expected one of Acceleration"),
        ({"dbc_signal": "Top"}, "found no signal 'Top', expected one of Tip, Heat"),
        ({"dbc_signal": "Heat"}, "found the unit 'degC', expected a whole number in m/s"),
        ({"dbc": str(tmp_path / "no.dbc")}, "cannot be read as DBC"),
    ):
        with pytest.raises(DriverError, match=words):
            sensor("can", channel, **{**keys, **wrong})


def test_a_counter_tells_which_frames_were_lost(channel: str) -> None:
    """Every hundredth frame is missing: NaN stands in its place, and it is counted as lost."""
    with sending(channel, lambda i: None if i % 100 == 50 else struct.pack("<hB", 100, i % 256)):
        tip = sensor("can", channel, id=0x181, counter={"start_bit": 16, "length": 8, "signed": False})
        tip.open()
        got = block(tip, 1600)
        tip.close()
    assert abs(got.lost - len(got.time) / 100) <= 1
    assert np.count_nonzero(np.isnan(got.accel)) == got.lost
    assert got.accel[np.isfinite(got.accel)] == pytest.approx(100)


def test_a_process_value_of_cia_404_beside_drives_on_one_bus(channel: str) -> None:
    """0x9130 in the second half of a TPDO, and drives: one opened bus serves both drivers."""
    pdo = [{"cob_id": 0x1A0, "map": [0x61500108, 0x00050018, 0x91300120]}]
    with (
        library_robot(channel) as robot,
        sending(channel, lambda i: struct.pack("<ii", 99, -i % 70000 - 70000), id=0x1A0),
    ):
        robot.start()
        tip = sensor("canopen", channel, node=0x20, object=0x9130, pdo=pdo, scale=0.001)
        drives = bus(channel)
        tip.open()
        drives.open()
        assert tip.identify()[0].ok
        assert all(who.ok for who in drives.identify())
        stop = threading.Event()
        heard: list[str] = []

        def listen() -> None:
            while not stop.is_set():
                heard.extend(sample.joint for sample in drives.read().samples)

        thread = threading.Thread(target=listen)
        thread.start()
        got = block(tip, 500)
        until(lambda: heard.count("j1") > 30)
        stop.set()
        thread.join()
        tip.close()
        drives.close()
    assert np.all((got.accel <= -0.001) & (got.accel >= -140.0))
    assert {"j1", "j2"} == set(heard)


@pytest.mark.slow
def test_what_comes_instead_is_told(channel: str) -> None:
    """Nothing, other frames, frames too short, another rate: each with its likely cause."""
    tip = sensor("can", channel, id=0x181)
    tip.open()
    assert "no frame at all" in tip.identify()[0].found
    with sending(channel, lambda i: b"\0\0", id=0x182):
        (who,) = tip.identify()
        assert who.found.startswith("only 0x182; likely cause: another identifier")
        assert who.gist == "only other frames; likely cause: another identifier, or a node that was not started"
    with sending(channel, lambda i: b"\0"):
        assert "frames too short for the signal, which ends in byte 2" in tip.identify()[0].found
    with sending(channel, lambda i: b"\0\0", rate_hz=100):
        (who,) = tip.identify()
        assert not who.ok
        assert "likely cause: rate_hz is not what the sensor is set to" in who.found
    tip.close()


@pytest.mark.parametrize(
    ("name", "keys", "words"),
    [
        ("can", {}, "no frame is named; expected id = 0x181, or dbc = a file"),
        (
            "can",
            {"id": 1, "signal": {"start_bit": 60, "length": 16}},
            "16 bits from bit 60 on, expected bits of the first 8",
        ),
        ("can", {"id": 1, "rate_hz": 100.0}, "the oscillator rings at 58 Hz"),
        ("canopen", {"node": 3}, "no PDO mapping; expected pdo"),
        ("canopen", {"node": 3, "pdo": [{"cob_id": 5, "map": [0x60640020]}]}, "no PDO of node 3 holds 0x7130:1"),
    ],
)
def test_what_cannot_work_is_refused(name: str, keys: dict[str, Any], words: str) -> None:
    """Before the bus is opened, in one line."""
    with pytest.raises(DriverError, match=words):
        sensor(name, "nowhere", **keys)


def test_a_limit_cuts_what_lies_beyond(channel: str) -> None:
    """Beyond range_ms2 a sample is broken and NaN."""
    with sending(channel, lambda i: struct.pack("<h", 5000 if i % 10 == 0 else 10)):
        tip = sensor("can", channel, id=0x181, scale=0.1, range_ms2=160.0)
        tip.open()
        got = block(tip, 500)
        tip.close()
    assert got.broken == np.count_nonzero(np.isnan(got.accel)) > 10
    assert np.nanmax(got.accel) == pytest.approx(1.0)
    assert tip.range_ms2 == 160.0
