"""A recording from a model: what its sensors would have told, and from which parameters.  No files are touched here."""

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
PIECE_S = 10.0  # simulated between two reports of progress
MOST_SAMPLES = 50_000_000
CHECK_STEP_S = 1e-3
LONGEST_CHECK_S = 10.0  # of motion; looking for chaos simulates it twice more


@dataclass(frozen=True, slots=True)
class _Sensors:
    """What is recorded of a base: the column with the noise, the others, those of them that the servo tells at its own
    rate, the motion where none is asked for, and where a free motion starts."""

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
    """What is to be simulated.

    motion: as ``model.motion.by_name`` takes it, or "free": no input, from a deflection of 1 mm or 0.5 rad; None: what
    suits the base.  duration [s]; rate_hz: of the recording; servo_rate_hz: of command and position, rounded to a whole
    part of rate_hz; noise: standard deviation, in the unit of the column that is measured (play: accel [m/s²];
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
        """How many rows there will be."""
        return max(round(self.duration * self.rate_hz), 1)

    def pieces(self) -> Iterator[Trajectory]:
        """The motion, some seconds at a time, each going on where the one before ended.  Raises SimulationError."""
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
        """When the motion stops being predictable [s]; inf when it does not, or is too long to find out cheaply.

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
        """What the sensors tell of the motion, with what it was made from in the metadata."""
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
        """Samples in a piece; all of them where an effect counts time from the start of a simulation."""
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
        """What the recording was made from, and the oscillator as the detector wants to know it."""
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
    """Each piece starts at the last time of the one before, and leaves that time out."""
    for begin in range(0, len(times), length):
        overlap = min(begin, 1)
        piece = model.simulate(drive, times[begin - overlap : begin + length], state)
        state = piece.state
        signals = {name: values[overlap:] for name, values in piece.signals.items()}
        yield Trajectory(piece.time[overlap:], signals, piece.states[overlap:], state, piece.substep_s)
