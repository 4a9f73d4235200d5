"""``lostmotion calibrate tap``: the oscillator from recordings of taps.  The numbers are detector/taps.py's."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from lostmotion.daemon.commands.calibrate_common import CalibrationError, lines_of, recordings, report, toml_out
from lostmotion.daemon.commands.options import as_json, column
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.taps import Calibrated, Estimate, TapRecording, find_taps, pooled
from lostmotion.drivers.recording import read_recording
from lostmotion.drivers.units import COLUMN_UNITS

__all__ = ["calibrate_tap"]


@click.command("tap", short_help="Resonance and damping of the bar, from taps.")
@recordings
@column
@toml_out
@as_json
def calibrate_tap(recordings: tuple[Path, ...], column: str, target: Path | None, as_json: bool) -> None:
    """The oscillator's resonance and damping from recordings of taps on the bar, some seconds apart."""
    if column not in COLUMN_UNITS:
        raise CalibrationError(f"--column: found {column!r}, expected one of {', '.join(COLUMN_UNITS)}")
    found = pooled([_taps(path, column) for path in recordings])
    lines = lines_of(
        {"f_res_hz": round(found.f_res_hz.value, 3), "zeta": round(found.zeta.value, 5)},
        "oscillator of the [[accelerometer]]; keep its length_m",
        "oscillator",
    )
    report(asdict(found), _words(found), found.warnings, lines, target, as_json)


def _taps(path: Path, column: str) -> TapRecording:
    recording = read_recording(path)
    try:
        return find_taps(*recording.signal(column))
    except DetectorError as error:
        raise CalibrationError(f"{path}: {error}") from error


def _words(found: Calibrated) -> list[str]:
    mains = f"; mains hum of {found.mains_hz:g} Hz was taken out" if found.mains_hz else ""
    return [
        f"{found.taps} {'taps' if found.taps > 1 else 'tap'}{mains}",
        f"f_res  {_interval(found.f_res_hz, '.3f')} Hz",
        f"zeta   {_interval(found.zeta, '.5f')}",
    ]


def _interval(estimate: Estimate, form: str) -> str:
    return f"{estimate.value:{form}} (95 %: {estimate.low:{form}} to {estimate.high:{form}})"
