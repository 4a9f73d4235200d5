"""Plain words: every effect of the catalogue speaks, signs are heard, a user's own effect speaks for itself."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from lostmotion.lab import words
from lostmotion.lab.quantity import Interval
from lostmotion.model import EffectInfo, Parameter, catalogue
from lostmotion.model.effects import ActsOn, Effect, registry

OWN = Effect(
    id="tight_spot", equation="-t near theta_t", summary="a tight spot in the bearing.", acts_on=ActsOn.JOINT,
    bases=("play",), parameters={"t": Parameter(1e-4, "N m")},
)  # fmt: skip


def found(effect: EffectInfo, **changed: float) -> Mapping[str, Interval]:
    """Its parameters at their defaults, or as changed, with intervals of some percent."""
    values = {name: changed.get(name, p.value) for name, p in effect.parameters.items()}
    return {name: Interval(v, v - 0.07 * abs(v), v + 0.07 * abs(v), effect.parameters[name].unit)
            for name, v in values.items()}  # fmt: skip


def of(effect: str, **changed: float) -> str:
    """The sentence of an effect of the catalogue."""
    info = next(one for one in catalogue() if one.id == effect)
    return words.sentence(effect, found(info, **changed))


@pytest.mark.parametrize("effect", catalogue(), ids=lambda one: one.id)
def test_every_effect_speaks_with_its_interval(effect: EffectInfo) -> None:
    """One sentence without symbols or gaps, holding a 95 % interval; a name of its own; where to look."""
    sentence = words.sentence(effect.id, found(effect))
    assert sentence.endswith(".")
    assert "(95 %)" in sentence
    assert not set("{}_") & set(sentence)
    assert "_" not in words.name(effect.id)
    assert len(words.look(effect.id)) > 40


@pytest.mark.parametrize(
    ("effect", "changed", "said"),
    [
        (
            "coulomb_friction",
            {"tau_c": 1.2e-4},
            "Something rubs: Coulomb friction of 0.120 mN m, between 0.112 and 0.128",
        ),
        ("command_delay", {"T": 4.2e-3}, "The command reaches the motor late, by 4.2 ms, between 3.9 and 4.5"),
        ("clock_skew", {"s": 1e-3}, "clock runs fast, by 0.100 %"),
        ("clock_skew", {"s": -5e-5}, "clock runs slow, by 50 ppm"),
        ("hardening_spring", {"k3": 2e9}, "The bar stiffens as it bends: its cubic stiffness is 2.00 N/mm³"),
        ("hardening_spring", {"k3": -2e9}, "The bar softens"),
        ("contact_asymmetry", {"ratio": 2.0}, "harder on the one flank"),
        ("contact_asymmetry", {"ratio": 0.5}, "by a factor of 2.00, between 1.87 and 2.15"),
        ("stribeck_friction", {"tau_c": 3e-4, "tau_s": 5e-4}, "sticks before it slides"),
        ("stribeck_friction", {"tau_c": 5e-4, "tau_s": 3e-4}, "slides more easily near rest"),
        ("gravity_leakage", {"c": -0.05}, "tilted by 2.9°"),
        ("gear_eccentricity", {"e": -1e-5}, "by 10.0 µm"),
    ],
)
def test_sizes_and_signs_are_heard(effect: str, changed: dict[str, float], said: str) -> None:
    """Human units, and the right word for either sign of the parameter."""
    assert said in of(effect, **changed)


def test_own_effect_speaks_through_its_summary(monkeypatch: pytest.MonkeyPatch) -> None:
    """An effect that nobody wrote words for tells its summary and its parameters; nothing is made up about causes."""
    monkeypatch.setitem(registry._EFFECTS, OWN.id, OWN)  # registered, for this test only
    sentence = words.sentence(OWN.id, {"t": Interval(1e-4, 0.9e-4, 1.1e-4, "N m")})
    assert sentence == "A tight spot in the bearing: t = 0.100 mN m, between 0.090 and 0.110 (95 %)."
    assert words.name(OWN.id) == "tight spot"
    assert words.look(OWN.id) == ""


def test_sizes_that_would_have_been_seen() -> None:
    """A share is read as the angle or the percentage that its sentence has; others in their unit, without sign."""
    assert words.size("coulomb_friction", "tau_c", 3e-5, "play") == "30.0 µN m"
    assert words.size("clock_skew", "s", -2e-5, "play") == "20.0 ppm"
    assert words.size("gravity_leakage", "c", 0.05, "play") == "2.87°"
