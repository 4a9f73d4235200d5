"""Milliseconds for seconds: asked about, and the recordings of real joints are not."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.readings import warn_of_units
from lostmotion.model.motion import FloatArray

TIME = np.arange(0.0, 4.0, 0.01)
SWING = 0.5 * np.sin(2 * np.pi * TIME)


@pytest.mark.parametrize(
    ("time", "position", "expected"),
    [
        (1e3 * TIME, SWING, "found a sample every 10 s, expected times in seconds; are they in ms or"),
        (TIME, SWING, ""),
        (TIME[:1], SWING[:1], ""),
    ],
    ids=["milliseconds", "a joint", "one row"],
)
def test_units_that_are_hardly_meant(
    time: FloatArray, position: FloatArray, expected: str, caplog: pytest.LogCaptureFixture
) -> None:
    """10 units of time from sample to sample are asked about, 10 ms are not."""
    with caplog.at_level(logging.WARNING):
        warn_of_units(Recording(time, {"position": position}, name="rec.csv"))
    assert [record.getMessage()[9:].startswith(expected) for record in caplog.records] == [True] * bool(expected)
