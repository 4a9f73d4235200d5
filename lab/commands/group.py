"""The commands ``lostmotion lab compare | fit | explain | add | improve``: arguments, progress and text only.

What computes is imported late, so that help and the shell's completion are quick.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from lostmotion.drivers.terminal import waiting
from lostmotion.lab.commands.options import (
    SearchOptions,
    curves_option,
    executor_option,
    json_option,
    model_argument,
    output_option,
    progress_option,
    report_option,
    search_options,
)
from lostmotion.lab.commands.reading import Files, recordings_argument, used
from lostmotion.lab.deadline import Progress

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from lostmotion.lab.data.experiment import Experiment
    from lostmotion.lab.models.add import Added
    from lostmotion.lab.results import Explanation
    from lostmotion.model import Model, Parameter

__all__ = ["lab"]


@click.group()
def lab() -> None:
    """Compare a model with measurements, find the missing effect, and add it."""


@lab.command(short_help="The error of a model, and where it arises.")
@model_argument
@recordings_argument
@report_option
@curves_option
@json_option
def compare(model: str, recordings: Files, report: Path | None, curves: Path | None, as_json: bool) -> None:
    """Compare MODEL with recordings: its error, where it fails, and in which equation.

    MODEL is a model file, or the name of a base.  No parameter is fitted; the initial state of each recording is
    estimated.
    """
    with waiting("comparing"):
        from lostmotion.lab.commands.output import write_output
        from lostmotion.lab.comparison.compare import compare as compared

        with used(model, recordings) as (built, experiments, read):
            found = compared(built, experiments, recordings=read)
    write_output(found, report, curves, as_json=as_json)


@lab.command(short_help="The free parameters, with intervals.")
@model_argument
@recordings_argument
@output_option
@executor_option
@report_option
@curves_option
@progress_option
@json_option
def fit(
    model: str, recordings: Files, output: Path, executor: str | None, report: Path | None,
    curves: Path | None, progress: str, as_json: bool,
) -> None:  # fmt: skip
    """Estimate MODEL's free parameters from all recordings together, with confidence intervals, into MODEL2."""
    with _shown(progress) as callback:
        from lostmotion.lab.commands.output import write_output
        from lostmotion.lab.estimate import fit as fitted

        with _prepared(model, recordings, executor) as (built, experiments, pool):
            found = fitted(built, experiments, pool, callback)
    _save(found.model, output)
    write_output(found, report, curves, output, as_json=as_json)


@lab.command(short_help="Which physical effect is missing.")
@model_argument
@recordings_argument
@search_options
def explain(model: str, recordings: Files, search: SearchOptions) -> None:
    """Find the physical effect that MODEL lacks, validated on the last recording, which is not fitted."""
    with _explained(model, recordings, search) as found:
        from lostmotion.lab.commands.output import write_output

        write_output(found, search.report, search.curves, as_json=search.as_json)


@lab.command(short_help="Explain, add and fit until nothing is missing.")
@model_argument
@recordings_argument
@output_option
@search_options
def improve(model: str, recordings: Files, output: Path, search: SearchOptions) -> None:
    """Explain, add and fit until nothing significant is missing; print how the error falls; write MODEL2."""
    with _explained(model, recordings, search) as explanation:
        from lostmotion.lab.commands.output import write_output
        from lostmotion.lab.results import ladder_of

        _save(explanation.best.model, output)
        write_output(ladder_of(explanation), search.report, search.curves, output, as_json=search.as_json)


@lab.command(short_help="A model with one more effect.")
@click.argument("model")
@click.argument("effect")
@output_option
@json_option
def add(model: str, effect: str, output: Path, as_json: bool) -> None:
    """Write MODEL2: MODEL with one more effect, its parameters at their defaults, for you to edit.

    MODEL is a model file, or the name of a base (play, oscillator, joint, servo).  EFFECT is an id of the catalogue
    (lostmotion effects), or your own as file.py:function; that file is run, now and whenever MODEL2 is used.
    """
    from lostmotion.lab.models.add import add as add_effect

    added = add_effect(model, effect, output)
    if as_json:
        click.echo(json.dumps({"model": str(output), **added.document()}, ensure_ascii=False))
    else:
        click.echo(_message(added, output))
    if added.note:
        click.echo(f"{added.effect.id} runs in plain Python, ten to twenty times as slowly: {added.note}", err=True)


@contextmanager
def _explained(model: str, recordings: Files, search: SearchOptions) -> Iterator[Explanation]:
    """The result of the search.  Within the block the user-defined effects stay registered, as the output uses their
    names and words."""
    with ExitStack() as own:
        with _shown(search.progress) as callback:
            from lostmotion.lab.explanation import explain
            from lostmotion.lab.models.own.file import load_effect
            from lostmotion.model.effects.registry import registered

            begun = monotonic()
            own.enter_context(registered([load_effect(reference) for reference in search.effects]))
            with _prepared(model, recordings, search.executor) as (built, experiments, pool):
                spent_s = monotonic() - begun
                found = explain(built, experiments, pool, callback, budget_s=search.budget_s, spent_s=spent_s)
        yield found


@contextmanager
def _prepared(
    model: str, recordings: Files, executor: str | None
) -> Iterator[tuple[Model, tuple[Experiment, ...], Executor]]:
    """The model, the experiments, and an executor."""
    from lostmotion.lab.parallel import open_executor

    with used(model, recordings) as (built, experiments, _), open_executor(executor) as pool:
        yield built, experiments, pool


def _save(model: Model, output: Path) -> None:
    from lostmotion.lab.models import modelfile

    modelfile.save(modelfile.ModelFile(model.base, model.effects, model.parameters), output)


@contextmanager
def _shown(how: str) -> Iterator[Progress]:
    """Yields the callback of progress; how: "bar", which shows nothing where stderr is no terminal, or "json"."""
    if how == "json":
        yield _line
    elif not sys.stderr.isatty():
        yield lambda what, part: None
    else:
        with _bar() as progress:
            yield progress


def _line(what: str, part: float) -> None:
    sys.stderr.write(json.dumps({"progress": what, "part": round(part, 4)}, ensure_ascii=False) + "\n")
    sys.stderr.flush()


@contextmanager
def _bar() -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, part: bar.update(task, description=what, completed=part)


def _message(added: Added, output: Path) -> str:
    lines = [
        f"{output}: base {added.model.base}, active effects: {', '.join(added.model.effects)}",
        f"added {added.effect.id} on the {added.effect.acts_on}: {added.effect.equation}",
    ]
    return "\n".join(lines + [_row(name, parameter) for name, parameter in added.parameters.items()])


def _row(name: str, parameter: Parameter) -> str:
    unit = f" {parameter.unit}" if parameter.unit else ""
    free = "fixed" if parameter.fixed else f"{parameter.low:g} to {parameter.high:g}{unit}"
    return f"  {name} = {parameter.value:g}{unit} ({free}){': ' if parameter.meaning else ''}{parameter.meaning}"
