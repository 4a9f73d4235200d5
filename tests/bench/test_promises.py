"""The bench of promises counts correctly."""

from __future__ import annotations

import numpy as np
import pytest
from bench import promises
from bench.gears import GEARS
from bench.promises import BAND, false_alarms, lives

from lostmotion.model import build_model


def test_false_alarms_are_those_of_the_promise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Six levels in white noise: between half and twice of the promised 1 % each; promised 5 %, as many more."""
    monkeypatch.setattr(promises, "LEVELS", 6)
    rates = false_alarms("white", BAND, False)
    assert rates.shape == (6,)
    assert 0.005 <= rates.min() <= rates.max() <= 0.02
    monkeypatch.setattr(promises, "PROMISED", 0.05)
    assert false_alarms("white", BAND, False).mean() == pytest.approx(0.05, abs=0.015)


def test_lives_of_a_gear_whose_severity_is_its_play() -> None:
    """Severities around the play itself: the 80 % interval holds the day in 65 to 95 % of the lives of even wear."""
    rng, plays = np.random.default_rng(8600), np.geomspace(promises.FIRST_M, promises.LAST_M, promises.PLAYS)
    samples = [play * np.exp(rng.normal(0, 0.1, 200)) for play in plays]
    count, hits, near = np.sum([lives(plays, samples, "even", seed) for seed in range(4)], axis=0)
    assert count == 4 * promises.LIVES
    assert 0.65 <= hits / count <= 0.95
    assert near / count > 0.8


@pytest.mark.parametrize("name", GEARS)
def test_every_gear_can_be_simulated(name: str) -> None:
    """Its parameters and effects are the model's."""
    gear = GEARS[name]
    model = build_model("play", gear.effects, values=dict(gear.values))
    assert all(model.parameters[key].value == value for key, value in gear.values)
