"""What the likelihood of gears adds to the search: which of the delays, which sizes may be zero, what is far."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.fitting.strategy import doubled, full_fit
from lostmotion.lab.gears.likelihood import SegmentFit, ShortSegments
from lostmotion.lab.gears.score_test import Direction, Scores
from lostmotion.lab.gears.unseen import Unseen
from lostmotion.lab.selection.backward import eliminated
from lostmotion.lab.selection.nesting import without
from lostmotion.lab.selection.search import Proposals, Selection
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.simulated_gears import GEARS, gears


def test_a_segment_that_one_fit_cannot_simulate_does_not_choose(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its error is infinite there; on the segments that both fits follow the other one is better."""

    def fit(*errors: float) -> Any:
        parts = tuple(np.full(8, error) for error in errors)
        return SimpleNamespace(model=None, level=SimpleNamespace(segments=()), unseen=SimpleNamespace(parts=parts))

    monkeypatch.setattr("lostmotion.lab.gears.likelihood.residuals", lambda model, segments, substep_s: [])
    fits, asked = [fit(2.0, 2.0, np.inf), fit(1.0, 1.0, 1.0)], SimpleNamespace(task=SimpleNamespace(substep_s=1e-3))
    with np.errstate(all="raise"):
        assert ShortSegments._with_least_error(asked, fits) is fits[1]  # type: ignore[arg-type]


@pytest.mark.parametrize(("short", "longest", "unseen", "statistic", "asked"), [
    (1.1, 1.1, 1.1, 5.0, ["longest"]),
    (1.1, 1.5, 1.5, 5.0, ["longest"]),
    (1.1, 1.0, 1.0, 50.0, ["longest"]),
    (1.1, 1.5, 1.5, 50.0, ["longest", "observers"]),
    (1.1, 1.9, 4.0, 5.0, ["short", "longest", "observers", "observers"]),
    (1.1, 5.0, 4.0, 50.0, ["short", "observers", "observers"]),
])  # fmt: skip
def test_where_candidates_are_looked_for(
    short: float, longest: float, unseen: float, statistic: float, asked: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The longest segments are asked as long as the model is near the noise there, whatever it leaves of unseen ones;
    observers, twice, where it is not, and once where a significant score leads to no effect and more is left than on
    the shortest segments."""
    met: list[str] = []
    direction = Direction("viscous_friction", build_model("play"), statistic, 1.0)
    found = "lostmotion.lab.gears.likelihood"

    def score(level: Any, *rest: object) -> Scores:
        met.append(level.name)
        return Scores((direction,), np.full(10, 10.0))

    def observed(*rest: object) -> list[Any]:
        met.append("observers")
        return []

    for name in ("near_trials", "full_fits"):
        monkeypatch.setattr(f"{found}.{name}", lambda *rest: [])
    monkeypatch.setattr(f"{found}.score_test", score)
    monkeypatch.setattr(f"{found}.search_effects", observed)
    monkeypatch.setattr(f"{found}.with_clipping", lambda *rest: None)
    monkeypatch.setattr(ShortSegments, "_validated", lambda *rest: Proposals([]))
    levels: Any = [SimpleNamespace(name=name, typical=typical, model=build_model("play"))
                   for name, typical in (("short", short), ("longest", longest))]  # fmt: skip
    task: Any = SimpleNamespace(substep_s=1e-3, experiments=())
    likelihood = ShortSegments(levels[0], Unseen(None, task, 0.5, None))  # type: ignore[arg-type]
    seen: Any = SimpleNamespace(error=unseen)
    for _ in likelihood.proposals(SegmentFit(levels[1], levels[0], seen, 1.1), ()):
        pass
    assert met == asked


@pytest.mark.slow
@pytest.mark.parametrize(("hidden", "met", "time_s", "seed", "length_s"), [
    ("actuator_lag", "command_delay", 3e-3, 61, 1.3), ("command_delay", "actuator_lag", 3e-3, 61, 0.85),
    ("command_delay", "command_delay", 3e-3, 61, 0.85), ("command_delay", "command_delay", 7e-4, 61, 0.85),
    ("command_delay", "sensor_lag", 5e-4, 81, 1.3),
])  # fmt: skip
def test_which_one_it_is(hidden: str, met: str, time_s: float, seed: int, length_s: float) -> None:
    """Whichever delay the search has met first, the one that is there is named, with its time; of a short one it is
    told that a lag is alike, and for three of five seeds a lag is named.  Unseen segments alone do not distinguish the
    last delay from a lag of the sensor.  Of a lag in recordings of 0.85 s a delay is named for one or two seeds of
    three, with cubic and with quintic inputs."""
    model = build_model("play", values=GEARS)
    recorded = [gears(seed + at, length_s, **{f"{hidden}.T": time_s}) for at in range(3)]
    *train, last = held = experiments(model, recorded)
    task = Task.of(model, train, noise_of(held))
    with ThreadPoolExecutor(2) as pool:
        unseen = Unseen(last, task, 0.5, pool)
        short = full_fit(model, task)
        now = SegmentFit(short, short, unseen.validate(short.model), 1.0)
        level = full_fit(model.with_effect(met).replace({f"{met}.T": 0.8 * time_s}), task)
        fit = SegmentFit(level, level, unseen.validate(level.model))
        found = ShortSegments(short, unseen).accepted(fit, now)
    assert found.model.effects == (hidden,)
    assert found.model.parameters[f"{hidden}.T"].value == pytest.approx(time_s, rel=0.03 if hidden != met else 0.1)
    assert ((hidden, "actuator_lag") in found.alike) == (time_s < 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("named", "hidden"), [
    ("coulomb_friction", {"coulomb_friction.tau_c": 5e-5}),
    ("stribeck_friction", {"stribeck_friction.tau_c": 3e-5, "stribeck_friction.tau_s": 1e-4,
                           "stribeck_friction.omega_s": 0.3}),
])  # fmt: skip
def test_of_two_nested_laws_the_one_that_is_needed_is_named(named: str, hidden: dict[str, float]) -> None:
    """A search may meet Stribeck friction first, where another effect is still missing.  In the end it gives way to
    Coulomb friction if that predicts as well, and stays where it is there."""
    model = build_model("play", values=GEARS)
    *train, last = held = experiments(model, [gears(seed, 1.3, **hidden) for seed in (71, 72, 73)])
    task = Task.of(model, train, noise_of(held))
    begin = {"stribeck_friction.tau_c": 5e-5, "stribeck_friction.tau_s": 7e-5, **hidden}
    wide = model.with_effect("stribeck_friction")
    wide = wide.replace({name: value for name, value in begin.items() if name in wide.parameters})
    with ThreadPoolExecutor(2) as pool:
        likelihood = ShortSegments(full_fit(model, task), unseen := Unseen(last, task, 0.5, pool))
        level = full_fit(wide, task)
        now = SegmentFit(level, level, unseen.validate(level.model), 1.0)
        found = eliminated(Selection((likelihood.first, now), ("stribeck_friction",), ()), likelihood, ())
    assert found.added == (named,)
    assert found.fits[-1].model.effects == (named,)
    assert found.fits[-1].rms == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_what_is_near_is_told_by_the_shortest_segments() -> None:
    """A fit on longer segments leaves what is missing there, too: beside it an error counts as near by what the same
    model leaves of the shortest ones."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, 2.0, **{"viscous_friction.b_v": 6e-4}) for seed in (7, 8)])
    task = Task.of(model, held, noise_of(held))
    short = full_fit(model, task)
    longer = doubled(short, task)
    assert longer is not None
    with ThreadPoolExecutor(2) as pool:
        floor = ShortSegments(short, Unseen(held[1], task, 0.5, pool))._floor(longer)
    assert longer.typical > 1.4 * short.typical
    assert floor == pytest.approx(short.typical, rel=0.4)


@pytest.mark.slow
def test_without_an_effect_a_fit_begins_where_it_ended_with_it() -> None:
    """Without the friction that is there the error is 1.9 times as large, and longer segments are not fitted;
    without the spring that is not there it is the same to 5 %."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(seed, 1.0, **{"viscous_friction.b_v": 1.5e-3}) for seed in (7, 8)])
    task = Task.of(model, held, noise_of(held))
    both = model.with_effect("viscous_friction").replace({"viscous_friction.b_v": 1.5e-3})
    level = doubled(full_fit(both.with_effect("hardening_spring"), task), task)
    assert level is not None
    with ThreadPoolExecutor(2) as pool:
        likelihood = ShortSegments(level, Unseen(held[1], task, 0.25, pool))
        fit = SegmentFit(level, level, likelihood.unseen.validate(level.model), 1.0)
        less, same = (
            likelihood.refitted(without(level.model, effect), fit)
            for effect in ("viscous_friction", "hardening_spring")
        )
    assert less.short.typical > 1.85 * level.typical
    assert less.level is less.short
    assert same.short.typical == pytest.approx(level.typical, rel=0.05)
    assert same.rms == pytest.approx(fit.rms, rel=0.05)
