"""Dynamixel packets: round trips, garbage, broken frames, and agreement with ROBOTIS's own SDK."""

from __future__ import annotations

import pytest
from dynamixel_sdk import Protocol2PacketHandler
from hypothesis import assume, given
from hypothesis import strategies as st

from lostmotion.drivers.codec.dynamixel import READ, STATUS, SYNC_READ, Packet, Question, crc16, decoder, encode

PACKETS = st.builds(Packet, st.integers(0, 252), st.integers(0, 127), st.binary(max_size=60))
SEVEN_BIT = st.lists(st.integers(0, 127), min_size=4, max_size=20).map(bytes)
TAME = st.builds(Packet, st.integers(1, 100), st.integers(0, 100), SEVEN_BIT)
"""packets that hold nothing like a header, so that what is lost with a broken one is certain"""
PROTOCOLS = st.sampled_from([1, 2])


@given(st.lists(PACKETS, max_size=5), PROTOCOLS, st.integers(1, 40))
def test_round_trip_in_any_chunks(packets: list[Packet], protocol: int, chunk: int) -> None:
    """What is encoded comes back, however the stream is cut, and nothing counts as broken."""
    stream = b"".join(encode(packet, protocol) for packet in packets)
    decode = decoder(protocol)
    found = [p for i in range(0, len(stream), chunk) for p in decode.feed(stream[i : i + chunk])]
    assert found == packets
    assert decode.broken == 0


@given(
    st.lists(st.sampled_from([b"\xff", b"\xff\xff\xfd\x00", b"\x01\x04", b"\x00"]) | st.binary(max_size=8)), PROTOCOLS
)
def test_garbage_never_raises_and_chunks_do_not_matter(pieces: list[bytes], protocol: int) -> None:
    """Any bytes at all give the same packets and the same count whether they come at once or one by one."""
    at_once, one_by_one = decoder(protocol), decoder(protocol)
    data = b"".join(pieces)
    found = at_once.feed(data)
    assert found == [p for byte in data for p in one_by_one.feed(bytes((byte,)))]
    assert at_once.broken == one_by_one.broken == found.count(None)


@given(st.lists(TAME, min_size=3, max_size=6), PROTOCOLS, st.data())
def test_a_corrupted_frame_loses_only_itself(packets: list[Packet], protocol: int, data: st.DataObject) -> None:
    """One flipped byte after the length costs that one packet; a FF made so may count as one more broken header."""
    frames = [bytearray(encode(packet, protocol)) for packet in packets]
    victim = data.draw(st.integers(0, len(frames) - 1))
    first = {1: 4, 2: 7}[protocol]
    frames[victim][data.draw(st.integers(first, len(frames[victim]) - 1))] ^= 0x11
    decode = decoder(protocol)
    found = decode.feed(b"".join(frames))
    assert [p for p in found if p is not None] == packets[:victim] + packets[victim + 1 :]
    assert decode.broken == 1 or frames[victim][-1] == 0xFF


@given(st.lists(TAME, min_size=3, max_size=6), PROTOCOLS, st.data())
def test_a_truncated_frame_loses_only_itself(packets: list[Packet], protocol: int, data: st.DataObject) -> None:
    """A frame cut short at any byte costs that one packet, unless what follows completes its checksum by chance."""
    frames = [encode(packet, protocol) for packet in packets]
    size = data.draw(st.integers(1, len(frames[0]) - 1))
    stream = frames[0][:size] + b"".join(frames[1:]) + bytes(300)
    assume(protocol == 2 or size < 4 or sum(stream[2 : len(frames[0])]) & 0xFF != 0xFF)
    decode = decoder(protocol)
    found = decode.feed(stream)
    assert [p for p in found if p is not None] == packets[1:]
    assert decode.broken >= 1


@given(st.integers(0, 252), st.integers(0, 127), st.binary(min_size=14, max_size=14))
def test_a_question_knows_its_plain_answer(id: int, error: int, data: bytes) -> None:
    """The request is the READ instruction; of the servo's status packet it gives the data, whatever the error byte."""
    question = Question(id, 30, 14)
    assert decoder(1).feed(question.request) == [Packet(id, READ, bytes((30, 14)))]
    answer = encode(Packet(id, error, data), 1)
    assert len(answer) == question.length
    assert answer.startswith(question.start)
    assert question.parameters(answer) == data


@given(st.binary(min_size=14, max_size=14), st.data())
def test_a_question_takes_no_other_answer(data: bytes, draw: st.DataObject) -> None:
    """One flipped bit, another servo's answer, one of another size, one cut short and noise before it give nothing."""
    question = Question(7, 30, 14)
    answer = bytearray(encode(Packet(7, 0, data), 1))
    assert not question.parameters(b"\x00" + answer)
    assert not question.parameters(bytes(answer[:-1]))
    assert not question.parameters(b"")
    assert not question.parameters(encode(Packet(8, 0, data), 1))
    assert not question.parameters(encode(Packet(7, 0, data[:2]), 1))
    answer[draw.draw(st.integers(0, len(answer) - 1))] ^= 1 << draw.draw(st.integers(0, 7))
    assert not question.parameters(bytes(answer))


def test_published_examples() -> None:
    """The frames of ROBOTIS's manual: reading the temperature of servo 1 (1.0), pinging servo 1 (2.0)."""
    assert encode(Packet(1, READ, b"\x2b\x01"), 1) == bytes.fromhex("ffff0104022b01cc")
    assert encode(Packet(1, 1), 2) == bytes.fromhex("fffffd00010300 01194e".replace(" ", ""))
    assert crc16(bytes.fromhex("fffffd000103 0001".replace(" ", ""))) == 0x4E19


@given(st.binary(max_size=40))
def test_crc_agrees_with_the_sdk(data: bytes) -> None:
    """Our CRC-16 is that of dynamixel-sdk."""
    assert crc16(data) == Protocol2PacketHandler().updateCRC(0, list(data), len(data))


def test_a_header_in_the_data_is_stuffed() -> None:
    """FF FF FD within a packet of protocol 2.0 goes out with one more FD, and comes back without it."""
    packet = Packet(3, STATUS, b"\x00\xff\xff\xfd\x01")
    frame = encode(packet, 2)
    assert frame[8:14] == b"\x00\xff\xff\xfd\xfd\x01"
    assert decoder(2).feed(frame) == [packet]


def test_too_long_a_packet_is_refused() -> None:
    """Protocol 1.0 ends at 250 bytes, 2.0 at 1024."""
    with pytest.raises(ValueError, match=r"protocol 1\.0 takes 250"):
        encode(Packet(1, READ, bytes(249)), 1)
    with pytest.raises(ValueError, match=r"protocol 2\.0 takes 1024"):
        encode(Packet(0xFE, SYNC_READ, bytes(1100)), 2)


def test_reset_forgets_a_frame_that_has_begun() -> None:
    """After a pause the rest of a frame is garbage and the next frame is found at once."""
    decode = decoder(1)
    frame = encode(Packet(1, 0, bytes(14)), 1)
    decode.feed(frame[:6])
    decode.reset()
    assert decode.feed(frame) == [Packet(1, 0, bytes(14))]
    assert decode.broken == 0
