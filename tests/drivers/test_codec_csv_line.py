"""Lines of numbers: round trips, garbage, broken lines."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from lostmotion.drivers.codec.csv_line import CsvDecoder

Row = tuple[float, ...]
NUMBER = st.floats(-1e6, 1e6).map(lambda x: round(x, 3))
ROWS = st.integers(1, 4).flatmap(lambda n: st.lists(st.tuples(*[NUMBER] * n), min_size=2, max_size=8))


def lines(rows: list[Row], separator: str = ",", end: str = "\r\n") -> bytes:
    """The rows as a microcontroller prints them."""
    return b"".join((separator.join(map(str, row)) + end).encode() for row in rows)


def begun() -> CsvDecoder:
    """A decoder past its first, incomplete line."""
    decode = CsvDecoder()
    decode.feed(b"34,5\n")
    return decode


@given(ROWS, st.sampled_from([",", ";", "\t", " , "]), st.sampled_from(["\n", "\r\n"]), st.integers(1, 30))
def test_round_trip_in_any_chunks(rows: list[Row], separator: str, end: str, chunk: int) -> None:
    """Rows come back however the stream is cut, with any separator and line end."""
    decode, stream = begun(), lines(rows, separator, end)
    assert [r for i in range(0, len(stream), chunk) for r in decode.feed(stream[i : i + chunk])] == rows
    assert decode.broken == 0


@given(st.lists(st.sampled_from([b"\n", b"1,2\n", b"nan\n", b",\n", b"\xff"]) | st.binary(max_size=12)))
def test_garbage_never_raises(pieces: list[bytes]) -> None:
    """Any bytes at all give rows of finite numbers, and each None is one broken line."""
    decode = CsvDecoder()
    found = [row for piece in pieces for row in decode.feed(piece)]
    assert all(row is None or all(abs(x) < float("inf") for x in row) for row in found)
    assert found.count(None) == decode.broken + decode.lost


@given(st.sampled_from([b"", b"nan,1", b"inf,1", b"1,", b"1_0,2", b"1.2.3,4", b"ERROR", b"12", b"1,2,3", b"\xff,\x00"]))
def test_a_broken_line_loses_only_itself(broken: bytes) -> None:
    """Not a number, NaN, an empty cell, a column too few or too many: None in its place, counted once."""
    decode = begun()
    assert decode.feed(b"1,2\n" + broken + b"\n3,4\n") == [(1.0, 2.0), None, (3.0, 4.0)]
    assert decode.broken == 1


LINES = st.lists(
    st.sampled_from([b"1,2\r\n3.5,-4\r\n", b"7,", b"8\n", b"1;2\n", b"3\n", b"1,2,3\n"]) | st.binary(max_size=6)
)


@given(LINES)
def test_a_table_is_what_the_rows_are(pieces: list[bytes]) -> None:
    """Whatever comes in, in whichever chunks: where there is a table it holds what the rows would have been."""
    quick, thorough = begun(), begun()
    for piece in pieces:
        rows, table = thorough.feed(piece), quick.table(piece)
        assert (quick.feed(piece) if table is None else [tuple(row) for row in table.tolist()]) == rows
    assert quick.broken == thorough.broken


def test_usual_lines_make_a_table() -> None:
    """Once one line is known, whole lines like it do, also those cut in two; a broken one does not."""
    decode = begun()
    decode.feed(b"1,2\n3,")
    table = decode.table(b"-4.5\r\n5\t 6\r\n7,")
    assert table is not None
    assert table.tolist() == [[3.0, -4.5], [5.0, 6.0]]
    assert decode.table(b"8\n9,x\n") is None
    assert decode.feed(b"8\n9,x\n") == [(7.0, 8.0), None]


def test_a_change_of_format_costs_one_line() -> None:
    """When all lines have a column more from some point on, the second of them is believed."""
    assert begun().feed(b"1,2\n1,2,3\n4,5,6\n7,8,9\n") == [(1.0, 2.0), None, (4.0, 5.0, 6.0), (7.0, 8.0, 9.0)]


def test_the_rest_of_a_line_waits_for_its_end() -> None:
    """A number cut in the middle is not taken for two."""
    decode = begun()
    assert decode.feed(b"1.25,2\n3.") == [(1.25, 2.0)]
    assert decode.feed(b"75,4\n") == [(3.75, 4.0)]


def test_the_first_line_after_opening_is_dropped() -> None:
    """It begins anywhere in a reading: 2.5 of 12.5 looks like a number."""
    decode = CsvDecoder()
    assert decode.feed(b"2.5\n12.5\n") == [(12.5,)]
    decode.reset()
    assert decode.feed(b".5\n7.5\n") == [(7.5,)]
    assert decode.broken == 0


def test_bytes_without_line_ends_do_not_pile_up() -> None:
    """A device that never ends a line counts as broken and costs no memory."""
    decode = begun()
    for _ in range(100):
        decode.feed(b"x" * 100)
    assert decode.broken >= 30
    assert decode.feed(b"\n1.5\n")[-1] == (1.5,)


def test_what_the_device_tells_as_lost() -> None:
    """``#lost 3`` makes three places, counted as lost and not as broken; other comments make none."""
    decode = begun()
    assert decode.feed(b"1,2\n#lost 3\r\n# hello\n3,4\n#lost many\n") == [(1.0, 2.0), None, None, None, (3.0, 4.0)]
    assert (decode.lost, decode.broken) == (3, 0)
