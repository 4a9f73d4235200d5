"""Recordings whose times are hardly in seconds: a warning asks, and the recording is used as it is.

Angles are not judged.  Shafts of motors come and go over more than three turns, too: 8 of 167 published recordings do,
all of them in rad.
"""

from __future__ import annotations

import logging

import numpy as np

from lostmotion.drivers.recording import Recording

__all__ = ["warn_of_units"]

SLOWEST = 2.0
"""Samples a second.  No motion of a robot shows at fewer (167 published recordings have 10 to 1024); 1000 a second in
milliseconds are 1."""
log = logging.getLogger(__name__)


def warn_of_units(recording: Recording) -> None:
    """Warns of a recording whose times are hardly in seconds."""
    spacing = float(np.median(np.diff(recording.time))) if recording.time.size > 1 else 0.0
    if spacing > 1 / SLOWEST:
        log.warning(
            "%s: found a sample every %.3g s, expected times in seconds; are they in ms or µs?", recording.name, spacing
        )
