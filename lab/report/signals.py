"""The data of the zoomable plots that assets/report.js draws, packed compactly without loss."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from lostmotion.lab.data.series import rms
from lostmotion.lab.quantity import quantities, scale, with_unit
from lostmotion.lab.report.tags import Html, Section, note
from lostmotion.lab.report.views import Trace
from lostmotion.model.motion import FloatArray

__all__ = ["packed", "signals"]

EVEN = 1e-6
"""Largest deviation of times from an even grid, as a share of its spacing, with which only start and spacing are
stored."""
TOOLS = (
    ("in", "+", "zoom in"),
    ("out", "−", "zoom out"),
    ("left", "◀", "earlier"),
    ("right", "▶", "later"),
    ("whole", "all", "the whole recording"),
)


def signals(traces: Sequence[Trace]) -> Section:
    """The section with the elements in which the script draws, one for each column of each recording."""
    text = (
        "Drag across an interval to zoom, double-click for the whole; on a phone one finger moves, two zoom. Keys: "
        "arrows, +, −, 0. The grey band holds 95 % of the sensor's noise."
    )
    if any(trace.before is not None for trace in traces):
        text += " Below, what is left with what was found, and without it; tap a name to hide or show its curve."
    places = [_place(number, trace, _largest(traces, trace)) for number, trace in enumerate(traces)]
    return Section("signals", "Measured and modelled", Html(note(text) + "".join(places)))


def packed(traces: Sequence[Trace]) -> str:
    """The data of these elements as JSON that is safe inside of a script element."""
    places = [_packed(number, trace, _largest(traces, trace)) for number, trace in enumerate(traces)]
    text = json.dumps(places, ensure_ascii=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _largest(traces: Sequence[Trace], like: Trace) -> float:
    """The largest residual of a column in all recordings, which share one unit."""
    return max(float(np.max(np.abs(trace.residual))) for trace in traces if trace.column == like.column)


def _place(number: int, trace: Trace, largest: float) -> str:
    (error, noise, _), unit = quantities(trace.unit, rms(trace.residual), trace.noise, largest)
    floor = f"; noise {with_unit(noise, unit)}" if np.isfinite(trace.noise) else ""
    tools = "".join(f'<button type="button" data-do="{do}" aria-label="{label}" title="{label}">{text}</button>'
                    for do, text, label in TOOLS)  # fmt: skip
    return (
        f'<div class="signal" id="{_id(number)}" tabindex="0" role="group" aria-label="{escape(trace.title)}">'
        f"<h3>{escape(trace.title[0].upper() + trace.title[1:])}</h3>"
        f'<p class="note">error {escape(with_unit(error, unit))} (root mean square){escape(floor)}</p>'
        f'<div class="tools">{tools}</div><div class="chart"></div><div class="chart"></div></div>\n'
    )


def _packed(number: int, trace: Trace, largest: float) -> dict[str, Any]:
    shown = scale(trace.unit, float(np.max(np.abs(trace.measured))))
    left = scale(trace.unit, largest)
    noise = trace.noise * shown.factor
    packed = {
        "id": _id(number),
        "what": trace.what,
        "unit": shown.unit,
        "residual_unit": left.unit,
        "residual_factor": left.factor / shown.factor,
        "noise": noise if np.isfinite(noise) else None,
        **_times(trace.time),
        "measured": _base64(trace.measured * shown.factor, "<f4"),
        "modelled": _base64(trace.modelled * shown.factor, "<f4"),
    }
    if trace.before is not None:
        packed["before"] = _base64(trace.before * shown.factor, "<f4")
    return packed


def _times(time: FloatArray) -> dict[str, Any]:
    spacing = float(time[-1] - time[0]) / max(time.size - 1, 1)
    even = time[0] + spacing * np.arange(time.size)
    if np.max(np.abs(time - even)) <= EVEN * spacing:
        return {"start": float(time[0]), "spacing": spacing, "count": time.size}
    return {"time": _base64(time, "<f8")}


def _base64(values: FloatArray, kind: str) -> str:
    return base64.b64encode(values.astype(kind).tobytes()).decode("ascii")


def _id(number: int) -> str:
    return f"signal-{number}"
