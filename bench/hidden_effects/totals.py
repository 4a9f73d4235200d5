"""The scores of many cases as rates beside their goals, and as tables.  No case is judged here."""

from __future__ import annotations

import math
import statistics
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from bench.hidden_effects.scoring import NOTHING, Score

__all__ = ["Rate", "document", "print_tables", "rates"]


@dataclass(frozen=True)
class Rate:
    """So many of so many; goal: as the issue words it; good: whether the rate itself reaches it."""

    what: str
    hits: int
    of: int
    goal: str
    good: Callable[[float], bool]

    @property
    def share(self) -> float:
        """hits/of, NaN of none."""
        return self.hits / self.of if self.of else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the share."""
        if not self.of:
            return 0.0, 1.0
        z, n, p = 1.96, self.of, self.share
        middle, half = (p + z * z / (2 * n)), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        return max((middle - half) / (1 + z * z / n), 0.0), min((middle + half) / (1 + z * z / n), 1.0)


def rates(scores: Sequence[Score]) -> list[Rate]:
    """What the bench is for, in the order of the goals."""

    def of_kind(*kinds: str) -> list[Score]:
        return [s for s in scores if s.kind in kinds]

    def bare(chosen: list[Score]) -> list[Score]:
        return [s for s in chosen if s.truth == (NOTHING,) and s.told]

    def hiding(chosen: list[Score]) -> list[Score]:
        return [s for s in chosen if s.truth != (NOTHING,)]

    strong, moderate, pairs, outside = map(of_kind, ("strong", "moderate", "pair", "outside"))
    nothing, bounces, joint = map(of_kind, ("nothing", "bounces", "joint"))
    errors = [s.error_ok for s in scores if s.error_ok is not None]
    effect_inside = [held for s in scores for name, held in s.inside.items() if "." in name]
    base_inside = [held for s in scores for name, held in s.inside.items() if "." not in name]

    def alarms(what: str, chosen: list[Score], goal: str = "") -> Rate:
        return Rate(what, sum(not s.strict for s in chosen), len(chosen), goal, lambda p: not goal or p <= 0.05)

    def named(what: str, chosen: list[Score], least: float) -> list[Rate]:
        goal = f">= {100 * least:.0f} %" if least else ""
        return [
            Rate(what, sum(s.strict for s in chosen), len(chosen), goal, lambda p: p >= least),
            Rate("  or in the answer's confusable group", sum(s.lenient for s in chosen), len(chosen), "", _any),
        ]

    return [
        *named("right effect first, strong", strong, 0.95),
        *named("right effect first, moderate", moderate, 0.85),
        alarms("false alarm, nothing missing", bare(nothing), "<= 5 %"),
        Rate("outside_catalogue recognised", sum(s.strict for s in outside), len(outside), ">= 80 %",
             lambda p: p >= 0.8),
        *named("both of a pair named", pairs, 0.75),
        Rate("error after <= 1.15 noise, right answers", sum(errors), len(errors), ">= 90 %", lambda p: p >= 0.9),
        Rate("95 % intervals that hold, effect", sum(effect_inside), len(effect_inside), "90-98 %", _covering),
        Rate("95 % intervals that hold, base", sum(base_inside), len(base_inside), "90-98 %", _covering),
        *named("many bounces, right effect first", hiding(bounces), 0.0),
        alarms("many bounces, false alarm", bare(bounces)),
        *named("MuJoCo's joint, right effect first", hiding(joint), 0.0),
        alarms("MuJoCo's joint, false alarm", bare(joint)),
        Rate("no answer", sum(not s.told for s in scores), len(scores), "", _any),
    ]  # fmt: skip


def _any(share: float) -> bool:
    return True


def _covering(share: float) -> bool:
    return 0.90 <= share <= 0.98


def document(scores: Sequence[Score]) -> dict[str, Any]:
    """All of it for a program."""
    rows = [
        {"what": r.what.strip(), "hits": r.hits, "of": r.of, "share": r.share if r.of else None,
         "interval": r.interval, "goal": r.goal, "reached": r.good(r.share) if r.of else None}
        for r in rates(scores)
    ]  # fmt: skip
    return {"rates": rows, "seconds": dict(zip(("median", "max"), _times(scores), strict=True)),
            "cases": [asdict(s) for s in scores]}  # fmt: skip


def _times(scores: Sequence[Score]) -> tuple[float, float]:
    seconds = [s.seconds for s in scores]
    return statistics.median(seconds), max(seconds)


def print_tables(scores: Sequence[Score], console: Console) -> None:
    """The rates beside their goals, the effects one by one, the wrong cases."""
    table = _table("", "cases", "share", "95 % interval", "goal", "")
    for rate in (r for r in rates(scores) if r.of):
        low, high = rate.interval
        reached = ("yes" if rate.good(rate.share) else "NO") if rate.goal else ""
        interval = f"{100 * low:.0f}-{100 * high:.0f} %"
        table.add_row(rate.what, f"{rate.hits}/{rate.of}", f"{100 * rate.share:.1f} %", interval, rate.goal, reached)
    console.print(table)
    median, longest = _times(scores)
    console.print(f"time a case: median {median:.1f} s, longest {longest:.1f} s\n")
    console.print(_by_effect(scores))
    wrong = _table("wrong case", "truth", "answer", "")
    for s in (s for s in scores if not s.strict):
        note = "(confusable) " if s.lenient else ""
        wrong.add_row(s.name, " + ".join(s.truth), " + ".join(s.told) or "none", note + s.remark)
    console.print(wrong if wrong.rows else "no wrong case")


def _by_effect(scores: Sequence[Score]) -> Table:
    table = _table("hidden", "right", "confusable", "error ok", "intervals hold", "told instead")
    groups: dict[str, list[Score]] = defaultdict(list)
    for s in scores:
        groups[f"{s.kind}: {' + '.join(s.truth)}" if s.kind in ("outside", "bounces", "joint") else s.truth[0]].append(
            s
        )
        if len(s.truth) > 1:
            groups[s.truth[1]].append(s)
    for name, group in sorted(groups.items()):
        errors = [s.error_ok for s in group if s.error_ok is not None]
        held = [ok for s in group for parameter, ok in s.inside.items() if parameter.startswith(f"{name}.")]
        instead = sorted({t for s in group if not s.strict for t in s.told} - {name})
        table.add_row(name, f"{sum(s.strict for s in group)}/{len(group)}", f"{sum(s.lenient for s in group)}",
                      f"{sum(errors)}/{len(errors)}", f"{sum(held)}/{len(held)}", ", ".join(instead))  # fmt: skip
    return table


def _table(*columns: str) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    return table
