"""Where a fit begins: start states of simulated recordings found, the bar's frequency read from the spectrum."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.shooting.initial_state import (
    _measured_state,
    find_start,
    ringing_hz,
    segment_of,
    with_best_starts,
)
from lostmotion.lab.shooting.segment import Segment
from lostmotion.model import Model, build_model
from lostmotion.model.motion import FloatArray
from tests.lab.simulated_gears import GEARS, NOISE, moved

SUBSTEP = 4e-5
LENGTH = 0.25


def begun_in_motion(seed: int, hidden: dict[str, float] | None = None) -> tuple[Experiment, FloatArray]:
    """A quarter of a second of gears that were in motion before, and the state (4,) in which it began."""
    run = moved(seed, LENGTH, **(hidden or {}))
    (experiment,) = experiments(build_model("play"), [run.recording(run.accel + NOISE * run.noise)])
    return experiment, run.states[0, :4]


def rms(model: Model, segment: Segment) -> float:
    """Error in units of the noise."""
    return float(np.sqrt(np.mean(segment.residual(model, segment.start, SUBSTEP) ** 2)))


@pytest.mark.parametrize("seed", range(4))
def test_start_on_gears(seed: int) -> None:
    """Position in the gap within a tenth of the play, the bar's deflection within a few times the noise; what is left
    is the noise."""
    experiment, true = begun_in_motion(seed)
    model = build_model("play", values=GEARS)
    found = find_start(model, segment_of(model, experiment, {"accel": NOISE}), SUBSTEP)
    assert rms(model, found) == pytest.approx(1.0, abs=0.2)
    gap = GEARS["d"] / model.parameters["R2"].value
    assert abs(found.start[0] - true[0]) < 0.1 * gap
    w2 = GEARS["k"] / model.parameters["m"].value
    assert abs(found.start[2] - true[2]) < 3 * NOISE / w2


def test_derivatives_are_corrected_by_secants(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight steps from a state a hundredth of its scale off reach the noise with 17 simulations: two sets of
    derivatives, not eight."""
    experiment, true = begun_in_motion(1)
    model = build_model("play", values=GEARS)
    segment, simulated = segment_of(model, experiment, {"accel": NOISE}), 0
    whole = Segment.residuals_of

    def counted(self: Segment, outputs: Sequence[FloatArray | None]) -> FloatArray:
        nonlocal simulated
        simulated += len(outputs)
        return whole(self, outputs)

    monkeypatch.setattr(Segment, "residuals_of", counted)
    (found,) = with_best_starts(model, [segment], [(true + 0.01 * segment.scale)[None]], SUBSTEP, 6)
    assert simulated == 1 + 8 + 2 * 4
    assert rms(model, found) == pytest.approx(1.0, abs=0.1)


def test_segments_side_by_side_begin_as_each_does_alone() -> None:
    """Of two recordings, each with guesses of its own; one of the segments cannot be simulated from its guess."""
    model, segments, states = build_model("play", values=GEARS), [], []
    for seed, guesses in ((1, 1), (2, 3)):
        experiment, true = begun_in_motion(seed)
        segment = segment_of(model, experiment, {"accel": NOISE})
        segments += [segment, segment]
        states += [true + 0.01 * k * np.outer(np.arange(1, guesses + 1), segment.scale) for k in (1, 2)]
    states[1] = np.full((1, 4), 1e30)
    found = with_best_starts(model, segments, states, SUBSTEP, 3)
    for segment, guess, together in zip(segments, states, found, strict=True):
        (alone,) = with_best_starts(model, [segment], [guess], SUBSTEP, 3)
        assert np.abs((together.start - alone.start) / segment.scale).max() < 1e-6


def test_start_is_better_than_following_the_command() -> None:
    """The state that moves along with the command is far off, and is where the search would begin without a scan."""
    experiment, _ = begun_in_motion(1)
    model = build_model("play", values=GEARS)
    plain = segment_of(model, experiment, {"accel": NOISE})
    assert rms(model, plain) > 5 * rms(model, find_start(model, plain, SUBSTEP))


def test_effects_states_follow_the_base() -> None:
    """A sensor's lag brings a state of its own, which needs no scan."""
    hidden = {"sensor_lag.T": 1e-3}
    experiment, _ = begun_in_motion(2, hidden)
    model = build_model("play", ["sensor_lag"], {**GEARS, **hidden})
    found = find_start(model, segment_of(model, experiment, {"accel": NOISE}), SUBSTEP)
    assert found.start.size == 5
    assert rms(model, found) == pytest.approx(1.0, abs=0.25)


@pytest.mark.filterwarnings("error")
def test_a_segment_of_one_sample_has_no_speed() -> None:
    """No line leads through one sample: times in ms, taken for s, are as far apart as segments are long."""
    time = np.arange(0.0, 4.0, 0.01)
    model = build_model("joint")
    (experiment,) = experiments(model, [Recording(time, {"position": np.cos(time)}, name="swing.csv")])
    one = {"position": np.where(time == 1.0, experiment.measured["position"], np.nan)}
    segment = segment_of(model, replace(experiment, measured=one), {"position": 1e-3})
    assert _measured_state(model, segment).tolist() == pytest.approx([math.cos(1.0), 0.0])


def test_known_state_is_tried_too() -> None:
    """A state from elsewhere that fits better than all of the scan is taken."""
    experiment, true = begun_in_motion(3)
    model = build_model("play", values=GEARS)
    segment = segment_of(model, experiment, {"accel": NOISE})
    without = find_start(model, segment, SUBSTEP)
    assert rms(model, find_start(model, segment, SUBSTEP, [true])) <= 1.02 * rms(model, without)


@pytest.mark.parametrize(
    ("base", "column", "noise", "begun"),
    [
        ("oscillator", "displacement", 1e-5, {"q": 7e-4, "q'": -0.1}),
        ("joint", "position", 1e-3, {"theta_2": 0.4, "omega_2": -0.7}),
        ("servo", "position", 1e-3, {"theta_2": 0.4, "omega_2": 0.2}),
    ],
)
def test_start_on_other_bases(base: str, column: str, noise: float, begun: dict[str, float]) -> None:
    """From the first measured samples, polished: the true state within a few times what the noise allows."""
    model = build_model(base)
    times = np.arange(400) / 800
    drive = None
    columns: dict[str, FloatArray] = {}
    if base == "servo":
        columns["command"] = 0.3 * np.sin(5 * times)
        (still,) = experiments(model, [Recording(times, {**columns, "position": times})])
        drive = still.drive
    true = model.initial_state(drive, 0.0, **begun)
    clean = model.simulate(drive, times, true)[column]
    columns[column] = clean + np.random.default_rng(5).normal(0, noise, times.size)
    (experiment,) = experiments(model, [Recording(times, columns)])
    segment = segment_of(model, experiment, {column: noise})
    found = find_start(model, segment, 1e-4)
    r = found.residual(model, found.start, 1e-4)
    assert np.sqrt(np.mean(r**2)) == pytest.approx(1.0, abs=0.12)
    np.testing.assert_allclose(found.start[0], true[0], atol=noise)
    np.testing.assert_allclose(found.start, true, atol=0.05 * float(np.max(segment.scale)))


@pytest.mark.parametrize("f_res", [52.0, 57.3, 75.0])
@pytest.mark.parametrize("empty", [1, 3])
def test_frequency_from_the_spectrum(f_res: float, empty: int) -> None:
    """Within 4 %, a line's width, for a bar that gears excite, also where two of three cells are empty."""
    k = 0.02 * (2 * math.pi * f_res) ** 2
    run = moved(7, 3.0, k=k)
    reading = run.accel + NOISE * run.noise
    reading[np.arange(reading.size) % empty != 0] = np.nan
    (experiment,) = experiments(build_model("play"), [run.recording(reading)])
    assert ringing_hz(experiment, 0.88 * f_res * 1.04, 1.12 * f_res * 1.04) == pytest.approx(f_res, rel=0.04)


def test_frequency_without_a_line_is_the_middle() -> None:
    """Between frequencies that the recording is too slow for, their geometric mean is told."""
    times = np.arange(800) / 800
    experiment = Experiment("slow", None, times, {"accel": np.sin(2 * math.pi * 50 * times)})
    assert ringing_hz(experiment, 500.0, 720.0) == pytest.approx(600.0)
