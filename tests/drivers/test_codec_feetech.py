"""Feetech's questions, answers and units: the maker's examples, round trips, garbage and broken frames."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lostmotion.drivers.codec.dynamixel import PING, READ, SYNC_READ, Packet, Question, decoder, encode
from lostmotion.drivers.codec.feetech import (
    ADDRESS,
    MODELS,
    FeetechModel,
    Listener,
    SyncQuestion,
    identity_question,
    model_number,
    number_bytes,
    signed,
)
from lostmotion.drivers.codec.servo_state import ServoState, model_name

STS, SCS = MODELS["STS3215"], MODELS["SCS0009"]
SIZE = 8
IDS = st.lists(st.integers(1, 100), min_size=3, max_size=6, unique=True)
TAME = st.lists(st.integers(1, 120), min_size=SIZE, max_size=SIZE).map(bytes)
"""data that hold nothing like a header, so that what is lost with a broken frame is certain"""
MANUAL_ANSWERS = bytes.fromhex("ffff010a00000800000000791e55ffff020a00ff0700000000772353")
"""two servos' answers to the sync read of 8 bytes from 56, in Feetech's protocol manual"""


def heard(ids: list[int], data: bytes, size: int = SIZE, chunk: int = 4096) -> Listener:
    """What a listener finds in some bytes that come in chunks."""
    listener = Listener(ids, size)
    listener.feed(data[i : i + chunk] for i in range(0, len(data), chunk))
    return listener


def test_the_manuals_requests() -> None:
    """PING of servo 1, READ of its position, SYNC READ of 8 bytes of servos 1 and 2: the examples 1, 2 and 8."""
    assert encode(Packet(1, PING), 1) == bytes.fromhex("ffff010201fb")
    assert Question(1, 56, 2).request == bytes.fromhex("ffff0104023802be")
    assert SyncQuestion([1, 2], 56, 8).request == bytes.fromhex("fffffe06823808010236")


def test_the_manuals_answers() -> None:
    """Position 1304 of example 2; positions 2048 and 2047, 12.1 and 11.9 V, 30 and 35 °C of example 8."""
    block = Question(1, 56, 2).parameters(bytes.fromhex("ffff0104001805dd"))
    assert int.from_bytes(block, "little") == 1304
    sync, listener = SyncQuestion([1, 2], 56, 8), heard([1, 2], MANUAL_ANSWERS)
    assert len(MANUAL_ANSWERS) == sync.length
    assert MANUAL_ANSWERS.startswith(sync.start)
    assert listener.broken == 0
    told = {id: STS.decode(bytes(14) + data + bytes(7)) for id, data in listener.found.items()}
    assert [told[id].position / STS.step for id in (1, 2)] == pytest.approx([0, -1])
    assert [told[id].voltage for id in (1, 2)] == pytest.approx([12.1, 11.9])
    assert [told[id].temperature for id in (1, 2)] == [30, 35]


def test_the_state_block_of_an_sts() -> None:
    """29 bytes from 42 with the low byte first: goal 3072, position 1024, speed -100 counts/s, -10 x 6.5 mA; the load
    at 60 is no torque and is left out."""
    assert (ADDRESS, STS.block_size) == (42, 29)
    table = bytearray(80)
    table[42:44], table[56:58], table[58:60] = b"\x00\x0c", b"\x00\x04", b"\x64\x80"
    table[60:62], table[62], table[63], table[69:71] = b"\x0a\x04", 74, 31, b"\x0a\x80"
    state = STS.decode(bytes(table[42:71]))
    assert state.command == pytest.approx(math.pi / 2)
    assert state.position == pytest.approx(-math.pi / 2)
    assert state.velocity == pytest.approx(-100 * math.tau / 4096)
    assert (state.voltage, state.temperature, state.current) == pytest.approx((7.4, 31, -0.065))


def test_the_state_block_of_an_scs() -> None:
    """22 bytes from 42 with the high byte first: goal 1023 is 149.7°, position 0 is -150°; it tells no current."""
    assert SCS.block_size == 22
    table = bytearray(80)
    table[42:44], table[56:58], table[58:60], table[62], table[63] = b"\x03\xff", b"\x00\x00", b"\x80\x64", 60, 29
    state = SCS.decode(bytes(table[42:64]))
    assert math.degrees(state.command) == pytest.approx(149.707, abs=1e-3)
    assert math.degrees(state.position) == pytest.approx(-150)
    assert math.degrees(state.velocity) == pytest.approx(-100 * 300 / 1024)
    assert (state.voltage, state.temperature) == pytest.approx((6.0, 29))
    assert math.isnan(state.current)


def test_a_position_below_zero_has_bit_15_set() -> None:
    """After a move of its zero an STS may stand at count -100, 0x8064; the word is no two's complement."""
    assert signed(0x8064) == -100
    block = bytearray(STS.encode(ServoState(0.0, (-100 - 2048) * STS.step, 0.0, 7.4, 30)))
    assert block[14:16] == b"\x64\x80"
    assert STS.decode(bytes(block)).position == pytest.approx(-2148 * STS.step)


@given(st.sampled_from(list(MODELS.values())), st.floats(-2.5, 2.5), st.floats(-2.5, 2.5), st.floats(-5, 5))
def test_round_trip_within_a_count(model: FeetechModel, command: float, position: float, velocity: float) -> None:
    """What a servo is told to show is read back to half a count."""
    state = model.decode(model.encode(ServoState(command, position, velocity, 7.4, 40.0, -0.1)))
    assert state.command == pytest.approx(command, abs=model.step / 2 + 1e-9)
    assert state.position == pytest.approx(position, abs=model.step / 2 + 1e-9)
    assert state.velocity == pytest.approx(velocity, abs=model.speed / 2 + 1e-9)
    assert math.isnan(state.current) or state.current == pytest.approx(-0.1, abs=model.ampere)


def test_model_numbers() -> None:
    """777 stands as 09 03 in an STS3215, 1284 as 05 04 in an SCS0009, whichever of them was expected."""
    assert number_bytes(STS) == b"\x09\x03"
    assert number_bytes(SCS) == b"\x05\x04"
    for model in MODELS.values():
        assert model_number(b"\x03\x0a\x00" + number_bytes(model)) == model.number
        assert model_name(model.number, MODELS) == f"{model.name} (model number {model.number})"
    assert model_name(1, MODELS) == "unknown model (model number 1)"


@given(st.integers(0, 252))
def test_an_echo_is_no_answer(id: int) -> None:
    """A line that gives back what is sent: neither a question for the model, nor a read, nor a sync read is its own
    answer."""
    for question, size in ((identity_question(id), 5), (Question(id, ADDRESS, 22), 22), (SyncQuestion([id], 42, 3), 3)):
        assert heard([id], question.request, size).found == {}


@given(IDS, st.data(), st.integers(1, 40))
def test_answers_among_noise_in_any_chunks(ids: list[int], data: st.DataObject, chunk: int) -> None:
    """Answers are found by id whatever stands between them and however they are cut, error bytes notwithstanding."""
    blocks = {id: data.draw(TAME) for id in ids}
    noise = st.lists(st.integers(0, 254), max_size=4).map(bytes)
    stream = b"".join(
        data.draw(noise) + encode(Packet(id, data.draw(st.integers(0, 127)), block), 1) for id, block in blocks.items()
    )
    assert heard(ids, stream, chunk=chunk).found == blocks


@given(IDS, st.data())
def test_a_broken_answer_loses_only_itself(ids: list[int], data: st.DataObject) -> None:
    """One flipped byte after the length is counted, and costs that one servo's answer."""
    blocks = {id: data.draw(TAME) for id in ids}
    frames = [bytearray(encode(Packet(id, 0, block), 1)) for id, block in blocks.items()]
    victim = data.draw(st.integers(0, len(ids) - 1))
    frames[victim][data.draw(st.integers(4, len(frames[victim]) - 1))] ^= 0x11
    listener = heard(ids, b"".join(frames))
    del blocks[ids[victim]]
    assert listener.found == blocks
    assert listener.broken >= 1


@given(IDS, st.data())
def test_a_truncated_answer_loses_only_itself(ids: list[int], data: st.DataObject) -> None:
    """An answer cut short before its length is known, or after it, costs no other one's: all ends with the next."""
    blocks = {id: data.draw(TAME) for id in ids}
    frames = [encode(Packet(id, 0, block), 1) for id, block in blocks.items()]
    cut = frames[0][: data.draw(st.integers(1, 3))]
    listener = heard(ids, cut + b"".join(frames[1:]) + b"\x00" * 4)
    assert listener.found == {id: block for id, block in blocks.items() if id != ids[0]}
    assert listener.broken >= 1


@given(st.lists(st.sampled_from([b"\xff", b"\xff\xff\x01\x0a\x00", b"\xff\xff\x02\x02"]) | st.binary(max_size=9)))
def test_garbage_never_raises(pieces: list[bytes]) -> None:
    """Any bytes at all: no error, no answer of another size, and the same count at once or byte by byte."""
    data = b"".join(pieces)
    at_once, one_by_one = heard([1, 2], data), heard([1, 2], data, chunk=1)
    assert at_once.found == one_by_one.found
    assert all(len(block) == SIZE for block in at_once.found.values())
    assert len(at_once.found) == 2 or at_once.broken == one_by_one.broken


@given(st.lists(st.integers(0, 252), min_size=1, max_size=40, unique=True), st.integers(1, 100))
def test_a_sync_read_names_its_servos(ids: list[int], size: int) -> None:
    """Its frame is a broadcast SYNC READ of address, size and ids; its answers are as long as it says."""
    question = SyncQuestion(ids, ADDRESS, size)
    assert decoder(1).feed(question.request) == [Packet(0xFE, SYNC_READ, bytes((ADDRESS, size, *ids)))]
    answers = b"".join(encode(Packet(id, 0, bytes(size)), 1) for id in ids)
    assert len(answers) == question.length
    assert answers.startswith(question.start)
    assert heard(ids, answers, size).found == dict.fromkeys(ids, bytes(size))


def test_a_plain_question_is_a_read() -> None:
    """A servo without sync read is asked by READ."""
    assert decoder(1).feed(identity_question(7).request) == [Packet(7, READ, b"\x00\x05")]
