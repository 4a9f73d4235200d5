"""Free recordings that do not begin at the release: what is before is left out, and nothing else."""

from __future__ import annotations

import logging
import math
import re
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.inverse.release import released
from lostmotion.model.motion import FloatArray
from tests.daemon.cli_world import call
from tests.lab.inverse.test_inverse import explained

RATE_HZ, LENGTH_S, NOISE = 100.0, 12.0, 2e-3
TIMES = np.arange(0.0, LENGTH_S, 1 / RATE_HZ)


def swing(start: float, at_s: float, friction: float = 0.05) -> FloatArray:
    """The angle of a pendulum of one hertz [rad] that a hand holds at ``start`` until a time, by SciPy's LSODA."""

    def slope(_: float, y: FloatArray) -> list[float]:
        return [y[1], -39.0 * np.sin(y[0]) - 0.05 * y[1] - friction * np.tanh(y[1] / 0.02)]

    free = TIMES[at_s <= TIMES]
    angle = np.full(TIMES.size, start)
    angle[at_s <= TIMES] = solve_ivp(slope, (free[0], LENGTH_S), [start, 0.0], "LSODA", free, rtol=1e-8, atol=1e-10).y[
        0
    ]
    return np.asarray(angle)


def measured(values: FloatArray, column: str = "position") -> Experiment:
    """With the noise of a sensor."""
    noise = NOISE * np.random.default_rng(7).standard_normal(values.size)
    return Experiment("free.csv", None, TIMES, {column: values + noise})


@pytest.mark.parametrize("start", [0.3, 1.0, 2.5])
@pytest.mark.parametrize("held_s", [1.5, 2.0, 4.0])
def test_a_pendulum_that_is_held_first(start: float, held_s: float, caplog: pytest.LogCaptureFixture) -> None:
    """The release is found to a fifth of a second, also of one that is held above its pivot, and is told."""
    (found,) = released([measured(swing(start, held_s))])
    assert 0.0 <= found.time[0] - held_s < 0.2
    assert "moves freely only from" in caplog.text


def test_a_long_rest_takes_little_memory() -> None:
    """Of a log at 1 kHz that begins half a minute before the release: as many readings as a part of it, not their
    square."""
    time = np.arange(0.0, 40.0, 1e-3)
    free = np.maximum(time - 30.0, 0.0)
    angle = np.exp(-free / 8) * np.cos(6 * free)
    noise = NOISE * np.random.default_rng(7).standard_normal(time.size)
    tracemalloc.start()
    (found,) = released([Experiment("free.csv", None, time, {"position": angle + noise})])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.0 <= found.time[0] - 30.0 < 0.2
    assert most < 100 * angle.nbytes


def test_a_pendulum_that_is_logged_at_each_count_of_its_encoder(caplog: pytest.LogCaptureFixture) -> None:
    """Where it turns there are no rows for a while, and the angle seems to rest; that no law explains the motion, as
    the encoder turns less on one side, does not mean that something acts on it again."""
    times, count = np.arange(0.0, 34.0, 2e-4), 2.6e-3
    moved = solve_ivp(
        lambda _, y: [y[1], -65.0 * math.sin(y[0]) - 0.066 * y[1] - 0.125 * math.tanh(y[1] / 0.02)], (0.0, 34.0),
        [0.67, 0.0], "LSODA", times, rtol=1e-8, atol=1e-10,
    )  # fmt: skip
    counts = np.round(np.where(moved.y[0] > 0, 1.0, 0.73) * moved.y[0] / count)
    rows = np.flatnonzero(np.diff(counts, prepend=counts[0] - 1))
    logged = {"position": np.append(counts[rows], counts[-1]) * count}
    (found,) = released([Experiment("logged.csv", None, np.append(times[rows], 65.0), logged)])
    assert found.time[-1] > 33.9
    assert "left out" not in caplog.text


@pytest.mark.parametrize("start", [0.3, 1.0, 2.5])
@pytest.mark.parametrize("friction", [0.0, 0.05, 0.5])
def test_a_pendulum_that_is_free_from_its_first_sample(
    start: float, friction: float, caplog: pytest.LogCaptureFixture
) -> None:
    """Nothing is left out, whatever damps it."""
    with caplog.at_level(logging.WARNING):
        (found,) = released([measured(swing(start, 0.0, friction))])
    assert found.time[0] == 0.0
    assert not caplog.text


@pytest.mark.parametrize("held_s", [0.0, 0.04, 0.06])
def test_an_arm_that_is_held_for_a_moment_and_hardly_swings(held_s: float) -> None:
    """Too short for an acceleration, and followed by too little motion to compare one with: the readings show it."""

    def slope(t: float, x: FloatArray) -> list[float]:
        return [x[1], -90.0 * (math.sin(x[0]) + 0.1 * math.tanh(100 * x[1])) - 8.4 * x[1]]

    time = np.arange(0.0, 3.3, 0.0075)
    free = time[time >= held_s] - held_s
    fall = solve_ivp(slope, (0.0, 3.3), [1.02, 0.0], "LSODA", free, rtol=1e-8, atol=1e-10).y[0]
    angle = np.round(np.concatenate([np.full(time.size - free.size, 1.02), fall]) / 6e-4) * 6e-4
    (found,) = released([Experiment("arm.csv", None, time, {"position": angle})])
    assert 0.0 <= found.time[0] - held_s < (0.03 if held_s else 1e-9)


def test_a_pendulum_that_falls_from_the_upright(caplog: pytest.LogCaptureFixture) -> None:
    """Its rest is left out, although it is free there, too: a thousandth of a degree decides which swing follows."""
    (found,) = released([measured(swing(np.pi - 1e-3, 1.5, friction=0.01))])
    assert found.time[0] - 1.5 > 0.5
    assert abs(found.measured["position"][0]) > 2.5
    assert "moves freely only from" in caplog.text


def test_a_swing_without_damping_is_free_throughout() -> None:
    """Its largest speed is anywhere, by noise: a law of what little comes after it says nothing of what was before."""
    for seed in range(8):
        noise = 1e-3 * np.random.default_rng(seed).standard_normal(TIMES.size)
        experiment = Experiment("free.csv", None, TIMES, {"position": 0.1 * np.cos(6 * TIMES) + noise})
        assert released([experiment.between(0.0, 4.0)])[0].time[0] == 0.0


def test_a_second_mode_is_no_blow() -> None:
    """A bar that is struck at the first sample, with a second mode that dies down in a tenth of its ring."""
    ring = np.exp(-0.3 * TIMES) * np.cos(2 * np.pi * 2.0 * TIMES) + 0.8 * np.exp(-6 * TIMES) * np.cos(
        2 * np.pi * 9 * TIMES
    )
    assert released([measured(ring, "displacement")])[0].time[0] == 0.0


def test_a_pendulum_that_is_lifted_by_a_hand(caplog: pytest.LogCaptureFixture) -> None:
    """A hand lifts it in two seconds and holds it for two more.  Of three recordings this is said in one line."""
    angle = swing(0.6, 4.0)
    lifted = TIMES < 2.0
    angle[lifted] = 0.3 * (1 - np.cos(np.pi * TIMES[lifted] / 2))
    later = measured(swing(0.6, 5.0))
    found = released([measured(angle), later, later])
    assert 4.0 <= found[0].time[0] < 4.25
    assert 5.0 <= found[1].time[0] < 5.25
    (line,) = caplog.messages
    assert re.search(r"and 2 more: moves freely only from 4\.\d+ \(5\S* to 5\S*\) s on; what is before is left", line)


SPRING, FRICTION = 20.0, 2.2
"""of a disk on springs, for its inertia [1/s², rad/s²]"""


def disk(deflected: float, hand_s: float, zero: float = 0.0) -> Recording:
    """The angle of a disk on springs with dry friction, in steps of a degree, at 20 Hz.  After 0.3 s a hand takes it
    from rest to a deflection [rad] within hand_s, and lets it go.  zero: the sensor's reading at rest [rad]."""
    times, start = np.arange(0.0, 9.0, 0.05), 0.3

    def slope(_: float, y: FloatArray) -> list[float]:
        return [y[1], -SPRING * y[0] - FRICTION * np.tanh(y[1] / 1e-3)]

    free = np.maximum(times - start - hand_s, 0.0)
    swung = solve_ivp(slope, (0.0, 9.0), [deflected, 0.0], "LSODA", np.unique(free), rtol=1e-8, atol=1e-10).y[0]
    lifted = deflected * (1 - np.cos(np.pi * np.clip(times - start, 0.0, hand_s) / hand_s)) / 2
    angle = np.where(free > 0, np.interp(free, np.unique(free), swung), lifted) + zero
    return Recording(times, {"position": np.round(angle / 0.0175) * 0.0175}, name=f"disk_{zero}.csv")


@pytest.mark.slow
def test_a_disk_on_a_spring_that_a_hand_deflects_within_half_a_period(tmp_path: Path) -> None:
    """A hand takes it from rest to its largest deflection as fast as it swings.  Its dry friction is found to 2 %; with
    the hand's half period in the fit nothing was named, or viscous friction."""
    found = explained(tmp_path, 'base = "joint"\neffects = ["spring_torque"]\n', [disk(3.0, 0.7)])
    assert found["missing"] == ["coulomb_friction"]
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(FRICTION * 2e-4, rel=0.02)


def test_a_mass_on_a_spring_that_a_hand_still_pushes(tmp_path: Path) -> None:
    """It gains energy within less than a period, as no second mode makes it: with that part in the fit nothing was
    named."""
    whole = disk(3.0, 1.0)
    pushed = whole.time > 0.4
    one = Recording(whole.time[pushed], {"displacement": whole.columns["position"][pushed]}, name="pushed.csv")
    assert explained(tmp_path, 'base = "oscillator"\n', [one])["missing"] == ["coulomb_friction"]


@pytest.mark.slow
def test_recordings_whose_sensors_have_different_zeros(tmp_path: Path) -> None:
    """The error is that of the steps of the sensor, not that of the zeros."""
    disks = [disk(3.0, 0.7, 0.4), disk(-2.6, 0.6, -0.3), disk(2.8, 0.8)]
    found = explained(tmp_path, 'base = "joint"\neffects = ["spring_torque"]\n', disks)
    assert found["missing"] == ["coulomb_friction"]
    assert found["error"]["after"] < 0.03
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(FRICTION * 2e-4, rel=0.02)


@pytest.mark.parametrize("column", ["displacement", "accel"])
@pytest.mark.parametrize("struck_s", [0.0, 3.0])
def test_a_mass_on_a_spring_that_is_struck(column: str, struck_s: float) -> None:
    """It rests, is struck at an unknown time, and rings down; by its displacement or by an accelerometer."""
    late = np.maximum(TIMES - struck_s, 0.0)
    ring = np.exp(-0.3 * late) * np.sin(2 * np.pi * 3.0 * late)
    found = released([measured(ring, column)])[0].time[0]
    assert struck_s <= found < struck_s + 0.2
    assert found == 0.0 or struck_s


@pytest.mark.parametrize(("gained", "is_refused"), [(30.0, True), (0.0, True), (-20.0, False)])
def test_a_shaft_that_does_not_slow_down_is_driven(gained: float, is_refused: bool) -> None:
    """A motor that runs up, or keeps its speed for a hundred turns, is not free, whatever it is called."""
    speed = 40 + gained * (1 - np.exp(-TIMES / 2))
    shaft = measured(np.cumsum(speed) / RATE_HZ)
    if not is_refused:
        assert released([shaft])[0].time[-1] == TIMES[-1]
        return
    with pytest.raises(
        ExperimentError, match=r"found [\d.]+ turns that do not slow down, and nothing that drives them"
    ):
        released([shaft])


@pytest.mark.parametrize(("turns", "is_refused"), [(1.6, True), (0.9, False)])
def test_a_motor_that_runs_up_over_a_turn_and_a_half_is_driven(turns: float, is_refused: bool) -> None:
    """That is too little for a shaft that coasts, and too much for a weight or a spring; by less than a turn a part may
    fall."""
    late = np.maximum(TIMES - 1.0, 0.0)
    ran = late - 3.0 * (1 - np.exp(-late / 3.0))
    motor = measured(2 * np.pi * turns * ran / ran[-1])
    if not is_refused:
        assert released([motor])
        return
    with pytest.raises(ExperimentError, match=r"found 1\.6 turns that do not slow down, and nothing that drives them"):
        released([motor])


def test_a_step_of_a_controller_is_no_free_motion() -> None:
    """Eight readings between two rests, as of a trace of a controller."""
    angle = np.where(TIMES < 2.0, 25.0, 50.0)
    ramp = (TIMES >= 2.0) & (TIMES < 2.0 + 6 / RATE_HZ)
    angle[ramp] = np.linspace(25.0, 50.0, int(ramp.sum()))
    with pytest.raises(ExperimentError, match=r"found a motion of \d samples and rests before and after it"):
        released([measured(angle)])


def test_a_motor_that_is_switched_off_is_no_free_motion() -> None:
    """Its speed, taken for an angle, is noise about a level until it falls within three readings, and rests then."""
    level = np.where(np.abs(TIMES % 4.0 - 2.0) < 1.0, 13.0, 0.0)
    noise = np.where(level > 0, np.random.default_rng(8).normal(0.0, 0.2, TIMES.size), 0.0)
    with pytest.raises(ExperimentError, match=r"rests \d samples after its largest speed"):
        released([measured(level + noise)])


@pytest.mark.slow
def test_an_arm_that_is_dropped_and_hangs_still(tmp_path: Path) -> None:
    """Of six seconds it moves for one, after a hand held it: both frictions are found, right to 3 %.  The noise of the
    rest narrowed the band to 4 Hz, and the weight was off by 20 % and 80 degrees."""
    times, drops = np.arange(0.0, 6.0, 0.01), []
    for held_s, start in ((0.0, 1.4), (1.0, -1.1), (0.6, 0.8)):

        def slope(_: float, y: FloatArray) -> list[float]:
            return [y[1], -30.0 * np.sin(y[0]) - 2.0 * y[1] - np.tanh(y[1] / 1e-3)]

        free = times[times >= held_s] - held_s
        fall = solve_ivp(slope, (0.0, 6.0), [start, 0.0], "LSODA", free, rtol=1e-8, atol=1e-10).y[0]
        angle = np.concatenate([np.full(times.size - free.size, start), fall])
        drops.append(Recording(times, {"position": np.round(angle / 0.0015) * 0.0015}, name=f"held_{held_s}.csv"))
    found = explained(tmp_path, 'base = "joint"\neffects = ["gravity_torque"]\n', drops)
    assert set(found["missing"]) == {"viscous_friction", "coulomb_friction"}
    values = {name: value[0] for name, value in found["parameters"].items()}
    assert values["gravity_torque.tau_g"] == pytest.approx(30.0 * 2e-4, rel=0.03)
    assert values["viscous_friction.b_v"] == pytest.approx(2.0 * 2e-4, rel=0.03)
    assert values["coulomb_friction.tau_c"] == pytest.approx(1.0 * 2e-4, rel=0.03)


@pytest.mark.parametrize("frequencies", [(0.7, 1.1), (0.5, 1.7)])
def test_what_gains_energy_is_driven(frequencies: tuple[float, float], tmp_path: Path) -> None:
    """A joint that follows two sines passes places again faster, and a pendulum that swings freely never does."""
    time = np.arange(2000) / 100
    follows = 0.5 * sum(np.sin(2 * np.pi * f * time) for f in frequencies)
    swings = np.exp(-0.05 * time) * np.sin(5 * time) + np.random.default_rng(1).normal(0, 2e-3, time.size)
    for name, angle, code in (("follows", follows, 2), ("swings", swings, 0)):
        np.savetxt(tmp_path / name, np.stack([time, angle], axis=1), "%.6f", ",", header="time,position", comments="")
        result = call("lab", "compare", "joint", tmp_path / name)
        assert result.exit_code == code, result.output
        assert ("gains energy, as no free one does" in result.output) == (code == 2)


@pytest.mark.parametrize("decay", [0.01, 0.0])
def test_a_swing_that_trades_energy_with_another_one(decay: float, tmp_path: Path) -> None:
    """A pendulum whose support yields passes a place faster than before, for a while, and dies away all the same; one
    that does not die away is driven."""
    time = np.arange(3000) / 50
    angle = np.exp(-decay * time) * (np.sin(4.2 * time) + 0.14 * np.exp(-0.5 * decay * time) * np.sin(5.0 * time))
    path = tmp_path / "film.csv"
    noisy = 0.2 * angle + np.random.default_rng(2).normal(0, 1e-3, time.size)
    np.savetxt(path, np.stack([time, noisy], axis=1), "%.6f", ",", header="time,position", comments="")
    result = call("lab", "compare", "joint", path)
    assert (result.exit_code == 2) == (decay == 0), result.output
    assert ("gains energy, as no free one does" in result.output) == (decay == 0)


@pytest.mark.parametrize("motion", ["triangle", "sine", "swing", "short"])
def test_what_loses_no_energy_may_be_driven(motion: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A piston that is pushed to and fro at one speed gains no energy, but loses none either; a pendulum with a quality
    of 200 does in ten periods; in three nothing is said."""
    time = np.arange(1000) / 100
    phase = 2 * np.pi * time
    angle = {
        "triangle": np.arcsin(np.sin(phase)), "sine": np.sin(phase),
        "swing": np.exp(-phase / 400) * np.sin(phase), "short": np.sin(0.3 * phase),
    }[motion]  # fmt: skip
    noisy = 0.3 * angle + np.random.default_rng(1).normal(0, 1e-3, time.size)
    path = tmp_path / "motion.csv"
    np.savetxt(path, np.stack([time, noisy], axis=1), "%.6f", ",", header="time,position", comments="")
    result = call("lab", "compare", "joint", path)
    assert result.exit_code == 0, result.output
    assert ("loses no energy, as a motion that is driven" in caplog.text) == (motion in ("triangle", "sine"))


@pytest.mark.parametrize("motion", ["triangle", "swing"])
def test_what_loses_no_energy_beside_series_without_a_name_is_refused(motion: str, tmp_path: Path) -> None:
    """A cylinder under test is pushed to and fro at one speed, beside its pressure and its force, in a table without
    a header: it had the weight of an arm and a ripple."""
    time = np.arange(1000) / 100
    phase = 2 * np.pi * time
    angle = 0.3 * (np.exp(-phase / 100) * np.sin(phase) if motion == "swing" else np.arcsin(np.sin(phase)))
    rng = np.random.default_rng(1)
    columns = np.stack([time, angle, np.gradient(angle, time), rng.normal(0, 0.1, time.size)], axis=1)
    path = tmp_path / "cylinder.csv"
    np.savetxt(path, columns + 1e-3 * rng.normal(size=(time.size, 1)) * [0, 1, 0, 0], "%.6f", ",")
    result = call("lab", "compare", "joint", path)
    assert (result.exit_code == 2) == (motion == "triangle"), result.output
    if motion == "triangle":
        assert "loses no energy, as one that is driven, and what may drive it is not used: column4" in result.output


@pytest.mark.parametrize("motion", ["sine", "swing"])
def test_what_loses_no_energy_beside_a_command_that_is_not_used_is_refused(motion: str, tmp_path: Path) -> None:
    """A motor under a sine, whose measured torque is zero throughout, had the weight of an arm.  The refusal says how
    to use the command, and how to leave it; a pendulum that dies away beside it needs neither."""
    time = np.arange(1000) / 100
    phase = 2 * np.pi * time
    angle = 0.3 * np.sin(phase) * (np.exp(-phase / 100) if motion == "swing" else 1.0)
    angle += np.random.default_rng(1).normal(0, 1e-3, time.size)
    path = tmp_path / "motor.csv"
    columns = np.stack([time, angle, np.zeros(time.size), np.cos(phase)], axis=1)
    np.savetxt(path, columns, "%.6f", ",", header="t,angle,torque,commanded_torque", comments="")
    result = call("lab", "compare", "joint", path)
    assert (result.exit_code == 2) == (motion == "sine"), result.output
    if motion == "sine":
        assert "use --map torque=commanded_torque; if it moves freely all the same, use --map torque=" in result.output
        for terms in ("torque=commanded_torque", "torque="):
            assert call("lab", "compare", "joint", path, "--map", terms).exit_code == 0
