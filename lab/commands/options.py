"""Arguments that several commands of the lab share."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Any

import click

__all__ = [
    "FILE", "SearchOptions", "curves_option", "executor_option", "json_option",
    "model_argument", "output_option", "progress_option", "report_option", "search_options",
]  # fmt: skip

FILE = click.Path(path_type=Path, readable=False)
"""not tried here: who reads the file says why it cannot be read"""
UNITS_S = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


class _Duration(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.4 on only
    """A length of time: ``60s``, ``2min``, ``90``."""

    name = "duration"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|)\s*", str(value))
        if not found or float(found[1]) == 0:
            self.fail(f"found {value!r}, expected a length of time such as 60s or 2min", param, ctx)
        return float(found[1]) * UNITS_S[found[2]]


DURATION = _Duration()
"""Converts to seconds."""

model_argument = click.argument("model")


def _no_pipe(ctx: click.Context, param: click.Parameter, value: Path) -> Path:
    """Standard output has the words, or the JSON document."""
    if str(value) == "-":
        raise click.BadParameter("found -, expected the name of a file", ctx, param)
    return value


output_option = click.option(
    "-o", "--output", type=FILE, required=True, metavar="MODEL2",
    callback=_no_pipe, help="Model file to write.",
)  # fmt: skip
executor_option = click.option(
    "--executor", metavar="SPEC", help="Where to compute: threads:N, processes:N or dask=HOST:PORT.  [default: threads]"
)
report_option = click.option("--report", type=FILE, metavar="F.html", help="Write a report to open in a browser.")
curves_option = click.option(
    "--curves", type=FILE, metavar="F.json",
    help="Write what the report draws over time: measured, modelled, and modelled without what was found.",
)  # fmt: skip
budget_option = click.option(
    "--budget", "budget_s", type=DURATION, default="60s", show_default=True, metavar="TIME",
    help="Time limit of the search; the answer lists what was not tried.",
)  # fmt: skip
effect_option = click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="FILE.py:FUNCTION",
    help="Your own effect, in addition to the catalogue.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else there.")
progress_option = click.option(
    "--progress", type=click.Choice(["bar", "json"]), default="bar", show_default=True,
    help="On stderr: a bar on a terminal, or for programs a line of JSON at the beginning of each stage.",
)  # fmt: skip


@dataclass(frozen=True)
class SearchOptions:
    """The options that ``explain`` and ``improve`` share.  executor, progress: see their help; report, curves: files to
    write; budget_s: time limit of the search [s]; effects: user-defined ones, as file.py:function; as_json: whether to
    print JSON."""

    executor: str | None
    report: Path | None
    curves: Path | None
    budget_s: float
    effects: tuple[str, ...]
    progress: str
    as_json: bool


def search_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options of a search for missing effects, which the command gets as ``search``, of type SearchOptions."""

    @wraps(command)
    def with_options(**given: Any) -> None:
        options = {field.name: given.pop(field.name) for field in fields(SearchOptions)}
        command(search=SearchOptions(**options), **given)

    every = (executor_option, report_option, curves_option, budget_option, effect_option, progress_option, json_option)
    for option in reversed(every):  # the help lists the option that is added last first
        with_options = option(with_options)
    return with_options
