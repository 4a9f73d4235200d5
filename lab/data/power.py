"""Which part of a servo's recording is driven: logs of servos have a column ``torque_enabled``, 1 while the motor holds
its goal and 0 after it was let go.

A model has one law for the whole recording: a servo that is let go after two seconds has an error of a radian
afterwards.  Nothing is fitted here.
"""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.recording import Recording

__all__ = ["COLUMN", "rows_of_base"]

COLUMN = "torque_enabled"
DRIVEN = {"servo": True, "joint": False}
"""Whether the base describes a motor that holds its goal, or a part that moves freely."""
OFF = ("0", "0.0", "false", "off")
log = logging.getLogger(__name__)


def rows_of_base(recording: Recording, base: str, is_free: bool) -> NDArray[np.bool_]:
    """The rows (N,) to use: the longest part in which the motor is on (``servo``) or off (a ``joint`` without torque,
    is_free), all rows where the recording does not say or is of one kind.  A warning reports the rest."""
    every = np.ones(recording.time.size, dtype=bool)
    said = recording.extra.get(COLUMN)
    if said is None or base not in DRIVEN or (base == "joint" and not is_free):
        return every
    fits = np.array([(cell.strip().lower() in OFF) != DRIVEN[base] for cell in said], dtype=bool)
    if fits.all() or not fits.any():
        return every
    ends = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    begin, end = max(zip(ends[::2], ends[1::2], strict=True), key=lambda part: part[1] - part[0])
    log.warning(
        "%s: the motor is %s from %.3g to %.3g s (%s): the rest is left out",
        recording.name, "on" if DRIVEN[base] else "off", recording.time[begin], recording.time[end - 1], COLUMN,
    )  # fmt: skip
    return np.asarray((np.arange(fits.size) >= begin) & (np.arange(fits.size) < end))
