"""Recordings prepared for a model: the input as a motion, the measured outputs on one time axis.

The base of the model determines the columns of both.  Every fit, search and comparison begins here.  Recordings that
cannot be used are rejected, with one line on what was found and what the base needs.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.recording import Recording
from lostmotion.lab.data import readings
from lostmotion.lab.data.checks import LEAST_SAMPLES, check_goal, check_output, check_rate
from lostmotion.lab.data.degrees import in_degrees
from lostmotion.lab.data.frequency_response import turned
from lostmotion.lab.data.rounded_input import rounding_step, smooth_motion
from lostmotion.lab.data.series import seen
from lostmotion.lab.data.stand_ins import LENGTHS, imported_columns, is_sampled, with_stand_ins
from lostmotion.lab.data.step_start import with_rest_before
from lostmotion.lab.data.supply import is_of_motor, of_voltage, supplied
from lostmotion.lab.errors import ExperimentError
from lostmotion.model import Model, Motion, Sampled
from lostmotion.model.motion import FloatArray

__all__ = [
    "ACCEL",
    "INPUT",
    "OUTPUTS",
    "Experiment",
    "axis_of",
    "experiments",
    "own_rows",
    "with_one_column",
]

ACCEL = "accel"
"""the column of the accelerometer"""

INPUT = {"play": "command", "oscillator": "force", "joint": "torque", "servo": "command"}
"""The column that drives each base."""
NEEDS_INPUT = ("play", "servo")
"""The bases that do not move without an input."""
OUTPUTS = {
    "play": ("accel", "position", "force"),
    "oscillator": ("displacement", "accel"),
    "joint": ("position",),
    "servo": ("position",),
}
"""The columns that are compared, whichever were recorded."""
IN_PLACE = {
    "current": ("current", "A", "KT", ""),
    "voltage": ("voltage", "V", "KT/R", "; the back EMF counts as viscous friction"),
}
"""What is taken for the torque of a joint where none was recorded: its unit, the factor to a torque, and a remark."""
log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Experiment:
    """One recording, or a segment of one.

    drive: the input, None without one; time: ascending (N,) [s]; measured: by column (N,), NaN where not sampled;
    given: values of fixed parameters of the model, from the metadata of the recording (``# kp = 12``) or its voltage.
    """

    name: str
    drive: Motion | None
    time: FloatArray
    measured: Mapping[str, FloatArray]
    given: Mapping[str, float] = field(default_factory=dict)
    clock_zero: float = 0.0
    """The time at which the clocks of sensor and host agree [s]: the first row of the recording."""
    is_linear: bool = False
    """Whether the position is a length (metadata of a linear axis), not an angle."""
    drive_unit: str = ""
    """The unit of what was recorded in place of a torque or force: "A" for a motor's current, "V" for its voltage; ""
    where it is one."""
    drive_step: float = 0.0
    """The step to which the command of gears was rounded [rad], 0 where it was not; see rounded_input.py."""
    left_drive: str = ""
    """What the reader says of a command in the file that no column has, as of what may drive the motion."""

    def __repr__(self) -> str:
        """Its size and columns, without the arrays."""
        moved = "free" if self.drive is None else "driven"
        what = f"{self.time.size} samples over {self.duration:.3g} s of {', '.join(self.measured)}"
        return f"<Experiment {self.name!r}: {what}, {moved}>"

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def rate_hz(self) -> float:
        """The sampling rate, from the median spacing."""
        return float(1 / np.median(np.diff(self.time)))

    @property
    def is_driven(self) -> bool:
        """Whether an input was recorded that is not zero throughout."""
        return self.drive is not None and bool(np.any(self.drive.position(self.time)))

    def has_samples_of(self, other: Experiment) -> bool:
        """Whether the readings are those of another experiment, at the same times from the first on."""
        return (
            self.time.size == other.time.size
            and self.measured.keys() == other.measured.keys()
            and np.allclose(self.time - self.time[0], other.time - other.time[0], 0.0, 1e-3 / self.rate_hz)
            and all(np.array_equal(x, other.measured[name], equal_nan=True) for name, x in self.measured.items())
        )

    def between(self, start: float, stop: float) -> Experiment:
        """The segment with start <= time < stop [s], which has at least two samples."""
        first, last = np.searchsorted(self.time, (start - 1e-9, stop - 1e-9))
        last = max(last, first + 2)
        measured = {name: values[first:last] for name, values in self.measured.items()}
        return replace(self, time=self.time[first:last], measured=measured)

    def interpolated(self, column: str, time: FloatArray) -> FloatArray:
        """The readings of a column at these times (M,) [s], linear between the samples that were read."""
        seen = ~np.isnan(self.measured[column])
        return np.interp(time, self.time[seen], self.measured[column][seen])

    def delayed(self, by_s: float) -> Experiment:
        """The experiment with an input that acts ``by_s`` [s] later than it was recorded."""
        return replace(self, drive=self.drive.changed(by_s)) if isinstance(self.drive, Sampled) and by_s else self

    def with_reversed_input(self) -> Experiment:
        """The experiment with an input of the opposite sign."""
        return replace(self, drive=self.drive.changed(sign=-1)) if isinstance(self.drive, Sampled) else self

    def model(self, model: Model) -> Model:
        """The model with the given values of this recording."""
        return model.replace(self.given) if self.given else model


def axis_of(experiments: Sequence[Experiment]) -> tuple[bool, str]:
    """Whether the axis moves along a line, and the unit of what was recorded in place of its torque, or ""."""
    return any(one.is_linear for one in experiments), next((one.drive_unit for one in experiments), "")


def with_one_column(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments with one column only, the most direct one that was measured in all of them; a warning reports the
    others.  Raises ExperimentError where they have none in common."""
    first, *rest = experiments
    column = next((name for name in first.measured if all(name in one.measured for one in rest)), "")
    if not column:
        raise ExperimentError(
            f"{experiments[-1].name}: found {', '.join(experiments[-1].measured)}, expected "
            f"{' or '.join(first.measured)} as in {first.name}: all recordings are compared by one column"
        )
    if beside := sorted({name for one in experiments for name in one.measured} - {column}):
        log.warning("%s: compared by its %s, without %s", first.name, column, ", ".join(beside))
    return tuple(replace(one, measured={column: one.measured[column]}) for one in experiments)


def own_rows(values: FloatArray) -> NDArray[np.intp] | None:
    """The rows in which a column (N,) was sampled, if it was sampled more slowly than other columns, so that the usual
    sample has none in the next row; else None.  NaN: not sampled."""
    at = np.flatnonzero(np.isfinite(values))
    return at if at.size > 1 and np.median(np.diff(at)) > 1 else None


def experiments(model: Model, recordings: Sequence[Recording]) -> tuple[Experiment, ...]:
    """The recordings prepared for the base of a model.  Raises ExperimentError for one that cannot be used."""
    of_motor = is_of_motor(np.concatenate([_readings(one, "voltage") for one in recordings] or [np.empty(0)]))
    found = [_experiment(model, recording, of_motor) for recording in recordings]
    return turned(model, in_degrees(found, recordings) if model.base == "joint" else found)


def _experiment(model: Model, recording: Recording, of_motor: bool) -> Experiment:
    recording = readings.without_stopped_end(recording)
    recording = _without_zeros(with_stand_ins(recording, model.base, OUTPUTS[model.base]), INPUT[model.base])
    outputs = _outputs(recording, model.base)
    if "position" in outputs and recording.metadata.get("position_unit") not in LENGTHS:
        recording = readings.without_wraps(recording)
    if "position" in outputs and model.base != "play":  # there a contact may be as short as a lost reading
        recording = readings.without_lost_readings(recording)
    column = _input(model.base, recording, of_motor)
    recording = readings.without_held_readings(recording, outputs, column)
    recording = with_rest_before(recording, column) if model.base in ("joint", "servo") else recording
    step = rounding_step(recording.columns[column]) if model.base == "play" and is_sampled(recording, column) else 0.0
    drive = _drive(model.base, recording, column, step)
    if model.base == "oscillator":
        readings.warn_of_clipping(recording)
    if model.base == "servo":
        check_goal(recording)
    rows = np.any([~np.isnan(recording.columns[name]) for name in outputs], axis=0)
    rows &= readings.rows_of_base(recording, model.base, drive is None)
    time = recording.time.copy()
    time[rows] = recording.times(rows)
    rows[rows] = np.diff(time[rows], prepend=-np.inf) > 0  # a merged row may repeat a time
    if isinstance(drive, Sampled):  # the input is unknown outside of its samples
        rows &= (time >= drive.time[0]) & (time <= drive.time[-1])
    measured = {name: recording.columns[name][rows] for name in outputs}
    for name, values in measured.items():
        check_output(recording.name, name, values)
        if model.base == "oscillator" and (unit := recording.foreign_units.get(name)):
            usual = replace(recording, metadata={}).unit(name)
            log.warning("%s: the %s is in %s, so that %s stands for %s", recording.name, name, unit, usual, unit)
    experiment = Experiment(
        recording.name, drive, time[rows], measured, _given(model, recording), float(recording.time[0]),
        recording.metadata.get("position_unit") in LENGTHS,
        _drive_unit(model.base, recording, column) if drive is not None else "",
        step, "" if drive is not None else str(imported_columns(recording).get("left_drive", "")),
    )  # fmt: skip
    if model.base == "play":
        check_rate(recording.name, experiment.rate_hz)
    return experiment


def _outputs(recording: Recording, base: str) -> list[str]:
    """The columns that are compared.  Raises ExperimentError where there are none."""
    outputs = [name for name in OUTPUTS[base] if is_sampled(recording, name)]
    if not outputs and (empty := [name for name in OUTPUTS[base] if name in recording.columns]):
        raise ExperimentError(f"{recording.name}: found no number in {', '.join(empty)}, expected samples")
    if not outputs:
        raise ExperimentError(
            f"{recording.name}: found {_there(recording)}, expected at least one of {', '.join(OUTPUTS[base])}; the "
            f"base {base!r} is compared with these: {_advice(recording, base)} (lostmotion import {recording.name} "
            "lists its series)"
        )
    return outputs


def _advice(recording: Recording, base: str) -> str:
    """What to type for a motion of which there is no column: what the reader says of a series that may be it."""
    if base == "joint" and (said := imported_columns(recording).get("left_motion")):
        return str(said)
    return f"choose its series with --map {OUTPUTS[base][-1]}=SERIES"


def _drive_unit(base: str, recording: Recording, column: str) -> str:
    """See ``Experiment.drive_unit``."""
    if base != "joint":
        return ""
    unit = recording.unit("torque") if column == "torque" else IN_PLACE[column][1]
    return "" if unit in ("N m", "N") else unit


def _without_zeros(recording: Recording, column: str) -> Recording:
    """The recording without an input that is zero throughout, as logs have such a column also where nothing measures
    it.  A gap in it is no gap of the motion."""
    if column == "command" or not is_sampled(recording, column) or _readings(recording, column).any():
        return recording
    log.warning("%s: the %s is zero throughout, and taken as not measured", recording.name, column)
    return replace(recording, columns={name: one for name, one in recording.columns.items() if name != column})


def _there(recording: Recording) -> str:
    return ", ".join(name for name in recording.columns if is_sampled(recording, name)) or "no samples"


def _drive(base: str, recording: Recording, column: str, step: float) -> Motion | None:
    """The input; step: to which the command of gears was rounded."""
    if not is_sampled(recording, column):
        if base in NEEDS_INPUT:
            raise ExperimentError(
                f"{recording.name}: found {_there(recording)}, expected {column!r}; it drives the base {base!r}: "
                f"choose its series with --map {column}=SERIES"
            )
        return None
    time, values = recording.signal(column)
    if not np.all(np.isfinite(values)):
        bad = time[~np.isfinite(values)][0]
        raise ExperimentError(f"{recording.name}: {column} at {bad:g} s is not finite, expected numbers")
    new = np.concatenate(([True], np.diff(time) > 0))
    time, values = time[new], values[new]
    if time.size < LEAST_SAMPLES:
        raise ExperimentError(
            f"{recording.name}: samples of {column}: found {time.size}, expected at least {LEAST_SAMPLES}; "
            "is the recording too short?"
        )
    longest = readings.longest_part(recording.name, column, time, values)
    if longest.stop - longest.start < LEAST_SAMPLES:
        raise ExperimentError(
            f"{recording.name}: samples of {column} between two gaps: found {longest.stop - longest.start} at most, "
            f"expected at least {LEAST_SAMPLES}"
        )
    time, values = time[longest], values[longest]
    return smooth_motion(time, values, step) if base == "play" else Sampled(time, values)


def _input(base: str, recording: Recording, of_motor: bool) -> str:
    """The column that drives the base.  For a joint without a measured torque it is the current of the motor, which is
    a torque up to a factor, or else its voltage, which is one up to a factor and a viscous friction.  A warning reports
    this, and a part that is taken to move freely though something may drive it.  of_motor: whether it is known."""
    column = INPUT[base]
    if base in NEEDS_INPUT or is_sampled(recording, column):
        return column
    acts = {
        "current": np.count_nonzero(_readings(recording, "current")) > recording.time.size / 2,
        "voltage": readings.MOTOR_ON not in recording.extra
        and of_motor
        and bool(_readings(recording, "voltage").any()),
    }
    if base == "joint" and (instead := next((name for name, is_one in acts.items() if is_one), "")):
        log.warning(
            "%s: no torque was found; the motor's %s is taken for it, so that torques are in %s: with "
            "--map torque=SERIES*%s they are in N m%s", recording.name, instead, *IN_PLACE[instead][1:],
        )  # fmt: skip
        return instead
    if base == "joint" and imported_columns(recording).get("follows_goal"):
        raise ExperimentError(f"{recording.name}: {imported_columns(recording)['left_drive']}")
    if beside := [name for name in ("command", "current", "voltage") if is_sampled(recording, name)]:
        why, series = ("", "SERIES") if of_motor or "voltage" not in beside else supplied(recording)
        log.warning(
            "%s: no %s was found beside %s%s; the part is taken to move freely. If a motor drives it, give its %s: "
            "--map %s=%s", recording.name, column, ", ".join(beside), why, column, column, series,
        )  # fmt: skip
    return column


def _readings(recording: Recording, column: str) -> FloatArray:
    """The readings of a column (M,), none where it was not recorded."""
    values = recording.columns.get(column, np.empty(0))
    return seen(values)


def _given(model: Model, recording: Recording) -> dict[str, float]:
    """The values of fixed parameters of the model (gain, mass, supply) that a recording states in its metadata, or by
    its voltage.  Raises ExperimentError for one that is no number."""
    found = {name: recording.metadata[name] for name, p in model.parameters.items()
             if p.fixed and name in recording.metadata}  # fmt: skip
    for name, value in found.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ExperimentError(f"{recording.name}: # {name}: found {value!r}, expected a number")
    stated = {name: float(value) for name, value in found.items()}
    return {**of_voltage(model, recording), **stated}
