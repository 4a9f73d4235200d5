"""Sections about the misfit itself: its spectra, and where it fails."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from lostmotion.lab.report.plots import spectrum
from lostmotion.lab.report.tags import Html, Section, figure, key, note
from lostmotion.lab.report.views import Overlay, spectra

__all__ = ["in_frequency"]


def in_frequency(overlays: Sequence[Overlay]) -> Section | None:
    """Spectra of measured, modelled, residual and noise; None where all recordings are too short."""
    found = [one for one in map(spectra, overlays) if one is not None]
    if not found:
        return None
    pictures = [figure(spectrum(one), f"{one.overlay.what}, {PurePath(one.overlay.recording).name}") for one in found]
    names = key(("measured", "measured"), ("modelled", "modelled"), ("residual", "residual"), ("noise", "noise floor"))
    text = "Where the residual stands above the noise floor, the model fails at that frequency."
    return Section("spectra", "Spectra", Html(f'{note(text)}{names}<div class="plots">{"".join(pictures)}</div>'))
