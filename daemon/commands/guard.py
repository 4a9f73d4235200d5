"""Error handling of the command line: an exception becomes one line on stderr and an exit status; late imports.

0: done; 1: the answer is bad news; 2: the call, the configuration or the input is wrong; 130, 141: ended by Ctrl-C, or
because the output's reader has ended (128 + the signal's number, as a shell reports it).
"""

from __future__ import annotations

import errno
import io
import os
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

import click

__all__ = ["LateCommand", "RootGroup"]

WRONG, INTERRUPTED, UNREAD = 2, 130, 141
LONGEST_WORD = 4096
"""Characters of a word in an error message: the longest path that Linux takes."""


class RootGroup(click.Group):
    """A group whose errors are one line."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Runs the command line and exits."""
        kwargs |= {"standalone_mode": False, "prog_name": "lostmotion"}
        sys.stdout, sys.stderr = sys.stdout or Closed(), sys.stderr or _nowhere()  # None: closed by the caller
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(errors="replace")  # a terminal without UTF-8 gets ? for bars and lines
        run = super().main
        sys.exit(_status(lambda: run(*args, **kwargs)))

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            ctx.exit(INTERRUPTED)
        except BrokenPipeError:
            ctx.exit(_unread())


class Closed(io.TextIOBase):
    """A stdout that the caller has closed: a command that has nothing to print may run all the same."""

    def write(self, text: str, /) -> int:
        raise OSError(errno.EBADF, "stdout is closed, expected to be open for the output")


class LateCommand(click.Command):
    """A command in a module that is imported only when the command is called.

    target: ``module:attribute`` of a click.Command; the help line is repeated here so that ``--help`` imports nothing.
    """

    def __init__(self, name: str, target: str, short_help: str) -> None:
        super().__init__(name, short_help=short_help)
        self._target = target

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """The context of the real command, which is all that click goes on with."""
        module, _, attribute = self._target.partition(":")
        command: click.Command = getattr(import_module(module), attribute)
        return command.make_context(info_name, args, parent, **extra)


def _status(call: Callable[[], Any]) -> int:
    """The exit status of a call; its error, if any, is printed on stderr."""
    try:
        status = call()
        sys.stdout.flush()
    except click.UsageError as error:
        from lostmotion.daemon.commands.usage import usage_line

        return _print_error(usage_line(error))
    except click.ClickException as error:
        return _print_error(error.format_message())
    except click.Abort:
        return INTERRUPTED
    except BrokenPipeError:
        return _unread()
    except Exception as error:  # noqa: BLE001 - the edge of the program: no traceback reaches a user
        return _explain(error)
    return status if isinstance(status, int) else 0


def _explain(error: Exception) -> int:
    import sqlite3

    from lostmotion.detector.errors import DetectorError
    from lostmotion.drivers.errors import LostmotionError
    from lostmotion.drivers.packages import missing

    if os.environ.get("LOSTMOTION_DEBUG"):
        import traceback

        traceback.print_exception(error)
    if isinstance(error, LostmotionError | DetectorError):
        return _print_error(str(error))
    if isinstance(error, sqlite3.Error):
        return _print_error(f"the database cannot be read: {error}; is it damaged, or locked by another program?")
    if isinstance(error, OSError) and error.strerror:
        return _print_error(f"{error.filename}: {error.strerror}" if error.filename else error.strerror)
    if isinstance(error, ModuleNotFoundError) and (line := missing(error.name, "this command")):
        return _print_error(line)
    if isinstance(error, UnicodeError):
        found = str(getattr(error, "object", error))
        return _print_error(f"found {found[:40]!r}, expected text in UTF-8")
    if isinstance(error, MemoryError):
        return _print_error(
            f"not enough memory: {error or 'none left'}; is the input far longer, or its times wider, than meant?"
        )
    return _print_error(f"internal error: {type(error).__name__}: {error}; set LOSTMOTION_DEBUG=1 for the traceback")


def _print_error(message: str) -> int:
    """A stderr that takes nothing, such as a log on a full disk, does not change the status: 1 would be bad news."""
    from lostmotion.drivers.terminal import printable

    words = (word if len(word) <= LONGEST_WORD else f"{word[:LONGEST_WORD]}..." for word in message.split())
    try:
        sys.stderr.write(f"lostmotion: {printable(' '.join(words))}\n")
        sys.stderr.flush()
    except OSError:
        _discard(sys.stderr)
    return WRONG


def _unread() -> int:
    _discard(sys.stdout)
    return UNREAD


def _nowhere() -> TextIO:
    """Takes what is written, and keeps nothing: a service may write for years."""
    return Path(os.devnull).open("w", encoding="utf-8")


def _discard(stream: TextIO) -> None:
    """The stream leads nowhere now, so that Python does not complain when it flushes at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
