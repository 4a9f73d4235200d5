"""Simulates a recording from a model: the readings of its sensors, with the parameters as metadata.

The command ``simulate`` writes it to a file; no files are touched here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lostmotion.drivers.recording import Recording
from lostmotion.lab.errors import SimulationError
from lostmotion.lab.models.modelfile import ModelFile
from lostmotion.model import Model, ModelError, Motion, Sensor, Trajectory, by_name, predictability_horizon
from lostmotion.model.effects import get_effect
from lostmotion.model.motion import FloatArray

__all__ = ["Simulation"]

FREE = "free"
"""The motion without an input."""
PIECE_S = 10.0  # simulated between two reports of progress
MOST_SAMPLES = 50_000_000
"""Largest number of rows of a recording."""
CHECK_STEP_S = 1e-3
"""Spacing of the samples of the motion that is tested for chaos [s]."""
LONGEST_CHECK_S = 10.0  # of motion; the test for chaos simulates it twice more


@dataclass(frozen=True, slots=True)
class _Sensors:
    """The sensors of a base.  noisy: the column with noise; exact: the other columns; servo: those that a servo reports
    at its own rate; motion: the default; free_start: initial values of a motion without an input."""

    noisy: str
    exact: tuple[str, ...]
    servo: tuple[str, ...]
    motion: str
    free_start: dict[str, float]


_SENSORS = {
    "play": _Sensors("accel", ("command", "position", "force"), ("command", "position"), "hand-waved", {"q": 1e-3}),
    "oscillator": _Sensors("displacement", ("force", "accel"), (), FREE, {"q": 1e-3}),
    "joint": _Sensors("position", ("torque",), (), FREE, {"theta_2": 0.5}),
    "servo": _Sensors("position", ("command",), ("command", "position"), "hand-waved", {"theta_2": 0.5}),
}


@dataclass(frozen=True, slots=True)
class Simulation:
    """The specification of a simulated recording.

    motion: as ``model.motion.by_name`` takes it, or "free": no input, from a deflection of 1 mm or 0.5 rad; None: the
    default of the base.  duration [s]; rate_hz: of the recording; servo_rate_hz: of command and position, rounded to a
    whole part of rate_hz; noise: standard deviation, in the unit of the column that is measured (play: accel [m/s²];
    oscillator: displacement [m]; joint, servo: position [rad]); seed: of the noise.
    """

    model: ModelFile
    motion: str | None = None
    duration: float = 10.0
    rate_hz: float = 1000.0
    servo_rate_hz: float | None = None
    noise: float = 0.0
    seed: int = 0

    @property
    def samples(self) -> int:
        """The number of rows."""
        return max(round(self.duration * self.rate_hz), 1)

    def pieces(self) -> Iterator[Trajectory]:
        """The motion, some seconds at a time, each starting where the one before ended.  Raises SimulationError."""
        if self.samples > MOST_SAMPLES:
            raise SimulationError(
                f"found {self.samples} samples (duration x rate), expected at most {MOST_SAMPLES}; simulate in parts"
            )
        try:
            model = self.model.build()
            drive = self._drive()
            yield from _pieces(model, drive, self._times(), self._start(model, drive), self._piece_length())
        except ModelError as error:
            raise SimulationError(str(error)) from error

    def horizon(self) -> float:
        """The horizon of predictability [s]; inf when the motion stays predictable, or is too long to test.

        Raises SimulationError.
        """
        if self.duration > LONGEST_CHECK_S:
            return math.inf
        try:
            model = self.model.build()
            drive = self._drive()
            times = np.arange(0.0, self.duration, CHECK_STEP_S)
            return predictability_horizon(model, drive, times, self._start(model, drive))
        except ModelError as error:
            raise SimulationError(str(error)) from error

    def recording(self, pieces: list[Trajectory]) -> Recording:
        """The readings of the sensors, with model and parameters as metadata."""
        sensors = _SENSORS[self.model.base]
        columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in (*sensors.exact, sensors.noisy)}
        rng = np.random.default_rng(self.seed)
        columns[sensors.noisy] = Sensor(noise=self.noise).apply(columns[sensors.noisy], rng)
        if self.servo_rate_hz is not None:
            every = max(round(self.rate_hz / self.servo_rate_hz), 1)
            silent = np.arange(self.samples) % every != 0
            for name in sensors.servo:
                columns[name] = np.where(silent, np.nan, columns[name])
        return Recording(self._times(), columns, self._metadata())

    def _piece_length(self) -> int:
        """The number of samples in a piece; all samples where an effect depends on the time from the start."""
        counts_time = any(get_effect(name).clock_rate is not None for name in self.model.effects)
        return self.samples if counts_time else max(round(PIECE_S * self.rate_hz), 1)

    def _times(self) -> FloatArray:
        return np.arange(self.samples) / self.rate_hz

    def _motion(self) -> str:
        return self.motion or _SENSORS[self.model.base].motion

    def _drive(self) -> Motion | None:
        return None if self._motion() == FREE else by_name(self._motion())

    def _start(self, model: Model, drive: Motion | None) -> FloatArray:
        start = _SENSORS[self.model.base].free_start if drive is None else {}
        return model.initial_state(drive, **start)

    def _metadata(self) -> dict[str, Any]:
        """Model and parameters of the recording, and the oscillator in the terms of the detector."""
        values = {name: parameter.value for name, parameter in self.model.build().parameters.items()}
        metadata = {
            "model": self.model.base,
            "effects": list(self.model.effects),
            "parameters": values,
            "motion": self._motion(),
            "noise": self.noise,
            "seed": self.seed,
        }
        if "k" in values:
            metadata["f_res_hz"] = math.sqrt(values["k"] / values["m"]) / (2 * math.pi)
            metadata["zeta"] = values["b"] / (2 * math.sqrt(values["k"] * values["m"]))
        return metadata


def _pieces(
    model: Model, drive: Motion | None, times: FloatArray, state: FloatArray, length: int
) -> Iterator[Trajectory]:
    """The simulated pieces.  Each begins at the last time of the one before, which it leaves out."""
    for begin in range(0, len(times), length):
        overlap = min(begin, 1)
        piece = model.simulate(drive, times[begin - overlap : begin + length], state)
        state = piece.state
        signals = {name: values[overlap:] for name, values in piece.signals.items()}
        yield Trajectory(piece.time[overlap:], signals, piece.states[overlap:], state, piece.substep_s)
