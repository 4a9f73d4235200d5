"""The commands ``lostmotion simulate | effects``: arguments and tables only.  What computes is imported late."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lostmotion.drivers.pipes import refuse_two_documents
from lostmotion.lab.commands.options import FILE, json_option
from lostmotion.lab.commands.table import print_table

if TYPE_CHECKING:
    from lostmotion.drivers.recording import Recording
    from lostmotion.lab.models.simulate import Simulation
    from lostmotion.model import EffectInfo, Trajectory

__all__ = ["effects", "simulate"]


class Number(click.FloatRange):
    """A number in a range, in which click lets nan through."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found: float = super().convert(value, param, ctx)
        if math.isnan(found):
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return found


POSITIVE = Number(min=0, min_open=True, max=1e9)


@click.command()
@click.argument("model")
@click.option("-o", "--output", type=FILE, required=True, metavar="REC",
              help="File to write; - is stdout.")  # fmt: skip
@click.option("--motion", metavar="TEXT", help="hand-waved:7 (seed), sine:6,0.02 (Hz, rad), chirp:…, step:…, or free.")
@click.option("--duration", type=POSITIVE, default=10.0, show_default=True, metavar="S", help="Length [s].")
@click.option("--rate-hz", type=POSITIVE, default=1000.0, show_default=True, metavar="R", help="Rows a second.")
@click.option("--servo-rate-hz", type=POSITIVE, metavar="R", help="Rate of command and position.  [default: --rate-hz]")
@click.option("--noise", type=Number(min=0, max=1e9), default=0.0, show_default=True, metavar="S",
              help="Standard deviation, in the unit of what is measured.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N", help="Of the noise.")
@json_option
def simulate(model: str, output: Path, as_json: bool, **options: Any) -> None:
    """Write a recording of MODEL: a model file, or the name of a base (play, oscillator, joint, servo).

    An existing REC is replaced, once all is simulated.
    """
    from lostmotion.drivers.recording import write_recording
    from lostmotion.lab.models import modelfile
    from lostmotion.lab.models.simulate import Simulation

    refuse_two_documents(output, as_json)
    simulation = Simulation(modelfile.load(model), **options)
    recording = simulation.recording(list(_progress(simulation)))
    write_recording(recording, output)
    horizon = simulation.horizon()
    if horizon < simulation.duration:
        click.echo(
            f"{output}: the motion is chaotic: from {horizon:.1f} s on, samples can be compared only statistically",
            err=True,
        )
    if as_json:
        click.echo(json.dumps({"recording": str(output), "rows": simulation.samples, **recording.metadata}))
    else:
        click.echo(_message(recording, output), err=True)


@click.command()
@json_option
def effects(as_json: bool) -> None:
    """List the catalogue of effects: id, equation, parameters with units, what each acts on."""
    from lostmotion.model import catalogue

    if as_json:
        click.echo(json.dumps([_effect(effect) for effect in catalogue()], indent=1, ensure_ascii=False))
    else:
        _print_table(catalogue())


def _progress(simulation: Simulation) -> Iterable[Trajectory]:
    """The simulation's pieces, with a bar on stderr where that is a terminal."""
    if not sys.stderr.isatty():
        yield from simulation.pieces()
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("simulating", total=simulation.samples)
        for piece in simulation.pieces():
            progress.advance(task, len(piece.time))
            yield piece


def _message(recording: Recording, output: Path) -> str:
    effects = ", ".join(recording.metadata["effects"]) or "none"
    columns = ", ".join(recording.columns)
    rows = len(recording.time)
    return f"{output}: {rows} rows of {columns}; base {recording.metadata['model']}, active effects: {effects}"


def _effect(effect: EffectInfo) -> dict[str, Any]:
    parameters = {
        name: {"value": parameter.value, "unit": parameter.unit, "meaning": parameter.meaning}
        for name, parameter in effect.parameters.items()
    }
    return {
        "id": effect.id,
        "equation": effect.equation,
        "summary": effect.summary,
        "parameters": parameters,
        "acts_on": effect.acts_on.value,
        "bases": list(effect.bases),
    }


def _print_table(effects: Iterable[EffectInfo]) -> None:
    rows = []
    for effect in effects:
        units = (f"{name} [{parameter.unit or '-'}]" for name, parameter in effect.parameters.items())
        rows.append((effect.id, effect.acts_on.value, effect.equation, ", ".join(units), ", ".join(effect.bases)))
    print_table(("id", "acts on", "equation", "parameters", "bases"), rows)
