"""Differences of two series of a table: those that ``--map position=motor - output`` asks for, as of the encoders
before and behind a gear, and that of the inputs of two half bridges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from lostmotion.drivers.formats.guess import POWERS
from lostmotion.drivers.formats.source import Choice, Series
from lostmotion.drivers.formats.table import Array, Table

__all__ = ["with_differences"]

MINUS = " - "
BRIDGES = ("rpwm", "lpwm")
"""what drives a motor in one direction, and in the other one"""

Pairs = Mapping[str, tuple[str, str]]
"""the two series of a difference, by its name"""


def with_differences(table: Table, choice: Choice) -> Table:
    """The table with these differences, that of half bridges in place of both where no input was chosen."""
    names = {one.name: one for one in table.series}
    asked = {term.name: _parted(term.name, names) for term in choice.terms.values() if term.name not in names}
    pairs = {name: pair for name, pair in asked.items() if pair}
    plain = {name.lower(): name for name in names}
    halves: list[str] = []
    if all(half in plain for half in BRIDGES) and not POWERS & {*choice.terms}:
        halves = [plain[half] for half in BRIDGES]
        pairs[MINUS.join(halves)] = halves[0], halves[1]
    series = [one for one in table.series if one.name not in halves]
    series += [Series(name, names[first].unit) for name, (first, _) in pairs.items()]
    return replace(table, series=series, load=partial(_load, table, pairs)) if pairs else table


def _parted(name: str, names: Mapping[str, Series]) -> tuple[str, str] | None:
    """The two series whose difference has this name; None for any other name."""
    parts = name.split(MINUS)
    splits = ((MINUS.join(parts[:at]), MINUS.join(parts[at:])) for at in range(1, len(parts)))
    return next((pair for pair in splits if pair[0] in names and pair[1] in names), None)


def _load(table: Table, pairs: Pairs, names: Sequence[str]) -> Mapping[str, Array]:
    """Reads columns, and differences from theirs."""
    wanted = dict.fromkeys(each for name in names for each in pairs.get(name, (name,)))
    loaded = table.load(list(wanted))
    return {
        name: np.subtract(*(np.asarray(loaded[each], dtype=float) for each in pairs[name]))
        if name in pairs else loaded[name]
        for name in names
    }  # fmt: skip
