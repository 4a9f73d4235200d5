"""Columns that stand for others: angle and torque of an oscillator, displacement and force of a linear axis."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.model.motion import FloatArray

__all__ = ["LENGTHS", "imported_columns", "is_sampled", "with_stand_ins"]

LENGTHS = ("m", "mm", "µm", "um", "in")
"""Units of a position that is a length."""
ELSE = {
    "oscillator": {"displacement": "position", "force": "torque"},
    "joint": {"position": "displacement", "torque": "force"},
}
"""What is taken for a column of a base where it was not recorded."""
WINDOWS, SAME, ALIKE = (11, 31, 101), 0.03, 0.99
"""Rows of the window in which an acceleration is compared with its position, how far their factor may be from 1, and
the least share of its variance that the position explains.  Of three recordings of a disc on a spring the factors are
0.995 to 0.997, and the shares 0.9999 and more, in windows of 31 and 101 rows (0.85 to 1.13, and 0.92 to 0.998, of 11);
of one of another logger, whose acceleration is not derived from the place, 0.74 and 0.80 at the best."""
log = logging.getLogger(__name__)


def with_stand_ins(recording: Recording, base: str, outputs: Sequence[str]) -> Recording:
    """The recording with its angle and torque as the displacement and the force of an oscillator that has no other
    motion, or with those as the position and the torque of a linear axis; a warning reports it.

    outputs: the columns that are compared."""
    recording = _without_second_derivative(recording) if base == "oscillator" else recording
    if base == "oscillator" and [name for name in recording.columns if is_sampled(recording, name)] == ["voltage"]:
        return _of_sensor(recording)
    pairs = ELSE.get(base, {})
    found = [name for name, other in pairs.items() if is_sampled(recording, other) and not is_sampled(recording, name)]
    if any(is_sampled(recording, name) for name in outputs):
        is_axis = base == "joint" and recording.metadata.get("position_unit") in LENGTHS
        found = [name for name in found if is_axis and name not in outputs]
    elif not {*found} & {*outputs}:
        found = []
    if "displacement" in found and base == "oscillator" and (series := _assumed(recording)):
        log.warning(
            "%s: no displacement was found; the position is taken for it, not as the degrees that were assumed, but "
            "its numbers as m; if they are in mm, use --map displacement=%s:mm", recording.name, series,
        )  # fmt: skip
        position = np.degrees(recording.columns["position"])
        return replace(recording, columns={**recording.columns, "displacement": position})
    for name in found:
        is_angular = base == "oscillator" and pairs[name] not in recording.foreign_units
        instead = f", so that {recording.unit(name)} stands for {recording.unit(pairs[name])}" if is_angular else ""
        if instead and recording.unit(pairs[name]) == "rad":
            instead += "; for a pendulum that swings far use the base joint, whose weight acts by the sine of its angle"
        log.warning("%s: no %s was found; the %s is taken for it%s", recording.name, name, pairs[name], instead)
    columns = {**recording.columns, **{name: recording.columns[pairs[name]] for name in found}}
    units = {f"{name}_unit": recording.unit(pairs[name]) for name in found if base == "joint"}
    return replace(recording, columns=columns, metadata={**recording.metadata, **units})


def _of_sensor(recording: Recording) -> Recording:
    """The recording with a voltage, which is all that there is, as the displacement: that of a sensor, as what drives a
    mass is of no use without its motion."""
    log.warning("%s: found nothing but a voltage; it is taken for that of a sensor of the displacement", recording.name)
    columns = {"displacement": recording.columns["voltage"]}
    return replace(recording, columns=columns, metadata={**recording.metadata, "displacement_unit": "V"})


def _without_second_derivative(recording: Recording) -> Recording:
    """The recording with its position as the displacement of an oscillator, instead of an acceleration that is how
    fast the position's speed changes, in m/s² for m: a logger that derives it adds noise.  A warning reports it."""
    is_chosen = is_sampled(recording, "displacement") or imported_columns(recording).get("accel_given", False)
    if is_chosen or not all(is_sampled(recording, name) for name in ("position", "accel")):
        return recording
    position, accel = (recording.columns[name] for name in ("position", "accel"))
    rows = np.isfinite(position) & np.isfinite(accel)
    if not any(_is_second_derivative(recording.time[rows], position[rows], accel[rows], width) for width in WINDOWS):
        return recording
    log.warning(
        "%s: accel is the second derivative of position, in m/s^2 for m: the position is taken for the displacement, "
        "and accel is left out; --map accel=SERIES uses that instead", recording.name,
    )  # fmt: skip
    columns = {name: values for name, values in recording.columns.items() if name not in ("position", "accel")}
    return replace(recording, columns={**columns, "displacement": position})


def _is_second_derivative(times: FloatArray, values: FloatArray, second: FloatArray, width: int) -> bool:
    """Whether numbers (N,) are the second derivative of others (N,), both weighted by a smooth window of so many rows,
    which takes the derivative instead of the numbers."""
    if values.size < 4 * width:
        return False
    window = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 4
    step = float(np.median(np.diff(times))) or 1.0
    derived = np.convolve(values - values.mean(), np.gradient(np.gradient(window, step), step), "valid")
    given = np.convolve(second - second.mean(), window, "valid")
    derived, given = derived - derived.mean(), given - given.mean()
    power, most = float(derived @ derived), float(given @ given)
    if not power or not most:
        return False
    factor = float(derived @ given) / power
    left = given - factor * derived
    return abs(factor - 1) < SAME and float(left @ left) < (1 - ALIKE) * most


def _assumed(recording: Recording) -> str:
    """The series of a position that was read in degrees only because no pendulum swings so far in rad; "" for none."""
    imported = imported_columns(recording)
    return str(imported.get("position", "SERIES")) if imported.get("position_assumed") == "deg" else ""


def imported_columns(recording: Recording) -> Mapping[str, Any]:
    """What is known of the columns of another program's recording."""
    found = recording.metadata.get("imported", {})
    return found if isinstance(found, Mapping) else {}


def is_sampled(recording: Recording, column: str) -> bool:
    """Whether a recording has readings of this column."""
    return column in recording.columns and not np.isnan(recording.columns[column]).all()
