"""Progress of a command of the lab on stderr: a bar for people, lines of JSON for programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from lostmotion.lab.deadline import Progress

__all__ = ["shown"]


@contextmanager
def shown(how: str) -> Iterator[Progress]:
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
