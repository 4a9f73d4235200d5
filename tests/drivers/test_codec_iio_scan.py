"""Scans of IIO buffers against a packer of single bits that knows nothing of the decoder."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostmotion.drivers.codec.iio_scan import ScanError, ScanFormat, ScanType

FRAMES = 500
EXAMPLES = 250


@st.composite
def types(draw: st.DrawFn) -> str:
    """Any type that a kernel may tell."""
    storage = draw(st.sampled_from([8, 16, 32, 64]))
    bits = draw(st.integers(1, storage))
    shift = draw(st.integers(0, storage - bits))
    repeat = draw(st.sampled_from(["", "", "X2", "X4"]))
    return f"{draw(st.sampled_from(['be', 'le']))}:{draw(st.sampled_from('su'))}{bits}/{storage}{repeat}>>{shift}"


def packed(texts: list[str], dice: random.Random) -> tuple[bytes, list[list[int]]]:
    """One frame with noise in every bit that means nothing, and its numbers: int.to_bytes, offsets counted up."""
    frame, numbers, largest = b"", list[list[int]](), 1
    for text in texts:
        bits = int(text[4 : text.index("/")])
        rest, shift = text[text.index("/") + 1 :].split(">>")
        storage, _, repeat = rest.partition("X")
        size, times = int(storage) // 8, int(repeat or 1)
        while len(frame) % (size * times):
            frame += b"\xa5"
        values = []
        for _ in range(times):
            word = dice.getrandbits(8 * size)
            value = (word >> int(shift)) % 2**bits
            values.append(value - 2**bits if text[3] == "s" and value >= 2 ** (bits - 1) else value)
            frame += word.to_bytes(size, "big" if text[0] == "b" else "little")
        numbers.append(values)
        largest = max(largest, size * times)
    while len(frame) % largest:
        frame += b"\x5a"
    return frame, numbers


@pytest.mark.slow
@given(texts=st.lists(types(), min_size=1, max_size=5), seed=st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, deadline=None)
def test_any_scan_is_unpacked(texts: list[str], seed: int) -> None:
    """125 000 frames of up to five elements of any type: every number is that which the packer put in."""
    dice = random.Random(seed)
    names = [f"e{i}" for i in range(len(texts))]
    scan = ScanFormat({name: ScanType.parse(text) for name, text in zip(names, texts, strict=True)})
    frames = [packed(texts, dice) for _ in range(FRAMES)]
    assert all(len(frame) == scan.size for frame, _ in frames)
    found = scan.decode(b"".join(frame for frame, _ in frames))
    for i, name in enumerate(names):
        got = found[name].reshape(FRAMES, -1).tolist()
        assert got == [numbers[i] for _, numbers in frames]


def test_a_scan_is_laid_out_as_the_kernel_does() -> None:
    """One axis of 16 bits, the time at 8: 16 bytes.  Three axes of 16 bits without time: 6; an element of 8 and one of
    32 bits: the second at 4."""
    short, time = ScanType.parse("le:s12/16>>4\n"), ScanType.parse("le:s64/64>>0")
    assert ScanFormat({"x": short, "t": time}).size == 16
    assert ScanFormat({"x": short, "y": short, "z": short, "t": time}).size == 16
    assert ScanFormat({"x": short, "y": short, "z": short}).size == 6
    mixed = ScanFormat({"a": ScanType.parse("le:u8/8>>0"), "b": ScanType.parse("be:s20/32>>12")})
    found = mixed.decode(bytes([7, 0xEE, 0xEE, 0xEE, 0xFF, 0xFF, 0xFF, 0xFA]))
    assert (mixed.size, found["a"].tolist(), found["b"].tolist()) == (8, [7], [-1])


@pytest.mark.parametrize(
    "text", ["", "s16/16>>0", "le:s16/16", "le:s17/16>>0", "le:s12/16>>5", "le:s16/24>>0", "le:f3"]
)
def test_other_types_are_refused(text: str) -> None:
    """What is no type, or does not fit into its storage, is told with what was found."""
    with pytest.raises(ScanError, match=r"found .* as scan type, expected"):
        ScanType.parse(text)
