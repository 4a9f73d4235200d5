"""Checks of whether a fit can use a recording: each raises ExperimentError, with one line on what was found and
what was expected."""

from __future__ import annotations

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.errors import ExperimentError
from lostmotion.model.motion import FloatArray

__all__ = ["FLAT_SHARE", "LEAST_SAMPLES", "SHORTEST_S", "check_goal", "check_output", "check_rate"]

LEAST_SAMPLES = 50
"""Least number of samples of an input or an output."""
FLAT_SHARE = 1e-9
"""Range of a signal, as a share of its largest magnitude, up to which it is constant."""
RAILS_SHARE = 0.5
"""Share of the samples at the largest or the smallest value, above which a signal is saturated."""
COPIED, COPIED_ROWS = 0.9, 3
"""Share of the rows in motion, above which a goal is a copy of the position; and how many rows it is ahead at most."""
SHORTEST_S = 0.25
"""Length of the shortest segments in which gears are fitted [s]."""
GEARS_HZ = 8 / SHORTEST_S
"""Least number of samples a second of gears: eight in the shortest segments.  Their motion has four initial values,
which else leave no samples to estimate the noise."""


def check_goal(recording: Recording) -> None:
    """Raises ExperimentError for a goal that never changes, and drives nothing; and for one that is the angle itself
    some rows ahead, as in some data sets for learning: a servo without delay, friction and weight was found in one."""
    goal, position = recording.columns["command"], recording.columns["position"]
    sent = goal[np.isfinite(goal)]
    if np.ptp(sent) <= FLAT_SHARE * np.abs(sent).max():
        raise ExperimentError(
            f"{recording.name}: found the command {sent[0]:g} at all times, expected a goal that changes: what moves a "
            "servo that holds was not recorded. Record steps or sweeps of its goal, or use the base joint, with what "
            "drives it as --map torque=SERIES"
        )
    for ahead in range(1, COPIED_ROWS + 1):
        now, then = goal[: goal.size - ahead], position[ahead:]
        moving = np.flatnonzero(np.diff(then)) + 1
        if moving.size >= LEAST_SAMPLES and np.mean(now[moving] == then[moving]) > COPIED:
            raise ExperimentError(
                f"{recording.name}: found a command that is the position {ahead} row(s) later, expected the goal that "
                "was sent to the servo: a copy of the angle says nothing about it"
            )


def check_output(name: str, column: str, values: FloatArray) -> None:
    """Raises ExperimentError for an output with too few samples, one that is not finite, flat or saturated."""
    sampled = values[~np.isnan(values)]
    if sampled.size < LEAST_SAMPLES:
        raise ExperimentError(
            f"{name}: usable samples of {column}: found {sampled.size}, expected at least {LEAST_SAMPLES}; "
            "is the recording too short, or are input and output from different times?"
        )
    if not np.all(np.isfinite(sampled)):
        raise ExperimentError(f"{name}: {column} holds a value that is not finite, expected numbers or empty cells")
    spread = float(np.ptp(sampled))
    if spread <= FLAT_SHARE * max(float(np.max(np.abs(sampled))), 1e-300):
        raise ExperimentError(
            f"{name}: {column} is flat at {sampled[0]:g}, expected a signal that moves; is the sensor connected?"
        )
    rails = np.mean((sampled == sampled.max()) | (sampled == sampled.min()))
    if column != "position" and rails > RAILS_SHARE:  # a joint may stand still at the end of its motion
        raise ExperimentError(
            f"{name}: {100 * rails:.0f} % of {column} stands at its largest or smallest value; expected a signal "
            "within the sensor's range; is it saturated?"
        )


def check_rate(name: str, rate_hz: float) -> None:
    """Raises ExperimentError for gears that were sampled too slowly to be fitted in segments."""
    if rate_hz < GEARS_HZ:
        raise ExperimentError(
            f"{name}: found {rate_hz:.3g} samples a second, expected at least {GEARS_HZ:g}: what the teeth of a gear "
            "do is over in a quarter of a second; are the times in seconds? Of a slow recording the base 'joint' "
            "(torque and position) or 'servo' (command and position) can be asked"
        )
