"""Metrics as Prometheus reads them: its text format, version 0.0.4.  Knows no metric by name and no connection.

The client library of Prometheus is not used for it: that brings a web server, TLS and asyncio, 10 MB of a service that
has 60.  Its parser reads in the tests what is written here.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

__all__ = ["CONTENT_TYPE", "Family", "Kind", "text"]

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"

Kind = Literal["gauge", "counter", "info"]
SUFFIX: Mapping[Kind, str] = {"gauge": "", "counter": "_total", "info": "_info"}
"""what the format asks the names of each kind to end in"""


@dataclass(frozen=True, slots=True)
class Family:
    """A metric: all its samples, each with the values of the same labels."""

    name: str
    kind: Kind
    help: str
    labels: Sequence[str] = ()
    samples: list[tuple[tuple[str, ...], float]] = field(default_factory=list)

    def add(self, value: float, *labels: str) -> Family:
        """One more sample; the family itself."""
        self.samples.append((labels, value))
        return self


def text(families: Iterable[Family]) -> str:
    """The page that a scrape gets."""
    return "".join(_of(family) for family in families)


def _of(family: Family) -> str:
    name = family.name + SUFFIX[family.kind]
    kind = "gauge" if family.kind == "info" else family.kind
    lines = [f"# HELP {name} {_escaped(family.help)}", f"# TYPE {name} {kind}"]
    lines += [f"{name}{_named(family.labels, values)} {_number(value)}" for values, value in family.samples]
    return "\n".join(lines) + "\n"


def _named(labels: Sequence[str], values: Sequence[str]) -> str:
    pairs = [f'{label}="{_quoted(value)}"' for label, value in zip(labels, values, strict=True)]
    return "{" + ",".join(pairs) + "}" if pairs else ""


def _escaped(words: str) -> str:
    return words.replace("\\", r"\\").replace("\n", r"\n")


def _quoted(value: str) -> str:
    return _escaped(value).replace('"', r"\"")


def _number(value: float) -> str:
    return {"nan": "NaN", "inf": "+Inf", "-inf": "-Inf"}.get(found := repr(float(value)), found)
