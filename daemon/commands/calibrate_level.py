"""``lostmotion calibrate level``: the level of eq. 9, or one that keeps a promise, by detector/level.py."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import numpy as np

from lostmotion.daemon import times
from lostmotion.daemon.commands.calibrate_common import (
    CalibrationError,
    about_settings,
    lines_of,
    recordings,
    report,
    toml_out,
)
from lostmotion.daemon.commands.calibrate_windows import read_all, read_settings
from lostmotion.daemon.commands.options import as_json, statistic
from lostmotion.daemon.commands.scoring_options import ScoringOptions
from lostmotion.detector.learner import settled
from lostmotion.detector.level import Level, from_healthy, level, windows_needed, youden
from lostmotion.detector.score import batch
from lostmotion.detector.window import FloatArray

__all__ = ["calibrate_level"]

CRITERIA = {"eq9": level, "youden": youden}
MANY = 0.05
"""Share of healthy windows above a level that is worth a warning."""


def _number(ctx: click.Context, param: click.Parameter, value: float) -> float:
    """The value; click takes nan as within any range."""
    if math.isnan(value):
        raise click.BadParameter("found nan, expected a number", ctx, param)
    return value


@click.command("level", short_help="The level, from healthy and worn joints.")
@recordings
@about_settings
@statistic
@click.option(
    "--false-alarm",
    type=click.FloatRange(0, 0.5, min_open=True),
    callback=_number,
    default=0.01,
    show_default=True,
    metavar="P",
    help="Promised share of healthy windows above the level; without --worn.",
)
@click.option(
    "--criterion",
    type=click.Choice(tuple(CRITERIA)),
    default="eq9",
    show_default=True,
    help="What is best, with --worn: eq. 9, or Youden's J.",
)
@toml_out
@as_json
def calibrate_level(
    recordings: tuple[Path, ...],
    worn: tuple[Path, ...],
    config: Path | None,
    false_alarm: float,
    criterion: str,
    target: Path | None,
    as_json: bool,
    **given: Any,
) -> None:
    """The level: eq. 9 where there are worn recordings, else the one that keeps a promised rate of false alarms."""
    settings = read_settings(recordings[0], config, ScoringOptions(**given))
    cut = read_all(recordings, settings, None)
    settings = settled(cut.accel, cut.rate_hz, settings)
    healthy = _finite(batch(cut.accel, cut.rate_hz, settings))
    if worn:
        bad = read_all(worn, settings, None)
        found, words, counts = _labelled(healthy, _finite(batch(bad.accel, bad.rate_hz, settings)), criterion)
    else:
        found, words, counts = _promised(healthy, false_alarm, cut.duration)
    value = float(f"{found.value:.4g}")
    document = {
        "level": value,
        "statistic": settings.statistic,
        "healthy": healthy.size,
        "refused": cut.refused,
        **counts,
    }
    lines = lines_of({"level": value}, f"[detector], or detector of the [[joint]]; for statistic {settings.statistic}")
    report(document, words, _warnings(found, criterion) if worn else [], lines, target, as_json)


LevelResult = tuple[Level, list[str], dict[str, Any]]
"""A level, the words for it, and what of the document depends on how it was found."""


def _labelled(healthy: FloatArray, worn: FloatArray, criterion: str) -> LevelResult:
    labels = np.arange(healthy.size + worn.size) >= healthy.size
    found = CRITERIA[criterion](np.concatenate([healthy, worn]), labels)
    counts = {
        "worn": worn.size, "false_alarm": None, "false_positive": found.false_positive,
        "false_negative": found.false_negative, "separable": found.separable,
    }  # fmt: skip
    return found, [_counts(found, criterion)], counts


def _promised(healthy: FloatArray, false_alarm: float, duration: float) -> LevelResult:
    _check(healthy.size, false_alarm, duration)
    found = from_healthy(healthy, false_alarm)
    words = [
        f"{healthy.size} healthy windows: a new one exceeds the level with a probability of {false_alarm:.2g}",
        f"(with 99 % confidence between {false_alarm / 2:.2g} and {2 * false_alarm:.2g}, whatever the noise)",
    ]
    counts = {
        "worn": 0, "false_alarm": false_alarm, "false_positive": found.false_positive,
        "false_negative": None, "separable": None,
    }  # fmt: skip
    return found, words, counts


def _finite(scores: FloatArray) -> FloatArray:
    return scores[np.isfinite(scores)]


def _check(count: int, false_alarm: float, duration: float) -> None:
    needed = windows_needed(false_alarm)
    if count >= needed:
        return
    longer = f" (about {times.span(duration * needed / count)} of this motion)" if count else ""
    raise CalibrationError(
        f"found {count} sound healthy windows, expected at least {needed}{longer} to promise a false-alarm rate of "
        f"{false_alarm:g}: record longer, or promise less with --false-alarm"
    )


def _counts(found: Level, criterion: str) -> str:
    worn, healthy = found.correct_accept + found.false_negative, found.correct_reject + found.false_positive
    apart = " (separable: the middle of the gap)" if found.separable else ""
    above = f"{found.correct_accept} of {worn} worn windows above it, {found.false_positive} of {healthy} healthy ones"
    return f"{criterion}: {above}{apart}"


def _warnings(found: Level, criterion: str) -> list[str]:
    """Eq. 9 likes to have none of one kind of error at the price of many of the other."""
    alarms = found.false_positive / max(found.false_positive + found.correct_reject, 1)
    if alarms < MANY:
        return []
    other = "; --criterion youden weighs both kinds of error" if criterion == "eq9" else ""
    return [f"{alarms:.0%} of the healthy windows are above this level{other}"]
