"""``lostmotion score``: the detector over a recording, window by window."""

from __future__ import annotations

import logging
import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from lostmotion.daemon.commands import output
from lostmotion.daemon.commands.scoring_options import ScoringOptions, settings_for
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.pooling import pooled
from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings, Score
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.recording import Recording, read_recording
from lostmotion.drivers.terminal import waiting
from lostmotion.drivers.units import COLUMN_UNITS, MANY_TURNS

__all__ = ["ScoreError", "score"]

KEYS = (
    "time", "duration", "score", "impact", "play", "play_low", "play_high", "severity", "severity_low", "severity_high",
    "quality",
)  # fmt: skip
MILLISECONDS = 0.5
"""No accelerometer is so slow [s]: a usual step of the times beyond this is one in milliseconds."""


log = logging.getLogger(__name__)


class ScoreError(LostmotionError):
    """The recording does not fit the options."""


def score(path: Path, config: Path | None, options: ScoringOptions, as_json: bool) -> None:
    """Prints the score of each window; times are the recording's own [s].  Raises LostmotionError."""
    if options.column not in COLUMN_UNITS:
        raise ScoreError(f"--column: found {options.column!r}, expected one of {', '.join(COLUMN_UNITS)}")
    recording = read_recording(path, options.joint or "")
    _doubt_units(recording)
    name = options.joint or str(recording.metadata.get("joint", "joint"))
    settings = settings_for(recording, config, options)
    _warn_of_others(recording, name)
    with waiting("scoring"):
        scores = _scores(recording, options.column, settings, name)
    if as_json:
        exact = [replace(window, duration=round(window.duration, 6)) for window in scores]  # the rate is an estimate
        windows = [{key: getattr(window, key) for key in KEYS} for window in exact]
        output.print_json({"joint": name, "level": settings.level, "windows": windows})
    else:
        _print(name, settings, scores)


def _doubt_units(recording: Recording) -> None:
    """Warns of angles without a unit that may be degrees."""
    for column in ("command", "position"):
        angles = recording.columns.get(column, np.zeros(1))
        largest = float(np.nanmax(np.abs(angles), initial=0.0))
        if largest > MANY_TURNS and not {f"{column}_unit", "imported"} & set(recording.metadata):
            log.warning(
                '%s: %s goes to %.4g and is taken as rad; if it is degrees, write # %s_unit = "deg" at the top',
                recording.name, column, largest, column,
            )  # fmt: skip


def _warn_of_others(recording: Recording, joint: str) -> None:
    """Warns where other joints move the accelerometer: their impacts are in the windows, too."""
    if others := recording.metadata.get("also_moved_by"):
        names = ", ".join(map(str, others)) if isinstance(others, list) else str(others)
        log.warning(
            "%s: the accelerometer is also moved by %s: impacts and play are those of %s only while %s rests",
            recording.name, names, joint, names,
        )  # fmt: skip


def _scores(recording: Recording, column: str, settings: DetectorSettings, joint: str) -> list[Score]:
    """Raises RecordingError, ScoreError."""
    times, values = recording.signal(column)
    settings = replace(settings, play_size=settings.play_size and column == "accel")
    try:
        return score_series(
            *recording.signal("command"),
            times,
            values,
            settings,
            joint=joint,
            resolution=recording.number("resolution_rad", math.nan),
            range_ms2=recording.number("range_ms2", math.inf),
        )
    except DetectorError as error:
        step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        cause = f'; the times are {step:g} apart: if they are milliseconds, write # time_unit = "ms" at the top'
        raise ScoreError(f"{recording.name}: {error}{cause if step > MILLISECONDS else ''}") from error


def _print(name: str, settings: DetectorSettings, scores: list[Score]) -> None:
    impacts = sum(window.impact for window in scores)
    used = f"(f_res {settings.f_res_hz:g} Hz, level {settings.level:g})"
    joint = "joint" if name == "joint" else f"joint {name}"  # the default of a recording without a name
    output.print_lines([f"{joint}: {output.counted(len(scores), 'window')}, {impacts} with impact {used}"])
    if scores:
        columns = ("time [s]", "duration [s]", "score", "impact", "play", "severity", "quality")
        output.print_table(columns, [_row(window) for window in scores], right=columns[:3])
    if impacts:
        output.print_lines([_play(scores)])


def _play(scores: list[Score]) -> str:
    """The size of the play over all windows, and why some have none."""
    halves = [(window.play_high - window.play_low) / 2 for window in scores]
    size = pooled([window.play for window in scores], halves)
    unknown = Counter(window.play_reason for window in scores if window.impact and window.play_reason)
    why = "".join(f"; {output.counted(count, 'window')}: {reason}" for reason, count in unknown.most_common(2))
    if size.reason:
        return f"play: unknown, {size.reason}{why}"
    degrees = [f"{math.degrees(angle):.3f}" for angle in (size.value, size.low, size.high)]
    return f"play: {output.arcmin(size.value)}, {degrees[0]}° (95 %: {degrees[1]} to {degrees[2]}){why}"


def _row(window: Score) -> list[str]:
    return [
        f"{window.time:.3f}",
        f"{window.duration:.3f}",
        output.number(window.score),
        "impact" if window.impact else "",
        output.arcmin(window.play),
        output.arcmin(window.severity),
        window.quality,
    ]
