"""A wrong call in one line: what was found, what was expected, and whose --help says more.  click's own words lack one
of the first two."""

from __future__ import annotations

import re

import click

from lostmotion.drivers.textfile import near

__all__ = ["usage_line"]


def usage_line(error: click.UsageError) -> str:
    """The line for the error."""
    said = _said(error)
    if not error.ctx:  # click does not tell whose option has no value
        return said
    return f"{said}{' See' if said.endswith('?') else '; see'} {error.ctx.command_path} --help"


def _said(error: click.UsageError) -> str:
    """What was found and what was expected; click's own words where that is in them."""
    ctx = error.ctx
    match error:
        case click.exceptions.NoArgsIsHelpError() if isinstance(error.ctx.command, click.Group):
            return f"found no command, expected one of {', '.join(error.ctx.command.list_commands(error.ctx))}"
        case click.NoSuchOption() if ctx:
            names = [name for param in ctx.command.get_params(ctx) for name in param.opts if name.startswith("--")]
            return _unknown("option", error.option_name, ctx, names)
        case click.BadOptionUsage() if "requires an argument" in error.message:
            return f"found the option {error.option_name!r} alone, expected a value behind it"
        case click.MissingParameter(param=click.Parameter() as param) if ctx:
            what = f"{param.opts[-1]} {param.make_metavar(ctx)}" if isinstance(param, click.Option) else _call(ctx)
            return f"found no {param.get_error_hint(ctx)}, expected {what}"
        case click.BadParameter(param=click.Parameter() as param) if expected := _expected(param.type):
            found, is_of_type, _ = error.message.partition(" is not ")
            if is_of_type:
                return f"Invalid value for {param.get_error_hint(ctx)}: found {found}, expected {expected}"
    if ctx and isinstance(ctx.command, click.Group) and (word := re.match(r"No such command '(.*?)'", error.message)):
        return _unknown("command", word[1], ctx, ctx.command.list_commands(ctx))
    if ctx and (words := re.match(r"Got unexpected extra arguments? \((.*)\)", error.message)):
        return f"found {words[1]!r} at the end, expected {_call(ctx)}"
    return error.format_message().rstrip(".")


def _unknown(kind: str, word: str, ctx: click.Context, known: list[str]) -> str:
    return f"found the {kind} {word!r}, expected one of {ctx.command_path}{near(word, known)}"


def _call(ctx: click.Context) -> str:
    """How the command is called."""
    return " ".join((ctx.command_path, *ctx.command.collect_usage_pieces(ctx)))


def _expected(kind: object) -> str:
    """What a value of this type is, "" where the type's own words say it."""
    if isinstance(kind, click.Choice):
        return f"one of {', '.join(map(str, kind.choices))}"
    if not isinstance(kind, type(click.INT) | type(click.FLOAT)):
        return ""
    noun = "a whole number" if isinstance(kind, type(click.INT)) else "a number"
    if not isinstance(kind, click.IntRange | click.FloatRange):
        return noun
    low = [] if kind.min is None else [f"{'more than' if kind.min_open else 'at least'} {kind.min:g}"]
    high = [] if kind.max is None else [f"{'less than' if kind.max_open else 'at most'} {kind.max:g}"]
    return f"{noun} of {' and '.join(low + high)}"
