"""The first of two effects is accepted provisionally where it explains too little alone."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.selection.score_test import Scores
from lostmotion.lab.selection.step import Step, Tried, provisional
from lostmotion.lab.selection.validate import Judged, Unseen
from lostmotion.lab.shooting.continuation import Level
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import Task
from lostmotion.model import build_model
from tests.lab.gears import GEARS, gears


def test_far_from_the_noise_the_first_of_two_is_accepted_provisionally() -> None:
    """The second best on unseen data is put first, as it explains more of the data of the fit; near the noise nothing
    is, nor where nothing could be fitted."""
    model = build_model("play", values=GEARS)
    held = experiments(model, [gears(1)])

    def tried(effect: str, unseen_error: float, typical: float) -> Tried:
        level = Level(model.with_effect(effect), Unknowns.of(model), np.zeros(0), (), typical, typical)
        return Tried(effect, level, judged(unseen_error))

    def judged(error: float) -> Judged:
        return Judged((np.full(100, error),))

    step = Step(
        Scores(),
        (tried("viscous_friction", 7.0, 5.0), tried("coulomb_friction", 8.0, 3.0)),
    )
    with ThreadPoolExecutor(1) as pool:
        unseen = Unseen(held[0], Task.of(model, held, {"accel": 0.2}), 0.25, pool)
        first = provisional(step, judged(10.0), unseen)
        assert provisional(step, judged(1.5), unseen) is None
        assert provisional(Step(step.scores), judged(10.0), unseen) is None
    assert first is not None
    assert [one.effect for one in first.tried] == ["coulomb_friction", "viscous_friction"]
    assert (first.accepted, first.provisional) == (True, True)
