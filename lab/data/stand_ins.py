"""Columns that stand for others: angle and torque of an oscillator, displacement and force of a linear axis."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from lostmotion.drivers.recording import Recording

__all__ = ["LENGTHS", "is_sampled", "with_stand_ins"]

LENGTHS = ("m", "mm", "µm", "um", "in")
ELSE = {
    "oscillator": {"displacement": "position", "force": "torque"},
    "joint": {"position": "displacement", "torque": "force"},
}
"""What is taken for a column of a base where it was not recorded."""
log = logging.getLogger(__name__)


def with_stand_ins(recording: Recording, base: str, outputs: Sequence[str]) -> Recording:
    """The recording with its angle and torque as the displacement and the force of an oscillator that has no other
    motion, or with those as the position and the torque of a linear axis; a warning reports it.

    outputs: the columns that are compared."""
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
        log.warning("%s: no %s was found; the %s is taken for it%s", recording.name, name, pairs[name], instead)
    columns = {**recording.columns, **{name: recording.columns[pairs[name]] for name in found}}
    units = {f"{name}_unit": recording.unit(pairs[name]) for name in found if base == "joint"}
    return replace(recording, columns=columns, metadata={**recording.metadata, **units})


def _assumed(recording: Recording) -> str:
    """The series of a position that was read in degrees only because no pendulum swings so far in rad; "" for none."""
    imported = recording.metadata.get("imported", {})
    is_table = isinstance(imported, Mapping)
    return str(imported.get("position", "SERIES")) if is_table and imported.get("position_assumed") == "deg" else ""


def is_sampled(recording: Recording, column: str) -> bool:
    """Whether a recording has readings of this column."""
    return column in recording.columns and not np.isnan(recording.columns[column]).all()
