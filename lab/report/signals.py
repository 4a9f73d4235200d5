"""The zoomable pictures: what assets/report.js draws, packed so that nothing is lost and the file stays small."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from html import escape
from pathlib import PurePath
from typing import Any

import numpy as np

from lostmotion.lab.quantity import quantities, scale, with_unit
from lostmotion.lab.report.tags import Html, Section, note
from lostmotion.lab.report.views import Overlay
from lostmotion.model.motion import FloatArray

__all__ = ["packed", "signals"]

EVEN = 1e-6
"""Times are sent as start and spacing where none is further from that grid than this share of the spacing."""
TOOLS = (
    ("in", "+", "zoom in"),
    ("out", "−", "zoom out"),
    ("left", "◀", "earlier"),
    ("right", "▶", "later"),
    ("whole", "all", "the whole recording"),
)


def signals(overlays: Sequence[Overlay]) -> Section:
    """The places where the script draws, one for each column of each recording."""
    text = (
        "Drag across a stretch to zoom, double-click for the whole; on a phone one finger moves, two zoom. Keys: "
        "arrows, +, −, 0. The grey band holds 95 % of the sensor's noise."
    )
    if any(overlay.before is not None for overlay in overlays):
        text += " Tap “without what was found” to see the model that lacks it."
    places = [_place(number, overlay) for number, overlay in enumerate(overlays)]
    return Section("signals", "Measured and modelled", Html(note(text) + "".join(places)))


def packed(overlays: Sequence[Overlay]) -> str:
    """The data of those places as JSON that is safe inside a script element."""
    text = json.dumps([_packed(number, overlay) for number, overlay in enumerate(overlays)], ensure_ascii=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _place(number: int, overlay: Overlay) -> str:
    rms = float(np.sqrt(np.mean(overlay.residual**2)))
    (error, noise, _), unit = quantities(overlay.unit, rms, overlay.noise, float(np.max(np.abs(overlay.residual))))
    floor = f"; noise {with_unit(noise, unit)}" if np.isfinite(overlay.noise) else ""
    title = f"{overlay.what}, {PurePath(overlay.recording).name}"
    tools = "".join(f'<button type="button" data-do="{do}" aria-label="{label}" title="{label}">{text}</button>'
                    for do, text, label in TOOLS)  # fmt: skip
    return (
        f'<div class="signal" id="{_id(number)}" tabindex="0" role="group" aria-label="{escape(title)}">'
        f"<h3>{escape(title[0].upper() + title[1:])}</h3>"
        f'<p class="note">error {escape(with_unit(error, unit))} (root mean square){escape(floor)}</p>'
        f'<div class="tools">{tools}</div><div class="chart"></div><div class="chart"></div></div>\n'
    )


def _packed(number: int, overlay: Overlay) -> dict[str, Any]:
    shown = scale(overlay.unit, float(np.max(np.abs(overlay.measured))))
    left = scale(overlay.unit, float(np.max(np.abs(overlay.residual))))
    noise = overlay.noise * shown.factor
    packed = {
        "id": _id(number),
        "what": overlay.what,
        "unit": shown.unit,
        "residual_unit": left.unit,
        "residual_factor": left.factor / shown.factor,
        "noise": noise if np.isfinite(noise) else None,
        **_times(overlay.time),
        "measured": _base64(overlay.measured * shown.factor, "<f4"),
        "modelled": _base64(overlay.modelled * shown.factor, "<f4"),
    }
    if overlay.before is not None:
        packed["before"] = _base64(overlay.before * shown.factor, "<f4")
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
