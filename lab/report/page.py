"""The report as a file: its sections, their order, and the page around them."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path, PurePath
from string import Template

import lostmotion
from lostmotion.detector.oscillator_id import Oscillator
from lostmotion.drivers.recording import replacing
from lostmotion.lab.comparison.compare import Comparison
from lostmotion.lab.report import findings, fitted, misfit, verdict
from lostmotion.lab.report.signals import packed, signals
from lostmotion.lab.report.tags import Html, Section, paragraphs
from lostmotion.lab.report.views import Trace, before, traces
from lostmotion.lab.results import Explanation, Fit, Ladder

__all__ = ["write_report"]

ASSETS = files("lostmotion.lab.report") / "assets"


def write_report(
    path: str | Path,
    *,
    title: str = "Model against measurement",
    comparison: Comparison | None = None,
    fit: Fit | None = None,
    explanation: Explanation | None = None,
    ladder: Ladder | None = None,
    tap: Oscillator | None = None,
) -> None:
    """Writes a report of the given results to a file; an existing file is replaced atomically.

    tap: the bar's resonance and damping from a tap.  Raises RecordingError where the file cannot be written.
    """
    explanation = explanation or (ladder.last if ladder else None)
    fit = fit or (explanation.best if explanation else None)
    drawn = tuple(traces(fit, comparison, before(fit, explanation)))
    sections = _sections(drawn, comparison, fit, explanation, ladder, tap)
    text = _page(title, _subtitle(comparison or fit), sections, drawn)
    with replacing(path) as file:
        file.write(text)


def _sections(
    drawn: Sequence[Trace],
    comparison: Comparison | None,
    fit: Fit | None,
    explanation: Explanation | None,
    ladder: Ladder | None,
    tap: Oscillator | None,
) -> tuple[Section, ...]:
    found, source = explanation, fit or comparison
    possible = (
        _headline(comparison, fit, explanation, ladder),
        findings.ladder(ladder) if ladder else None,
        findings.advice(found) if found else None,
        signals(drawn) if drawn else None,
        findings.left(found.residual, found.error.unit) if found and found.residual else None,
        misfit.errors(comparison) if comparison else None,
        misfit.over_time(comparison) if comparison else None,
        misfit.over_states(comparison) if comparison else None,
        misfit.in_frequency(drawn, comparison),
        misfit.over_lags(comparison) if comparison else None,
        findings.ranking(found) if found else None,
        findings.detectable(found) if found else None,
        fitted.model(source.model) if source else None,
        fitted.parameters(fit) if fit else None,
        fitted.correlations(fit) if fit else None,
        _tap(tap) if tap else None,
    )
    return tuple(section for section in possible if section is not None)


def _headline(
    comparison: Comparison | None, fit: Fit | None, explanation: Explanation | None, ladder: Ladder | None
) -> Section | None:
    """The verdict in sentences, and what to inspect on the robot; None without a result."""
    if ladder:
        sentences, effects = verdict.of_ladder(ladder), ladder.last.missing
    elif explanation:
        sentences, effects = verdict.of_explanation(explanation), explanation.missing
    elif fit:
        sentences, effects = verdict.of_fit(fit), ()
    elif comparison:
        sentences, effects = verdict.of_comparison(comparison), ()
    else:
        return None
    tone = explanation.verdict if explanation else ""
    body = paragraphs(sentences, "tells") + findings.remedies(effects)
    return Section("verdict", "In plain words", Html(f'<div class="headline {tone}">{body}</div>'))


def _tap(tap: Oscillator) -> Section:
    text = f"Resonance {tap.f_res_hz:.2f} Hz, damping ratio {tap.zeta:.4f}, from {tap.cycles:.0f} cycles of ring-down."
    return Section("tap", "The bar, from a tap", paragraphs([text]))


def _page(title: str, subtitle: str, sections: Sequence[Section], drawn: Sequence[Trace]) -> str:
    licence = _comment(_asset("uPlot.LICENSE.txt"))
    script = "\n".join((_asset("language.js"), licence, _asset("uPlot.iife.min.js"), _asset("report.js")))
    return Template(_asset("page.html")).substitute(
        title=escape(title),
        version=escape(lostmotion.__version__),
        subtitle=subtitle,
        style=_asset("uPlot.min.css") + "\n" + _asset("report.css"),
        contents="".join(f'<a href="#{section.id}">{escape(section.heading)}</a>' for section in sections),
        sections="\n".join(section.html() for section in sections),
        signals=packed(drawn),
        script=script,
    )


def _subtitle(source: Comparison | Fit | None) -> Html:
    if source is None:
        return Html()
    names = ", ".join(dict.fromkeys(PurePath(experiment.name).name for experiment in source.experiments))
    active = ", ".join(source.model.effects) or "none"
    return paragraphs([f"base {source.model.base}; active effects: {active}; recordings: {names}"])


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _comment(text: str) -> str:
    return f"/*! uPlot\n{text}*/"
