"""Driven systems for ``bench.driven_motions``: a joint under a controller, a servo, and a mass on a spring.

Each has one hidden effect, two, or none, and is simulated by SciPy's LSODA with equations written here; sizes, rates
and noise are drawn over decades.  A system gives recordings as files would.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from lostmotion.drivers.recording import Recording

__all__ = ["SYSTEMS", "Bar", "Joint", "Servo", "System"]

FloatArray = NDArray[np.float64]
Function = Callable[[float], float]
Slope = Callable[[float, FloatArray], list[float]]
DURATION_S, LEAD_S, TONES = 8.0, 2.0, 8
SHARP = 300.0
"""Usual speed over the width within which dry friction changes sign."""
SECOND_DAMPING, LAG, SKEW = 0.02, 0.05, 2e-3
"""Of the second mode; the sensor's lag in periods of the resonance; of the sensor's clock."""
PLAYS = (0.05, 0.1, 0.2, 0.4)
"""Plays in the swing of a joint (the root mean square of its goal)."""
END = 0.02
"""Last part of an elastic contact, in which its motion comes to an end: a sudden end takes LSODA minutes."""
PROFILE_S = 1e-3
"""Step of the profile of a servo with a limited speed [s]: a servo's own loop runs at a kilohertz."""
SPEED = 3.5
"""Usual speed of a servo's goal, in its swing [rad/s]."""
FINER = 16
"""Times in the step of a recording at which what a sensor with a lag feels is linear in between.  With the samples
alone, twelve in a period of the fastest tone, its amplitude was 2 % too small there, and a second mode was named for it
(seed 2310)."""


def tones(rng: np.random.Generator, low: float, high: float, size: float) -> tuple[Function, Function, Function]:
    """A sum of sines between two frequencies [Hz], of root mean square ``size``, and its first two derivatives."""
    f = 2 * math.pi * np.exp(rng.uniform(math.log(low), math.log(high), TONES))
    a = rng.uniform(0.5, 1.0, TONES) / f**0.5
    a *= size * math.sqrt(2) / float(np.sqrt(np.sum(a**2)))
    phase = rng.uniform(0, 2 * math.pi, TONES)
    return (
        lambda t: float(a @ np.sin(f * t + phase)),
        lambda t: float((a * f) @ np.cos(f * t + phase)),
        lambda t: -float((a * f * f) @ np.sin(f * t + phase)),
    )


def followed(slope: Slope, time: FloatArray, start: list[float]) -> FloatArray:
    """The states at these times, one a row.  Raises RuntimeError where they cannot be found."""
    found = solve_ivp(slope, (time[0], time[-1]), start, "LSODA", time, rtol=1e-7, atol=1e-10)
    if not found.success:
        raise RuntimeError(found.message)
    return np.asarray(found.y.T)


def dry(speed: float) -> float:
    """sign(speed), smoothed; speed: in units of the usual one."""
    return math.tanh(SHARP * speed)


@dataclass(frozen=True)
class Law:
    """The torque of hidden effects on a joint.

    scale [N m] and speed [rad/s]: usual ones of the motion; sizes: of each effect in units of ``scale``; count, phase:
    of a ripple, the phase of a weight too.
    """

    effects: tuple[str, ...]
    scale: float
    speed: float
    sizes: tuple[float, ...]
    count: int
    phase: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, effects: tuple[str, ...], scale: float, speed: float) -> Law:
        """Effects of a fifth to three fifths of the usual torque."""
        sizes = tuple(rng.uniform(0.2, 0.6, len(effects)).tolist())
        return cls(effects, scale, speed, sizes, int(rng.integers(3, 12)), float(rng.uniform(-0.5, 0.5)))

    def __call__(self, theta: float, omega: float, load: float) -> float:
        """Their torque [N m]; load: the transmitted one."""
        each = zip(self.effects, self.sizes, strict=True)
        return self.scale * sum(size * self._one(name, theta, omega / self.speed, load) for name, size in each)

    def behind_play(self, y: float, omega: float, swing: float) -> tuple[float, float]:
        """The torque [N m] of dry friction behind a play, which is a share of the swing [rad], with an elastic contact
        of a third of it; and the rate of its state y, the place within the play [rad/s]."""
        if "friction_behind_play" not in self.effects:
            return 0.0, 0.0
        play = swing * PLAYS[self.count % len(PLAYS)]
        bent = (abs(y) - play / 2) / (play / 3)
        size = self.scale * self.sizes[self.effects.index("friction_behind_play")]
        return -math.copysign(size * min(max(bent, 0.0), 1.0), y), omega * (
            1.0 if y * omega < 0 else min((1 - bent) / END, 1.0)
        )

    def _one(self, name: str, theta: float, u: float, load: float) -> float:
        """The torque of an effect of size one; u: the speed in units of the usual one."""
        match name:
            case "viscous_friction":
                return -u
            case "coulomb_friction":
                return -dry(u)
            case "stribeck_friction":
                return -(1 + 1.5 * math.exp(-((u / 0.15) ** 2))) * dry(u)
            case "load_dependent_friction":
                return -abs(load) / self.scale * dry(u)
            case "gravity_torque":
                return -math.sin(theta + self.phase)
            case "quadratic_damping":
                return -u * abs(u)
            case "torque_ripple":
                return math.sin(self.count * theta + self.phase)
            case "spring_torque":
                return -theta
        return 0.0


@dataclass(frozen=True)
class Joint:
    """A joint under proportional and derivative control, recorded by its torque and angle.

    high [Hz], swing [rad]: of its motion; noise [rad], torque_noise [N m]: of the readings.
    """

    inertia: float
    law: Law
    rate: float
    noise: float
    torque_noise: float
    high: float
    swing: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, effects: tuple[str, ...]) -> Joint:
        """One of 1e-4 to 10 kg m²."""
        inertia, high, swing = 10 ** rng.uniform(-4, 1), 10 ** rng.uniform(-0.3, 0.5), 10 ** rng.uniform(-0.5, 0.5)
        speed = 2 * math.pi * high * swing * 0.6
        scale = inertia * speed * 2 * math.pi * high
        return cls(
            inertia, Law.drawn(rng, effects, scale, speed), float(rng.choice([100, 200, 500])),
            swing * 10 ** rng.uniform(-4.5, -3.3), scale * 10 ** rng.uniform(-2.5, -1.5), high, swing,
        )  # fmt: skip

    def record(self, rng: np.random.Generator, name: str) -> Recording:
        """One recording of it."""
        goal, rate, push = tones(rng, self.high / 8, self.high, self.swing)
        stiff = self.inertia * (2 * math.pi * self.high * 6) ** 2
        damp = 1.4 * math.sqrt(stiff * self.inertia)

        def torque(t: float, x: FloatArray) -> float:
            return self.inertia * push(t) + stiff * (goal(t) - float(x[0])) + damp * (rate(t) - float(x[1]))

        def slope(t: float, x: FloatArray) -> list[float]:
            load, (bent, change) = torque(t, x), self.law.behind_play(x[2], x[1], self.swing)
            return [x[1], (load + self.law(x[0], x[1], load) + bent) / self.inertia, change]

        time = np.arange(0.0, DURATION_S, 1 / self.rate)
        states = followed(slope, time, [goal(0.0), rate(0.0), 0.0])
        torques = np.array([torque(t, x) for t, x in zip(time, states, strict=True)])
        return Recording(time, {
            "position": states[:, 0] + self.noise * rng.standard_normal(time.size),
            "torque": torques + self.torque_noise * rng.standard_normal(time.size),
        }, name=name)  # fmt: skip


@dataclass(frozen=True)
class Servo:
    """A servo as the base describes it (12 V, 4.4 Ohm, 1.2 N m/A, a duty of 5.28 a radian), behind a delay or a lag
    [s] or a limit of its speed, recorded by its goal and angle.  limit [rad/s]."""

    inertia: float
    law: Law
    delay: float
    lag: float
    rate: float
    noise: float
    swing: float
    limit: float = math.inf

    @classmethod
    def drawn(cls, rng: np.random.Generator, effects: tuple[str, ...]) -> Servo:
        """One of 5e-3 to 5e-2 kg m²."""
        servo = cls(
            10 ** rng.uniform(-2.3, -1.3), Law.drawn(rng, effects, 1.0, 2.5),
            rng.uniform(0.015, 0.05) * ("command_delay" in effects),
            rng.uniform(0.02, 0.06) * ("actuator_lag" in effects),
            float(rng.choice([50, 100, 200])), 10 ** rng.uniform(-3.7, -3), rng.uniform(0.3, 0.7),
        )  # fmt: skip
        is_limited = "velocity_limit" in effects
        return replace(servo, limit=rng.uniform(0.6, 1.4) * SPEED * servo.swing) if is_limited else servo

    def record(self, rng: np.random.Generator, name: str) -> Recording:
        """One recording of it, which begins when it moves already."""
        goal, _, _ = tones(rng, 0.2, 1.5, self.swing)
        asked = self._limited(goal) if math.isfinite(self.limit) else goal

        def slope(t: float, x: FloatArray) -> list[float]:
            aim = asked(t - self.delay)
            duty = min(max(5.28 * ((x[2] if self.lag else aim) - x[0]), -1.0), 1.0)
            load = 1.2 * (duty * 12 - 1.2 * x[1]) / 4.4
            torque = load - 0.08 * x[1] + self.law(x[0], x[1], load)
            return [x[1], torque / self.inertia, (aim - x[2]) / (self.lag or 1.0)]

        time = np.arange(0.0, LEAD_S + DURATION_S, 1 / self.rate)
        states = followed(slope, time, [goal(0.0), 0.0, goal(0.0)])
        kept = time >= LEAD_S
        return Recording(time[kept] - LEAD_S, {
            "command": np.array([goal(t) for t in time[kept]]),
            "position": states[kept, 0] + self.noise * rng.standard_normal(int(kept.sum())),
        }, name=name)  # fmt: skip

    def _limited(self, goal: Function) -> Function:
        """The goal as a profile with a limited speed follows it, in steps of ``PROFILE_S``."""
        time = np.arange(0.0, LEAD_S + DURATION_S, PROFILE_S)
        wanted = np.array([goal(t) for t in time])
        step, followed_goal = self.limit * PROFILE_S, wanted.copy()
        for n in range(1, time.size):
            followed_goal[n] = followed_goal[n - 1] + min(max(wanted[n] - followed_goal[n - 1], -step), step)
        return lambda t: float(np.interp(t, time, followed_goal))


@dataclass(frozen=True)
class Bar:
    """A mass on a spring that a force drives from rest, recorded by its place or its acceleration.

    size: of the hidden effect, a share of what damper or spring do; second: frequency of the second mode over the
    first; noise: a share of the reading; usual, reading: root mean squares of place and reading without the effect.
    """

    damping: float
    spring: float
    effects: tuple[str, ...]
    size: float
    second: float
    column: str
    noise: float
    mass: float = 0.02
    usual: float = 0.0
    reading: float = 0.0

    @classmethod
    def drawn(cls, rng: np.random.Generator, effects: tuple[str, ...]) -> Bar:
        """One of 1 to 60 Hz, with a damping ratio of 0.01 to 0.1."""
        bar = cls(0.0, 0.02 * (2 * math.pi * 10 ** rng.uniform(0, 1.8)) ** 2, effects, rng.uniform(0.15, 0.4),
                  rng.uniform(2.6, 4.5), "", 10 ** rng.uniform(-3, -2))  # fmt: skip
        of_sensor = {"sensor_lag", "bias_drift", "sensor_saturation", "clock_skew"} & set(effects)
        bar = replace(
            bar,
            damping=2 * 10 ** rng.uniform(-2, -1) * math.sqrt(bar.spring * bar.mass),
            column="accel" if of_sensor or rng.random() < 0.5 else "displacement",
        )
        push, time = bar._pushed(rng)
        bare = replace(bar, effects=("second_mode",) if "second_mode" in effects else ())
        states = bare._states(push, time)
        return replace(bar, usual=float(np.std(states[:, 0])), reading=float(np.std(bare._seen(push, time, states))))

    def record(self, rng: np.random.Generator, name: str) -> Recording:
        """One recording of it."""
        push, time = self._pushed(rng)
        at = time / (1 + SKEW * ("clock_skew" in self.effects))
        seen = self._seen(push, at, self._states(push, at))
        if "sensor_lag" in self.effects:
            fine = np.linspace(time[0], time[-1], (time.size - 1) * FINER + 1)
            seen = lagged(fine, self._seen(push, fine, self._states(push, fine)), LAG / self._f_hz)[::FINER]
        if "bias_drift" in self.effects:
            seen = seen + 2 * self.size * self.reading * time / time[-1]
        seen = seen + self.noise * self.reading * rng.standard_normal(time.size)
        if "sensor_saturation" in self.effects:
            seen = np.clip(seen, -1.5 * self.reading, 1.5 * self.reading)
        return Recording(time, {"force": np.array([push(t) for t in time]), self.column: seen}, name=name)

    @property
    def _f_hz(self) -> float:
        return math.sqrt(self.spring / self.mass) / (2 * math.pi)

    def _pushed(self, rng: np.random.Generator) -> tuple[Function, FloatArray]:
        """A force of 1 N, and the times of the samples: twelve a period of its fastest tone."""
        high = (1.3 * self.second if "second_mode" in self.effects else 1.6) * self._f_hz
        return tones(rng, self._f_hz / 4, high, 1.0)[0], np.arange(0.0, 40 / self._f_hz, 1 / (12 * high))

    def _states(self, push: Function, time: FloatArray) -> FloatArray:
        return followed(lambda t, x: self._slope(t, x, push), time, [0.0] * 4)

    def _seen(self, push: Function, time: FloatArray, states: FloatArray) -> FloatArray:
        """What a sensor without errors reads."""
        if self.column == "displacement":
            return np.asarray(states[:, 0] + states[:, 2])
        slopes = np.array([self._slope(t, x, push) for t, x in zip(time, states, strict=True)])
        return np.asarray(slopes[:, 1] + slopes[:, 3])

    def _slope(self, t: float, x: FloatArray, push: Function) -> list[float]:
        force = push(t) - self.damping * x[1] - self.spring * x[0] + (self._hidden(x[0], x[1]) if self.usual else 0.0)
        share = 2.0 * self.size if "second_mode" in self.effects else 0.0
        other = 2 * math.pi * self.second * self._f_hz
        return [
            x[1], force / self.mass,
            x[3], share * push(t) / self.mass - 2 * SECOND_DAMPING * other * x[3] - other**2 * x[2],
        ]  # fmt: skip

    def _hidden(self, place: float, speed: float) -> float:
        """The hidden force [N]."""
        fast = self.usual * 2 * math.pi * self._f_hz
        s, u, damper = place / self.usual, speed / fast, self.damping * fast
        match self.effects:
            case ("coulomb_friction",):
                return -2 * self.size * damper * dry(u)
            case ("quadratic_damping",):
                return -2 * self.size * damper * u * abs(u)
            case ("hardening_spring",):
                return -0.3 * self.size * self.spring * self.usual * s**3
        return 0.0


def lagged(time: FloatArray, values: FloatArray, lag: float) -> FloatArray:
    """The values behind a first-order low-pass, exactly for values that are linear between the times."""
    step = float(time[1] - time[0])
    decay, found = math.exp(-step / lag), values.copy()
    for i in range(1, values.size):
        slope = float(values[i] - values[i - 1]) / step
        found[i] = values[i] - slope * lag + (found[i - 1] - values[i - 1] + slope * lag) * decay
    return found


System = Joint | Servo | Bar
SYSTEMS: dict[str, type[Joint] | type[Servo] | type[Bar]] = {"joint": Joint, "servo": Servo, "oscillator": Bar}
