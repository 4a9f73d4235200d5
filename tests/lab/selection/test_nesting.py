"""Effects that contain another one."""

from __future__ import annotations

import numpy as np
import pytest

from lostmotion.lab.selection.nesting import merged, others, reduced, simplified, without
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


def test_a_general_law_takes_over_the_part_beside_it() -> None:
    """Coulomb's friction beside Stribeck's is one of Stribeck with both contributions; other effects stay."""
    both = build_model("play", ["coulomb_friction", "clock_skew", "stribeck_friction"]).replace(
        {"coulomb_friction.tau_c": 2e-4, "stribeck_friction.tau_c": 1e-4, "stribeck_friction.tau_s": 3e-4}
    )
    one = merged(both)
    assert one.effects == ("clock_skew", "stribeck_friction")
    assert one.parameters["stribeck_friction.tau_c"].value == pytest.approx(3e-4)
    assert one.parameters["stribeck_friction.tau_s"].value == pytest.approx(5e-4)
    assert merged(one) is one


@pytest.mark.parametrize(("own", "less", "part"), [
    ((), (), ("coulomb_friction",)),
    (("coulomb_friction",), ("coulomb_friction",), None),
])  # fmt: skip
def test_without_a_law_that_replaced_a_part_of_the_model_that_is_back(
    own: tuple[str, ...], less: tuple[str, ...], part: tuple[str, ...] | None
) -> None:
    """Without Stribeck friction the Coulomb friction of the file is there again, and is no simpler law to be named."""
    first, now = build_model("play", own), build_model("play", ["stribeck_friction"])
    simple = simplified(now, "stribeck_friction", first)
    assert reduced(now, "stribeck_friction", first).effects == less
    assert (simple and simple.effects) == part


def test_a_law_beside_its_own_part_has_no_simpler_one() -> None:
    """Without Stribeck friction Coulomb friction, which the file has, stays as it is."""
    first = build_model("joint", ["coulomb_friction"])
    now = first.with_effect("stribeck_friction")
    assert simplified(now, "stribeck_friction", first) is None
    assert reduced(now, "stribeck_friction", first).effects == ("coulomb_friction",)
