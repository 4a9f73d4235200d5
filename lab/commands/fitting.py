"""``lostmotion lab fit | explain | improve``: arguments, progress and text only."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from lostmotion.lab.commands.options import (
    budget_option,
    curves_option,
    effect_option,
    executor_option,
    json_option,
    model_argument,
    output_option,
    progress_option,
    report_option,
)
from lostmotion.lab.commands.progress import shown
from lostmotion.lab.commands.reading import Files, recordings_argument, used
from lostmotion.lab.deadline import Progress

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from lostmotion.lab.data.experiment import Experiment
    from lostmotion.lab.results import Explanation
    from lostmotion.model import Model

__all__ = ["explain", "fit", "improve"]


@click.command(short_help="The free parameters, with intervals.")
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
    from lostmotion.lab.commands.output import write_output
    from lostmotion.lab.estimate import fit as fitted

    with _prepared(model, recordings, executor, progress) as (built, experiments, pool, callback):
        found = fitted(built, experiments, pool, callback)
    _save(found.model, output)
    if write_output(found, "fit", report, curves, as_json=as_json):
        return
    from lostmotion.lab.commands.fitting_terminal import show_fit

    show_fit(found, output)


@click.command(short_help="Which physical effect is missing.")
@model_argument
@recordings_argument
@executor_option
@report_option
@curves_option
@budget_option
@effect_option
@progress_option
@json_option
def explain(
    model: str, recordings: Files, executor: str | None, report: Path | None, curves: Path | None,
    budget_s: float, effects: tuple[str, ...], progress: str, as_json: bool,
) -> None:  # fmt: skip
    """Find the physical effect that MODEL lacks, validated on the last recording, which is not fitted."""
    from lostmotion.lab.commands.output import write_output

    with _explained(model, recordings, executor, progress, budget_s, effects) as found:
        if write_output(found, "explanation", report, curves, as_json=as_json):
            return
        from lostmotion.lab.commands.fitting_terminal import show_explanation

        show_explanation(found)


@click.command(short_help="Explain, add and fit until nothing is missing.")
@model_argument
@recordings_argument
@output_option
@executor_option
@report_option
@curves_option
@budget_option
@effect_option
@progress_option
@json_option
def improve(
    model: str, recordings: Files, output: Path, executor: str | None, report: Path | None,
    curves: Path | None, budget_s: float, effects: tuple[str, ...], progress: str, as_json: bool,
) -> None:  # fmt: skip
    """Explain, add and fit until nothing significant is missing; print how the error falls; write MODEL2."""
    from lostmotion.lab.commands.output import write_output
    from lostmotion.lab.results import ladder_of

    with _explained(model, recordings, executor, progress, budget_s, effects) as explanation:
        found = ladder_of(explanation)
        _save(explanation.best.model, output)
        if write_output(found, "ladder", report, curves, as_json=as_json):
            return
        from lostmotion.lab.commands.fitting_terminal import show_ladder

        show_ladder(found, output)


@contextmanager
def _explained(
    model: str, recordings: Files, executor: str | None, progress: str, budget_s: float, effects: tuple[str, ...]
) -> Iterator[Explanation]:
    """What is missing; the user-defined effects stay known in the block, as the output uses their names and words."""
    from lostmotion.lab.explain import explain

    until = monotonic() + budget_s
    with _beside(effects):
        with _prepared(model, recordings, executor, progress) as (built, experiments, pool, callback):
            found = explain(built, experiments, pool, callback, budget_s=until - monotonic())
        yield found


@contextmanager
def _beside(references: tuple[str, ...]) -> Iterator[None]:
    """Adds user-defined effects to the candidates."""
    from lostmotion.lab.models.own.file import load_effect
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
    model: str, recordings: Files, executor: str | None, progress: str
) -> Iterator[tuple[Model, tuple[Experiment, ...], Executor, Progress]]:
    """The model, the experiments, an executor and the callback of progress."""
    from lostmotion.lab.parallel import open_executor

    with (
        used(model, recordings) as (built, experiments, _),
        open_executor(executor) as pool,
        shown(progress) as callback,
    ):
        yield built, experiments, pool, callback


def _save(model: Model, output: Path) -> None:
    from lostmotion.lab.models import modelfile

    modelfile.save(modelfile.ModelFile(model.base, model.effects, model.parameters), output)
