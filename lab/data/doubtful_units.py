"""Recordings whose numbers are hardly in the units of the format: degrees for rad, milliseconds for seconds.

A model compared with such a recording is wrong in everything, and no error of the fit says why.  A warning asks; the
recording is used as it is.
"""

from __future__ import annotations

import logging

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.model.motion import FloatArray

__all__ = ["warn_of_units"]

ANGLES = ("command", "position")
WIDEST = 20.0
"""[rad], three turns.  A joint that comes and goes within 20 degrees reads as much where its angles are in degrees."""
RETURNS = 1.5
"""Way of the angle by its range: 1 of a shaft that runs in one direction, as far as it likes, 2 where it comes back."""
SLOWEST = 2.0
"""Samples a second.  No motion of a robot shows at fewer; 1000 a second in milliseconds are 1."""
log = logging.getLogger(__name__)


def warn_of_units(recording: Recording) -> None:
    """Warns of times and angles that are hardly in s and rad."""
    spacing = float(np.median(np.diff(recording.time))) if recording.time.size > 1 else 0.0
    if spacing > 1 / SLOWEST:
        log.warning(
            "%s: found a sample every %.3g s, expected times in seconds; are they in ms or µs?", recording.name, spacing
        )
    for name in ANGLES:
        values = recording.columns.get(name, np.empty(0))
        if "position_unit" not in recording.metadata and (width := _comes_and_goes(values[np.isfinite(values)])):
            log.warning(
                "%s: found %s over %.0f rad, %.0f turns; are these degrees? Then give --map %s=%s:deg",
                recording.name, name, width, width / (2 * np.pi), name, name,
            )  # fmt: skip


def _comes_and_goes(values: FloatArray) -> float:
    """The range of an angle (N,) [rad] that is wider than any joint's and not that of a shaft that runs on; else 0."""
    width = float(np.ptp(values)) if values.size else 0.0
    return width if width > WIDEST and float(np.abs(np.diff(values)).sum()) > RETURNS * width else 0.0
