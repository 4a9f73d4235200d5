"""The fuzz bench: a few inputs of each kind are taken or refused, and whatever is bad is noticed."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest
from bench import fuzz

from lostmotion.drivers.errors import RecordingError


def endless(data: bytes) -> bool:
    while True:
        pass


def internal(data: bytes) -> bool:
    raise IndexError(len(data))


def lines(data: bytes) -> bool:
    raise RecordingError("one\ntwo")


def refusing(data: bytes) -> bool:
    raise RecordingError("one line")


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_few_of_each_kind(capsys: pytest.CaptureFixture[str]) -> None:
    """300 inputs of all kinds: none is bad, most are refused (MCAP and WPILib's logs are read up to the damage), some
    taken."""
    assert fuzz.main(["--inputs", "300", "--seed", "7"]) == 0
    told = capsys.readouterr()
    rows = [line.rsplit(maxsplit=4) for line in told.out.splitlines()[1:]]
    assert [row[0] for row in rows] == [kind.name for kind in fuzz.KINDS]
    assert len(rows) == 13
    for name, inputs, rejected, _, bad in rows:
        assert (inputs, bad) == ("300", "0")
        assert {"MCAP": 100, "WPILib data logs": 30}.get(name, 200) < int(rejected) < 300
    assert "300/300" in told.err


def test_sound_inputs_are_taken() -> None:
    """Else the damaged ones would not show anything."""
    for kind in fuzz.KINDS:
        for data in kind.sound:
            assert kind.name == "servo states" or kind.take(data, Random(1)), kind.name


@pytest.mark.parametrize(("take", "expected"), [
    (endless, "Endless in test_fuzz.py"), (internal, "IndexError in test_fuzz.py"), (lines, "no short line"),
])  # fmt: skip
def test_what_is_bad_is_noticed(
    take: Callable[[bytes], bool],
    expected: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A reader that hangs, breaks down, or refuses in two lines: the status is 1, and the first input is shown."""
    monkeypatch.setattr(fuzz, "ENDLESS_S", 0.02)
    monkeypatch.setattr(fuzz, "KINDS", (fuzz.Kind("some", (b"sound",), lambda data, dice: take(data)),))
    assert fuzz.main(["--inputs", "3"]) == 1
    told = capsys.readouterr().out
    assert "some                    3" in told
    assert "some, 3 times, the first input 0, " in told
    assert expected in told


def test_the_slow_is_bad_and_a_refusal_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond the processor time that an input may take; one line is what is asked for."""
    kind = fuzz.Kind("some", (b"sound",), lambda data, dice: refusing(data))
    outcome = fuzz.fuzz(kind, 5)
    assert (outcome.inputs, outcome.rejected, outcome.bad) == (5, 5, {})
    monkeypatch.setattr(fuzz, "SLOW_S", 0.0)
    assert fuzz.fuzz(kind, 5).bad["slow"][0] == 5


def test_the_seed_decides() -> None:
    """The same input comes again for the same seed and number, another one for another seed."""
    seen: list[bytes] = []
    kind = fuzz.Kind("some", (bytes(range(99)),), lambda data, dice: bool(seen.append(data)))
    for inputs, seed in ((20, 1), (20, 1), (20, 2)):
        fuzz.fuzz(kind, inputs, seed)
    assert seen[:20] == seen[20:40] != seen[40:]
