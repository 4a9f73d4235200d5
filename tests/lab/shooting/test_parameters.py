"""The free parameters as a vector: there and back, bounds, slopes, and how far a search may go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.lab.shooting.parameters import Unknown, Unknowns, free_names
from lostmotion.model import Model, Parameter, build_model

MODEL = build_model(
    "play", ["coulomb_friction", "gear_eccentricity", "clock_skew"], {"d": 6e-5, "coulomb_friction.tau_c": 0.0}
)


def position(unknowns: Unknowns, name: str) -> int:
    """Where a parameter stands in the vector."""
    return unknowns.names.index(name)


def test_only_free_numbers_vary() -> None:
    """What is fixed, and the whole number of teeth, is never changed by a fit."""
    names = free_names(MODEL)
    assert {"d", "alpha", "k", "b", "l", "coulomb_friction.tau_c", "gear_eccentricity.e", "clock_skew.s"} <= set(names)
    assert not {"R1", "J2", "n", "m", "gear_eccentricity.N"} & set(names)
    held = MODEL.replace({"d": Parameter(6e-5, "m", fixed=True)})
    assert set(names) - set(free_names(held)) == {"d"}


def test_there_and_back() -> None:
    """z stands for the model's values; put writes them back, to the last digits, and touches nothing else."""
    unknowns = Unknowns.of(MODEL)
    again = unknowns.put(build_model("play", MODEL.effects, {"R1": 0.02}), unknowns.z(MODEL))
    for name in unknowns.names:
        assert again.parameters[name].value == pytest.approx(MODEL.parameters[name].value, rel=1e-12, abs=1e-300)
    assert again.parameters["R1"].value == 0.02


def test_positive_quantities_vary_by_their_logarithm() -> None:
    """A step of log 2 doubles the play; a friction that may be zero goes by its scale and stops at zero."""
    unknowns = Unknowns.of(MODEL)
    z = unknowns.z(MODEL)
    z[position(unknowns, "d")] += math.log(2)
    z[position(unknowns, "coulomb_friction.tau_c")] = -1.0
    moved = unknowns.put(MODEL, z)
    assert moved.parameters["d"].value == pytest.approx(1.2e-4, rel=1e-12)
    assert moved.parameters["coulomb_friction.tau_c"].value == 0.0


def test_values_stay_within_the_bounds() -> None:
    """However far a vector lies, the model gets a value that its bounds allow; bounds in z stand for those."""
    model = MODEL.replace({"d": Parameter(6e-5, "m", low=5e-5, high=7e-5)})
    unknowns = Unknowns.of(model)
    low, high = unknowns.bounds
    i = position(unknowns, "d")
    assert (low[i], high[i]) == pytest.approx((math.log(5e-5), math.log(7e-5)), rel=1e-12)
    for z, expected in ((-1e6, 5e-5), (1e6, 7e-5)):
        vector = unknowns.z(model)
        vector[i] = z
        assert unknowns.put(model, vector).parameters["d"].value == pytest.approx(expected, rel=1e-12)
    assert np.all(low <= unknowns.z(model))
    assert np.all(unknowns.z(model) <= high)


def test_slopes_are_those_of_the_values() -> None:
    """d value / d z against central differences of the value."""
    unknowns = Unknowns.of(MODEL)
    z, h = unknowns.z(MODEL) + 0.01, 1e-5
    numeric = [(item.value(x + h) - item.value(x - h)) / (2 * h) for item, x in zip(unknowns.items, z, strict=True)]
    np.testing.assert_allclose(unknowns.slopes(z), numeric, rtol=1e-8)


@pytest.mark.parametrize(("name", "factor"), [("d", 1.8), ("k", 1.25), ("alpha", 5.0)])
def test_search_stays_near_what_is_known(name: str, factor: float) -> None:
    """Around a model, play and stiffness move by a factor of trust at most; without it, by the file's bounds only."""
    known = MODEL.parameters[name].value
    unknowns = Unknowns.of(MODEL, around=MODEL)
    vector = unknowns.z(MODEL)
    ends = []
    for far in (-50.0, 50.0):
        vector[position(unknowns, name)] = far
        ends.append(unknowns.put(MODEL, vector).parameters[name].value)
    assert ends == pytest.approx([known / factor, known * factor], rel=1e-9)
    wide, near = ([bound[position(u, name)] for bound in u.bounds] for u in (Unknowns.of(MODEL), unknowns))
    assert wide[0] < near[0] < near[1] < wide[1]


def test_a_share_keeps_off_its_ends() -> None:
    """Half of a joint's inertia behind the shaft may become 1 or 99 %, never all or nothing."""
    model: Model = build_model("play", ["shaft_compliance"])
    unknowns = Unknowns.of(model)
    i = position(unknowns, "shaft_compliance.share")
    item = unknowns.items[i]
    assert 0.01 <= item.value(-1e9) < item.value(1e9) <= 0.99


def test_a_parameter_without_a_range_has_a_scale() -> None:
    """Bounds that meet at zero, as of a torque that nothing shows, leave z at 0 and divide by nothing."""
    unknown = Unknown.of("a", Parameter(0.0, "N m", 0.0, 0.0))
    assert (unknown.z(0.0), unknown.value(1.0), unknown.ends) == (0.0, 0.0, (0.0, 0.0))


def test_a_phase_goes_round() -> None:
    """A phase has no end: a step over pi goes on at -pi, and stands for the same angle."""
    model = MODEL.replace({"gear_eccentricity.phi": 3.0})
    unknowns = Unknowns.of(model)
    i = position(unknowns, "gear_eccentricity.phi")
    z = unknowns.z(model)
    z[i] += 0.5
    assert np.isinf(unknowns.bounds[0][i])
    assert np.isinf(unknowns.bounds[1][i])
    assert unknowns.put(model, z).parameters["gear_eccentricity.phi"].value == pytest.approx(3.5 - 2 * math.pi)


@pytest.mark.parametrize(("name", "half", "expected"), [
    ("d", 1.0, (6e-5 / math.e, 6e-5 * math.e)), ("d", 600.0, (0.0, math.inf)),
    ("coulomb_friction.tau_c", 1e10, (-math.inf, math.inf)),
])  # fmt: skip
def test_what_nothing_tells_has_no_interval(name: str, half: float, expected: tuple[float, float]) -> None:
    """An interval of a factor of 1e9 and more, or of so many scales, is infinite instead of a number like 1e-263."""
    unknowns = Unknowns.of(MODEL)
    item, at = unknowns.items[position(unknowns, name)], unknowns.z(MODEL)[position(unknowns, name)]
    assert item.interval(float(at), half) == pytest.approx(expected)
