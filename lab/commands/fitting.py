"""``lostmotion lab fit | explain | improve``: arguments, progress and text only."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

from lostmotion.lab.commands.duration import DURATION

__all__ = ["explain", "fit", "improve"]

Progress = Callable[[str, float], None]
model_argument = click.argument("model")
recordings_argument = click.argument(
    "recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="REC..."
)
output_option = click.option(
    "-o", "--output", type=click.Path(path_type=Path), required=True, metavar="MODEL2", help="Model file to write."
)
executor_option = click.option(
    "--executor", metavar="SPEC", help="Where to compute: threads:N, processes:N or dask=HOST:PORT.  [default: threads]"
)
report_option = click.option(
    "--report", type=click.Path(path_type=Path), metavar="F.html", help="Write a report to open in a browser."
)
budget_option = click.option(
    "--budget", "budget_s", type=DURATION, default="60s", show_default=True, metavar="TIME",
    help="After so long no further effect is looked for; the answer says what was not tried.",
)  # fmt: skip
effect_option = click.option(
    "--effect", "effects", multiple=True, metavar="FILE.py:FUNCTION", help="Your own effect, beside the catalogue."
)
json_option = click.option("--json", "as_json", is_flag=True, help="One JSON document on stdout, nothing else there.")


@click.command(short_help="The free parameters, with intervals.")
@model_argument
@recordings_argument
@output_option
@executor_option
@report_option
@json_option
def fit(
    model: str, recordings: tuple[Path, ...], output: Path, executor: str | None, report: Path | None, as_json: bool
) -> None:
    """Estimate MODEL's free parameters from all recordings together, with confidence intervals, into MODEL2."""
    from lostmotion.lab.fit import fit as fitted

    with _prepared(model, recordings, executor) as (built, experiments, pool, progress):
        found = fitted(built, experiments, pool, progress)
    _save(found.model, output)
    if _told(found, report, as_json, "fit"):
        return
    from lostmotion.lab.commands.fitting_terminal import show_fit

    show_fit(found, output)


@click.command(short_help="Which physical effect is missing.")
@model_argument
@recordings_argument
@executor_option
@report_option
@budget_option
@effect_option
@json_option
def explain(
    model: str, recordings: tuple[Path, ...], executor: str | None, report: Path | None, budget_s: float,
    effects: tuple[str, ...], as_json: bool,
) -> None:  # fmt: skip
    """Say which physical effect MODEL lacks, judged on the last recording, which the fit does not see."""
    from lostmotion.lab.explain import explain as explained

    with _beside(effects), _prepared(model, recordings, executor) as (built, experiments, pool, progress):
        found = explained(built, experiments, pool, progress, budget_s=budget_s)
    if _told(found, report, as_json, "explanation"):
        return
    from lostmotion.lab.commands.fitting_terminal import show_explanation

    show_explanation(found)


@click.command(short_help="Explain, add and fit until nothing is missing.")
@model_argument
@recordings_argument
@output_option
@executor_option
@report_option
@budget_option
@effect_option
@json_option
def improve(
    model: str, recordings: tuple[Path, ...], output: Path, executor: str | None, report: Path | None,
    budget_s: float, effects: tuple[str, ...], as_json: bool,
) -> None:  # fmt: skip
    """Explain, add and fit until nothing significant is missing; print how the error falls; write MODEL2."""
    from lostmotion.lab.explain import explain as explained
    from lostmotion.lab.ladder import ladder_of

    with _beside(effects), _prepared(model, recordings, executor) as (built, experiments, pool, progress):
        found = ladder_of(explained(built, experiments, pool, progress, budget_s=budget_s))
    _save(found.last.best.model, output)
    if _told(found, report, as_json, "ladder"):
        return
    from lostmotion.lab.commands.fitting_terminal import show_ladder

    show_ladder(found, output)


@contextmanager
def _beside(references: tuple[str, ...]) -> Iterator[None]:
    """Effects of the user's own among the candidates."""
    from lostmotion.lab.own.file import load_effect
    from lostmotion.model.effects import register, unregister

    loaded = [load_effect(reference) for reference in references]
    for effect in loaded:
        register(effect)
    try:
        yield
    finally:
        for effect in loaded:
            unregister(effect.id)


@contextmanager
def _prepared(
    model: str, recordings: tuple[Path, ...], executor: str | None
) -> Iterator[tuple[Any, Any, Any, Progress]]:
    """The model, the experiments, an executor and what progress is told to; input that cannot be used is refused."""
    from lostmotion.drivers.recording import read_recording
    from lostmotion.lab import modelfile
    from lostmotion.lab.errors import ExperimentError
    from lostmotion.lab.experiment import experiments
    from lostmotion.lab.parallel import open_executor
    from lostmotion.model import ModelError

    built = modelfile.load(model).build()
    held = experiments(built, [read_recording(path) for path in recordings])
    try:
        with open_executor(executor) as pool, _progress() as progress:
            yield built, held, pool, progress
    except ModelError as error:
        raise ExperimentError(f"{model}: the model cannot be run on these recordings: {error}") from error


@contextmanager
def _progress() -> Iterator[Progress]:
    """A bar on stderr, nothing where that is no terminal."""
    if not sys.stderr.isatty():
        yield lambda what, part: None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda what, part: bar.update(task, description=what, completed=part)


def _save(model: Any, output: Path) -> None:
    from lostmotion.lab import modelfile

    modelfile.save(modelfile.ModelFile(model.base, model.effects, model.parameters), output)


def _told(found: Any, report: Path | None, as_json: bool, kind: str) -> bool:
    """Writes the report and the JSON document that were asked for; whether that is all, as a program reads it."""
    if report is not None:
        from lostmotion.lab.report import write_report

        write_report(report, **{kind: found})
    if as_json:
        click.echo(json.dumps(found.document(), ensure_ascii=False, allow_nan=False))
    return as_json
