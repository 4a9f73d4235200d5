"""TOML: values of a text, within bounds, or one error, whatever the text holds; and values as text.

``tomllib`` alone follows nested values until the stack ends, takes whole numbers that Python then refuses to print, and
needs minutes for a key of many parts.  What the values mean is the callers' business.  No file is opened here.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from datetime import date, datetime, time
from numbers import Integral, Real
from typing import Any

__all__ = ["WORDS", "TomlError", "at", "in_words", "loads", "toml_key", "toml_value"]

MOST_LEVELS = 64
"""of tables and lists within each other, and of parts in a key"""
YEARS = (2, 9998)
"""of a date and time: a day less or more in another time zone is still in the calendar"""
WHOLE = 2**63
"""TOML's whole numbers have 64 bits, with their sign"""
PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
PLACE = re.compile(r" \(at (?:line (?P<line>\d+), column (?P<column>\d+)|end of document)\)$")
LINE = 60
"""characters of a wrong line that its error shows"""
SLIPS = (
    (r"[^=]*=\s*\{[^}]*$", "a table in braces stands on one line"),
    (r"[^=:\"']*:", "a key and its value are joined by ="),
    (r"[^=]*=\s*[-+]?\d+,\d", "a number has a decimal point"),
    (r"[^=]*=\s*[-+]?[\d.]+\s*[^\W\d]", "a number stands without its unit"),
    (r"[^=]*=\s*[-+]?\d+ \d", "a number holds no spaces"),
    (r"[^=]*=\s*[\"'][^\"']*$", "a quotation mark is missing"),
    (r"[^=]*=\s*[^\W\d]|[^=]*=\s*[/~“”„‘’«»]", 'text stands between straight quotation marks, as in "arm1"'),
    (r"\s*\[\w", "a table that stands several times is written [[name]]"),
)
"""Beginnings of lines as people write them by mistake, and what TOML expects there; the first that fits is told."""
WORDS = {"float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "object": "a table",
         "array": "a list"}  # fmt: skip
"""what msgspec's names of types mean to a person"""
LONG_KEY = re.compile(rf"""(?<![\w"'\\-])(?:{PART}[ \t]*+\.[ \t]*+){{{MOST_LEVELS},}}+""")


class TomlError(ValueError):
    """The text is no TOML, or holds what no reader of ours could use; the message is one line."""


def loads(text: str) -> dict[str, Any]:
    """The values of a TOML document.  Raises TomlError."""
    if LONG_KEY.search(text):
        raise TomlError(f"found a key of more than {MOST_LEVELS} parts, expected a short one")
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise TomlError(f"no valid TOML: {_told(text, str(error))}") from error
    except RecursionError as error:
        raise TomlError(f"found values that are nested too deeply, expected at most {MOST_LEVELS} levels") from error
    except (ValueError, OverflowError) as error:  # Python converts no number of more than 4300 digits
        raise TomlError("found a number that is too long, expected whole numbers of at most 64 bits") from error
    _check(tables)
    return tables


def toml_value(value: object) -> str:
    """A value as TOML on one line.  Raises TypeError for what TOML does not have."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, Integral):
        return str(int(value))
    if isinstance(value, Real):
        return repr(float(value))
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    if isinstance(value, Mapping):
        inner = ", ".join(f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, Sequence):
        return f"[{', '.join(toml_value(item) for item in value)}]"
    raise TypeError(f"found {type(value).__name__}, expected a value that TOML has")


def toml_key(key: str) -> str:
    """A key, in quotation marks where it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def at(value: Any, path: str) -> Any:
    """What stands at a path such as ``$.joint[2].port`` within a table or list; msgspec's messages have one."""
    for key in re.findall(r"\w+", path):
        value = value[int(key)] if isinstance(value, list) else value[key]
    return value


def in_words(message: str) -> str:
    """What msgspec expected, in a person's words and without the type that was found."""
    return re.sub("`(.+?)`", _types_in_words, re.sub(", got `.*`$", "", message))


def _types_in_words(types: re.Match[str]) -> str:
    return " or ".join(WORDS.get(name, name) for name in types[1].split(" | "))


def _told(text: str, message: str) -> str:
    """A parser's message with the line that it is about, and what is usually wrong with such a line."""
    place = PLACE.search(message)
    if place is None or place["line"] is None:
        return message
    line = text.split("\n")[int(place["line"]) - 1].strip()
    shown = line if len(line) <= LINE else f"{line[:LINE]}…"
    slip = next((f"; {hint}" for pattern, hint in SLIPS if re.match(pattern, line)), "")
    return f"line {place['line']} is {shown!r}: {message[: place.start()]} (at column {place['column']}){slip}"


def _check(tables: dict[str, Any]) -> None:
    """Without recursion, which is what a deep value would break."""
    level: list[object] = [tables]
    for _ in range(MOST_LEVELS):
        level = [
            inner
            for value in level
            if isinstance(value, dict | list)
            for inner in (value.values() if isinstance(value, dict) else value)
        ]
        for value in level:
            _check_value(value)
    if any(isinstance(value, dict | list) for value in level):
        raise TomlError(f"found values that are nested too deeply, expected at most {MOST_LEVELS} levels")


def _check_value(value: object) -> None:
    if isinstance(value, int) and not -WHOLE <= value < WHOLE:
        raise TomlError("found a number that is too long, expected whole numbers of at most 64 bits")
    if isinstance(value, datetime) and not YEARS[0] <= value.year <= YEARS[1]:
        raise TomlError(f"found a time in the year {value.year}, expected {YEARS[0]} to {YEARS[1]}")
