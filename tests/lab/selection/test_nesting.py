"""Effects that contain another one."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.lab.selection.nesting import others, without
from lostmotion.model import build_model


def test_what_contains_another_goes_on_with_what_that_did() -> None:
    """Coulomb's friction beside Stribeck's, taken out: the same motion, by Stribeck's alone; nor is it tried again."""
    both = build_model("joint", ["coulomb_friction", "stribeck_friction"])
    alone = without(both, "coulomb_friction")
    times = np.linspace(0, 1, 200)
    before, after = (model.simulate(None, times, [0.0, 3.0]).signals["velocity"] for model in (both, alone))
    assert alone.effects == ("stribeck_friction",)
    assert after == pytest.approx(before, rel=1e-6)
    assert "coulomb_friction" not in others(alone)
    assert "stribeck_friction" in others(build_model("joint", ["coulomb_friction"]))
