"""Runs side by side, in lanes, are what each of them is alone."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from lostmotion.lab.inverse import torques
from lostmotion.model import Model, build_model, kernel, observer, solve
from lostmotion.model.base import Term
from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.effects.registry import catalogue, registered
from lostmotion.model.kernel import Slots, python_kernel, whole_power
from lostmotion.model.lanes import LANES
from lostmotion.model.motion import FloatArray, Sampled
from lostmotion.model.parameter import Parameter
from lostmotion.model.run import run_beside, run_each
from lostmotion.model.signals import OMEGA2, TORQUE

TIMES = np.arange(480) / 800
SIZES = {"play": 0.2, "oscillator": 1.0, "joint": 2e-3, "servo": 0.5}


def driven(base: str) -> Sampled:
    """Three tones, of which the slowest stops the joint now and then."""
    tones = ((1.0, 0.3, 1.0), (2.3, 0.5, 2.0), (3.1, 0.2, 3.0))
    return Sampled(TIMES, SIZES[base] * sum(a * np.sin(2 * np.pi * f * TIMES + phi) for f, a, phi in tones))


def states(model: Model, count: int) -> FloatArray:
    """States (count, n) around that of the input."""
    begin = model.initial_state(driven(model.base), 0.0)
    return np.array([begin + 2e-5 * k * (1 + np.arange(begin.size)) for k in range(count)])


def outputs(base: str) -> Sequence[str]:
    return ("displacement", "accel") if base == "oscillator" else ("position", "velocity")


@pytest.mark.parametrize("base", SIZES)
def test_lanes_are_runs_alone(base: str) -> None:
    """With every effect of the catalogue, also where dry friction halves the steps of some lanes; times between steps
    and at knots; more runs than lanes."""
    motion, count = driven(base), LANES + 3
    for effect in catalogue():
        if base not in effect.bases:
            continue
        model = build_model(base, [effect.id])
        times = np.sort(np.concatenate([TIMES[::3], TIMES[1:-1:3] + 3e-4]))
        run, starts = model.prepare(motion, times, outputs(base), 0.0), states(model, count)
        alone = np.array([run(start[None], 5e-4)[0] for start in starts])
        scale = np.abs(alone).max(axis=2, keepdims=True)
        assert np.all(np.abs(run(starts, 5e-4) - alone) <= 1e-9 * scale), effect.id


def test_each_lane_has_its_own_parameters() -> None:
    """Models that differ in values, also in the width of a friction and in what signals are preset to."""
    motion, model = driven("play"), build_model("play", ["coulomb_friction", "sensor_lag"])
    changes = ({}, {"d": 9e-5}, {"J2": 2.1e-4}, {"coulomb_friction.omega_0": 0.05}, {"coulomb_friction.tau_c": 0.0})
    models = [model.replace(values) for values in changes]
    runs = [one.prepare(motion, TIMES, ("accel",), 0.0) for one in models]
    starts = states(model, len(models))
    alone = np.array([run(start[None], 5e-4)[0] for run, start in zip(runs, starts, strict=True)])
    assert np.abs(run_beside(runs, starts, 5e-4) - alone).max() <= 1e-9 * np.abs(alone).max()
    assert np.ptp(alone[:, 0, -1]) > 1e-3 * np.abs(alone).max()


def test_each_lane_has_its_own_input() -> None:
    """Segments of one recording, with the input and the time of each."""
    motion, model = driven("play"), build_model("play", ["bias_drift"], {"bias_drift.c": 1.0})
    parts = [TIMES[begin : begin + 80] for begin in range(0, 400, 40)]
    runs = [model.prepare(motion, part, ("accel", "position"), 0.0) for part in parts]
    starts = np.array([model.initial_state(motion, float(part[0])) for part in parts])
    alone = [run(start[None], 5e-4)[0] for run, start in zip(runs, starts, strict=True)]
    assert all(run.goes_beside(runs[0]) for run in runs)
    found = np.array(run_each(runs, starts, 5e-4))
    assert np.abs(found - alone).max() <= 1e-9 * np.abs(alone).max()


def test_a_delay_goes_alone() -> None:
    """Runs with another input, other times or other terms do not go beside each other."""
    motion, model = driven("play"), build_model("play", ["command_delay"])
    run = model.prepare(motion, TIMES, ("accel",), 0.0)
    assert run.goes_beside(model.replace({"d": 9e-5}).prepare(motion, TIMES, ("accel",), 0.0))
    assert not run.goes_beside(model.replace({"command_delay.T": 2e-3}).prepare(motion, TIMES, ("accel",), 0.0))
    assert not run.goes_beside(model.prepare(motion, TIMES[:-1], ("accel",), 0.0))
    assert not run.goes_beside(build_model("play").prepare(motion, TIMES, ("accel",), 0.0))


@pytest.mark.parametrize(("effect", "name"), [("command_delay", "T"), ("clock_skew", "s")])
def test_a_delay_that_differs_by_less_than_rounding_goes_alone(effect: str, name: str) -> None:
    """A derivative by a delay, or by the rate of a clock, shifts times by less than they are rounded."""
    motion, model = driven("play"), build_model("play", [effect])
    full = f"{effect}.{name}"
    moved = model.replace({full: model.parameters[full].value * (1 + 3e-8)})
    run, other = (one.prepare(motion, TIMES, ("accel",), 0.0) for one in (model, moved))
    assert not run.goes_beside(other)
    assert run.goes_beside(model.prepare(motion, TIMES, ("accel",), 0.0))


def test_a_lane_that_diverges_leaves_the_others() -> None:
    """A gear that begins deep within the teeth has no finite motion; its neighbours do."""
    model = build_model("play")
    run = model.prepare(driven("play"), TIMES, ("accel",), 0.0)
    starts = np.tile(model.initial_state(driven("play"), 0.0), (8, 1))
    starts[3, 0] = 1.0
    found = run(starts, 5e-4)
    assert not np.isfinite(found[3]).all()
    assert np.array_equal(np.delete(found, 3, axis=0), np.tile(run(starts[:1], 5e-4), (7, 1, 1)))


@python_kernel
def damped(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """A Maxwell damper in plain Python."""
    dx[0] = (s[OMEGA2] - x[0]) / p[1]
    return -p[0] * (s[OMEGA2] - x[0])


def test_python_functions_see_one_lane() -> None:
    """A kernel in plain Python reads and writes one simulation, whatever the number of lanes."""
    values = {"c": 1e-3, "T": 0.05}
    own = Effect(
        id="damper",
        equation="x' = (omega - x)/T",
        summary="somebody else's",
        acts_on=ActsOn.JOINT,
        bases=("joint",),
        parameters={name: Parameter(value, source="test", meaning="test") for name, value in values.items()},
        terms={"joint": (Term(TORQUE, damped, ("c", "T")),)},
        states=(OMEGA2,),
    )
    with registered([own]):
        model = build_model("joint", ["damper"])
        run, starts = model.prepare(driven("joint"), TIMES[:40], ("position", "velocity"), 0.0), states(model, 3)
        alone = np.array([run(start[None], 5e-3)[0] for start in starts])
        assert np.abs(run(starts, 5e-3) - alone).max() <= 1e-12 * np.abs(alone).max()


@pytest.mark.parametrize("exponent", [0, 1, 2, 11, 101])
def test_whole_power(exponent: int) -> None:
    """Repeated squaring without a branch."""
    for base in (-1.7, -0.3, 0.0, 0.9, 1.2):
        assert whole_power(base, float(exponent)) == pytest.approx(base**exponent, rel=1e-13)


def test_compiled_code_is_of_the_present_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is cached has a checksum in its name, of all files of which code is compiled into other ones.  With the old
    code of one and the new code of another one an observer had the wrong time within a step."""
    folder = Path(kernel.__file__).parent
    mark = re.compile("@(jitted|subroutine|intrinsic_function)")
    shared = {path.name for path in folder.glob("*.py") if mark.search(path.read_text())} - {"solve.py", "observer.py"}
    assert shared <= {*kernel.INLINED}
    before = kernel.SOURCES
    assert solve.integrate.py_func.__qualname__.endswith(before)
    assert observer._follow.py_func.__qualname__.endswith(before)
    assert torques._evaluate.py_func.__qualname__.endswith(before)
    for name in kernel.INLINED:
        shutil.copy(folder / name, tmp_path)
    monkeypatch.setattr(kernel, "__file__", str(tmp_path / "kernel.py"))
    assert kernel._sources() == before
    (tmp_path / "rk4.py").write_text((tmp_path / "rk4.py").read_text() + "# another one\n")
    assert kernel._sources() != before
