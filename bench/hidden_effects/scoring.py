"""An answer against the truth: what was right, how well the parameters were estimated.  No totals, no printing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Score", "score"]

ERROR_LIMIT = 1.15
LONG = 4.0
"""A recording that is predictable this long [s] is so to its end."""
NOT_JUDGED = ("omega_0", "N")
"""Fixed by convention, or a whole number."""
FLIPPED = {"gear_eccentricity": "e", "gravity_leakage": "c", "torque_ripple": "tau_r"}
"""Sizes whose sign can be had by half a turn of phi."""
BASE = ("d", "alpha", "k", "l", "b", "J")
OUTSIDE_CATALOGUE, NOTHING = "outside_catalogue", "nothing"


@dataclass(frozen=True)
class Score:
    """One case judged.

    truth, told: the effects, or "outside_catalogue" or "nothing"; strict: the right effect first (a pair: both named;
    nothing and outside: the verdict); lenient: named at all, or in a group that the answer calls confusable with what
    it names; error_ok: after the answer's effects within 1.15 of the noise, estimated and true, None where it is not
    asked; inside: by parameter, whether the 95 % interval holds the truth.
    """

    name: str
    kind: str
    truth: tuple[str, ...]
    told: tuple[str, ...]  # a key of the JSON document
    strict: bool
    lenient: bool
    error_ok: bool | None
    inside: Mapping[str, bool] = field(default_factory=dict)
    seconds: float = 0.0
    remark: str = ""


def score(
    name: str, truth: Mapping[str, Any], document: Mapping[str, Any] | None, seconds: float, failure: str
) -> Score:
    """The answer's document, None when there was no answer, against truth.json."""
    kind, hidden = truth["kind"], tuple(truth["effects"])
    expected = (OUTSIDE_CATALOGUE,) if kind == "outside" else hidden or (NOTHING,)
    if document is None:
        return Score(name, kind, hidden or expected, (), False, False, None, {}, seconds, failure)
    named = tuple(document["missing"]) or (
        (OUTSIDE_CATALOGUE,) if document["verdict"] == OUTSIDE_CATALOGUE else (NOTHING,)
    )
    strict, lenient = _named(kind, expected, named, document)
    scored = Score(
        name, kind, hidden or expected, named, strict, lenient, None, {}, seconds, _error_text(document, truth)
    )
    if not strict or kind == "outside":
        return scored
    inside = dict(_covered(hidden, truth["parameters"], document))
    error_ok = _error_ok(document["error"], truth) if hidden else None
    return Score(name, kind, hidden or expected, named, strict, lenient, error_ok, inside, seconds, scored.remark)


def _named(
    kind: str, expected: tuple[str, ...], named: tuple[str, ...], document: Mapping[str, Any]
) -> tuple[bool, bool]:
    if kind == "outside":
        right = document["verdict"] == OUTSIDE_CATALOGUE
        return right, right
    alike = set(named).union(*(group for group in document["confusable"] if set(group) & set(named)))
    lenient = set(expected) <= alike
    if len(expected) > 1:
        return set(expected) <= set(named), lenient
    return named[0] == expected[0] and document["verdict"] != OUTSIDE_CATALOGUE, lenient


def _error_ok(error: Mapping[str, Any], truth: Mapping[str, Any]) -> bool:
    after, noise = error["after"], error["noise"]
    true = math.sqrt(sum(rms**2 for rms in truth["noise"]) / len(truth["noise"]))
    return after is not None and noise is not None and after <= ERROR_LIMIT * min(noise, true)


def _error_text(document: Mapping[str, Any], truth: Mapping[str, Any]) -> str:
    figures = [document["error"][name] for name in ("before", "after", "noise")]
    before, after, noise = ("-" if value is None else f"{value:.3g}" for value in figures)
    chaos = min(truth.get("predictable_s", [LONG]))
    return f"error {before} -> {after}, noise {noise} (true {max(truth['noise']):.3g})" + (
        f", chaotic from {chaos:.1f} s" if chaos < LONG else ""
    )


def _covered(
    effects: tuple[str, ...], true: Mapping[str, float], document: Mapping[str, Any]
) -> list[tuple[str, bool]]:
    """Each parameter of the effects and of the base whose interval the answer gives."""
    intervals = dict(document.get("parameters", {}))
    for entry in document["ranking"]:
        for name, triple in entry["parameters"].items():
            intervals.setdefault(f"{entry['effect']}.{name}", triple)
    wanted = [name for name in true if name in BASE or (name.split(".")[0] in effects and "." in name)]
    found = []
    for name in wanted:
        triple = intervals.get(name)
        if name.split(".")[-1] in NOT_JUDGED or triple is None or None in triple or triple[1] == triple[2]:
            continue
        found.append((name, _holds(name, triple, true, intervals)))
    return found


def _holds(name: str, triple: list[float], true: Mapping[str, float], estimates: Mapping[str, list[float]]) -> bool:
    """Whether low <= truth <= high, for angles in any turn, for sizes with the sign that goes with their phase."""
    effect, _, own = name.rpartition(".")
    value, (_, low, high) = true[name], triple
    flip = effect in FLIPPED and true[f"{effect}.{FLIPPED[effect]}"] * estimates[f"{effect}.{FLIPPED[effect]}"][0] < 0
    if own == "phi":
        value += math.pi if flip else 0.0
        middle = (low + high) / 2
        value = middle + math.remainder(value - middle, 2 * math.pi)
    elif flip and own == FLIPPED[effect]:
        value = -value
    return low <= value <= high
