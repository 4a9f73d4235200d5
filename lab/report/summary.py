"""A comparison in a few lines: the error, where it occurs, and its cause.  Numbers are computed elsewhere."""

from __future__ import annotations

import math

from lostmotion.lab import words
from lostmotion.lab.comparison.compare import MENTIONED, Comparison
from lostmotion.lab.quantity import quantities
from lostmotion.lab.report.verdict import worst_phase

__all__ = ["summary"]


def summary(comparison: Comparison) -> list[str]:
    """The lines, the main one first."""
    column = comparison.column
    lines = [_size(comparison, name) for name in comparison.maps]
    horizon = min(one.horizon_s for one in comparison.overlays)
    if math.isfinite(horizon):
        lines.append(
            f"The modelled motion can be predicted for {horizon:.1f} s only; later samples carry little information."
        )
    if comparison.is_noise:
        return [*lines, "The residual is as large as the noise and depends on no variable: nothing is missing here."]
    return [*lines, *_where(comparison, column), *_why(comparison)]


def _size(comparison: Comparison, name: str) -> str:
    what, unit = comparison.label(name)
    (error, noise), unit = quantities(unit, comparison.rms(name), comparison.noise[name].rms)
    return (
        f"{what}: fit {comparison.fit_percent(name):.1f} %, error {error} {unit} where the noise is {noise} {unit}"
        f"{': down to the noise' if comparison.is_small(name) else ''}"
    )


def _where(comparison: Comparison, column: str) -> list[str]:
    lines = [worst_phase(comparison, column)]
    bands = [band for band in comparison.spectra[column].bands if band.stands_out]
    if bands:
        band = max(bands, key=lambda one: one.residual)
        lines.append(f"Most of the error is between {band.low_hz:.2g} and {band.high_hz:.2g} Hz.")
    maps = [one for one in comparison.maps[column] if one.significant and one.explained > MENTIONED]
    if maps:
        named = [f"{words.variable(one.variable)[0]} ({100 * one.explained:.0f} % of it)" for one in maps[:3]]
        lines.append(f"It depends on {', on '.join(named)}.")
    return lines


def _why(comparison: Comparison) -> list[str]:
    localisation = comparison.localisation
    if localisation is None:
        return ["No single equation explains it: first fit the parameters (lostmotion lab fit)."]
    return [
        f"With these parameters it looks as if {localisation.description}.",
        "Wrong parameters have the same effect: run lostmotion lab fit first, then lostmotion lab explain.",
    ]
