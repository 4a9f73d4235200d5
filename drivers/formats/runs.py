"""Several runs side by side in one table, each with times of its own: the one that is meant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.drivers.formats.guess import mapped
from lostmotion.drivers.formats.source import Choice, Series, shown
from lostmotion.drivers.formats.table import Table
from lostmotion.drivers.formats.words import column_of, is_run, is_time, joint_of

__all__ = ["of_one_run"]


def of_one_run(table: Table, choice: Choice) -> Table:
    """The table with the columns of one run, where each column of times begins a run: the run of the joint that was
    chosen, else the longest; and a note that says how to take another.  Where columns are given, it stays as it is."""
    runs = _runs(table.series)
    if len(runs) < 2 or "time" in choice.terms or choice.rate_hz is not None:
        return table
    loaded = table.load([run[0].name for run in runs])
    lengths = [int(np.count_nonzero(~np.isnan(np.asarray(loaded[run[0].name], dtype=float)))) for run in runs]
    own = [run for run in runs if choice.joint and any(joint_of(one.name) == choice.joint for one in run[1:])]
    chosen = own[0] if own else runs[int(np.argmax(lengths))]
    others = [run for run in runs if run is not chosen]
    options = " ".join([mapped("time", others[0][0].name), *(mapped(*pair) for pair in _columns(others[0]))])
    note = f"{len(runs)} runs side by side: that with the times {shown(chosen[0].name)} is used; for another {options}"
    return replace(table, series=chosen, notes=[*table.notes, note])


def _columns(run: Sequence[Series]) -> list[tuple[str, str]]:
    """The first column of a run with its series; the first series where no name says what it is."""
    named = [(column, one.name) for one in run[1:] if (column := column_of(one.name))]
    return named[:1] or [("position", run[1].name)]


def _runs(series: Sequence[Series]) -> list[list[Series]]:
    """The columns from each column of times to the next, where all of these but the first are numbered."""
    starts = [i for i, one in enumerate(series) if is_time(one.name)]
    if not starts or starts[0] != 0 or not all(is_run(series[i].name) for i in starts[1:]):
        return []
    runs = [list(series[a:b]) for a, b in zip(starts, [*starts[1:], len(series)], strict=True)]
    return runs if all(len(run) > 1 for run in runs) else []
