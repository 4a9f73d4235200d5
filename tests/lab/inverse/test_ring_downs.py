"""Ring-downs as people record them: a struck beam of many modes, a mass that softens, a motion that was computed."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording
from lostmotion.lab import compare, fit, open_executor
from lostmotion.lab.data.experiment import Experiment, experiments
from lostmotion.lab.inverse.modes import band_limited
from lostmotion.lab.inverse.output_error import offset_of
from lostmotion.lab.inverse.release import released
from lostmotion.lab.selection.evidence import are_consistent
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.inverse.test_inverse import explained

BARE = 'base = "oscillator"\n'
OTHERS = ((45.0, 0.003, 30.0), (120.0, 0.002, 40.0), (240.0, 0.001, 60.0))
"""Frequency [Hz], damping ratio and acceleration [m/s²] of the other modes of a struck beam."""


def bend(
    times: FloatArray, drag: float, cubic: float, first: float, damping: float = 0.4, hz: float = 7.0
) -> FloatArray:
    """Displacement and acceleration (2, N) of the first mode [m, m/s²], by SciPy's LSODA; drag [1/m] and cubic
    stiffness [1/(m² s²)] per mass."""
    w = 2 * math.pi * hz

    def slope(_: float, x: FloatArray) -> list[float]:
        return [x[1], -(w**2) * x[0] - cubic * x[0] ** 3 - damping * x[1] - drag * x[1] * abs(x[1])]

    swing = solve_ivp(slope, (0, times[-1]), [first, 0.0], "LSODA", times, rtol=1e-9, atol=1e-12).y
    return np.array([swing[0], [slope(0.0, x)[1] for x in swing.T]])


def beam(seed: int, drag: float) -> Recording:
    """The accelerometer on a beam that was struck: at rest for 0.1 s, then the first mode and three others."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 6.0, 1 / 1024)
    after = times[times >= 0.1] - 0.1
    felt = bend(after, drag, 0.0, 0.012)[1]
    for f, zeta, size in OTHERS:
        turned = 2 * np.pi * f * after
        felt = felt + size * np.exp(-zeta * turned) * np.cos(turned + rng.uniform(0, 2 * np.pi))
    whole = np.concatenate([np.zeros(times.size - after.size), felt]) + 0.02 * rng.standard_normal(times.size)
    return Recording(times, {"accel": whole}, name=f"beam{seed}.csv")


@pytest.mark.slow
@pytest.mark.parametrize("drag", [3.0, 0.0])
def test_a_struck_beam_of_many_modes(drag: float, tmp_path: Path) -> None:
    """The second mode is named, and drag of the first where there is some, but no friction; two others are told."""
    answer = explained(tmp_path, BARE, [beam(1, drag)])
    assert set(answer["missing"]) == {"second_mode", *(["quadratic_damping"] if drag else [])}
    assert answer["parameters"]["second_mode.f2"][0] == pytest.approx(OTHERS[0][0], rel=1e-3)
    assert answer["error"]["after"] < 0.05 * answer["error"]["before"]


def test_the_other_modes_are_told(caplog: pytest.LogCaptureFixture) -> None:
    """Their frequencies stand in a warning; a bar with a single other mode is compared as it is."""
    model = build_model("oscillator")
    (struck,) = experiments(model, [beam(2, 0.0)])
    with caplog.at_level(logging.WARNING):
        (found,) = band_limited(model, [struck])
    assert found.rate_hz < struck.rate_hz
    assert "has further modes, at 120, 240 Hz; the motion is compared below 73.5 Hz" in caplog.text
    two = struck.measured["accel"] * 0
    for f, zeta, size in ((7.0, 0.01, 20.0), (45.0, 0.01, 5.0)):
        turned = 2 * np.pi * f * struck.time
        two = two + size * np.exp(-zeta * turned) * np.cos(turned)
    plain = Experiment("two.csv", None, struck.time, {"accel": two + 0.01 * np.sin(1e5 * struck.time**2)})
    assert band_limited(model, [plain]) == (plain,)


@pytest.mark.parametrize(
    ("others", "every"), [((45.0, 120.0), 2), ((45.0, 80.0), 14), ((150.0, 310.0), 14), ((14.0, 21.0), 1)]
)
def test_the_band_has_two_modes_if_they_are_apart(others: tuple[float, ...], every: int) -> None:
    """It ends between the second and the third one, or beside the first where these are near to each other, or too fast
    for the sampling rate; what a clamp that slips adds at two and three times the first is no mode, and another
    recording has the same band.  every: how many readings of 1024 Hz are one then."""
    times, kinds = np.arange(0.0, 6.0, 1 / 1024), [(), others]
    felt = [
        Recording(times, {"accel": sum(np.cos(2 * np.pi * f * times) * np.exp(-0.5 * times) for f in (7.0, *more))})
        for more in kinds
    ]
    model = build_model("oscillator")
    recorded = experiments(model, [replace(one, name=f"{at}.csv") for at, one in enumerate(felt)])
    for one in band_limited(model, recorded):
        assert one.rate_hz == pytest.approx(1024 / every)


def test_a_fit_and_a_comparison_leave_out_the_other_modes() -> None:
    """They are of the same readings as a search: two modes are followed to a hundredth of what is felt."""
    model = build_model("oscillator", ["second_mode"], {"second_mode.f2": 44.9})
    struck = experiments(model, [beam(2, 0.0)])
    with open_executor("threads:1") as pool:
        found = fit(model, struck, pool)
    compared = compare(found.model, struck, is_described=False)
    assert found.experiments[0].rate_hz == compared.experiments[0].rate_hz < struck[0].rate_hz
    assert found.rms["accel"] < 0.01 * np.nanstd(found.experiments[0].measured["accel"])
    assert found["second_mode.f2"].value == pytest.approx(OTHERS[0][0], rel=1e-3)


@pytest.mark.slow
def test_a_mass_that_softens_and_is_damped_within_few_swings(tmp_path: Path) -> None:
    """The spring is named, and not a second mode that overlaps the first."""
    times = np.arange(0.0, 1.5, 0.01)
    place = bend(times, 0.0, -7000.0, 0.11, 6.0, 2.9)[0]
    measured = np.round((place + 5e-4 * np.random.default_rng(3).standard_normal(times.size)) * 500) / 500
    answer = explained(tmp_path, BARE, [Recording(times, {"displacement": measured}, name="soft.csv")])
    assert answer["missing"] == ["hardening_spring"]
    assert answer["parameters"]["hardening_spring.k3"][0] < 0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_mass_that_friction_stops_has_no_second_mode(seed: int, tmp_path: Path) -> None:
    """Dry friction alone slows a mass to a seventh in three periods; the error of the integration is no effect."""
    times, w, amplitude = np.arange(0.0, 0.27, 1 / 500), 2 * math.pi * 11.7, 5.4e-3

    def slope(_: float, x: FloatArray) -> list[float]:
        return [x[1], -(w**2) * x[0] - 1.97 * math.tanh(x[1] / (1e-4 * w * amplitude))]

    place = solve_ivp(slope, (0, times[-1]), [amplitude, 0.0], "Radau", times, rtol=1e-8, atol=1e-11).y[0]
    measured = 0.54e-3 + place + 7.4e-6 * np.random.default_rng(seed).standard_normal(times.size)
    answer = explained(tmp_path, BARE, [Recording(times, {"displacement": measured}, name="rubs.csv")])
    assert answer["missing"] == ["coulomb_friction"]
    assert answer["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(0.02 * 1.97, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("cubic", "zero"), [(2.7e10, 3e-4), (2.7e10, 0.1), (-1.2e10, 0.1)])
def test_a_spring_is_symmetric_about_its_place_of_rest(cubic: float, zero: float, tmp_path: Path) -> None:
    """A mass on a spring that stiffens or softens, by a sensor whose zero is elsewhere, as that of a sonar."""
    times = np.arange(0.0, 0.4, 0.003)
    place = bend(times, 0.0, cubic, 4e-4, 6.0, 17.5)[0]
    measured = zero + place + 3.5e-6 * np.random.default_rng(5).standard_normal(times.size)
    answer = explained(tmp_path, BARE, [Recording(times, {"displacement": measured}, name="spring.csv")])
    assert answer["missing"] == ["hardening_spring"]
    assert answer["parameters"]["hardening_spring.k3"][0] == pytest.approx(0.02 * cubic, rel=0.15)


def test_modes_that_overlap_are_no_two() -> None:
    """Two modes are apart by more than the half-power bandwidth of either, or there is one, or its harmonic; what an
    input excites is no harmonic."""
    model = build_model("oscillator", ["second_mode"], {"m": 1.0, "k": (2 * math.pi * 2.0) ** 2, "b": 0.1})
    for f2, zeta2, is_one in ((2.3, 0.02, True), (2.03, 0.02, False), (2.3, 0.1, False), (9.0, 0.9, False),
        (4.05, 0.01, False), (4.3, 0.01, True),
    ):  # fmt: skip
        found = model.replace({"second_mode.f2": f2, "second_mode.zeta2": zeta2, "second_mode.participation": 0.0})
        assert are_consistent(found, ["second_mode"]) is is_one
        driven = found.replace({"second_mode.participation": 0.1})
        assert are_consistent(driven, ["second_mode"]) is (is_one or f2 == 4.05)


@pytest.mark.slow
def test_a_motion_that_was_computed_lacks_nothing(tmp_path: Path) -> None:
    """A decay in closed form, to all digits: what is left is the error of the integration."""
    times = np.arange(0.0, 30.0, 0.1)
    ring = 1e-3 * np.exp(-0.03 * times) * np.cos(0.9 * times)
    answer = explained(tmp_path, BARE, [Recording(times, {"displacement": ring}, name="exact.csv")])
    assert (answer["verdict"], answer["complete"]) == ("nothing_missing", True)


def test_a_jerk_does_not_hide_the_release() -> None:
    """A mass that is shifted at once, pulled slowly, held and let go moves freely from there."""
    times = np.arange(0.0, 200.0, 0.1)
    after = np.maximum(times - 38.0, 0.0)
    pulled = np.interp(times, [0, 2.3, 2.4, 20, 28], [0, -2.3, 0, 0, 0.8])
    place = np.where(times < 38.0, pulled, 0.8 * np.exp(-0.02 * after) * np.cos(0.9 * after))
    (found,) = released([Experiment("pulled.csv", None, times, {"displacement": place})])
    assert 38.0 <= found.time[0] < 40.0


@pytest.mark.parametrize("second", [0.0, 0.9, 0.3])
def test_a_second_release_is_left_out(second: float, caplog: pytest.LogCaptureFixture) -> None:
    """A pendulum that comes to rest, is held up by a hand and let go again: the larger motion remains, and alone it is
    free until it rests."""
    step = 0.02
    times, place, speed, swing = np.arange(0, 70, step), 0.6, 0.0, []
    for time in times:
        held = second if 35 <= time < 38 else None
        for _ in range(4):
            speed += step / 4 * (-25 * math.sin(place) - 0.5 * speed)
            place += step / 4 * speed
        if held:
            place, speed = held * min(time - 35, 1.0), 0.0
        swing.append(place)
    noise = np.random.default_rng(3).normal(0, 0.001, times.size)
    whole = Experiment("twice.csv", None, times, {"position": np.array(swing) + noise})
    (part,) = released([whole])
    if second > 0.6:
        assert 36 < part.time[0] < 40
        assert part.time[-1] > 45
    elif second:
        assert part.time[0] == 0
        assert 8 < part.time[-1] < 35
        assert "something acts on it again" in caplog.text
    else:
        assert part.time[0] == 0
        assert 8 < part.time[-1] < 35
        assert not caplog.text


@pytest.mark.slow
@pytest.mark.parametrize("friction", [2.5e-3, 0.0])
def test_dry_friction_and_drag_together(friction: float, tmp_path: Path) -> None:
    """A mass that both slow as viscous friction would, to a sixth in 60 swings: beside it neither alone takes anything.
    Viscous friction alone lacks nothing."""
    times, w, rng = np.arange(0.0, 75.0, 0.03), 5.0, np.random.default_rng(2)
    viscous, drag = (0.0, 0.6) if friction else (0.05, 0.0)

    def slope(_: float, x: FloatArray) -> list[float]:
        dry = friction * math.tanh(x[1] / (1e-3 * w * 0.04))
        return [x[1], -(w**2) * x[0] - viscous * x[1] - drag * x[1] * abs(x[1]) - dry]

    place = solve_ivp(slope, (0, times[-1]), [0.04, 0.0], "LSODA", times, rtol=1e-8, atol=1e-10).y[0]
    measured = place + 1e-4 * rng.standard_normal(times.size)
    answer = explained(tmp_path, BARE, [Recording(times, {"displacement": measured}, name="both.csv")])
    assert sorted(answer["missing"]) == (["coulomb_friction", "quadratic_damping"] if friction else [])
    if friction:
        assert answer["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(0.02 * friction, rel=0.05)
        assert answer["parameters"]["quadratic_damping.b2"][0] == pytest.approx(0.02 * drag, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("range_ms2", "offset"), [(19.6, 0.0), (19.6, 9.81), (157.0, 9.81)])
def test_a_struck_bar_beyond_the_range_of_its_accelerometer(range_ms2: float, offset: float, tmp_path: Path) -> None:
    """The range is found to 0.1 %, and nothing beside it, also where the sensor feels gravity and one side is cut off
    first.  The harmonics of what is cut off were taken for modes, and the offset for a drift."""
    rng, times, taps = np.random.default_rng(4), np.arange(0.0, 1.2, 1 / 500), []
    rate, ratio = 2 * np.pi * 12.0, 0.02
    for number, strength in enumerate((2.2, 2.6, 3.0)):
        swing = np.cos(rate * np.sqrt(1 - ratio**2) * times + rng.uniform(0, 6))
        felt = strength * range_ms2 * np.exp(-ratio * rate * times) * swing + offset
        noise = 0.01 * range_ms2 * rng.standard_normal(times.size)
        taps.append(Recording(times, {"accel": np.clip(felt + noise, -range_ms2, range_ms2)}, name=f"tap{number}.csv"))
    found = explained(tmp_path, 'base = "oscillator"\n', taps)
    assert found["missing"] == ["sensor_saturation"]
    assert found["complete"]
    assert found["parameters"]["sensor_saturation.a_max"][0] == pytest.approx(range_ms2, rel=1e-3)


@pytest.mark.parametrize("size", [1.0, 1e6, 1e200])
def test_the_offset_of_readings_that_are_cut_off(size: float) -> None:
    """It is found from a motion of the right size, and any motion has one, also one that a trial step made diverge."""
    motion = 30.0 * np.sin(np.arange(400) / 7.0)
    found = offset_of(np.clip(motion + 9.81, -19.6, 19.6), size * motion, 19.6)
    assert np.isfinite(found)
    assert size > 1 or found == pytest.approx(9.81)


def test_a_mode_above_half_of_the_sampling_rate_is_not_fitted() -> None:
    """A bar that rings at 7.84 Hz, read 66 times a second: the default mode at 58 Hz has an alias there."""
    times = np.arange(0.0, 4.0, 1 / 65.84)
    default = build_model("oscillator")
    stiffness, mass = (default.parameters[name].value for name in ("k", "m"))
    assert math.sqrt(stiffness / mass) / (2 * math.pi) == pytest.approx(65.84 - 7.84, abs=0.05)
    felt = np.exp(-0.43 * times) * np.cos(2 * math.pi * 7.84 * times) + 0.45
    recording = Recording(times, {"accel": felt + 1e-3 * np.random.default_rng(1).standard_normal(times.size)})
    with open_executor() as pool:
        found = fit(default, experiments(default, [recording]), pool)
    assert found["k"].value == pytest.approx(mass * (2 * math.pi * 7.84) ** 2, rel=1e-3)
    (shown,) = found.experiments
    assert abs(float(np.nanmean(shown.measured["accel"]))) < 0.02  # without what the sensor reads at rest
