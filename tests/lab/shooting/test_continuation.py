"""Segments that tile a record, grow into each other, and are left out when they are missed."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.shooting.continuation import (
    errors,
    first_level,
    fitted,
    merged,
    outliers,
    residuals,
    tiles,
)
from lostmotion.lab.shooting.initial_state import segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment
from lostmotion.model import HandWaved, Parameter, build_model

NOISE = 1e-5
MODEL = build_model("oscillator", values={"k": 2600.0, "b": 0.02, "m": Parameter(0.02, "kg", fixed=True)})
TIMES = np.arange(800) / 800.0


def ringing(name: str = "a.csv", seed: int = 0, times: np.ndarray = TIMES) -> Experiment:
    """A bar that rings down from 1 mm, with noise."""
    displacement = MODEL.simulate(None, times, MODEL.initial_state(None, q=1e-3))["displacement"]
    noise = np.random.default_rng(seed).normal(0, NOISE, times.size)
    (experiment,) = experiments(MODEL, [Recording(times, {"displacement": displacement + noise}, name=name)])
    return experiment


def segments_of(experiment: Experiment, halvings: int) -> list[Segment]:
    """Tiles that begin with the true state."""
    run = MODEL.simulate(None, experiment.time, MODEL.initial_state(None, q=1e-3))
    scale = np.array([1e-3, 0.3])
    begins = [int(np.searchsorted(experiment.time, tile.time[0])) for tile in tiles(experiment, halvings)]
    return [
        Segment(tile, {"displacement": NOISE}, scale, run.states[i])
        for tile, i in zip(tiles(experiment, halvings), begins, strict=True)
    ]


@pytest.mark.parametrize("halvings", [0, 1, 3, 5])
def test_tiles_hold_each_sample_once(halvings: int) -> None:
    """However often the record is halved, the tiles in a row are the record."""
    experiment = ringing()
    parts = tiles(experiment, halvings)
    assert len(parts) == 2**halvings
    np.testing.assert_array_equal(np.concatenate([part.time for part in parts]), experiment.time)
    values = np.concatenate([part.measured["displacement"] for part in parts])
    np.testing.assert_array_equal(values, experiment.measured["displacement"])
    assert np.ptp([part.time.size for part in parts]) <= 1


def test_merged_segments_keep_the_start_states() -> None:
    """Half as many, of two records, each beginning with the state of the shorter segment that began there."""
    first, second = ringing("a.csv"), ringing("b.csv", 1)
    short = [*segments_of(first, 3), *segments_of(second, 3)]
    short = [segment.starting(np.array([i, -i], float)) for i, segment in enumerate(short)]
    longer = merged(short, [first, second], 2)
    assert [segment.start[0] for segment in longer] == [0, 2, 4, 6, 8, 10, 12, 14]
    assert [segment.experiment.name for segment in longer] == ["a.csv"] * 4 + ["b.csv"] * 4
    (whole, other) = merged(longer, [first, second], 0)
    np.testing.assert_array_equal(whole.experiment.time, first.time)
    assert other.start[0] == 8


def test_merging_over_a_gap_in_the_output() -> None:
    """A sensor that was silent for half of the record leaves segments that still find their beginnings."""
    experiment = ringing(times=np.concatenate((TIMES[:200], TIMES[600:])))
    short = [Segment(tile, {"displacement": NOISE}, np.ones(2), np.zeros(2)) for tile in tiles(experiment, 3)]
    for halvings in (2, 1, 0):
        short = list(merged(short, [experiment], halvings))
    np.testing.assert_array_equal(short[0].experiment.time, experiment.time)


@pytest.mark.parametrize(
    ("base", "length", "halvings"), [("play", 4.0, 4), ("play", 0.2, 0), ("joint", 4.0, 2), ("servo", 6.0, 3)]
)
def test_first_segments_suit_the_base(base: str, length: float, halvings: int) -> None:
    """A quarter of a second on gears, a second on a joint that drifts; a short record is not cut."""
    times = np.arange(round(length * 800)) / 800
    experiment = Experiment("a.csv", None, times, {"position": times})
    assert first_level(base, experiment) == halvings


def test_error_of_the_true_model_is_the_noise() -> None:
    """In units of the noise one, segment by segment; a segment with a wrong start is the only one that is missed."""
    segments = segments_of(ringing(), 2)
    found = errors(MODEL, segments, 1e-4)
    np.testing.assert_allclose(found, 1.0, atol=0.2)
    segments[2] = segments[2].starting(segments[2].start + np.array([5e-4, 0]))
    np.testing.assert_array_equal(outliers(errors(MODEL, segments, 1e-4)), [False, False, True, False])


def test_missed_is_told_by_the_better_segments() -> None:
    """Three times the better third; what cannot be run is missed; below three times the noise nothing is."""
    np.testing.assert_array_equal(outliers(np.array([5.0, 6, 7, 14, 19, np.inf])), [False] * 4 + [True] * 2)
    assert not outliers(np.array([0.1, 0.2, 2.9, 0.1])).any()


def test_level_finds_the_parameters() -> None:
    """From a stiffness 1 % and a damping 30 % off, on segments whose starts are off, one of them far."""
    segments = [s.starting(s.start + s.scale * np.array([0.01, -0.01])) for s in segments_of(ringing(), 2)]
    segments[3] = segments[3].starting(segments[3].start + np.array([2e-2, 0]))
    rough = MODEL.replace({"k": 2626.0, "b": 0.026})
    level = fitted(rough, Unknowns.of(rough), segments, 1e-4)
    assert level.model.parameters["k"].value == pytest.approx(2600, rel=1e-3)
    assert level.model.parameters["b"].value == pytest.approx(0.02, rel=0.03)
    np.testing.assert_allclose(errors(level.model, level.segments, 1e-4), 1.0, atol=0.2)
    assert level.rms == pytest.approx(1.0, abs=0.1)
    assert level.horizon_s == pytest.approx(0.25, abs=0.01)


def test_missed_segment_of_gears_has_no_say() -> None:
    """It keeps its wrong start, and the play found is that of the others."""
    model = build_model("play")
    drive = HandWaved(seed=3)
    run = model.simulate(drive, TIMES)
    accel = run["accel"] + np.random.default_rng(1).normal(0, 0.2, TIMES.size)
    columns = {"command": drive.position(TIMES), "accel": accel}
    (experiment,) = experiments(model, [Recording(TIMES, columns)])
    segments = [
        segment_of(model, tile, {"accel": 0.2}).starting(run.states[np.searchsorted(TIMES, tile.time[0])])
        for tile in tiles(experiment, 2)
    ]
    wrong = segments[2].start + 40 * segments[2].scale
    segments[2] = segments[2].starting(wrong)
    d = model.parameters["d"].value
    rough = model.replace({"d": 1.01 * d})
    level = fitted(rough, Unknowns.of(rough), segments, 1e-4)
    np.testing.assert_array_equal(level.segments[2].start, wrong)
    assert level.model.parameters["d"].value == pytest.approx(d, rel=5e-3)
    np.testing.assert_array_equal(outliers(errors(level.model, level.segments, 1e-4)), [False, False, True, False])


def test_level_tells_the_error_of_its_solution() -> None:
    """rms over all samples, and 1.48 medians, which one bad segment does not change much."""
    unknowns = Unknowns.of(MODEL)
    segments = tuple(segments_of(ringing(), 3))
    bad = (*segments[:-1], segments[-1].starting(np.array([1e-3, 0.0])))
    good, spoilt = (fitted(MODEL, unknowns, s, 1e-4, iterations=0) for s in (segments, bad))
    r = np.concatenate(residuals(MODEL, segments, 1e-4))
    assert good.rms == pytest.approx(float(np.sqrt(np.mean(r**2))), rel=1e-12)
    assert good.typical == pytest.approx(good.rms, rel=0.1)
    assert spoilt.rms > 10 * good.rms
    assert spoilt.typical == pytest.approx(good.typical, rel=0.35)
