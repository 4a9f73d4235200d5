"""A length of time on the command line: ``60s``, ``2min``, ``90``."""

from __future__ import annotations

import re

import click

__all__ = ["DURATION"]

UNITS_S = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


class _Duration(click.ParamType[float]):
    name = "duration"

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|)\s*", str(value))
        if not found or float(found[1]) == 0:
            self.fail(f"found {value!r}, expected a length of time such as 60s or 2min", param, ctx)
        return float(found[1]) * UNITS_S[found[2]]


DURATION = _Duration()
"""Converts to seconds."""
