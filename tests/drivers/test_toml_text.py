"""Errors of TOML: the line that is wrong, and what is usually wrong with such a line."""

from __future__ import annotations

import pytest

from lostmotion.drivers.toml_text import TomlError, loads


@pytest.mark.parametrize(
    ("line", "hint"),
    [
        ("name = arm1", "straight quotation marks"),
        ("name = \u201carm1\u201d", "straight quotation marks"),
        ("port = /dev/ttyUSB0", "straight quotation marks"),
        ('name = "arm1', "a quotation mark is missing"),
        ("rate = 1 kHz", "a number stands without its unit"),
        ("rate = 1000Hz", "a number stands without its unit"),
        ("scale = 1,5", "a number has a decimal point"),
        ("baudrate = 115 200", "a number holds no spaces"),
        ('name: "arm1"', "a key and its value are joined by ="),
        ("levers = {\n a = 1 }", "a table in braces stands on one line"),
        ("[a]", "a table that stands several times is written [[name]]"),
    ],
)
def test_a_wrong_line_is_shown_with_its_likely_cause(line: str, hint: str) -> None:
    """Each usual mistake in the second line is told with the line, its number and what TOML expects there."""
    with pytest.raises(TomlError) as refused:
        loads(f"[a]\n{line}\n")
    message = str(refused.value)
    assert message.startswith(f"no valid TOML: line 2 is {line.split(chr(10))[0]!r}: ")
    assert hint in message
    assert "\n" not in message


def test_a_long_line_is_cut() -> None:
    """A line of ten thousand characters, and an error at the end of the text, stay short."""
    for text in ("a = " + "b" * 10_000, "a = ["):
        with pytest.raises(TomlError) as refused:
            loads(text)
        assert len(str(refused.value)) < 250
