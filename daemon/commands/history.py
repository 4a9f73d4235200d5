"""``lostmotion history``: the scores of a joint as a table, CSV or JSON."""

from __future__ import annotations

import csv
import math
import sys
from datetime import datetime
from pathlib import Path
from typing import Any

from lostmotion.daemon import documents
from lostmotion.daemon.commands import output, times
from lostmotion.daemon.commands.where import open_joint
from lostmotion.daemon.records import ScoreRow

__all__ = ["history"]

Bounds = tuple[datetime | None, datetime | None, int | None]


def history(joint: str, config: Path | None, database: Path | None, bounds: Bounds, form: str | Path) -> None:
    """Prints the scores with since <= time < until, the newest ``limit`` of them; form: table, csv or json, or the
    Parquet file to write."""
    times.check_order(*bounds[:2])
    with open_joint(joint, config, database) as reader:
        if isinstance(form, Path):
            from lostmotion.daemon.commands.history_parquet import write

            write(reader, joint, bounds, form)
            return
        scores = reader.scores(joint, *bounds)
    if form == "json":
        output.print_json(documents.history(joint, scores))
    elif form == "csv":
        _print_csv(scores)
    else:
        _print_table(joint, scores)


def _print_csv(scores: list[ScoreRow]) -> None:
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(documents.SCORE_KEYS)
    for score in scores:
        writer.writerow([_cell(value) for value in documents.score(score).values()])


def _cell(value: Any) -> Any:
    """true and false as in JSON, nothing for NaN."""
    if isinstance(value, bool):
        return str(value).lower()
    return "" if isinstance(value, float) and math.isnan(value) else value


def _print_table(joint: str, scores: list[ScoreRow]) -> None:
    if not scores:
        output.print_lines([f"no scores of {joint} in that time"])
        return
    full = max((score.score for score in scores if math.isfinite(score.score)), default=1.0)
    columns = ("time (UTC)", "score", "", "level", "impact", "play", "severity", "quality")
    output.print_table(columns, [_row(score, full) for score in scores], right=("score", "level", "play", "severity"))


def _row(score: ScoreRow, full: float) -> list[str]:
    colour = "red" if score.impact else "green"
    return [
        times.local(score.time),
        output.number(score.score),
        f"[{colour}]{output.bar(score.score, full)}[/{colour}]",
        f"{score.level:.2f}",
        "impact" if score.impact else "",
        output.arcmin(score.play),
        output.arcmin(score.severity),
        score.quality,
    ]
