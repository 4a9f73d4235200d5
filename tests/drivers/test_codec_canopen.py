"""The codecs of CAN: PDO mappings, signals of DBC files, SDO transfers and the text of serial adapters, each against
another implementation's bytes."""

from __future__ import annotations

import os
import struct
import tty
from typing import Any

import can
import canopen
import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.drivers.codec import cia402, sdo, slcan
from lostmotion.drivers.codec.pdo import fields_of, value_of
from lostmotion.drivers.codec.signal import SignalError, layout_of

PIECES = int(os.environ.get("LOSTMOTION_EXAMPLES", "400"))
FRAMES = 256
"""of each mapping: with PIECES some 1e5 frames"""
OBJECTS = [(0x6041, 16), (0x6062, 32), (0x6064, 32), (0x606C, 32), (0x6077, 16), (0x6078, 16), (0x6079, 32),
           (0x607A, 32), (0x6061, 8), (0x0005, 8), (0x0006, 16)]  # fmt: skip


def mappings() -> Any:
    """Lists of objects that fit into a PDO."""
    lists = st.lists(st.sampled_from(OBJECTS), min_size=1, max_size=8, unique_by=lambda o: o[0])
    return lists.filter(lambda found: sum(bits for _, bits in found) <= 64)


@pytest.mark.slow
@settings(max_examples=PIECES, deadline=None)
@given(mapping=mappings(), seed=st.integers(0, 2**32))
def test_pdo_fields_against_plain_slices_of_bits(mapping: list[tuple[int, int]], seed: int) -> None:
    """1e5 frames of random bytes: each object is the slice of a string of bits that its mapping says, in two's
    complement where it is signed."""
    fields = fields_of([index << 16 | bits for index, bits in mapping], cia402.SIGNED)
    size = (sum(bits for _, bits in mapping) + 7) // 8
    assert {index for index, _ in fields} == {index for index, _ in mapping if index > 7}
    for data in np.random.default_rng(seed).integers(0, 256, (FRAMES, size), np.uint8):
        frame, at = data.tobytes(), 0
        text = "".join(f"{byte:08b}" for byte in reversed(frame))
        number = int.from_bytes(frame, "little")
        for index, bits in mapping:
            plain = int(text[len(text) - at - bits : len(text) - at], 2)
            if (index, 0) in cia402.SIGNED and plain >= 1 << (bits - 1):
                plain -= 1 << bits
            at += bits
            if index > 7:
                assert value_of(fields[index, 0], number) == plain


@settings(max_examples=150, deadline=None)
@given(mapping=mappings(), seed=st.integers(0, 2**32))
def test_pdo_fields_against_the_canopen_library(mapping: list[tuple[int, int]], seed: int) -> None:
    """What the library packs into a PDO of the same mapping comes out as it went in."""
    from tests.drivers.canbus import dictionary

    objects = [(index, bits) for index, bits in mapping if index in (0x6041, 0x6062, 0x6064, 0x606C, 0x6077, 0x6078)]
    if not objects:
        return
    node = canopen.LocalNode(1, dictionary())
    pdo = node.tpdo[1]
    pdo.clear()
    for index, _ in objects:
        pdo.add_variable(index)
    fields = fields_of([index << 16 | bits for index, bits in objects], cia402.SIGNED)
    dice = np.random.default_rng(seed)
    for _ in range(8):
        values = {}
        for index, bits in objects:
            low, high = (0, 1 << bits) if index == 0x6041 else (-(1 << bits - 1), 1 << bits - 1)
            values[index] = int(dice.integers(low, high))
            pdo[index].raw = values[index]
        number = int.from_bytes(bytes(pdo.data), "little")
        assert {index: value_of(fields[index, 0], number) for index, _ in objects} == values


@settings(max_examples=PIECES, deadline=None)
@given(
    bits=st.integers(1, 64),
    place=st.integers(0, 63),
    big=st.booleans(),
    signed=st.booleans(),
    seed=st.integers(0, 2**32),
)
def test_signals_against_cantools(bits: int, place: int, big: bool, signed: bool, seed: int) -> None:
    """Any start, length, order and sign: what cantools decodes from random frames, or both refuse."""
    signed = signed and bits > 1
    conversion = cantools.database.conversion.BaseConversion.factory(scale=0.5, offset=-3)
    order: Any = "big_endian" if big else "little_endian"
    signal = cantools.database.can.Signal("a", place, bits, order, signed, conversion=conversion)
    try:
        layout = layout_of(0x100, place, bits, big, signed, 0.5, -3)
    except SignalError:
        with pytest.raises(cantools.database.errors.Error):
            cantools.database.can.Message(0x100, "m", 8, [signal], strict=True)
        return
    message = cantools.database.can.Message(0x100, "m", 8, [signal], strict=True)
    frames = [row.tobytes() for row in np.random.default_rng(seed).integers(0, 256, (64, 8), np.uint8)]
    expected = [float(message.decode(frame)["a"]) for frame in frames]  # type: ignore[arg-type, call-overload]
    np.testing.assert_allclose(layout.values(frames), expected, rtol=1e-12, atol=0)
    assert np.isnan(layout.values([frame[: layout.ends - 1] for frame in frames])).all()
    assert np.isfinite(layout.values([frame[: layout.ends] for frame in frames])).all()


@pytest.mark.slow
@settings(max_examples=PIECES, deadline=None)
@given(
    frames=st.lists(st.tuples(st.integers(0, 0x1FFFFFFF), st.binary(max_size=8)), max_size=30), cut=st.integers(1, 40)
)
def test_slcan_text_there_and_back_in_any_pieces(frames: list[tuple[int, bytes]], cut: int) -> None:
    """Frames as an adapter writes them, cut anywhere, with answers to commands between them, come out as they were."""
    text = b"z\r\r\x07".join(slcan.encode(id, data) for id, data in frames)
    decoder = slcan.SlcanDecoder()
    found = [frame for i in range(0, len(text), cut) for frame in decoder.feed(text[i : i + cut])]
    assert found == frames
    assert (decoder.broken, decoder.foreign) == (0, b"")


def test_slcan_against_python_can() -> None:
    """The text that python-can's slcan bus sends is what we write, and is read with and without an adapter's time."""
    master, slave = os.openpty()
    tty.setraw(slave)
    with can.Bus(os.ttyname(slave), interface="slcan", sleep_after_open=0) as bus:
        os.read(master, 100)
        for id, extended in ((0x181, False), (0x7FF, False), (0x12345678, True)):
            data = bytes(range(id % 9))
            bus.send(can.Message(arbitration_id=id, data=data, is_extended_id=extended))
            sent = os.read(master, 100)
            assert slcan.encode(id, data) == sent
            assert slcan.SlcanDecoder().feed(sent) == [(id, data)]
            assert slcan.SlcanDecoder().feed(sent[:-1] + b"1A2B\r") == [(id, data)]
    os.close(master)
    os.close(slave)


@settings(max_examples=PIECES, deadline=None)
@given(data=st.binary(max_size=400))
def test_any_bytes_at_all_on_a_serial_port(data: bytes) -> None:
    """No exception, and every frame has an identifier and at most eight bytes."""
    for id, content in slcan.SlcanDecoder().feed(data):
        assert 0 <= id < 1 << 32
        assert len(content) <= 8


OBJECTS_OF_A_SERVER = {
    (0x1000, 0): struct.pack("<I", 5),
    (0x1001, 0): b"\1",
    (0x1008, 0): b"a device name of 30 bytes, yes",
}


def server() -> sdo.SdoServer:
    """One with three objects, none of which may be written."""

    def read(index: int, subindex: int) -> bytes:
        try:
            return OBJECTS_OF_A_SERVER[index, subindex]
        except KeyError:
            raise sdo.Abort(0x06020000) from None

    def write(index: int, subindex: int, data: bytes) -> None:
        raise sdo.Abort(0x06010002)

    return sdo.SdoServer(read, write)


@pytest.mark.slow
@settings(max_examples=PIECES, deadline=None)
@given(requests=st.lists(st.binary(max_size=10) | st.binary(min_size=8, max_size=8), max_size=20))
def test_any_requests_at_all_to_the_server(requests: list[bytes]) -> None:
    """No exception; an answer has eight bytes, or there is none; afterwards it serves as before."""
    one = server()
    for request in requests:
        answer = one.answer(request)
        assert answer is None or len(answer) == 8
    assert sdo.uploaded(0x1000, 0, one.answer(sdo.upload_request(0x1000, 0)) or b"") == 5
    with pytest.raises(sdo.Abort, match="0x06020000"):
        sdo.uploaded(0x2000, 0, one.answer(sdo.upload_request(0x2000, 0)) or b"")


@pytest.mark.parametrize(
    ("word", "state"),
    [(0x0000, "not ready to switch on"), (0x0250, "switch on disabled"), (0x0231, "ready to switch on"),
     (0x0233, "switched on"), (0x1637, "operation enabled"), (0x0217, "quick stop active"),
     (0x021F, "fault reaction active"), (0x0218, "fault"), (0x0032, "unknown (0x0032)")],
)  # fmt: skip
def test_the_states_of_a_status_word(word: int, state: str) -> None:
    """Table 30 of CiA 402-2, with bits set that do not count."""
    assert cia402.state_of(word) == state
