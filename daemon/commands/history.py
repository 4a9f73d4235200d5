"""``lostmotion history``: the scores of a joint as a table, CSV or JSON."""

from __future__ import annotations

import csv
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lostmotion.daemon import documents, times
from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.where import open_joint
from lostmotion.daemon.reader import Bounds
from lostmotion.daemon.records import ScoreRow

__all__ = ["history"]


def history(joint: str, config: Path | None, database: Path | None, bounds: Bounds, form: str | Path) -> None:
    """Prints the scores with since <= time < until, the newest ``limit`` of them; form: table, csv or json, or the
    Parquet file to write.  However many there are, a few thousand are in memory at a time."""
    times.check_order(*bounds[:2])
    with open_joint(joint, config, database) as reader:
        if isinstance(form, Path):
            from lostmotion.daemon.commands.history_parquet import write

            write(reader, joint, bounds, form)
        elif form == "json":
            rows = ([documents.score(score) for score in scores] for scores in reader.stream(joint, bounds))
            output.print_json_list({"joint": joint}, "scores", rows)
        elif form == "csv":
            _print_csv(reader.stream(joint, bounds))
        else:
            last = reader.last_window(joint)
            newest = f"; the newest is of {times.local(last.time)}" if last else ""
            _print_table(
                reader.stream(joint, bounds),
                reader.largest(joint, bounds),
                f"no scores of {joint} in that time{newest}",
            )


def _print_csv(batches: Iterator[list[ScoreRow]]) -> None:
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(documents.SCORE_KEYS)
    for scores in batches:
        writer.writerows([_cell(value) for value in documents.score(score).values()] for score in scores)


def _cell(value: Any) -> Any:
    """true and false as in JSON, nothing for NaN."""
    if isinstance(value, bool):
        return str(value).lower()
    return "" if isinstance(value, float) and math.isnan(value) else value


def _print_table(batches: Iterator[list[ScoreRow]], largest: float, nothing: str) -> None:
    columns = ("time (UTC)", "score", "", "level", "impact", "play", "severity", "quality")
    rows = ([_row(score, largest) for score in scores] for scores in batches)
    if not output.print_long_table(columns, rows, right=("score", "level", "play", "severity"), spare=("",)):
        output.print_lines([nothing])


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
