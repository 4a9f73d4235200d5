"""Several runs side by side in one table, each with times of its own: the one that is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.drivers.formats.guess import mapped
from lostmotion.drivers.formats.source import Choice, Series, shown
from lostmotion.drivers.formats.swinging import power
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import column_of, is_run, is_time, joint_of

__all__ = ["of_one_run"]

STILL = 0.1
"""of the motion of another run: what is left of one whose pendulum hangs still (0.005 of a published one)"""


def of_one_run(table: Table, choice: Choice) -> Table:
    """The table with the columns of one run, where each column of times begins a run: the run of the joint that was
    chosen, else the longest, of equal ones the first that moves; and a note that says how to take another.  Where
    columns are given, it stays as it is."""
    runs = _runs(table.series)
    if len(runs) < 2 or "time" in choice.terms or choice.rate_hz is not None:
        return table
    loaded = table.load([one.name for run in runs for one in run[:2]])
    columns = {name: np.asarray(values, dtype=float) for name, values in loaded.items()}
    lengths = [int(np.count_nonzero(~np.isnan(columns[run[0].name]))) for run in runs]
    moved = [power(columns[run[1].name]) for run in runs]
    own = [run for run in runs if choice.joint and any(joint_of(one.name) == choice.joint for one in run[1:])]
    chosen = own[0] if own else _longest(runs, lengths, moved)
    others = [run for run in runs if run is not chosen]
    options = " ".join([mapped("time", others[0][0].name), *(mapped(*pair) for pair in _columns(others[0]))])
    note = f"{len(runs)} runs side by side: that with the times {shown(chosen[0].name)} is used; for another {options}"
    return replace(table, series=chosen, notes=[*table.notes, note])


def _longest(runs: Sequence[list[Series]], lengths: Sequence[int], moved: Sequence[float]) -> list[Series]:
    """The first of the longest runs whose variance is no mere noise beside that of the others."""
    longest = [i for i, length in enumerate(lengths) if length == max(lengths)]
    least = STILL**2 * max(moved[i] for i in longest)
    return runs[next(i for i in longest if moved[i] >= least)]


def _columns(run: Sequence[Series]) -> list[tuple[str, str]]:
    """The first column of a run with its series; the first series where no name says what it is."""
    named = [(column, one.name) for one in run[1:] if (column := column_of(one.name))]
    return named[:1] or [("position", run[1].name)]


def _runs(series: Sequence[Series]) -> list[list[Series]]:
    """The columns from each column of times to the next, where all of these but the first are numbered."""
    starts = [i for i, one in enumerate(series) if is_time(one.name)]
    if not starts or starts[0] != 0 or not all(_is_next(series[0].name, series[i].name) for i in starts[1:]):
        return []
    runs = [list(series[a:b]) for a, b in zip(starts, [*starts[1:], len(series)], strict=True)]
    return runs if all(len(run) > 1 for run in runs) else []


def _is_next(first: str, name: str) -> bool:
    """Whether a column of times begins another run: a number stands behind its name, or a letter stands in place of
    the first one's, as in ``Time A`` and ``Time B``."""
    return is_run(name) or (len(first) == len(name) and sum(a != b for a, b in zip(first, name, strict=True)) == 1)
