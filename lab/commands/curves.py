"""``--curves``: the time series of the report as JSON, for other programs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from lostmotion.drivers.recording import replacing
from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.report.views import Trace, traces_of
from lostmotion.lab.results import Explanation, Fit, Ladder
from lostmotion.model.motion import FloatArray

__all__ = ["write_curves"]

DIGITS = 6
"""of each number: more than a plot can show"""


def write_curves(path: Path, found: Comparison | Fit | Explanation | Ladder) -> None:
    """Writes each column of each recording: measured, modelled, and modelled without what was found.

    A file of that name is replaced, once all is written.  Raises RecordingError when it cannot be written.
    """
    document = [_document(trace) for trace in traces_of(found)]
    with replacing(path) as file:
        json.dump(document, file, ensure_ascii=False, allow_nan=False)


def _document(trace: Trace) -> dict[str, Any]:
    return {
        "recording": trace.recording,
        "column": trace.column,
        "what": trace.what,
        "unit": trace.unit,
        "noise": trace.noise if np.isfinite(trace.noise) else None,
        "time": trace.time.round(9).tolist(),
        "measured": _numbers(trace.measured),
        "modelled": _numbers(trace.modelled),
        "before": None if trace.before is None else _numbers(trace.before),
    }


def _numbers(values: FloatArray) -> list[float | None]:
    """The values, None for NaN and infinity, which JSON cannot represent: a wrong model may diverge."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values]
