"""The results of the lab in sentences, for the terminal, the report, notebooks and ``--json``.

words.py has the sentences on single effects.  Nothing is computed here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from lostmotion.lab import policy, words
from lostmotion.lab.comparison.compare import MENTIONED, Comparison
from lostmotion.lab.data.experiment import axis_of
from lostmotion.lab.data.series import direction
from lostmotion.lab.quantity import Interval, number, quantities, quantity, with_unit
from lostmotion.lab.results import Displayed, Errors, Estimate, Explanation, Finding, Fit, InputLimit, Ladder
from lostmotion.model.effects import get_effect

__all__ = [
    "detectable",
    "joined",
    "of",
    "of_comparison",
    "of_explanation",
    "of_finding",
    "of_fit",
    "of_ladder",
]

MOST_VARIABLES = 3
"""Largest number of variables in a sentence."""
UNSEEN_RATIO = 3.0
"""Ratio of the error on unseen samples to that of the fit, from which on a sentence reports it.  Of 41 answers on
measured machines 36 have at most 2.3.  Of the five from 3.0 on one lacks an effect, one has an effect that raises the
error there, one was cut off by the time, and two name what is expected."""
PLACES = {"joint": "the joint", "oscillator": "the bar", "sensor": "the sensor"}


def of(found: Displayed) -> tuple[str, ...]:
    """Sentences on a result of any kind."""
    if isinstance(found, Ladder):
        return of_ladder(found)
    if isinstance(found, Explanation):
        return of_explanation(found)
    if isinstance(found, Fit):
        return of_fit(found)
    assert isinstance(found, Comparison)
    return of_comparison(found)


def of_explanation(explanation: Explanation) -> tuple[str, ...]:
    """Sentences on the missing effects and their sizes, on the errors, and on structure that no effect explains."""
    error, found = explanation.error, explanation.residual
    sentences = [_named(effect, explanation) for effect in explanation.missing]
    if explanation.verdict == "nothing_missing":
        apart = ", apart from a few samples" if error.after > policy.STRUCTURED * error.noise else ""
        sentences.append(
            f"Nothing is missing: the model explains these recordings down to the noise{apart}: {_against(error)}."
        )
    else:
        noise = "noise" if explanation.input_limit else "sensor's noise"
        sentences.append(_falls(error, len(explanation.missing), noise))
    if explanation.verdict == "outside_catalogue":
        sentences.append(
            "Something is missing; the time was not enough to say what."
            if explanation.untried
            else "Something is missing that no effect of the catalogue explains."
        )
        sentences += of_finding(found) if found else ()
    if explanation.missing and not explanation.complete and found:
        sentences.append(_left(error, is_tried=not explanation.untried))
        sentences += of_finding(found)
    sentences += _constant(explanation)
    sentences += _unidentified(explanation)
    sentences += _on_unseen_samples(explanation)
    sentences += [_held(one) for one in explanation.held]
    if explanation.input_limit:
        sentences.append(_limited(explanation.input_limit, error))
    sentences += _unused(explanation)
    if explanation.unshown:
        effects = joined([words.name(effect) for effect in explanation.unshown])
        sentences.append(f"Only the fit needs {effects}: the error of the samples kept for judging is as low without.")
    return tuple(sentences)


def _left(error: Errors, is_tried: bool) -> str:
    """A sentence on what is left beyond the noise beside the effects that are named, as a share of the squared error
    before them; is_tried: whether all effects were tried."""
    share = max(error.after**2 - error.noise**2, 0.0) / error.before**2 if error.before else 1.0
    figure = "less than 0.1" if share < 0.001 else f"{100 * share:.0f}" if share > 0.1 else f"{100 * share:.2g}"
    size = f"{figure} % of the squared error" if share < 1 else "more than before"
    return f"Beyond the noise, {size} is left{', which no effect of the catalogue explains' if is_tried else ''}."


def _named(effect: str, explanation: Explanation) -> str:
    """A sentence on a missing effect with its size, and on the effects that are confusable with it."""
    sizes = words.intervals(explanation.best, effect)
    sentence = words.sentence(effect, sizes)
    may_vanish = [sizes[name] for name in get_effect(effect).amplitudes if name in sizes]
    if may_vanish and all(one.low <= 0.0 <= one.high for one in may_vanish):
        sentence += " Its size may be zero, if what is left disturbs the motion for long."
    alike = [words.name(name) for group in explanation.confusable if group[0] == effect for name in group[1:]]
    if not alike:
        return sentence
    return f"{sentence} These recordings do not distinguish it from {joined(alike)}."


def _constant(explanation: Explanation) -> list[str]:
    """A sentence on a constant torque beside the effects, where it is larger than the error that is left."""
    shown, error = explanation.best.experiments, explanation.error
    found = next((one for one in explanation.best.estimates if one.name == "bias"), None)
    if found is None or explanation.columns.get("torque") is not error or not explanation.missing:
        return []
    if found.low <= 0.0 <= found.high or abs(found.value) <= error.after:
        return []
    what, _ = words.column("torque", *axis_of(shown))
    size = Interval(found.value, found.low, found.high, found.unit)
    angles = [one.measured["position"] for one in shown if "position" in one.measured]
    why = ": dry friction, as the motion has one direction, or" if direction(angles) else ", or is"
    return [f"A constant {what} of {size}, acts as well{why} the zero of what was recorded."]


def _unidentified(explanation: Explanation) -> list[str]:
    """A sentence on the best effect that leaves less than what is named, and is not identified."""
    best = min(explanation.unidentified, key=lambda one: one.rms_after, default=None)
    if best is None:
        return []
    left = quantity(best.rms_after, explanation.error.unit, 2)
    said = f"{words.name(best.effect).capitalize()} alone would leave {left}"
    return [f"{said}, but is not named: its size may be zero, or its estimates are not those of this effect."]


def _on_unseen_samples(explanation: Explanation) -> list[str]:
    """A sentence where far more is left of the samples kept for judging than of those of the fit."""
    error = explanation.error
    of_fit = next((explanation.best.rms.get(name) for name, one in explanation.columns.items() if one is error), None)
    if explanation.complete or not of_fit or error.after < UNSEEN_RATIO * of_fit:
        return []
    times = number(error.after / of_fit, 0)
    why = "they move otherwise, or something acts that hardly acts in the others"
    return [f"The samples kept for judging leave {times} times as much as those of the fit: {why}."]


def _unused(explanation: Explanation) -> list[str]:
    """Sentences on the effects and the data that the search left out."""
    sentences = []
    if explanation.untried:
        effects = joined([words.name(effect) for effect in explanation.untried])
        beside = joined([words.name(effect) for effect in explanation.missing])
        where = f" beside {beside}" if beside else ""
        sentences.append(f"Not tried{where} within the time budget (--budget): {effects}.")
    used, whole = explanation.used_s or (0.0, 0.0)
    if used < whole:
        part = number(used, 1 if used < 10 else 0)
        sentences.append(
            f"Of {whole:.0f} s of recordings the {part} s that move most were used; a larger --budget uses more."
        )
    left, segments = explanation.left_out
    if left:
        sentences.append(
            f"{left} of {segments} segments of the recording kept for judging could not be followed, and do not count "
            "in the errors."
        )
    return sentences


def of_finding(finding: Finding) -> tuple[str, ...]:
    """Sentences on the equation on which the structure of a residual acts, its variables, and its shape."""
    place = PLACES.get(finding.acts_on, finding.acts_on)
    depends = joined([words.variable(name)[0] for name in finding.depends_on])
    where = f"It acts on {place}" + (f" and depends on {depends}." if depends else ".")
    text = finding.description
    return (where, f"{text[0].upper()}{text[1:].rstrip('.')}.") if text else (where,)


def of_fit(fit: Fit) -> tuple[str, ...]:
    """Sentences on the error in each column, and on parameters that are not identifiable or held."""
    sentences = ["The fit was stopped early: these are the best figures until then."] if fit.stopped_early else []
    for column, rms in fit.rms.items():
        what, si = words.column(column, *axis_of(fit.experiments))
        (error, noise), unit = quantities(si, rms, fit.noise.get(column, math.nan))
        sentences.append(f"The error in {what} is {with_unit(error, unit)}; the noise is {noise}.")
    hidden = [e.name for e in fit.estimates if not e.identified]
    if hidden:
        sentences.append(f"Not identifiable from these recordings: {joined(hidden)}.")
    return (*sentences, *map(_held, fit.held))


def of_comparison(comparison: Comparison) -> tuple[str, ...]:
    """Sentences on the error in each column, and on where the error in the main column arises."""
    sentences = [_error_in(column, comparison) for column in comparison.columns]
    horizon = min(one.horizon_s for one in comparison.overlays)
    if math.isfinite(horizon):
        sentences.append(
            f"The motion can be predicted for {horizon:.1f} s only; later samples can be compared only statistically."
        )
    if comparison.is_noise:
        last = "The residual is as large as the noise and depends on no variable: nothing is missing here."
        return (*sentences, last)
    return (*sentences, *_where(comparison), *_why(comparison.localisation))


def _error_in(column: str, comparison: Comparison) -> str:
    what, si = comparison.label(column)
    (error, noise), unit = quantities(si, comparison.rms(column), comparison.columns[column].noise.rms)
    fit = f"{number(comparison.fit_percent(column), 1)} %"
    return f"The error in {what} is {with_unit(error, unit)}, a fit of {fit}; the noise is {noise}."


def _where(comparison: Comparison) -> list[str]:
    """Sentences on the phase of the motion, the frequencies and the variables that have most of the error."""
    column = comparison.column
    phase, unit = comparison.worst_phase(column), comparison.label(column)[1]
    size, share = quantity(phase.rms, unit, 2), 100 * phase.error
    sentences = [f"The error is largest {phase.phase}: {size} there, {share:.0f} % of the squared error."]
    bands = [band for band in comparison.columns[column].spectra.bands if band.stands_out]
    if bands:
        band = max(bands, key=lambda one: one.residual)
        sentences.append(f"Most of the error is between {band.low_hz:.2g} and {band.high_hz:.2g} Hz.")
    maps = [one for one in comparison.columns[column].maps if one.significant and one.explained > MENTIONED]
    if maps:
        named = [f"{words.variable(one.variable)[0]} ({100 * one.explained:.0f} % of it)" for one in maps]
        sentences.append(f"It depends on {', on '.join(named[:MOST_VARIABLES])}.")
    return sentences


def _why(localisation: Finding | None) -> list[str]:
    """Sentences on the equation in which the error arises."""
    if localisation is None:
        return ["No single equation explains it: first fit the parameters (lostmotion lab fit)."]
    return [
        f"With these parameters it looks as if {localisation.description}.",
        "Wrong parameters have the same effect: run lostmotion lab fit first, then lostmotion lab explain.",
    ]


def of_ladder(ladder: Ladder) -> tuple[str, ...]:
    """The sentences on the last search of a ladder, and whether anything more is missing."""
    last = ladder.last
    return (*of_explanation(last), *(("Nothing more is missing.",) if last.missing and last.complete else ()))


def detectable(explanation: Explanation) -> tuple[str, ...]:
    """For each absent effect, the size from which on it would have been detected."""
    base = explanation.base.model.base
    return tuple(
        f"{words.name(effect)}: from {words.size(effect, parameter, value, base)} on ({parameter})"
        for effect, (parameter, value) in explanation.detectable.items()
    )


def joined(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _falls(error: Errors, count: int, what: str) -> str:
    """ "Adding it brings the error from 4.1 to 0.41 m/s²; the sensor's noise is 0.40." """
    if not count:
        return f"The error is {_against(error)} of noise."
    (before, after, noise), unit = quantities(error.unit, error.before, error.after, error.noise)
    them = "it" if count == 1 else "them"
    turns = "brings the error" if error.after <= error.before else "raises the error of what was not fitted"
    return f"Adding {them} {turns} from {before} to {with_unit(after, unit)}; the {what} is {noise}."


def _limited(limit: InputLimit, error: Errors) -> str:
    """A sentence on the error that the recorded command causes."""
    (causes, sensor, added), unit = quantities(error.unit, limit.error, limit.sensor, error.noise)
    steps = f"in steps of {quantity(limit.step, 'rad', 2)}" if limit.step else f"{limit.rate_hz:.0f} times a second"
    return (
        f"The command is recorded {steps}, which alone causes an error of {with_unit(causes, unit)}. So that it is not "
        f"taken for an effect, the readings were given a noise of {added} instead of {with_unit(sensor, unit)}."
    )


def _held(one: Estimate) -> str:
    """A sentence on a parameter whose value no recording determines."""
    of_motor = one.unit == "N m/A"
    known = (
        "give it, or the inertia, with fixed = true" if of_motor else "give it in the model file, or record the input"
    )
    return f"Only ratios to {one.name} are identifiable: {one.name} stays at {quantity(one.value, one.unit)}; {known}."


def _against(error: Errors) -> str:
    """ "0.41 m/s² against 0.40": the error and the noise."""
    (after, noise), unit = quantities(error.unit, error.after, error.noise)
    return f"{with_unit(after, unit)} against {noise}"
