"""What the lab found, in sentences: the headline of each kind of result."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lostmotion.lab.report import verdict
from lostmotion.lab.results import Ranked
from tests.lab import report_example

RUBS = (
    "Something rubs: Coulomb friction of 0.120 mN m, between 0.112 and 0.128 (95 %). These recordings "
    "do not distinguish it from Stribeck friction."
)


def test_verdict_of_a_missing_effect() -> None:
    """The headline: the effect and its interval, the error before and after against the noise, what cannot be told."""
    assert verdict.of_explanation(report_example.explanation()) == (
        RUBS,
        "Adding it brings the error from 4.1 to 0.41 m/s²; the sensor's noise is 0.40.",
    )


def test_what_the_judged_recording_is_free_of_is_said() -> None:
    """An effect that only the recordings of the fit hold: why the error stays where it was."""
    only = replace(report_example.explanation(), unshown=("coulomb_friction",))
    said = verdict.of_explanation(only)[-1]
    assert said == "Only the fit needs Coulomb friction: the error of the samples kept for judging is as low without."


def test_a_short_part_of_the_recordings_is_not_rounded_to_none() -> None:
    """The 0.4 s that a small budget allowed are told as 0.4, not as 0."""
    said = verdict.of_explanation(replace(report_example.explanation(), used_s=(0.4, 5.0)))[-1]
    assert said == "Of 5 s of recordings the 0.4 s that move most were used; a larger --budget uses more."


def test_what_the_time_did_not_allow_was_not_tried_beside_what_is_named() -> None:
    """The table shows an effect's figures alone; beside the named one it was not tried."""
    said = verdict.of_explanation(replace(report_example.explanation(), untried=("actuator_lag",)))[-1]
    assert said == "Not tried beside Coulomb friction within the time budget (--budget): an actuator that lags."


def test_verdict_of_nothing_missing() -> None:
    """It says so, how close to the noise, and how large each effect would have had to be."""
    explanation = report_example.nothing_missing()
    (said,) = verdict.of_explanation(explanation)
    assert said == "Nothing is missing: the model explains these recordings down to the noise: 0.41 m/s² against 0.40."
    assert verdict.detectable(explanation) == (
        "viscous friction: from 21.0 µN m s/rad on (b_v)",
        "a bar that stiffens: from 0.300 N/mm³ on (k3)",
        "a sensor clock that is off: from 20.0 ppm on (s)",
    )


def test_few_samples_above_the_noise_are_said() -> None:
    """Where the error is more than noise, but not that of most samples."""
    found = report_example.nothing_missing()
    said = verdict.of_explanation(replace(found, error=replace(found.error, after=2 * found.error.noise)))[0]
    assert said.endswith("down to the noise, apart from a few samples: 0.80 m/s² against 0.40.")


@pytest.mark.parametrize(
    ("after", "said"),
    [
        (0.43, "0.15 % of the squared error is left"),
        (0.401, "less than 0.1 % of the squared error is left"),
        (2.0, "23 % of the squared error is left"),
        (5.0, "more than before is left"),
    ],
)
def test_what_is_left_beside_the_named_effects(after: float, said: str) -> None:
    """As a share of the squared error before, which was 4.1 m/s² in noise of 0.40."""
    found = report_example.explanation()
    error, rest = replace(found.error, after=after), report_example.outside_catalogue().residual
    explanation = replace(found, error=error, complete=False, residual=rest, untried=())
    assert f"Beyond the noise, {said}, which no effect of the catalogue explains." in verdict.of_explanation(
        explanation
    )
    explanation = replace(explanation, untried=("actuator_lag",))
    assert f"Beyond the noise, {said}." in verdict.of_explanation(explanation)


def test_verdict_outside_the_catalogue() -> None:
    """It names no effect, says where what is left acts and on what it depends."""
    assert verdict.of_explanation(report_example.outside_catalogue()) == (
        "The error is 3.2 m/s² against 0.40 of noise.",
        "Something is missing that no effect of the catalogue explains.",
        "It acts on the joint and depends on the joint's angle.",
        "A torque against the motion, in a narrow range of the angle.",
    )


def test_verdict_of_effects_that_predict_worse() -> None:
    """What only the fitted recordings show may raise the error of the last one, which is told as such."""
    found = report_example.explanation()
    raised = replace(found, error=replace(found.error, before=0.41, after=4.1))
    assert verdict.of_explanation(raised)[1] == (
        "Adding it raises the error of what was not fitted from 0.41 to 4.1 m/s²; the sensor's noise is 0.40."
    )


def test_verdict_of_a_ladder() -> None:
    """What explain says of it, once, and that nothing more is missing."""
    assert verdict.of_ladder(report_example.ladder()) == (
        RUBS,
        "Adding it brings the error from 4.1 to 0.41 m/s²; the sensor's noise is 0.40.",
        "Nothing more is missing.",
    )


def test_verdict_of_a_fit() -> None:
    """Error against noise for each column, what cannot be told, and whether the fit was stopped early."""
    fitted = report_example.fit()
    assert verdict.of_fit(fitted) == (
        "The error in acceleration is 0.41 m/s²; the noise is 0.40.",
        "Not identifiable from these recordings: alpha.",
    )
    assert "stopped early" in verdict.of_fit(replace(fitted, stopped_early=True))[0]


def test_verdict_of_a_comparison() -> None:
    """Without the friction: the error, the phase and the states it comes from; with it: no more than noise."""
    first, *rest = verdict.of_comparison(report_example.comparison())
    assert first.startswith("The error in acceleration is 8.9 m/s², a fit of −6.7 %; the noise is 0.")
    assert any(said.startswith("It depends on the bar's deflection (") for said in rest)
    assert any(said.startswith("Most of the error is between ") for said in rest)
    assert "nothing is missing here" in verdict.of_comparison(report_example.comparison("coulomb_friction"))[-1]


def test_lists_in_words() -> None:
    """None, one, two and three names."""
    lists = ([], ["a"], ["a", "b"], ["a", "b", "c"])
    assert [verdict.joined(names) for names in lists] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("left", "is_identified", "is_told"), [(0.2, False, True), (0.2, True, False), (0.5, False, False)]
)
def test_an_effect_that_leaves_less_and_is_not_named_is_told(left: float, is_identified: bool, is_told: bool) -> None:
    """A second resonance halves what is left beside the friction that is named, but its size may be zero."""
    given = report_example.explanation()
    other = Ranked("second_mode", given.error.before, left, 1e-6, is_identified=is_identified)
    said = " ".join(verdict.of_explanation(replace(given, ranking=(*given.ranking, other))))
    assert ("Another resonance of the bar alone would leave 0.20 m/s², but is not named" in said) is is_told
