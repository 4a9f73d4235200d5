"""Several runs in one table, side by side, each with times of its own, or one after another: the one that is meant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from lostmotion.drivers.errors import RecordingError
from lostmotion.drivers.formats.bag import Bag
from lostmotion.drivers.formats.source import Choice, Series, Source, shown
from lostmotion.drivers.formats.swinging import power
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import is_run, is_time, joint_of

__all__ = ["STILL", "of_its_number", "of_one_run", "runs_in"]

Of = TypeVar("Of", Table, Bag)

STILL = 0.02
"""of the motion of another run: what is left of one whose pendulum hangs still.  0.005 of a published one; 0.064 of a
disk that is driven far below its resonance, beside one at it."""


def runs_in(source: Source, choice: Choice) -> int:
    """How many runs a file holds, of which none was chosen: each may be a recording of its own."""
    if choice.episode is not None:
        return 1
    if isinstance(source, Bag):
        return source.runs
    if not isinstance(source, Table) or _of_joint(_side_by_side(source, choice), choice):
        return 1
    return len(_all(source, choice)) or 1


def of_its_number(source: Of, choice: Choice) -> Of:
    """The run with the number that was chosen; all of a file without one.  Raises RecordingError."""
    if choice.episode is None:
        return source
    runs = _all(source, choice)
    if not 0 <= choice.episode < max(len(runs), 1):
        said = f"0 to {len(runs) - 1}" if runs else "0, as the file holds one run"
        raise RecordingError(f"{source.name}: found episode={choice.episode}, expected {said}")
    return runs[choice.episode]() if runs else source


def of_one_run(table: Table, choice: Choice) -> Table:
    """The table of the run with the number that was chosen.  Without a number, of runs side by side, where each column
    of times begins one, that of the joint that was chosen, else the longest, of equal ones the first that moves; and a
    note that says how to take another.  Raises RecordingError."""
    if choice.episode is not None:
        return of_its_number(table, choice)
    if not (beside := _side_by_side(table, choice)):
        return table
    own = _of_joint(beside, choice)
    chosen = own[0] if own else _longest(table, beside)
    note = (
        f"{len(beside)} runs side by side: that with the times {shown(chosen[0].name)} is used; for another "
        f"FILE#episode={int(chosen is beside[0])}"
    )
    return replace(table, series=chosen, notes=[*table.notes, note])


def _all(source: Of, choice: Choice) -> list[Callable[[], Of]]:
    """What reads each of several runs; nothing for one."""
    if source.open_episode:
        return [partial(source.open_episode, at) for at in range(source.runs)]
    if isinstance(source, Bag):
        return []
    if beside := _side_by_side(source, choice):
        return [partial(replace, source, series=series) for series in beside]
    return [partial(source.of_rows, rows) for rows in source.restarts(choice)]


def _of_joint(runs: Sequence[list[Series]], choice: Choice) -> list[list[Series]]:
    """The runs of the joint that was chosen; none where each has it."""
    own = [run for run in runs if choice.joint and any(joint_of(one.name) == choice.joint for one in run[1:])]
    return own if len(own) < len(runs) else []


def _longest(table: Table, runs: Sequence[list[Series]]) -> list[Series]:
    """The first of the longest runs whose variance is no mere noise beside that of the others."""
    loaded = table.load([one.name for run in runs for one in run[:2]])
    columns = {name: np.asarray(values, dtype=float) for name, values in loaded.items()}
    lengths = [int(np.count_nonzero(~np.isnan(columns[run[0].name]))) for run in runs]
    moved = [power(columns[run[1].name]) for run in runs]
    longest = [i for i, length in enumerate(lengths) if length == max(lengths)]
    least = STILL**2 * max(moved[i] for i in longest)
    return runs[next(i for i in longest if moved[i] >= least)]


def _side_by_side(table: Table, choice: Choice) -> list[list[Series]]:
    """The columns from each column of times to the next, where all of these but the first are numbered; none where
    there is one, or the times are given."""
    series = table.series
    starts = [i for i, one in enumerate(series) if is_time(one.name)]
    if "time" in choice.terms or choice.rate_hz is not None or len(starts) < 2 or starts[0] != 0:
        return []
    if not all(_is_next(series[0].name, series[i].name) for i in starts[1:]):
        return []
    runs = [list(series[a:b]) for a, b in zip(starts, [*starts[1:], len(series)], strict=True)]
    return runs if all(len(run) > 1 for run in runs) else []


def _is_next(first: str, name: str) -> bool:
    """Whether a column of times begins another run: a number stands behind its name, or a letter stands in place of
    the first one's, as in ``Time A`` and ``Time B``."""
    return is_run(name) or (len(first) == len(name) and sum(a != b for a, b in zip(first, name, strict=True)) == 1)
