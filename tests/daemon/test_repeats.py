"""What is told of problems that come again and again."""

from __future__ import annotations

import pytest

from lostmotion.daemon.repeats import Condition, Repeats, place


def test_a_problem_that_stays_is_told_once_an_hour() -> None:
    """Met every second for two hours and a half; each problem by itself."""
    repeats = Repeats()
    assert [second for second in range(9000) if repeats.is_news("damaged", second)] == [0, 3600, 7200]
    assert repeats.is_news("full", 9000)


def test_a_problem_that_returns_is_news() -> None:
    """It has gone away when it has not been met for a minute."""
    repeats = Repeats()
    assert [repeats.is_news("damaged", second) for second in (0, 59, 118, 178, 179)] == [
        True,
        False,
        False,
        True,
        False,
    ]


def test_a_condition_is_told_when_it_changes() -> None:
    """Well, gone, another reason, well again, and gone once more some minutes later."""
    condition = Condition()
    course = [(0, ""), (1, ""), (2, "gone"), (3, "gone"), (4, "missing"), (9, ""), (200, "gone"), (201, "")]
    assert [second for second, problem in course if condition.is_news(problem, second)] == [0, 2, 4, 9, 200, 201]


def test_a_loose_plug_is_told_once_and_how_it_ends() -> None:
    """Gone, missing and well every three seconds for half an hour; then missing for good, which is the last word."""
    condition = Condition()
    told = [
        (second, problem)
        for second in range(1800)
        if condition.is_news(problem := ("gone", "missing", "")[second % 3], second)
    ]
    assert told == [(0, "gone"), (1, "missing"), (2, "")]
    assert [second for second in range(1801, 3000) if condition.is_news("missing", second)] == [1821]
    assert condition.is_news("", 3000)


def fail(figure: float) -> None:
    """Raises with other words each time."""
    raise ValueError(f"found {figure}")


def test_an_error_is_known_by_its_place() -> None:
    """The same line, whatever the error says; another line is another one."""
    places = []
    for call in (lambda: fail(1.0), lambda: fail(2.0), lambda: float("one")):
        with pytest.raises(ValueError, match="o") as error:
            call()
        places.append(place(error.value))
    assert places[0] == places[1] != places[2]
