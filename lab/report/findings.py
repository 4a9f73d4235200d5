"""The report's sections on a search for missing effects: ladder, ranking, detectable sizes, structure of the
residual."""

from __future__ import annotations

import math

from lostmotion.lab import words
from lostmotion.lab.quantity import Interval, quantities, scale, with_unit
from lostmotion.lab.report import verdict
from lostmotion.lab.report.plots import curve
from lostmotion.lab.report.tags import Html, Section, bar, cell, figure, note, paragraphs, probability, table
from lostmotion.lab.results import Curve, Explanation, Finding, Ladder, Ranked, Rung
from lostmotion.model import Parameter
from lostmotion.model.effects import get_effect

__all__ = ["advice", "detectable", "ladder", "left", "ranking", "remedies"]


def remedies(effects: tuple[str, ...]) -> Html:
    """Paragraphs on what to inspect on the robot, for each of these effects."""
    return paragraphs(words.look(effect) for effect in effects)


def ladder(climbed: Ladder) -> Section:
    """The error after each added effect, and the noise."""
    largest = max(rung.rms for rung in climbed.rungs)
    befores: list[tuple[str, ...] | None] = [None, *(rung.effects for rung in climbed.rungs[:-1])]
    errors, unit = quantities(climbed.rungs[0].unit, *(rung.rms for rung in climbed.rungs))
    noises, _ = quantities(climbed.rungs[0].unit, largest, *(rung.noise for rung in climbed.rungs))
    rows = [
        (_rung(rung, before), bar(rung.rms / largest, rung.noise / largest),
         cell(with_unit(error, unit), css="number"), cell(with_unit(noise, unit), css="number"))
        for rung, before, error, noise in zip(climbed.rungs, befores, errors, noises[1:], strict=True)
    ]  # fmt: skip
    text = "Root mean square of measured minus modelled, on data that the fit has not seen. Dashed: the noise floor."
    return Section("ladder", "How the error fell",
                   Html(note(text) + table(("", "error", "error>", "noise>"), rows)))  # fmt: skip


def ranking(explanation: Explanation) -> Section | None:
    """The effects that were found, then the others that were tried, best first; None where none was."""
    tried = explanation.ranking
    if not tried:
        return None
    unit, noise = explanation.error.unit, explanation.error.noise
    largest = max((v for r in tried for v in (r.rms_before, r.rms_after) if math.isfinite(v)), default=1.0) or 1.0
    rows = [
        (_tried(explanation, entry), bar(entry.rms_after / largest, noise / largest),
         *_errors(entry, unit), cell(probability(entry.p_value), css="number"))
        for entry in tried
    ]  # fmt: skip
    shown = scale(unit, largest).unit
    text = (
        f"Errors in {shown} on data that the fit has not seen: of what was found, each beside those above it; of the "
        "others, each alone. Dashed: the noise. p: the chance that an effect which is not there would do as well."
    )
    head = ("effect", "error with it", "before>", "after>", "p>")
    return Section("ranking", "Which effects were tried",
                   Html(note(text) + table(head, rows, (e.effect in explanation.missing for e in tried))))  # fmt: skip


def detectable(explanation: Explanation) -> Section | None:
    """The size at which each effect would have been detected; None where it was not computed."""
    if not explanation.detectable:
        return None
    base = explanation.base.model.base
    rows = [
        (cell(words.name(effect), effect), cell(words.size(effect, name, value, base), _meaning(effect, name, base)))
        for effect, (name, value) in explanation.detectable.items()
    ]
    text = "An effect that is not named above is smaller than this, or these recordings would have shown it."
    return Section("detectable", "What would have been seen",
                   Html(note(text) + table(("effect", "seen from"), rows)))  # fmt: skip


def left(finding: Finding, unit: str) -> Section:
    """The structure of the residual that no effect explains: description, curve, formula; unit: of the curve where the
    finding states none."""
    body = paragraphs(verdict.of_finding(finding))
    if finding.formula:
        body = Html(body + paragraphs([f"A short formula that fits: {finding.formula}"]))
    if finding.curve is not None:
        body = Html(body + _shape(finding.curve, finding.curve.mean_unit or unit))
    return Section("left", "What no effect of the catalogue explains", body)


def advice(explanation: Explanation) -> Section | None:
    """The proposed next experiment; None without advice."""
    if not explanation.advice:
        return None
    return Section("advice", "What to record next", paragraphs([explanation.advice]))


def _rung(rung: Rung, before: tuple[str, ...] | None) -> Html:
    new = [words.name(effect) for effect in rung.effects if effect not in (before or ())]
    what = "the model as given" if before is None else f"with {verdict.joined(new)}"
    return cell(what, ", ".join(rung.effects) or "no effects")


def _meaning(effect: str, parameter: str, base: str) -> str:
    meaning = get_effect(effect).parameters_on(base)[parameter].meaning
    return f"{parameter}, {meaning}" if meaning else parameter


def _errors(entry: Ranked, unit: str) -> tuple[Html, Html]:
    (before, after), _ = quantities(unit, entry.rms_before, entry.rms_after, digits=3)
    return cell(before, css="number"), cell(after, css="number")


def _tried(explanation: Explanation, entry: Ranked) -> Html:
    known = get_effect(entry.effect).parameters_on(explanation.base.model.base)
    short = {name.removeprefix(f"{entry.effect}."): triple for name, triple in entry.parameters.items()}
    values = (_size(name, triple, known[name]) for name, triple in short.items() if name in known)
    return cell(words.name(entry.effect), entry.effect, *values)


def _size(name: str, triple: tuple[float, float, float], parameter: Parameter) -> str:
    """A parameter with its interval (value, low, high), or that it is not identifiable, where the interval contains all
    possible values."""
    _, low, high = triple
    if low <= parameter.low and high >= parameter.high:
        return f"{name} is not identifiable"
    return f"{name} = {Interval(*triple, parameter.unit)}"


def _shape(shape: Curve, unit: str) -> Html:
    what, _ = words.variable(shape.variable)
    title = f"Residual over {what}."
    picture = curve(title, shape.x, shape.mean, shape.low, shape.high, (what, "what is left"), (shape.unit, unit))
    return figure(picture, title, "Mean with its 95 % band.")
