"""The report's sections on a comparison: errors of each recording, over time, over states, over frequency."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import groupby
from pathlib import PurePath

import numpy as np

from lostmotion.lab import words
from lostmotion.lab.comparison.compare import Comparison, Overlay
from lostmotion.lab.comparison.residual_analysis import Block, PhaseError
from lostmotion.lab.data.whiteness import Correlation
from lostmotion.lab.discrepancy.residual_maps import ResidualMap
from lostmotion.lab.quantity import number, quantities, with_unit
from lostmotion.lab.report.plots import curve, history, spectrum, stems
from lostmotion.lab.report.tags import Html, Section, bar, cell, figure, key, more, note, p_value, table
from lostmotion.lab.report.views import Trace, amplitudes

__all__ = ["errors", "in_frequency", "over_lags", "over_states", "over_time"]


def errors(comparison: Comparison) -> Section:
    """Fit, error, noise and predictability horizon of every column of every recording."""
    rows = [(cell(PurePath(one.recording).name, one.what), *_errors(one))
            for one in comparison.overlays]  # fmt: skip
    text = (
        "Fit: 100 % is perfect, 0 % no better than the mean. Predictable: until then motions that begin alike stay "
        "alike; later, samples can be compared only statistically."
    )
    head = ("recording", "fit>", "error>", "noise>", "predictable>")
    return Section("errors", "Errors, recording by recording", Html(note(text) + table(head, rows)))


def over_time(comparison: Comparison) -> Section:
    """The errors in each phase of the motion, and over the time of each recording."""
    column = comparison.column
    what, unit = comparison.label(column)
    rows = [_phase(one, unit) for one in comparison.columns[column].phases]
    text = "Bar: the share of the squared error that arises in this phase; dashed: the share of the time that it takes."
    phases = note(text) + table(("phase", f"error in {what}", "share>", "error>"), rows)
    grouped = groupby(comparison.columns[column].blocks, key=lambda block: block.recording)
    pictures = [_history(name, list(blocks), what, unit, comparison) for name, blocks in grouped]
    return Section("time", "When it fails", Html(phases + _grid(pictures)))


def over_states(comparison: Comparison) -> Section | None:
    """The residual of each column over each variable, significant maps unfolded; None where there are no maps."""
    pictures = [
        (one.significant, _map(comparison.label(column), one))
        for column, found in comparison.columns.items()
        for one in found.maps
    ]
    if not pictures:
        return None
    seen = [picture for matters, picture in pictures if matters]
    quiet = [picture for matters, picture in pictures if not matters]
    text = (
        "The residual, averaged over each state of the motion, with the band that contains 95 % of pure noise. "
        "A curve that leaves the band shows what the missing effect depends on."
    )
    body = note(text) + (_grid(seen) if seen else note("Nothing stands out here."))
    if quiet:
        body += more(f"{len(quiet)} that show nothing beyond chance", _grid(quiet))
    return Section("maps", "Where it fails", Html(body))


def in_frequency(traces: Iterable[Trace], comparison: Comparison | None) -> Section | None:
    """Spectra of measured, modelled, residual and noise; None where all recordings are too short."""
    found = [one for one in (amplitudes(trace, comparison) for trace in traces) if one is not None]
    if not found:
        return None
    pictures = [figure(spectrum(one), one.trace.title) for one in found]
    names = key(("measured", "measured"), ("modelled", "modelled"), ("residual", "residual"), ("noise", "noise floor"))
    text = "Where the residual stands above the noise floor, the model fails at that frequency."
    return Section("spectra", "Spectra", Html(note(text) + names + _grid(pictures)))


def over_lags(comparison: Comparison) -> Section | None:
    """The correlations of the residual with itself and with the input; None where there are none."""
    tests = [(f"{comparison.label(column)[0]}: {name}", one)
             for column, found in comparison.columns.items() for name, one in found.tests.items()]  # fmt: skip
    if not tests:
        return None
    pictures = [figure(stems(name, one.lags, one.values, one.bound), name, _verdict(one)) for name, one in tests]
    text = (
        "A residual that is only noise resembles neither its own past nor the input: in 95 % of cases not one of its "
        "correlations leaves the band."
    )
    return Section("lags", "Is what is left only noise?", Html(note(text) + _grid(pictures)))


def _errors(one: Overlay) -> tuple[Html, ...]:
    (error, noise), unit = quantities(one.unit, one.rms, one.noise)
    horizon = f"{one.horizon_s:.1f} s" if math.isfinite(one.horizon_s) else "to the end"
    texts = (f"{number(one.fit_percent, 1)} %", with_unit(error, unit), with_unit(noise, unit), horizon)
    return tuple(cell(text, css="number") for text in texts)


def _phase(one: PhaseError, unit: str) -> tuple[Html, ...]:
    (error,), shown = quantities(unit, one.rms)
    share = cell(f"{100 * one.error:.0f} %", css="number")
    return cell(one.phase), bar(one.error, one.samples), share, cell(with_unit(error, shown), css="number")


def _history(name: str, blocks: Sequence[Block], what: str, unit: str, comparison: Comparison) -> Html:
    middle = np.array([(block.start + block.stop) / 2 for block in blocks])
    rms = np.array([block.rms for block in blocks])
    title = f"error in {what}, {PurePath(name).name}"
    return figure(
        history(title, f"error, {what}", unit, middle, rms, comparison.columns[comparison.column].noise.rms), title
    )


def _map(label: tuple[str, str], one: ResidualMap) -> Html:
    (what, unit), (left, left_unit) = words.variable(one.variable), label
    picture = curve(f"Residual of {left} against {what}", one.x, one.mean, -one.half_width, one.half_width,
                    (what, f"residual, {left}"), (unit, left_unit))  # fmt: skip
    share = f"takes {number(100 * one.explained, 0)} % of what is left" if one.significant else "nothing beyond chance"
    return figure(picture, f"{left} against {what}:", f"{share}, {p_value(one.p_value)}")


def _verdict(one: Correlation) -> str:
    return f"{'more than noise' if one.significant else 'like noise'}, {p_value(one.p_value)}"


def _grid(pictures: Sequence[str]) -> Html:
    return Html(f'<div class="plots">{"".join(pictures)}</div>')
