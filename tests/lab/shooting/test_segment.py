"""The residual of one segment and its derivatives, against central differences with steps a hundred times larger."""

from __future__ import annotations

import numpy as np
import pytest
from bench.hidden_effects.motion import hand_waved
from bench.hidden_effects.physics import follow, simulate

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.shooting.initial_state import segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import STEP, Segment, in_motion, motions, state_scales
from lostmotion.model import Model, ModelError, build_model
from lostmotion.model.motion import FloatArray

VALUES = {"d": 8e-5, "alpha": 4000.0, "b": 0.18, "k": 2600.0}
NOISE = {"accel": 0.2}
SUBSTEP = 2e-5
TIMES = np.arange(161) / 800


def gears(effects: tuple[str, ...] = ()) -> Model:
    """The base play with some effects, each small."""
    return build_model("play", effects, VALUES)


def measured(accel: FloatArray | None = None) -> Experiment:
    """A fifth of a second of gears, from the bench's own simulator, without noise; or other readings."""
    command = hand_waved(np.random.default_rng(4), 1.0)
    if accel is None:
        accel = simulate(VALUES, command, TIMES, follow(VALUES, command, 0.0))[0]
    (experiment,) = experiments(gears(), [Recording(TIMES, {"command": command.at(TIMES), "accel": accel})])
    return experiment


def test_true_model_leaves_little() -> None:
    """Two simulators written apart agree within a tenth of the noise."""
    segment = segment_of(gears(), measured(), NOISE)
    assert np.max(np.abs(segment.residual(gears(), segment.start, SUBSTEP))) < 0.1


@pytest.mark.parametrize("effects", [(), ("coulomb_friction", "sensor_lag"), ("hardening_spring", "gravity_leakage")])
def test_derivatives(effects: tuple[str, ...]) -> None:
    """By every parameter and every state, within 1 % of their size: the small step does not drown in rounding."""
    model = gears(effects)
    segment = segment_of(model, measured(), NOISE)
    unknowns = Unknowns.of(model)
    z, step = unknowns.z(model), 100 * STEP
    found = segment.linearised(model, unknowns, z, SUBSTEP)
    np.testing.assert_allclose(found.r, segment.residual(model, segment.start, SUBSTEP), atol=1e-9)

    def at(dz: FloatArray, ds: FloatArray) -> FloatArray:
        return segment.residual(unknowns.put(model, z + dz), segment.start + segment.scale * ds, SUBSTEP)

    P, n = z.size, segment.start.size
    for i, slope in enumerate(found.A.T):
        dz = step * np.eye(P)[i]
        central = (at(dz, np.zeros(n)) - at(-dz, np.zeros(n))) / (2 * step)
        assert np.linalg.norm(slope - central) < 0.01 * np.linalg.norm(central) + 1e-3, unknowns.names[i]
    for i, slope in enumerate(found.B.T):
        ds = step * np.eye(n)[i]
        central = (at(np.zeros(P), ds) - at(np.zeros(P), -ds)) / (2 * step)
        assert np.linalg.norm(slope - central) < 0.01 * np.linalg.norm(central) + 1e-3, model.state_names[i]


def test_derivative_at_an_upper_bound() -> None:
    """A parameter at its bound is moved inwards, not held: its slope is that of the other side."""
    model = gears()
    segment = segment_of(model, measured(), NOISE)
    d = model.parameters["d"]
    at_bound = model.replace({"d": type(d)(d.value, d.unit, d.low, d.value)})
    i = Unknowns.of(model).names.index("d")
    inside, edge = (
        segment.linearised(m, Unknowns.of(m), Unknowns.of(m).z(m), SUBSTEP).A[:, i] for m in (model, at_bound)
    )
    assert np.linalg.norm(edge - inside) < 0.01 * np.linalg.norm(inside)


def test_empty_cells_are_left_out() -> None:
    """Residual and derivatives of a signal with gaps are those of the whole signal without these rows."""
    readings = measured().measured["accel"] + 0.3
    seen = np.arange(TIMES.size) % 3 != 1
    full = segment_of(gears(), measured(readings), NOISE)
    holed = Experiment("holed", full.experiment.drive, TIMES, {"accel": np.where(seen, readings, np.nan)})
    unknowns = Unknowns.of(gears())
    z = unknowns.z(gears())
    every, some = (
        s.linearised(gears(), unknowns, z, SUBSTEP) for s in (full, Segment(holed, NOISE, full.scale, full.start))
    )
    assert some.r.size == np.sum(seen)
    np.testing.assert_allclose(some.r, every.r[seen], atol=1e-9)
    np.testing.assert_allclose(some.A, every.A[seen], atol=1e-6)
    np.testing.assert_allclose(some.B, every.B[seen], atol=1e-6)


def test_two_columns_count_in_their_own_noise() -> None:
    """Residuals stand one column after the other, each over its noise."""
    plain = measured()
    both = Experiment(
        "two", plain.drive, plain.time,
        {"accel": plain.measured["accel"] + 0.4, "position": np.where(TIMES < 0.1, np.nan, 0.5)},
    )  # fmt: skip
    noise = {"accel": 0.2, "position": 0.01}
    segment = Segment(both, noise, state_scales(gears(), both), segment_of(gears(), plain, NOISE).start)
    r = segment.residual(gears(), segment.start, SUBSTEP)
    run = segment.simulate(gears(), segment.start, SUBSTEP)
    assert r.size == TIMES.size + np.sum(TIMES >= 0.1)
    np.testing.assert_allclose(r[: TIMES.size], 2.0, atol=0.1)
    np.testing.assert_allclose(r[TIMES.size :], (0.5 - run["position"][TIMES >= 0.1]) / 0.01, rtol=1e-6)


def test_many_start_states_at_once() -> None:
    """Each row is the residual of its own state; one that cannot be run is infinite, and spoils no other."""
    segment = segment_of(gears(), measured(), NOISE)
    starts = segment.start + np.array([[0.0], [1.0], [-1.0]]) * segment.scale
    starts[1] = np.nan
    rows = segment.residuals(gears(), starts, SUBSTEP)
    assert np.all(np.isinf(rows[1]))
    for i in (0, 2):
        np.testing.assert_allclose(rows[i], segment.residual(gears(), starts[i], SUBSTEP), rtol=1e-12)


def test_recording_states_its_own_values() -> None:
    """What a recording says of a fixed parameter counts in its derivatives too: twice the force, twice the slope."""
    model = build_model("servo")
    command = hand_waved(np.random.default_rng(4), 1.0).at(TIMES)
    columns = {"command": command, "position": command}
    unknowns = Unknowns.of(model)
    slopes = []
    for kp in (model.parameters["kp"].value, 1.5 * model.parameters["kp"].value):
        (experiment,) = experiments(model, [Recording(TIMES, columns, {"kp": kp})])
        segment = segment_of(model, experiment, {"position": 1e-3})
        own = model.replace({"kp": kp})
        found = segment.linearised(model, unknowns, unknowns.z(model), SUBSTEP)
        np.testing.assert_allclose(found.r, segment.residual(own, segment.start, SUBSTEP), atol=1e-9)
        slopes.append(np.linalg.norm(found.A))
    assert slopes[0] != pytest.approx(slopes[1], rel=0.05)


def test_a_segment_that_cannot_be_run_is_left_out() -> None:
    """A start deep in the teeth flies off; the others' motions are there all the same, and none at all is an error."""
    model = gears()
    good = segment_of(model, measured(), NOISE)
    lost = good.starting(good.start + np.eye(4)[0])
    assert len(motions(model, [good, lost, good], SUBSTEP)) == 2
    with pytest.raises(ModelError, match="exceeds all numbers"):
        motions(model, [lost], SUBSTEP)


@pytest.mark.parametrize("late", [0.0, 0.003])
def test_a_lag_begins_as_having_followed_for_long(late: float) -> None:
    """In the midst of a motion it stands where a run from long before has brought it, within 3 % of how far it is
    behind its command, which may be delayed as well."""
    effects = ("actuator_lag", *(("command_delay",) if late else ()))
    values = {"actuator_lag.T": 4e-3, **({"command_delay.T": late} if late else {})}
    model, drive = build_model("play", effects, {**VALUES, **values}), measured().drive
    assert drive is not None
    place = model.state_names.index("actuator_lag.0")
    times = np.array([0.01, 0.04, 0.08, 0.11, 0.16])
    long = model.simulate(drive, np.concatenate(([-0.2], times))).states[1:, place]
    behind = long - drive.position(times - late)
    found = np.array([in_motion(model, drive, float(time))[place] for time in times])
    assert np.max(np.abs(behind)) > 1e-3
    np.testing.assert_allclose(found, long, atol=0.03 * np.max(np.abs(behind)))
    given = in_motion(model, drive, 0.1, **{"actuator_lag.0": 0.5})
    assert given[place] == 0.5
