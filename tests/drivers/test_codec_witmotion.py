"""Frames of WitMotion sensors: round trips, garbage, broken frames."""

from __future__ import annotations

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lostmotion.drivers.codec.witmotion import ACCELERATION, WitDecoder, WitFrame, encode, to_ms2

INT16 = st.integers(-32768, 32767)
FRAMES = st.builds(WitFrame, st.integers(0x50, 0x5A), st.tuples(INT16, INT16, INT16, INT16))
SMALL = st.integers(0, 0x40)
TAME = st.builds(WitFrame, st.just(ACCELERATION), st.tuples(SMALL, SMALL, SMALL, SMALL))


@given(st.lists(FRAMES, max_size=5), st.integers(1, 15))
def test_round_trip_in_any_chunks(frames: list[WitFrame], chunk: int) -> None:
    """What is encoded comes back, however the stream is cut, and nothing counts as broken."""
    stream = b"".join(map(encode, frames))
    decode = WitDecoder()
    assert [f for i in range(0, len(stream), chunk) for f in decode.feed(stream[i : i + chunk])] == frames
    assert decode.broken == 0


@given(st.lists(st.sampled_from([b"\x55\x51", b"\x55"]) | st.binary(max_size=12)))
def test_garbage_never_raises_and_chunks_do_not_matter(pieces: list[bytes]) -> None:
    """Any bytes give the same frames and count whether they come at once or one by one."""
    at_once, one_by_one = WitDecoder(), WitDecoder()
    data = b"".join(pieces)
    assert at_once.feed(data) == [f for byte in data for f in one_by_one.feed(bytes((byte,)))]
    assert at_once.broken == one_by_one.broken


@given(st.lists(TAME.map(encode) | FRAMES.map(encode) | st.binary(max_size=12)), st.integers(1, 40))
def test_the_quick_way_tells_the_same(pieces: list[bytes], chunk: int) -> None:
    """Accelerations taken together, and what is left to ``feed``, are what ``feed`` alone gives, in the same order."""
    quick, slow = WitDecoder(), WitDecoder()
    data = b"".join(pieces)
    found: list[WitFrame | None] = []
    for part in (data[i : i + chunk] for i in range(0, len(data), chunk)):
        values = quick.accelerations(part)
        found += quick.feed(part) if values is None else [WitFrame(ACCELERATION, one) for one in values]
    assert found + quick.feed(b"") == slow.feed(data)
    assert quick.broken == slow.broken


@given(st.lists(TAME, min_size=3, max_size=6), st.integers(2, 10), st.integers(1, 0x40), st.data())
def test_a_corrupted_frame_loses_only_itself(frames: list[WitFrame], at: int, flip: int, data: st.DataObject) -> None:
    """One changed byte costs that one frame and counts once, in its place."""
    victim = data.draw(st.integers(0, len(frames) - 1))
    raw = [bytearray(encode(frame)) for frame in frames]
    raw[victim][at] = raw[victim][at] ^ flip if raw[victim][at] ^ flip != 0x55 else 0
    assume(raw[victim][-1] != 0x55)  # a sum that looks like a header counts as one
    decode = WitDecoder()
    assert decode.feed(b"".join(raw)) == [None if i == victim else f for i, f in enumerate(frames)]
    assert decode.broken == 1


@given(st.lists(TAME, min_size=2, max_size=5), st.integers(1, 10))
def test_a_truncated_frame_loses_only_itself(frames: list[WitFrame], size: int) -> None:
    """A frame cut short costs itself, unless what follows completes its sum by chance (1 in 256)."""
    stream = encode(frames[0])[:size] + b"".join(map(encode, frames[1:]))
    assume(sum(stream[:10]) & 0xFF != stream[10])
    decode = WitDecoder()
    found = decode.feed(stream)
    assert [frame for frame in found if frame] == frames[1:]
    assert decode.broken == 1


def test_full_scale_is_16_g() -> None:
    """A raw 2048 is 1 g, the manual's raw / 32768 × 16 g."""
    assert to_ms2(2048) == pytest.approx(9.80665)
    assert WitDecoder().feed(bytes.fromhex("5551 0008 0000 0008 c409 83")) == [WitFrame(0x51, (2048, 0, 2048, 2500))]
