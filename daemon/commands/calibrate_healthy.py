"""``lostmotion calibrate healthy``: window, bands and noise from a healthy joint, by detector/tuning.py."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.calibrate_common import about_settings, lines_of, recordings, report, toml_out
from lostmotion.daemon.commands.calibrate_windows import Cuttings, read_all, read_settings
from lostmotion.daemon.commands.options import as_json
from lostmotion.daemon.commands.scoring_options import ScoringOptions
from lostmotion.detector.score import batch
from lostmotion.detector.tuning import LONGEST_S, Tuned, least_acceleration, least_amplitude, tune
from lostmotion.detector.window import FloatArray

__all__ = ["calibrate_healthy"]

PLAYS_DEG = (0.03, 0.1, 0.3, 1.0)
"""Plays for which the needed motion is reported."""
GENTLE_DEG = 0.1
"""A motion that cannot make this play detectable is too gentle; at a reversal it changes by twice its amplitude."""
KEYS = ("window_s", "f_width_hz", "f_norm_hz", "f_norm_width_hz", "noise_ms2", "noise_colour", "statistic")


@click.command("healthy", short_help="Window, bands and noise, from a healthy joint.")
@recordings
@about_settings
@toml_out
@as_json
def calibrate_healthy(
    recordings: tuple[Path, ...],
    worn: tuple[Path, ...],
    config: Path | None,
    target: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """Window, bands and noise from recordings of a healthy joint in motion; and the acceleration that is needed.

    Without --worn, simulated rings of the bar are added to the healthy windows.
    """
    settings = read_settings(recordings[0], config, ScoringOptions(**given))
    settings = replace(settings, statistic="ringdown")  # which needs no norm band
    healthy = read_all(recordings, settings, LONGEST_S)
    bad = read_all(worn, settings, LONGEST_S).accel if worn else None
    tuned = tune(healthy.accel, healthy.rate_hz, settings, bad)
    needed, least_ring = _needed(tuned, healthy)
    values = {key: getattr(tuned.settings, key) for key in KEYS}
    if math.isfinite(needed[GENTLE_DEG]):
        values["gentle"] = float(f"{2 * needed[GENTLE_DEG]:.3g}")
    lines = lines_of(values, "[detector], or detector of the [[joint]]; the level comes from calibrate level")
    document = {
        "windows": tuned.windows, "refused": healthy.refused, "settings": values, "found": tuned.found,
        "found_before": tuned.before, "least_ring_ms2": least_ring,
        "needed": [{"play": math.radians(deg), "acceleration": a} for deg, a in needed.items()],
        "motion": _motion(healthy.swing),
    }  # fmt: skip
    report(document, _words(tuned, healthy, needed, bool(worn)), _warnings(needed, healthy), lines, target, as_json)


def _needed(tuned: Tuned, healthy: Cuttings) -> tuple[dict[float, float], float]:
    """Acceleration of a 1 Hz sine [rad/s²] by play [deg], and the least ring that is detected [m/s²]."""
    length = round((tuned.settings.window_s or LONGEST_S) * healthy.rate_hz)
    windows = healthy.accel[:, :length]
    level = max(tuned.settings.level, float(np.quantile(batch(windows, healthy.rate_hz, tuned.settings), 0.99)))
    amplitude = least_amplitude(windows, healthy.rate_hz, tuned.settings, level)
    accelerations = {deg: least_acceleration(amplitude, math.radians(deg), tuned.settings) for deg in PLAYS_DEG}
    return accelerations, amplitude


def _motion(swing: FloatArray) -> float:
    """Amplitude of the recorded acceleration [rad/s²]: about half of its change at a reversal."""
    return float(np.median(swing)) / 2


def _warnings(needed: dict[float, float], healthy: Cuttings) -> list[str]:
    if _motion(healthy.swing) >= needed[GENTLE_DEG]:
        return []
    reached, wanted = _motion(healthy.swing), needed[GENTLE_DEG]
    if math.isinf(wanted):
        return ["no motion makes a play detectable, as these windows have impacts of their own; gentle is left out"]
    advice = "move faster, or take a longer bar or a quieter sensor"
    return [
        f"the motion reached {reached:.2g} rad/s², but {wanted:.2g} make {GENTLE_DEG:g}° of play detectable: {advice}"
    ]


def _words(tuned: Tuned, healthy: Cuttings, needed: dict[float, float], labelled: bool) -> list[str]:
    what = "worn windows" if labelled else "simulated ring-downs added to them"
    found: dict[str, Any] = {"eq. 8 as configured": tuned.before, "eq. 8 tuned": tuned.found["band"]}
    found["ringdown"] = tuned.found["ringdown"]
    accelerations = ", ".join(
        f"{deg:g}° {a:.2g}" if math.isfinite(a) else f"{deg:g}° none" for deg, a in needed.items()
    )
    return [
        f"{tuned.windows} healthy windows ({healthy.refused} not sound) in {healthy.duration:.0f} s",
        f"{what}, share detected at 10 % false alarms: "
        + ", ".join(f"{name} {share:.0%}" for name, share in found.items()),
        f"acceleration of a 1 Hz sine [rad/s²] at which a play is detectable: {accelerations}",
        f"the recorded motion reached {output.number(_motion(healthy.swing))}",
    ]
