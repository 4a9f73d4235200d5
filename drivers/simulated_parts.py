"""What moves in a simulated robot: joints with their gears, and metal bars with an accelerometer.

Each is made step by step.  The equations are the model's, which is imported when the first device is opened.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from lostmotion.drivers.base import AccelBlock, FloatArray, ServoSample
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.schedule import YEAR_S, Step, grid
from lostmotion.drivers.simulated_options import MOST_PLAY_M, SimulatedAccelerometerOptions, SimulatedJointOptions

__all__ = ["Bar", "Gear"]

KNOT_S = 2e-3
MOST_WEAR = 100.0
"""Exponent of the wear, at which any gap has reached its largest, and exp does not overflow."""
RUN_UP_S = 1.5
"""Motion before a stretch that nobody sees [s]: gears and bar are then in the middle of it."""


class Motion(Protocol):
    """A motion of the model, which is not imported yet: an angle [rad] and its derivatives at times [s]."""

    def position(self, t: FloatArray) -> FloatArray: ...
    def velocity(self, t: FloatArray) -> FloatArray: ...
    def acceleration(self, t: FloatArray) -> FloatArray: ...


class Gear:
    """One joint: the base ``play`` with the gap of the day, or, without play, the bar alone on a gear that follows."""

    def __init__(self, options: SimulatedJointOptions, seed: int) -> None:
        self.options = options
        self.samples: deque[list[ServoSample]] = deque()
        self.is_read = True
        self._seed = seed
        self._motion = ""
        self._body: Playing | Rigid | None = None

    def play_m(self, robot_time: float) -> float:
        """The gap after so much operation [m]."""
        worn = min(self.options.wear_per_year * robot_time / YEAR_S, MOST_WEAR)
        return min(self.options.play_m * math.exp(worn), MOST_PLAY_M)

    def lever_ratio(self, bar: Bar) -> float:
        """The joint's lever arm at its accelerometer in lengths of the bar: the factor of the acceleration there."""
        length_m = bar.options.oscillator.length_m
        return self.options.levers_m.get(bar.options.name, length_m) / length_m

    def prepare(self, motion: str, bar: Bar | None) -> None:
        """Builds the model with the bar's oscillator on it, and runs it once.  Raises DriverError."""
        from lostmotion.model import ModelError

        if self._body is not None:
            return
        self._motion = motion
        try:
            body = (Playing if self.options.play_m else Rigid)(bar.oscillator if bar else {})
            body.begin(self._moves(0), -RUN_UP_S)
            body.move(np.array([-RUN_UP_S, 0.0]), self.options.play_m)
        except ModelError as error:
            raise DriverError(f"{self.options.name}: {error}") from error
        self._body = body

    def move(self, step: Step, accel_times: FloatArray) -> FloatArray:
        """Moves through a step, queues the servo's samples; the tip acceleration [m/s²] at these times [s].

        The model's time is that of the stretch: a large time has few digits left for the phase of a motion.
        """
        assert self._body is not None
        if step.after_rest:
            self._body.begin(self._moves(step.stretch), -RUN_UP_S)
        servo_times = grid(step.begin, step.servo_end, self.options.poll_hz)
        all_times = np.unique(np.concatenate([servo_times, accel_times]))
        times = np.concatenate([[self._body.time], all_times - step.origin])
        command, position, accel = (signal[1:] for signal in self._body.move(times, self.play_m(step.begin)))
        if self.is_read:
            at = np.searchsorted(all_times, servo_times)
            self.samples.append(self._servo_samples(servo_times, command[at], position[at]))
        return np.asarray(accel[np.searchsorted(all_times, accel_times)])

    def _moves(self, stretch: int) -> Motion:
        """The motion of a stretch; a hand never waves twice the same.  Raises ModelError."""
        from lostmotion.model import HandWaved, by_name

        return HandWaved(self._seed + 1000 * stretch) if self._motion == "hand-waved" else by_name(self._motion)

    def _servo_samples(self, times: FloatArray, command: FloatArray, position: FloatArray) -> list[ServoSample]:
        step = self.options.resolution_rad
        if step:
            command, position = np.round(command / step) * step, np.round(position / step) * step
        rows = zip(times.tolist(), command.tolist(), position.tolist(), strict=True)
        return [ServoSample(self.options.name, *row) for row in rows]


class Playing:
    """Gears with play and the bar on them: the model as it is."""

    def __init__(self, oscillator: Mapping[str, float]) -> None:
        from lostmotion.model import build_model

        self._model = build_model("play", values=oscillator)

    def begin(self, motion: Motion, time: float) -> None:
        """Moves along with that motion from that time [s] on."""
        self._motion, self.time = motion, time
        self._state = self._model.initial_state(motion, time)

    def move(self, times: FloatArray, play_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """command, position [rad] and tip acceleration [m/s²] at ``times`` [s], of which the first is where it stands.

        The gap widens in steps of 0.1 %, which is as good as steadily, and cheaper.
        """
        if abs(play_m / self._model.parameters["d"].value - 1) > 1e-3:
            self._model = self._model.replace({"d": play_m})
        moved = self._model.simulate(self._motion, times, self._state)
        self.time, self._state = float(times[-1]), moved.state
        return moved["command"], moved["position"], moved["accel"]


class Rigid:
    """A joint without play: theta_2 = theta_1 exactly, so that only the bar is left to be integrated.

    By eq. 7 that is an oscillator under the force -m l theta_1''; its tip accelerates by q'' + l theta_1''.
    """

    def __init__(self, oscillator: Mapping[str, float]) -> None:
        from lostmotion.model import build_model

        given = {name: value for name, value in oscillator.items() if name != "l"}
        self._model = build_model("oscillator", values=given)
        self._length = oscillator.get("l", 0.1)

    def begin(self, motion: Motion, time: float) -> None:
        """Moves along with that motion from that time [s] on."""
        self._motion, self.time, self._state = motion, time, np.zeros(2)

    def move(self, times: FloatArray, play_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As Playing's."""
        from lostmotion.model import Sampled

        knots = np.arange(times[0] - KNOT_S, times[-1] + 3 * KNOT_S, KNOT_S)
        force = -self._model.parameters["m"].value * self._length * self._motion.acceleration(knots)
        moved = self._model.simulate(Sampled(knots, force), times, self._state)
        self.time, self._state = float(times[-1]), moved.state
        angle = self._motion.position(times)
        return angle, angle, moved["accel"] + self._length * self._motion.acceleration(times)


class Bar:
    """One accelerometer at the end of its metal bar."""

    def __init__(self, options: SimulatedAccelerometerOptions, seed: Sequence[int]) -> None:
        self.options = options
        self.blocks: deque[AccelBlock] = deque()
        self.is_read = True
        self._rng = np.random.default_rng(seed)

    def times(self, step: Step) -> FloatArray:
        """When it samples in a step [s]."""
        return grid(step.begin, step.end, self.options.rate_hz)

    @property
    def oscillator(self) -> dict[str, float]:
        """The bar as parameters of the model; the mass itself makes no difference to the acceleration."""
        bar, mass = self.options.oscillator, 0.02
        omega = 2 * math.pi * bar.f_res_hz
        return {"m": mass, "k": mass * omega**2, "b": 2 * bar.zeta * mass * omega, "l": bar.length_m}

    def feel(self, step: Step, tip: FloatArray) -> None:
        """Queues the readings of a step for the true tip acceleration [m/s²]."""
        from lostmotion.model import Sensor

        options = self.options
        sensor = Sensor(noise=options.noise_ms2, resolution=options.resolution_ms2, range=options.range_ms2)
        readings = sensor.apply(tip, self._rng)
        if self.is_read:
            self.blocks.append(AccelBlock(self.times(step), readings))
