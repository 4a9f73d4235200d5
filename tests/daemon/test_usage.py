"""Wrong calls: one line that says what was found, what was expected, and whose --help says more."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.daemon.cli_world import call, is_one_line

OLD_CLICK = """
import click
def refuse(cls, kinds):
    raise TypeError("'type' object is not subscriptable")
click.ParamType.__class_getitem__ = classmethod(refuse)
from lostmotion.daemon.cli import main
main()
"""


@pytest.mark.parametrize(
    ("words", "found", "expected", "help_of"),
    [
        ("nonsense", "found the command 'nonsense'", "expected one of lostmotion; there are alarms, ", ""),
        ("statuss", "found the command 'statuss'", "did you mean status?", ""),
        ("lab explian", "found the command 'explian'", "expected one of lostmotion lab; did you mean explain?", " lab"),
        ("lab", "found no command", "expected one of add, compare, explain", " lab"),
        ("status --nonsense", "found the option '--nonsense'", "there are --config, --database, --fail", " status"),
        ("history elbow --limt 3", "found the option '--limt'", "did you mean --limit?", " history"),
        ("history", "found no 'JOINT'", "expected lostmotion history [OPTIONS] JOINT;", " history"),
        ("lab compare play", "found no 'REC...'", "lab compare [OPTIONS] MODEL REC...;", " lab compare"),
        ("record", "found no '--config'", "expected --config FILE", " record"),
        ("simulate play", "found no '-o' / '--output'", "expected --output REC", " simulate"),
        ("history elbow --limit", "found the option '--limit' alone", "expected a value", None),
        (
            "history elbow --limit 0",
            "'--limit': found 0",
            "expected a whole number of at least 1 and at most",
            " history",
        ),
        ("history elbow --limit x", "'--limit': found 'x'", "expected a whole number of at least 1", " history"),
        ("history elbow more", "found 'more' at the end", "expected lostmotion history [OPTIONS] JOINT", " history"),
        ("run --duration x", "'--duration': found 'x'", "expected a number;", " run"),
        ("simulate play -o x --rate-hz 0", "found 0.0", "expected a number of more than 0 and at most", " simulate"),
        ("trend elbow --of size", "'--of': found 'size'", "expected one of severity, score, play;", " trend"),
        ("trend elbow --level x", "found 'x'", "expected a number above 0", " trend"),
    ],
)
def test_a_wrong_call_is_one_line(words: str, found: str, expected: str, help_of: str | None) -> None:
    """Each kind of mistake that click refuses, in the words of all other errors."""
    result = call(*words.split())
    assert is_one_line(result, found, expected), result.stderr
    assert help_of is None or result.stderr.endswith(f"ee lostmotion{help_of} --help\n")


def test_types_of_options_need_no_newer_click() -> None:
    """Before click 8.4 its types take no parameters: the program starts there, too."""
    command = [sys.executable, "-c", OLD_CLICK]
    for words in (["history", "--help"], ["lab", "explain", "--help"]):
        done = subprocess.run([*command, *words], capture_output=True, text=True, check=False, timeout=60)
        assert done.returncode == 0, done.stderr
