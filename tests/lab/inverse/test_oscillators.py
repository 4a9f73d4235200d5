"""A mass on a spring that rubs, a mode whose frequency nothing tells, and ripples that the samples cannot show."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp

from lostmotion.daemon.cli import cli
from lostmotion.drivers.recording import Recording
from lostmotion.lab.data.experiment import experiments, with_one_column
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.fitting.identifiability import with_free_states
from lostmotion.lab.inverse.effect_sizes import is_sized
from lostmotion.lab.inverse.first_values import _covers
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.model import build_model
from lostmotion.model.motion import FloatArray
from tests.lab.inverse.test_inverse import explained

HZ, MASS, RUBBING_N = 3.0, 0.5, 0.35
NOISE_M = 1e-4


def cart(seed: int, first: float, rubbing: float = RUBBING_N) -> Recording:
    """A mass on a spring that is let go."""
    rng, times = np.random.default_rng(seed), np.arange(0.0, 5.0, 0.01)
    moving = let_go(times, first, HZ, rubbing / MASS)
    return Recording(times, {"displacement": moving + NOISE_M * rng.standard_normal(times.size)}, name=f"c{seed}.csv")


def let_go(times: FloatArray, first: float, hz: float, rubbing: float) -> FloatArray:
    """The motion in closed form: half swings about +-f/w², each smaller by 2 f/w², until the spring no longer overcomes
    the friction; rubbing: f, the friction by the mass."""
    w = 2 * np.pi * hz
    shift = rubbing / w**2
    half = np.floor(w * times / np.pi)
    last = np.ceil((first - shift) / (2 * shift)) if shift else np.inf
    swing = first - (2 * half + 1) * shift
    moving = swing * np.cos(w * times) + np.where(half % 2, -shift, shift)
    return np.where(half < last, moving, (-1.0) ** last * (first - 2 * last * shift) if shift else 0.0)


@pytest.mark.slow
def test_a_slow_swing_that_is_read_fast_by_a_coarse_encoder(tmp_path: Path) -> None:
    """A pendulum of 1.3 Hz, 10 000 readings a second in steps of 0.16 mrad around pi, that comes to rest.  By noise the
    stiffness of its acceleration is 280 times as large, from which no effect of the catalogue led to the swing."""
    times = np.arange(0.0, 12.0, 1e-4)
    angle = 1.57e-4 * np.round((np.pi + let_go(times, 0.066, 1.286, 0.165)) / 1.57e-4)
    found = explained(tmp_path, 'base = "oscillator"\n', [Recording(times, {"displacement": angle}, name="swing.csv")])
    assert found["missing"] == ["coulomb_friction"]
    mass = found["scale"][0]["value"]
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(0.165 * mass, rel=0.02)
    assert found["parameters"]["k"][0] == pytest.approx((2 * np.pi * 1.286) ** 2 * mass, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("recordings", [1, 3])
def test_a_mass_on_a_spring_that_rubs(recordings: int, tmp_path: Path) -> None:
    """Coulomb friction is named first, with its ratio to the mass: the file's, of which nothing tells."""
    lengths = (0.06, 0.05, 0.055)[:recordings]
    asked = [cart(seed, length) for seed, length in enumerate(lengths)]
    found = explained(tmp_path, 'base = "oscillator"\n[parameters]\nm = 0.5\n', asked)
    assert found["missing"][:1] == ["coulomb_friction"]
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(RUBBING_N, rel=0.03)
    assert found["error"]["after"] < 2 * NOISE_M


@pytest.mark.parametrize(
    ("effect", "size"), [("", ""), ("quadratic_damping", "quadratic_damping.b2"), ("hardening_spring", "")]
)
def test_a_damping_of_nearly_zero_is_fitted(effect: str, size: str, tmp_path: Path) -> None:
    """With a scale of its own value a damping that a fit left at 1e-15 stayed there, with an interval of no width; so
    did a drag."""
    times = np.arange(0.0, 20.0, 0.02)
    swing = 0.02 * np.exp(-0.1 * times) * np.cos(6 * times)
    (tmp_path / "swing.csv").write_text(
        "time,displacement\n" + "".join(f"{t:.2f},{x:.7f}\n" for t, x in zip(times, swing, strict=True))
    )
    tiny = f"{size} = 1e-15\n" if size else ""
    effects = f'effects = ["{effect}"]\n' if effect else ""
    (tmp_path / "m.toml").write_text(f'base = "oscillator"\n{effects}[parameters]\nb = 1e-15\n{tiny}')
    names = [str(tmp_path / name) for name in ("m.toml", "swing.csv", "out.toml")]
    ran = CliRunner().invoke(cli, ["lab", "fit", *names[:2], "-o", names[2], "--json"])
    assert ran.exit_code == 0, ran.output
    value, low, high = json.loads(ran.stdout)["parameters"]["b"]
    assert value == pytest.approx(0.2 * 0.02, rel=0.01)
    assert 0 < low < value < high < 2 * value


@pytest.mark.slow
def test_a_mass_on_a_spring_that_does_not_rub(tmp_path: Path) -> None:
    """Nothing is named."""
    found = explained(tmp_path, 'base = "oscillator"\n', [cart(seed, 0.05, 0.0) for seed in (5, 6)])
    assert found["verdict"] == "nothing_missing"


@pytest.mark.slow
def test_a_bar_with_both_columns_is_compared_by_its_displacement(tmp_path: Path) -> None:
    """Of a bar that rubs, read by a displacement sensor and by an accelerometer, the friction is named, 0.02 N to 5 %;
    on short segments, as gears are, the range of the accelerometer was."""
    model = build_model("oscillator", ["coulomb_friction"], {"coulomb_friction.tau_c": 0.02})
    rng, times = np.random.default_rng(5), np.arange(0, 2, 1e-3)
    asked = []
    for first in (1e-3, 9e-4, 8e-4):
        motion = model.simulate(None, times, model.initial_state(None, q=first))
        columns = {
            "displacement": motion["displacement"] + 2e-6 * rng.standard_normal(times.size),
            "accel": motion["accel"] + 0.2 * rng.standard_normal(times.size),
        }
        asked.append(Recording(times, columns, name=f"{first}.csv"))
    found = explained(tmp_path, 'base = "oscillator"\n', asked)
    assert found["missing"] == ["coulomb_friction"]
    assert found["parameters"]["coulomb_friction.tau_c"][0] == pytest.approx(0.02, rel=0.05)
    assert list(found["columns"]) == ["displacement"]


def test_recordings_of_different_columns_are_refused() -> None:
    """One bar's displacement and another one's acceleration are not compared together."""
    one, other = (
        Recording(np.arange(100) * 0.01, {column: np.sin(np.arange(100.0))}, name=f"{column}.csv")
        for column in ("displacement", "accel")
    )
    with pytest.raises(ExperimentError, match=r"accel.csv: found accel, expected displacement as in displacement.csv"):
        with_one_column(experiments(build_model("oscillator"), [one, other]))


def one_mode() -> OutputError:
    """A free swing of one mode."""
    model = build_model("oscillator", ["second_mode"], {"k": MASS * (2 * np.pi * HZ) ** 2, "m": MASS, "b": 0.0})
    (held,) = experiments(model, [cart(7, 0.05, 0.0)])
    return OutputError.of([Signals.of(held)], with_free_states(model))


def test_a_mode_whose_frequency_nothing_tells_is_none() -> None:
    """A second mode that does not swing has any frequency, and is not told.  (Fitted to the noise it may have one: of
    twenty such swings in ten; then unseen samples decide.)"""
    data = one_mode()
    fit = regressed(data.prior_centre, data, steps=1)
    assert not is_sized("second_mode", fit)


@pytest.mark.parametrize(("speed", "is_seen"), [(2.0, True), (12.0, False)])
def test_a_ripple_faster_than_the_band_is_no_candidate(speed: float, is_seen: bool) -> None:
    """A shaft that starts within a tenth of a second, 50 samples a second, a band of 10 Hz: 18 periods a turn
    show at 2 rad/s, and at 12 rad/s at the start only.  Once a turn is one on a shaft only."""
    times = np.arange(0.0, 6.0, 0.02)
    turned = speed * (times - 0.1 * (1 - np.exp(-times / 0.1)))
    model = build_model("joint")
    (held,) = experiments(model, [Recording(times, {"position": turned, "torque": np.ones(times.size)})])
    ripple = model.with_effect("torque_ripple").replace({"torque_ripple.N": 18.0})
    signals = replace(Signals.of(held), band_hz=10.0)
    assert _covers("torque_ripple", ripple, InverseModel.of([signals], model)) is is_seen
    once = ripple.replace({"torque_ripple.N": 1.0})  # the law of a weight, which an arm has rather
    assert _covers("torque_ripple", once, InverseModel.of([signals], model)) is not is_seen


@pytest.mark.slow
def test_a_soft_spring_whose_model_has_the_cubic_of_a_stiff_one(tmp_path: Path) -> None:
    """The catalogue's cubic spring, which was only added to the model, throws a mass of 0.2 kg on a spring of 15 N/m,
    whose place is measured from somewhere else, beyond all numbers.  The fit begins without it, and follows."""

    def swings(seed: int) -> Recording:
        def slope(t: float, x: FloatArray) -> list[float]:
            return [x[1], -(15.0 * x[0] + 0.01 * x[1]) / 0.2]

        time = np.arange(0.0, 20.0, 0.02)
        place = solve_ivp(slope, (0.0, 20.0), [0.05 + 0.01 * seed, 0.0], "LSODA", time, rtol=1e-9, atol=1e-12).y[0]
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(time.size)
        return Recording(time, {"displacement": 0.37 + place + noise}, name=f"{seed}.csv")

    model = 'base = "oscillator"\neffects = ["hardening_spring"]\n[parameters]\nm = { value = 0.2, fixed = true }\n'
    answer = explained(tmp_path, model, [swings(1), swings(2), swings(3)])
    assert answer["missing"] == []
    assert answer["error"]["before"] < 3e-4
