"""The delay between torque and motion, on joints whose motion another simulator made (SciPy's LSODA)."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bench.driven_motions import Case
from scipy.integrate import solve_ivp

from lostmotion.lab import experiments, explain, open_executor
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.inverse import channel
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.explain import fitted
from lostmotion.lab.inverse.likelihood import Method
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.results import Explanation
from lostmotion.model import Sampled, build_model
from lostmotion.model.motion import FloatArray

J, B = 0.02, 0.15
"""kg m², N m s/rad"""


TIMES = np.arange(0.0, 10.0, 5e-3)


def torque(seed: int, time: FloatArray) -> FloatArray:
    """A chirp of 0.3 to 6 Hz [N m]."""
    sweep = (6.0 - 0.3) / (2 * TIMES[-1])
    return np.asarray(0.8 * np.sin(2 * np.pi * (0.3 + sweep * time) * time + seed))


@cache
def angle(seed: int) -> FloatArray:
    """How a joint with viscous friction follows it [rad]."""
    law = lambda t, y: (y[1], (torque(seed, t) - B * y[1]) / J)  # noqa: E731
    solved = solve_ivp(law, (0, TIMES[-1]), (0.0, 0.0), "LSODA", TIMES, rtol=1e-9, atol=1e-11)
    return np.asarray(solved.y[0])


def chirp(seed: int, late_s: float) -> Experiment:
    """Such a joint; its torque is recorded ``late_s`` after it acts."""
    rng = np.random.default_rng(seed)
    read = torque(seed, np.maximum(TIMES - late_s, 0.0)) + 5e-3 * rng.standard_normal(TIMES.size)
    position = angle(seed) + 2e-5 * rng.standard_normal(TIMES.size)
    return Experiment(f"chirp{seed}.csv", Sampled(TIMES, read), TIMES, {"position": position})


def found(late_s: float) -> dict[str, float]:
    """Inertia and friction as they are fitted to three such recordings."""
    recorded = [chirp(seed, late_s) for seed in range(3)]
    model = build_model("joint", ["viscous_friction"])
    estimates = fitted(model, recorded, Method.TORQUE, {"torque": 5e-3, "position": 2e-5}).estimates
    return {one.name: one.value for one in estimates}


def switched(seed: int, volts: float, late_s: float) -> Experiment:
    """A motor without gears to which a voltage is switched from rest and, after half the time, another one: its back
    EMF and its dry friction act against it, and the driver acts ``late_s`` after its command."""
    inertia, emf, dry, rate_hz = 1e-3, 0.0335, 0.345, 500.0
    time = np.arange(0.0, 1.6, 1 / rate_hz)
    voltage = volts * np.where(time < 0.2, 0.0, np.where(time < 0.9, 1.0, 0.6))
    speed, since = np.zeros(time.size), time - 0.2 - late_s
    lag, friction = inertia / emf, np.sign(volts) * dry
    for begin, value in ((0.0, volts), (0.7, 0.6 * volts)):
        on = since >= begin
        first = speed[on][0]
        end = (value - friction) / emf
        speed[on] = end + (first - end) * np.exp(-(since[on] - since[on][0]) / lag)
    angle = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 / rate_hz)])
    read = angle + 2e-4 * np.random.default_rng(seed).standard_normal(time.size)
    return Experiment(f"switched{seed}.csv", Sampled(time, voltage), time, {"position": read})


@pytest.mark.parametrize("late_s", [0.0, 0.006, 0.012])
def test_a_delay_longer_than_a_quarter_of_a_period_of_the_band(late_s: float) -> None:
    """Switched voltages have several frequencies, most of them far below the end of this band: the delay is found
    to a sample and a half, and none where there is none (a step between two samples is read as a ramp)."""
    recorded = [switched(at, volts, late_s) for at, volts in enumerate((8.0, -10.0, 12.0, -6.0))]
    in_band, _ = Channel._of_band(recorded, 50.0)
    assert in_band.delay_s == pytest.approx(late_s, abs=3e-3 if late_s else 1.5e-3)
    assert Channel.of(recorded).delay_s == pytest.approx(late_s, abs=3e-3 if late_s else 1.5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("late_s", [-0.006, 0.004, 0.01])
def test_a_delay_is_found_and_removed(late_s: float, caplog: pytest.LogCaptureFixture) -> None:
    """The delay is right within 0.5 ms and reported once, and inertia and friction are right within 2 %."""
    with caplog.at_level(logging.WARNING):
        found_in = Channel.of([chirp(seed, late_s) for seed in range(3)])
        found_in.warn("chirp0.csv")
    delay_s = found_in.delay_s
    assert delay_s == pytest.approx(-late_s, abs=5e-4)
    assert f"acts {1e3 * abs(delay_s):.2g} ms {'later' if delay_s > 0 else 'earlier'} than" in caplog.text
    values = found(late_s)
    assert values["J"] == pytest.approx(J, rel=0.02)
    assert values["viscous_friction.b_v"] == pytest.approx(B, rel=0.02)


def test_without_it_friction_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """The quadrature part of the inertia's torque, J (2 pi f)² times 10 ms, is taken for friction."""
    monkeypatch.setattr(channel, "_delayed", lambda usual: (0.0, usual.fit()))
    assert abs(found(0.01)["viscous_friction.b_v"] / B - 1) > 0.05


def test_no_delay_where_there_is_none() -> None:
    """Recordings of one clock have none, and those of a steady sine do not identify any."""
    assert Channel.of([chirp(seed, 0.0) for seed in range(3)]).delay_s == 0.0
    times = np.arange(0.0, 10.0, 5e-3)
    rng = np.random.default_rng(5)
    sine = Sampled(times, B * np.cos(2 * np.pi * (times - 0.01)) + 1e-3 * rng.standard_normal(times.size))
    position = np.sin(2 * np.pi * times) / (2 * np.pi) + 1e-5 * rng.standard_normal(times.size)
    assert Channel.of([Experiment("sine.csv", sine, times, {"position": position})]).delay_s == 0.0


def test_dry_friction_under_a_sine_is_no_delay() -> None:
    """A geared motor under 24 V at 1 Hz, by an encoder of 1200 counts a turn.  Below 1.3 Hz only the sine is left, and
    a delay of -37 ms explained what the filter leaves of the harmonics of 1.6 V of dry friction; the inertia was then
    several times as large, which excluded the wider bands."""
    times = np.arange(0.0, 30.0, 5e-3)
    volts = lambda t: 24 * np.sin(2 * np.pi * t)  # noqa: E731
    law = lambda t, y: (y[1], (volts(t) - 0.094 * y[1] - 1.6 * np.tanh(y[1] / 0.2) - 0.2) / 1e-3)  # noqa: E731
    solved = solve_ivp(law, (0, 30), (0.0, 0.0), "LSODA", times, rtol=1e-8, atol=1e-9, max_step=0.01).y[0]
    position = np.round(solved / 0.0052) * 0.0052
    found = Channel.of([Experiment("sine.csv", Sampled(times, volts(times)), times, {"position": position})])
    assert abs(found.delay_s) < 0.005
    assert found.band_hz > 2


def explained(recorded: Sequence[Experiment]) -> Explanation:
    """What a bare joint lacks."""
    with open_executor("threads:1") as pool:
        return explain(build_model("joint"), recorded, pool, budget_s=100.0)


@pytest.mark.slow
def test_a_ripple_is_not_taken_for_a_delay(caplog: pytest.LogCaptureFixture) -> None:
    """A ripple of ten a turn looks like a delay of 20 ms as long as it is not in the model: the search without the
    delay, which leaves the noise, is the one that counts.  A delay that is there is kept."""
    rippled = experiments(build_model("joint"), Case("joint", "torque_ripple", 2001).recordings())
    assert Channel.of(rippled[:-1]).delay_s == pytest.approx(0.02, abs=1e-3)
    found = explained(rippled)
    assert (found.missing, found.complete, found.best.delay_s) == (("torque_ripple",), True, 0.0)
    assert "this delay is removed" not in caplog.text
    late = explained([chirp(seed, 0.01) for seed in range(3)])
    assert late.missing == ("viscous_friction",)
    assert late.best.delay_s == pytest.approx(-0.01, abs=5e-4)
    assert "acts 10 ms earlier than" in caplog.text


@pytest.mark.parametrize("is_magnitude", [True, False])
def test_a_torque_without_its_sign_is_told(is_magnitude: bool, caplog: pytest.LogCaptureFixture) -> None:
    """Readings in steps of 20 mN m of a current without a sign are zero at each reversal, and never below; those with a
    sign are not told."""
    read = np.round(torque(0, TIMES) / 0.02) * 0.02
    measured = Sampled(TIMES, np.abs(read) if is_magnitude else read)
    with caplog.at_level(logging.WARNING):
        Channel.of([Experiment("elbow.csv", measured, TIMES, {"position": angle(0)})])
    assert ("has one sign in all others, as a magnitude has" in caplog.text) == is_magnitude


def test_a_torque_of_one_sign_suits_a_motion_in_one_direction(caplog: pytest.LogCaptureFixture) -> None:
    """A motor that is off for a second, and then runs up and down under a voltage that is never negative."""
    times = np.arange(0.0, 6.0, 0.02)
    voltage = np.where(times < 1, 0.0, 6.0 + 3.0 * np.sin(times))
    speed = np.zeros_like(times)
    for i in range(1, times.size):
        speed[i] = speed[i - 1] + 0.02 * (voltage[i - 1] - speed[i - 1]) / 0.3
    position = np.cumsum(speed) * 0.02
    with caplog.at_level(logging.WARNING):
        Channel.of([Experiment("motor.csv", Sampled(times, voltage), times, {"position": position})])
    assert "as a magnitude has" not in caplog.text


def test_the_inertia_is_not_taken_for_smaller_by_a_noisy_speed() -> None:
    """The angle is the integral of a speed with noise (a tachometer), whose acceleration is mostly noise beyond the
    motion: the band ends below, and the inertia is right to a tenth (a hundredth of it, in the widest band)."""
    slow = [0.8 * np.sin(2 * np.pi * 0.6 * TIMES + phase) for phase in (0.0, 1.0)]
    recorded = []
    for seed, drive in enumerate(slow):
        law = lambda t, y, u=drive: [(np.interp(t, TIMES, u) - B * y[0]) / J]  # noqa: E731
        speed = solve_ivp(law, (0, TIMES[-1]), [0.0], "LSODA", TIMES, rtol=1e-8, max_step=0.01).y[0]
        read = speed + 0.5 * np.random.default_rng(seed).standard_normal(TIMES.size)
        position = np.cumsum(read) * float(TIMES[1])
        recorded.append(Experiment(f"motor{seed}.csv", Sampled(TIMES, drive), TIMES, {"position": position}))
    model = build_model("joint", ["viscous_friction"])
    values = {one.name: one.value for one in fitted(model, recorded, Method.TORQUE, {"torque": 0.0}).estimates}
    assert values["J"] == pytest.approx(J, rel=0.1)
    assert values["viscous_friction.b_v"] == pytest.approx(B, rel=0.05)


@pytest.mark.parametrize("reverses", [False, True])
def test_a_torque_of_one_size_along_the_motion_is_refused(reverses: bool) -> None:
    """A motor by full voltage, forwards and back: dry friction of that size is exact; steps that brake tell more."""
    volts = np.where(TIMES < 5, 1.0, -1.0) if reverses else np.where(TIMES % 5 < 4, np.where(TIMES < 5, 1.0, -1.0), 0.0)
    held = np.where(TIMES % 5 < 4, volts, np.sign(volts))
    speed = np.zeros_like(TIMES)
    for i in range(1, TIMES.size):
        is_on = volts[i] != 0
        speed[i] = speed[i - 1] + 5e-3 * (volts[i] - 0.15 * speed[i - 1]) / 0.05 if is_on else 0.0
    angle_rad = np.cumsum(speed) * 5e-3 + 1e-4 * np.random.default_rng(0).standard_normal(TIMES.size)
    recorded = Experiment("motor.csv", Sampled(TIMES, held), TIMES, {"position": angle_rad})
    if reverses:
        assert Channel.of([recorded]).band_hz > 0
        return
    with pytest.raises(ExperimentError, match="found a torque of 1 along the motion at all times"):
        Channel.of([recorded])
    constant = replace(recorded, drive=Sampled(TIMES, np.full(TIMES.size, -2.0)))
    with pytest.raises(ExperimentError, match="found a torque of -2 at all times"):
        Channel.of([constant])


@pytest.mark.parametrize(("constant_s", "is_told"), [(0.01, False), (0.1, True)])
def test_a_supply_that_is_switched_to_and_fro_needs_samples_that_brake(constant_s: float, is_told: bool) -> None:
    """A motor without dry friction, +-17 V with a ripple for 2 s each: with a time constant of 10 ms 0.3 % of the
    samples brake, and the voltage was named as Coulomb friction of 17 V; 3 % tell the two apart.  A torque that was
    measured may have one size: it is that of friction."""
    time = np.arange(0.0, 20.0, 0.005)
    rng = np.random.default_rng(1)
    ideal = np.where(time % 4 < 2, 17.0, -17.0)
    law = lambda t, y: [(ideal[min(int(t / 0.005), time.size - 1)] / 17 - y[0]) / constant_s]  # noqa: E731
    speed = solve_ivp(law, (0.0, time[-1]), [0.0], "LSODA", time, rtol=1e-8, max_step=0.005).y[0]
    angle_rad = np.cumsum(speed) * 0.005 + 1e-3 * rng.standard_normal(time.size)
    volts = Sampled(time, ideal * (1 + 0.03 * rng.standard_normal(time.size)))
    recorded = Experiment("motor.csv", volts, time, {"position": angle_rad}, drive_unit="V")
    if is_told:
        assert Channel.of([recorded]).band_hz > 0
        return
    with pytest.raises(ExperimentError, match=r"found a voltage of 1[67]\.\d* along the motion at all times"):
        Channel.of([recorded])
    assert Channel.of([replace(recorded, drive_unit="")]).band_hz > 0


@pytest.mark.slow
def test_constant_voltages_of_several_sizes_are_no_single_supply() -> None:
    """A motor that starts from rest by another constant voltage in each recording: each alone would be exact as dry
    friction of its size, all together tell the back EMF from the friction."""

    def started(volts: float) -> Experiment:
        law = lambda t, y: (y[1], (volts - B * y[1] - 0.2 * np.tanh(y[1] / 1e-3)) / J)  # noqa: E731
        time = TIMES[TIMES < 1.0]
        moved = solve_ivp(law, (0.0, time[-1]), (0.0, 0.0), "LSODA", time, rtol=1e-8).y[0]
        noise = 1e-5 * np.random.default_rng(int(10 * abs(volts))).standard_normal(time.size)
        steady = Sampled(time, np.full(time.size, volts))
        return Experiment(f"{volts} V.csv", steady, time, {"position": moved + noise}, drive_unit="V")

    with pytest.raises(ExperimentError, match="of 1 along the motion at all times"):
        Channel.of([started(1.0), started(-1.0)])
    recordings = [started(volts) for volts in (1.0, -1.0, 0.5, 2.0, -2.0, 1.5)]
    with open_executor() as pool:
        answer = explain(build_model("joint"), recordings, pool)
    assert set(answer.missing) == {"viscous_friction", "coulomb_friction"}
    assert answer.best["viscous_friction.b_v"].value == pytest.approx(B, rel=0.05)
    assert answer.best["coulomb_friction.tau_c"].value == pytest.approx(0.2, rel=0.1)


def flexible(seed: int) -> Experiment:
    """A motor that turns a flexible ruler, clamped to it, swept from 0.5 to 10 Hz by a voltage of 200 units; the ruler
    rings at 2.5 Hz, so that the inertia depends on the frequency."""
    times, sweep = np.arange(0.0, 8.0, 2e-3), (10.0 - 0.5) / 16.0

    def volts(t: float) -> float:
        return 200 * math.sin(2 * math.pi * (0.5 + sweep * t) * t + seed)

    def slope(t: float, x: FloatArray) -> list[float]:
        held = 2 * (math.tau * 2.5) ** 2 * (x[0] - x[2]) + 0.3 * (x[1] - x[3])
        return [x[1], (volts(t) - 18 * x[1] - held) / 0.4, x[3], held / 2]

    solved = solve_ivp(slope, (0.0, 8.0), [0.0] * 4, "LSODA", times, rtol=1e-8, atol=1e-10)
    position = solved.y[0] + 1e-3 * np.random.default_rng(seed).standard_normal(times.size)
    return Experiment(f"ruler{seed}.csv", Sampled(times, np.array([*map(volts, times)])), times, {"position": position})


def test_a_band_has_most_of_the_motion() -> None:
    """Whatever an inertia below its first frequencies is, the swept motion is compared."""
    recorded = [flexible(seed) for seed in (1, 2)]
    widest = max(Signals.of(one).band_hz for one in recorded)
    assert Channel.of(recorded).band_hz > widest / 2


def hoist(seed: int, turn: float, load: float, *legs: tuple[float, float]) -> Experiment:
    """A winch that lifts (legs of a speed and a time [s], half a second to change it) against a load [A] and dry
    friction of 1.4 A, whose current is counted against the angle; turn: the unit of the angle."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, sum(leg[1] for leg in legs), 0.03)
    ends = np.cumsum([leg[1] for leg in legs])
    wanted = np.array([leg[0] for leg in legs])[np.searchsorted(ends, time, side="right")]
    speed = np.convolve(np.pad(wanted, 8, mode="edge"), np.ones(17) / 17, mode="valid")
    current = load - 1.4 * np.sign(speed) + np.where(speed == 0, 0.1, 0.8) * rng.standard_normal(time.size)
    angle = turn * (np.cumsum(speed) * 0.03 + 1e-4 * rng.standard_normal(time.size))
    return Experiment(f"hoist{seed}.csv", Sampled(time, current), time, {"position": angle})


@pytest.mark.parametrize("turn", [0.3, 1.0, 4.0, 2 * math.pi, 20.0])
def test_a_load_does_not_tell_the_sign_of_the_torque(turn: float) -> None:
    """A winch ends higher than it began.  The work on its load counted as that of friction, and friction drove in one
    unit of the angle, but not in another one."""
    up, down, still = (0.5, 18.0), (-0.5, 18.0), (0.0, 5.0)
    for load in (-17.0, 17.0):
        recorded = [hoist(seed, turn, load, still, leg, still) for seed, leg in enumerate((up, down, up))]
        assert Channel.of(recorded).is_reversed
