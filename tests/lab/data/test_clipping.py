"""The end of a sensor's range, seen in the readings themselves, and found although only one segment reaches it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.clipping import clipping_level
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.fitting.strategy import full_fit
from lostmotion.lab.gears.likelihood import ShortSegments
from lostmotion.lab.gears.unseen import Unseen
from lostmotion.lab.selection.forward import batches, until_accepted
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.simulated_gears import GEARS, gears


def rail(reading: FloatArray) -> float | None:
    """Where these readings [m/s²] stop."""
    time = np.arange(reading.size) / 800.0
    recording = Recording(time, {"command": np.sin(20 * time), "accel": reading}, name="rec")
    return clipping_level(experiments(build_model("play"), [recording]))


def test_readings_that_stop_are_told_from_noise_and_from_a_gap() -> None:
    """Equal to the last digit at the largest size, on either side; quantised noise has a largest reading too."""
    noise = np.random.default_rng(1).normal(0, 3.0, 3200)
    assert rail(np.clip(noise, -6.0, 6.0)) == 6.0
    assert rail(np.clip(noise, -6.0, None)) is None
    assert rail(np.where(np.abs(noise) > 5.9, np.nan, noise)) is None
    assert rail(np.round(noise / 0.005) * 0.005) is None
    assert rail(np.round(300 * np.sin(np.arange(3200) / 3)) / 100) is None  # the top of a sine in steps


@pytest.mark.slow
@pytest.mark.parametrize("largest", [24.0, np.inf])
def test_an_end_that_one_segment_reaches_is_found(largest: float) -> None:
    """It is the segment that the fit misses, so that neither the score test nor the unseen recording shows anything."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(102, 1.0, largest=largest), gears(92, 1.0), gears(96, 1.0)])
    task = Task.of(model, held[:2], noise_of(held))
    level = full_fit(model, task)
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(held[2], task, 0.5, pool)
        likelihood = ShortSegments(level, unseen)
        found = until_accepted(batches(likelihood.first, (), likelihood))
    assert found.is_accepted == np.isfinite(largest)
    if found.is_accepted:
        best = found.judged[0]
        assert best.effect == "sensor_saturation"
        assert best.fit.model.parameters["sensor_saturation.a_max"].value == pytest.approx(largest, rel=0.01)
