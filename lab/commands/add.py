"""``lostmotion lab add``: arguments and text only."""

from __future__ import annotations

import json
from pathlib import Path

import click

from lostmotion.lab.commands.options import json_option, output_option
from lostmotion.lab.models.add import Added
from lostmotion.lab.models.add import add as add_effect
from lostmotion.model import Parameter

__all__ = ["add"]


@click.command(short_help="A model with one more effect.")
@click.argument("model")
@click.argument("effect")
@output_option
@json_option
def add(model: str, effect: str, output: Path, as_json: bool) -> None:
    """Write MODEL2: MODEL with one more effect, its parameters at their defaults, for you to edit.

    MODEL is a model file, or the name of a base (play, oscillator, joint, servo).  EFFECT is an id of the catalogue
    (lostmotion effects), or your own as file.py:function; that file is run, now and whenever MODEL2 is used.
    """
    added = add_effect(model, effect, output)
    if as_json:
        click.echo(json.dumps({"model": str(output), **added.document()}, ensure_ascii=False))
    else:
        click.echo(_message(added, output))
    if added.note:
        click.echo(f"{added.effect.id} runs in plain Python, ten to twenty times as slowly: {added.note}", err=True)


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
