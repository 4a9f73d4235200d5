"""A recording as a file for Rerun's viewer: a scalar over time for each column.  Needs rerun-sdk, imported late."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.base import FloatArray
from lostmotion.drivers.formats.needed import needed
from lostmotion.drivers.recording import Recording

__all__ = ["write_rerun"]


def write_rerun(recording: Recording, joint: str, path: Path) -> int:
    """How many numbers were written.  The timeline ``time`` is UTC where the start is known.  Raises RecordingError."""
    rerun = needed("rerun", "a file of Rerun")
    start, count = recording.start, 0
    stream = rerun.RecordingStream("lostmotion", send_properties=False)
    stream.save(path)
    for column, values in recording.columns.items():
        there = ~np.isnan(values)
        if not there.any():
            continue
        index = rerun.TimeColumn("time", **_times(recording.time, there, start))
        stream.send_columns(f"{joint}/{column}", indexes=[index], columns=rerun.Scalars.columns(scalars=values[there]))
        count += int(there.sum())
    stream.flush()
    stream.disconnect()
    return count


def _times(time: FloatArray, there: NDArray[np.bool_], start: datetime | None) -> dict[str, Any]:
    """Of the timeline: UTC, or else seconds."""
    if start is None:
        return {"duration": time[there]}
    since_first = np.round((time[there] - time[0]) * 1e9).astype("timedelta64[ns]")
    return {"timestamp": np.datetime64(start.replace(tzinfo=None), "ns") + since_first}
