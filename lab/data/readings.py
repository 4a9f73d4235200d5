"""Repairs readings that are no samples of the motion: repeated or lost ones, angles that wrap, and rows in which the
motor is on or off.  A warning reports each repair.

All fits assume that a reading belongs to its time, that errors have about one size, and that one law holds for the
whole recording:

- A log repeats the readings of a slower sensor or bus on its faster clock until the next reading comes.  The spectrum
  of this staircase has images of the motion at multiples of the true rate, which are taken for motion.
- A program that gets no answer from a bus records a zero, or the end of the range.
- Encoders and ``atan2`` wrap after a turn, and counters where they are full.
- A servo that is let go has a large error afterwards.

Times that are hardly in seconds are asked about, not changed; angles are not judged, as shafts of motors come and go
over more than three turns, too (8 of 167 published recordings).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lostmotion.drivers.recording import Recording
from lostmotion.lab import policy
from lostmotion.lab.data.series import resolution
from lostmotion.lab.errors import ExperimentError
from lostmotion.model.motion import FloatArray

__all__ = [
    "MOTOR_ON",
    "cut_ends",
    "held_for",
    "longest_part",
    "lost_readings",
    "rows_of_base",
    "unwrapped",
    "warn_of_clipping",
    "warn_of_units",
    "without_held_readings",
    "without_lost_readings",
    "without_wraps",
]

LONGEST_GAP, LEAST_PART = 20.0, 0.05
"""Longest spacing of two samples of an input, in usual ones, over which the motion is known; least share of the rows in
the part without longer ones.  From 0.2 % of the rows of a motor, recorded in 1900 bursts, a weight was named."""
LEAST_CHANGES = 20
"""Changes of a column, by which its rate is judged.  With 10 and with 40, too, none of 268 columns of
``bench.real`` counts as held."""
EVEN, STEPS = 0.8, 1.2
"""Least share of the changes of a column that come at even intervals, or with those of another one: 0.88 and 0.97 of a
camera's and an arm's held readings, 0.5 of a servo's current in steps.  Least ratio of the quartiles of its steps: 2.4
and more of seven held columns of 260 public tables, 1 of a slow motion in the steps of an encoder.  Or of the lower one
to the smallest difference of two readings: 11 of a motor at one speed, whose angle comes every fourth row; none of 534
columns of public recordings counts as held for that alone."""
USUAL = 0.95
"""Quantile of the steps between two samples that stands for the motion: as many as 2 % of readings may be lost.  Of 620
readings that were put out of the range of 155 real angles, four in each, 601 are found (607 with the quantile 0.9, 151
with 0.99), and none besides."""
MOST_LOST = 5
"""Consecutive readings; ``policy.LOST_JUMP`` has the measurement."""
WRAPS = 0.01
"""A jump this close to whole turns, in turns, is that of an angle that wraps.  Of the same 620 readings 608 are found
with 0.003, 589 with 0.02 and 561 with 0.05."""
ANGLES = ("position", "command")
"""The columns that may begin anew."""
WHOLE = 0.75
"""Share of the range: the least jump of an angle that begins anew; other steps are at most the rest of it.  Of 468 real
angles of 1.5 to 6 turns that were wrapped 467 are put back with 0.7 to 0.8, 456 with 0.9; none of 261 as they
are is changed."""
NEAR = 3
"""Samples before and after a jump, which go on in the same direction; the same with 2 and 5."""
OFF = 0.02
"""How far a jump may be from a turn, in turns: 463 of the same angles are put back with 0.01, 468 with 0.05."""
MOTOR_ON = "torque_enabled"
"""A column of logs of servos: 1 while the motor holds its goal, 0 after it was let go."""
DRIVEN = {"servo": True, "joint": False}
"""Whether the base describes a motor that holds its goal, or a part that moves freely."""
NO = ("0", "0.0", "false", "off")
"""Cells of ``MOTOR_ON`` where the motor is off."""
SLOWEST = 2.0
"""Samples a second.  No motion of a robot shows at fewer (167 published recordings have 10 to 1024); 1000 a second in
milliseconds are 1."""
STOPPED = 20
"""Times as many rows with one time as elsewhere in the recording, from which on the clock had stopped: 250 rows, with
two elsewhere, at the end of an actuator's log.  A computer that stamps lines as it reads them does so throughout."""
log = logging.getLogger(__name__)


def cut_ends(values: FloatArray) -> list[tuple[float, int]]:
    """The ends of the range at which readings (N,), NaN where not sampled, are cut off, and the number of readings at
    each: ``policy.RAILED`` times as many as at the next value."""
    values = values[np.isfinite(values)]
    ends = [(sign, *np.unique(sign * values, return_counts=True)) for sign in (-1, 1)]
    return [(sign * float(each[-1]), int(counts[-1])) for sign, each, counts in ends
            if each.size > 1 and counts[-1] >= policy.RAILED * counts[-2]]  # fmt: skip


def warn_of_clipping(recording: Recording) -> None:
    """Warns of an accelerometer whose readings are cut off at an end of its range, which the model does not have."""
    if cut := cut_ends(recording.columns.get("accel", np.empty(0))):
        log.warning(
            "%s: %d readings of accel stand at %s m/s^2: there the range of the sensor cut the motion off, and what is "
            "found is too small", recording.name, sum(count for _, count in cut),
            " and ".join(f"{end:.4g}" for end, _ in cut),
        )  # fmt: skip


def warn_of_units(recording: Recording) -> None:
    """Warns of a recording whose times are hardly in seconds."""
    spacing = float(np.median(np.diff(recording.time))) if recording.time.size > 1 else 0.0
    if spacing > 1 / SLOWEST:
        log.warning(
            "%s: found a sample every %.3g s, expected times in seconds; are they in ms or µs?", recording.name, spacing
        )


def without_held_readings(recording: Recording, outputs: Sequence[str], driver: str) -> Recording:
    """The recording with empty cells where readings of the outputs repeat the one before; those of the input too where
    it was held with them.  One that is held alone is what the input was: a command.  A warning says it."""
    columns, seen = dict(recording.columns), None
    for name in outputs:
        at = np.flatnonzero(~np.isnan(columns[name]))
        rows = held_for(columns[name][at])
        if rows == 1:
            continue
        new = at[_new(columns[name][at], rows)]
        log.warning(
            "%s: readings of %s are repeated until the next one comes, %d rows as a rule: the first of each is used",
            recording.name, name, rows,
        )  # fmt: skip
        columns[name] = _only(columns[name], new)
        seen = new if seen is None else seen
    if seen is not None and driver in columns and _changes_with(columns[driver], seen):
        columns[driver] = _only(columns[driver], seen)
    return replace(recording, columns=columns)


def without_stopped_end(recording: Recording) -> Recording:
    """The recording without the rows at its end that have one time, where elsewhere far fewer have one, as those of a
    logger do whose clock has stopped; a warning says it."""
    runs = np.diff(np.concatenate([[-1], np.flatnonzero(np.diff(recording.time)), [recording.time.size - 1]]))
    if runs[-1] < STOPPED * max(runs[:-1].max(initial=1), 1):
        return recording
    size = recording.time.size - int(runs[-1]) + 1
    log.warning(
        "%s: the last %d rows have one time, %.6g s, and are left out but for the first: had the clock of the logger "
        "stopped?",
        recording.name, runs[-1], recording.time[-1],
    )  # fmt: skip
    return replace(
        recording,
        time=recording.time[:size],
        columns={name: values[:size] for name, values in recording.columns.items()},
        extra={name: values[:size] for name, values in recording.extra.items()},
    )


def held_for(values: FloatArray) -> int:
    """The number of samples for which each value (N,) is held; 1 where they are not.

    Held readings change at even intervals, by steps of all sizes, or by more than the smallest difference of two of
    them.  Those of a slow motion in the steps of an encoder repeat, too, but change by one such step.
    """
    at = np.flatnonzero(np.diff(values))
    if at.size < LEAST_CHANGES:
        return 1
    gaps, steps = np.diff(at), np.abs(np.diff(values)[at])
    usual = int(np.median(gaps))
    low, high = np.quantile(steps, (0.25, 0.75))
    is_even = np.mean(np.abs(gaps - usual) <= max(usual // 4, 1)) >= EVEN
    return usual if usual > 1 and is_even and (high > STEPS * low or low > STEPS * resolution(values)) else 1


def _new(values: FloatArray, rows: int) -> NDArray[np.intp]:
    """The samples that are readings: the first, each change, and where nothing changes one in so many rows."""
    found = [0]
    for at in [*(np.flatnonzero(np.diff(values)) + 1).tolist(), values.size]:
        found += range(found[-1] + rows, at - rows // 2, rows)
        found += [at] if at < values.size else []
    return np.array(found)


def _only(values: FloatArray, rows: NDArray[np.intp]) -> FloatArray:
    """The column with empty cells everywhere but in these rows."""
    kept = np.full_like(values, np.nan)
    kept[rows] = values[rows]
    return kept


def _changes_with(values: FloatArray, rows: NDArray[np.intp]) -> bool:
    """Whether a column changes in these rows only, as a rule."""
    changes = np.flatnonzero(np.diff(values)) + 1
    return changes.size > 0 and float(np.mean(np.isin(changes, rows))) >= EVEN


def without_lost_readings(recording: Recording) -> Recording:
    """The recording with empty cells where readings of the angle were lost; what came with them is as unsure.  A
    warning says how many."""
    values = recording.columns["position"]
    seen = np.flatnonzero(~np.isnan(values))
    lost = seen[lost_readings(values[seen])]
    if not lost.size:
        return recording
    log.warning(
        "%s: %d of %d readings of position jump away and come back within %d samples, the first at %g s: left out",
        recording.name, lost.size, seen.size, MOST_LOST, recording.time[lost[0]],
    )  # fmt: skip
    blank = np.isin(np.arange(values.size), lost)
    columns = {name: np.where(blank, np.nan, samples) for name, samples in recording.columns.items()}
    return replace(recording, columns=columns)


def lost_readings(values: FloatArray) -> NDArray[np.bool_]:
    """Which values (N,) lie between two jumps, or between one and an end, and are ``MOST_LOST`` at most."""
    step, lost = np.abs(np.diff(values)), np.zeros(values.size, dtype=bool)
    if not step.any():
        return lost
    limit = policy.LOST_JUMP * max(float(np.quantile(step, USUAL)), float(step[step > 0].min()))
    turns = step / math.tau
    jumps = np.flatnonzero((step > limit) & ~((turns > 0.5) & (np.abs(turns - np.round(turns)) < WRAPS)))
    ends = np.concatenate([[-1], jumps, [values.size - 1]])
    for first, last in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        inner = first >= 0 and last + 1 < values.size
        back = not inner or abs(values[last + 1] - values[first]) <= limit
        if last - first <= MOST_LOST and back and jumps.size and not lost[max(first, 0)]:
            lost[first + 1 : last + 1] = True
    return lost


def without_wraps(recording: Recording) -> Recording:
    """The recording with angles that turn on where they began anew.  A warning says how often."""
    columns = dict(recording.columns)
    for name in ANGLES:
        values = columns.get(name, np.empty(0))
        seen = np.flatnonzero(~np.isnan(values))
        found = unwrapped(values[seen])
        if found is not None:
            columns[name] = np.array(values)
            columns[name][seen] = found
            added = np.abs(np.diff(found - values[seen]))
            log.warning(
                "%s: %s begins anew %d times, after %.4g rad each: it is taken to turn on", recording.name, name,
                np.count_nonzero(added > added.max() / 2), added.max(),
            )  # fmt: skip
    return replace(recording, columns=columns)


def unwrapped(values: FloatArray) -> FloatArray | None:
    """The angle (N,) without its jumps by one size, a turn or the range of a counter; None where there are none.

    What begins anew goes on in the direction from which it came, against the jump; a servo that jumps between two goals
    faster than it is read rests before and after.  Near a turn the readings of a shaft at rest may jump, too.
    """
    steps = np.diff(values)
    size = np.abs(steps)
    jumps = np.flatnonzero(size > WHOLE * np.ptp(values)) if values.size > 2 * NEAR else np.empty(0, dtype=int)
    others = np.delete(size, jumps)
    if not jumps.size or not others.size or others.max() > (1 - WHOLE) * np.ptp(values):
        return None
    around = [np.r_[steps[max(at - NEAR, 0) : at], steps[at + 1 : at + 1 + NEAR]] for at in jumps]
    onward = np.array([np.median(near[np.abs(near) <= others.max()]) if near.size else 0.0 for near in around])
    ranges = np.abs(steps[jumps] - onward)
    whole = float(np.median(ranges))
    is_turn = abs(whole - math.tau) < OFF * math.tau
    if np.abs(ranges - whole).max() > (1 - WHOLE) * whole or not (is_turn or (onward * steps[jumps] < 0).all()):
        return None
    return np.unwrap(values, period=math.tau if is_turn else whole)


def rows_of_base(recording: Recording, base: str, is_free: bool) -> NDArray[np.bool_]:
    """The rows (N,) to use: the longest part in which the motor is on (``servo``) or off (a ``joint`` without torque,
    is_free), all rows where the recording does not say or is of one kind.  A warning reports the rest."""
    every = np.ones(recording.time.size, dtype=bool)
    said = recording.extra.get(MOTOR_ON)
    if said is None or base not in DRIVEN or (base == "joint" and not is_free):
        return every
    fits = np.array([(cell.strip().lower() in NO) != DRIVEN[base] for cell in said], dtype=bool)
    if fits.all() or not fits.any():
        return every
    ends = np.flatnonzero(np.diff(np.concatenate([[False], fits, [False]]).astype(int)))
    begin, end = max(zip(ends[::2], ends[1::2], strict=True), key=lambda part: part[1] - part[0])
    log.warning(
        "%s: the motor is %s from %.3g to %.3g s (%s): the rest is left out",
        recording.name, "on" if DRIVEN[base] else "off", recording.time[begin], recording.time[end - 1], MOTOR_ON,
    )  # fmt: skip
    return np.asarray((np.arange(fits.size) >= begin) & (np.arange(fits.size) < end))


def longest_part(name: str, column: str, time: FloatArray, values: FloatArray) -> slice:
    """The samples of the longest part of the input without a gap; a warning reports the rest.  A goal that is the same
    on both sides of a gap was held in it.  Raises ExperimentError for a recording that is mostly gaps."""
    spacing = np.diff(time)
    held = (np.diff(values) == 0) & (column == "command")
    gaps = np.flatnonzero((spacing > LONGEST_GAP * np.median(spacing)) & ~held)
    ends = np.concatenate([[0], gaps + 1, [time.size]])
    at = int(np.argmax(np.diff(ends)))
    first, last = int(ends[at]), int(ends[at + 1])
    if last - first < LEAST_PART * time.size:
        raise ExperimentError(
            f"{name}: {column} has {gaps.size} gaps of more than {LONGEST_GAP:g} sample spacings, and only "
            f"{last - first} of {time.size} rows in the longest part without one: cut out one motion, or resample it"
        )
    if gaps.size:
        beside = [gap for gap in (first - 1, last - 1) if gap in gaps]
        told = " and ".join(f"{spacing[gap]:.3g} s at {time[gap]:g} s" for gap in beside)
        log.warning(
            "%s: %s has a gap of %s, more than %g sample spacings: used from %g to %g s; cut the "
            "recording in two there to use all of it",
            name, column, told, LONGEST_GAP, time[first], time[last - 1],
        )  # fmt: skip
    return slice(first, last)
