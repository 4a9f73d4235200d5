"""Excitations: the input of a model as a function of time.  Closed forms, a recording, and a name for each.

The value is an angle [rad] where the base takes a command, a torque [N m] on ``joint``, a force [N] on ``oscillator``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lostmotion.model.errors import ModelError

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, CubicSpline

__all__ = ["Chirp", "FloatArray", "HandWaved", "Motion", "Sampled", "Sine", "Step", "by_name"]

FloatArray = NDArray[np.float64]

LARGEST = 1e12
"""of a number in the name of a motion, and the inverse of the smallest: a product of a few of them is finite"""


@runtime_checkable
class Motion(Protocol):
    """An input with its first and second derivative at times t [s], an array of any shape; the result has its shape."""

    def position(self, t: FloatArray) -> FloatArray: ...
    def velocity(self, t: FloatArray) -> FloatArray: ...
    def acceleration(self, t: FloatArray) -> FloatArray: ...


class Named(Motion, Protocol):
    """A motion that has a name, and bounds of its velocity and acceleration."""

    def peaks(self) -> tuple[float, float]:
        """Velocity and acceleration [rad/s, rad/s²] that it does not exceed at any time."""


@dataclass(frozen=True)
class Sine:
    """amplitude sin(2 pi f t): the paper's figure 1 at 6 Hz."""

    frequency_hz: float = 6.0
    amplitude_rad: float = 0.02

    def __post_init__(self) -> None:
        _require(self, frequency_hz=self.frequency_hz > 0)

    @property
    def _w(self) -> float:
        return 2 * math.pi * self.frequency_hz

    def position(self, t: FloatArray) -> FloatArray:
        return self.amplitude_rad * np.sin(self._w * t)

    def velocity(self, t: FloatArray) -> FloatArray:
        return self.amplitude_rad * self._w * np.cos(self._w * t)

    def acceleration(self, t: FloatArray) -> FloatArray:
        return -self.amplitude_rad * self._w**2 * np.sin(self._w * t)

    def peaks(self) -> tuple[float, float]:
        return abs(self.amplitude_rad) * self._w, abs(self.amplitude_rad) * self._w**2


@dataclass(frozen=True)
class HandWaved:
    """An irregular motion as of a hand: lines of random frequency and phase between low_hz and high_hz, valid at any t.

    The lines fall as 1/f; their root mean square is that of a sine of amplitude_rad.  Same seed, same motion.
    """

    seed: int = 0
    amplitude_rad: float = 0.15
    low_hz: float = 0.5
    high_hz: float = 3.0
    lines: int = 12

    def __post_init__(self) -> None:
        sound = {"low_hz": self.low_hz > 0, "high_hz": self.high_hz > self.low_hz}
        _require(self, **sound, seed=self.seed >= 0, lines=self.lines >= 1)

    @cached_property
    def _lines(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Angular frequency [rad/s], phase and amplitude of each line, shape (lines,)."""
        rng = np.random.default_rng(self.seed)
        edges = np.linspace(self.low_hz, self.high_hz, self.lines + 1)
        frequency = rng.uniform(edges[:-1], edges[1:])
        amplitude = rng.uniform(0.5, 1.0, self.lines) / frequency
        amplitude *= self.amplitude_rad / np.sqrt(np.sum(amplitude**2))
        return 2 * math.pi * frequency, rng.uniform(0, 2 * math.pi, self.lines), amplitude

    def _sum(self, t: FloatArray, order: int) -> FloatArray:
        t = np.asarray(t, dtype=float)
        total = np.zeros_like(t)
        for w, phase, amplitude in zip(*self._lines, strict=True):
            total += amplitude * w**order * np.sin(w * t + (phase + order * math.pi / 2))
        return total

    def position(self, t: FloatArray) -> FloatArray:
        return self._sum(t, 0)

    def velocity(self, t: FloatArray) -> FloatArray:
        return self._sum(t, 1)

    def acceleration(self, t: FloatArray) -> FloatArray:
        return self._sum(t, 2)

    def peaks(self) -> tuple[float, float]:
        w, _, amplitude = self._lines
        return float(np.sum(np.abs(amplitude) * w)), float(np.sum(np.abs(amplitude) * w**2))


@dataclass(frozen=True)
class Chirp:
    """A sine whose frequency runs from start_hz at t = 0 to stop_hz at duration_s, and stays there."""

    start_hz: float = 0.5
    stop_hz: float = 8.0
    duration_s: float = 10.0
    amplitude_rad: float = 0.02

    def __post_init__(self) -> None:
        _require(self, start_hz=self.start_hz > 0, stop_hz=self.stop_hz > 0, duration_s=self.duration_s > 0)

    def _phase(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The phase [rad] and its two derivatives."""
        slope = 2 * math.pi * (self.stop_hz - self.start_hz) / self.duration_s
        swept = np.clip(t, 0.0, self.duration_s)
        rate = 2 * math.pi * self.start_hz + slope * swept
        phase = 2 * math.pi * self.start_hz * swept + slope * swept**2 / 2 + rate * (t - swept)
        return phase, rate, np.where(swept == t, slope, 0.0)

    def position(self, t: FloatArray) -> FloatArray:
        return self.amplitude_rad * np.sin(self._phase(t)[0])

    def velocity(self, t: FloatArray) -> FloatArray:
        phase, rate, _ = self._phase(t)
        return self.amplitude_rad * rate * np.cos(phase)

    def acceleration(self, t: FloatArray) -> FloatArray:
        phase, rate, slope = self._phase(t)
        return self.amplitude_rad * (slope * np.cos(phase) - rate**2 * np.sin(phase))

    def peaks(self) -> tuple[float, float]:
        fastest = 2 * math.pi * max(self.start_hz, self.stop_hz)
        slope = 2 * math.pi * abs(self.stop_hz - self.start_hz) / self.duration_s
        return abs(self.amplitude_rad) * fastest, abs(self.amplitude_rad) * (slope + fastest**2)


@dataclass(frozen=True)
class Step:
    """From 0 to angle_rad between start_s and start_s + rise_s, with the least jerk (a polynomial of degree five)."""

    angle_rad: float = 0.1
    rise_s: float = 0.1
    start_s: float = 0.1

    def __post_init__(self) -> None:
        _require(self, rise_s=self.rise_s > 0)

    def _part(self, t: FloatArray) -> FloatArray:
        return np.clip((np.asarray(t) - self.start_s) / self.rise_s, 0.0, 1.0)

    def position(self, t: FloatArray) -> FloatArray:
        u = self._part(t)
        return self.angle_rad * u**3 * (10 - 15 * u + 6 * u**2)

    def velocity(self, t: FloatArray) -> FloatArray:
        u = self._part(t)
        return self.angle_rad / self.rise_s * 30 * u**2 * (1 - u) ** 2

    def acceleration(self, t: FloatArray) -> FloatArray:
        u = self._part(t)
        return self.angle_rad / self.rise_s**2 * 60 * u * (1 - u) * (1 - 2 * u)

    def peaks(self) -> tuple[float, float]:
        angle = abs(self.angle_rad)
        return 15 / 8 * angle / self.rise_s, 10 / math.sqrt(3) * angle / self.rise_s**2


class Sampled:
    """A recorded input: the cubic spline (C2, not-a-knot) through samples, straight lines outside them.

    time: (N,) [s], strictly ascending, N >= 2, evenly spaced or not; values: (N,); degree: of the spline, 3 or 5 (C4,
    N >= 6), whose error falls with the sixth power of the spacing.  Raises ModelError otherwise.
    """

    def __init__(self, time: ArrayLike, values: ArrayLike, degree: int = 3) -> None:
        self.degree = degree
        self.time = np.array(time, dtype=np.float64)
        self.values = np.array(values, dtype=np.float64)
        if self.time.ndim != 1 or self.time.shape != self.values.shape or self.time.size < 2:
            raise ModelError(
                f"samples need as many values as times, at least two; found {self.time.shape} and {self.values.shape}"
            )
        for name, array in (("time", self.time), ("value", self.values)):
            array.flags.writeable = False
            if not np.all(np.isfinite(array)):
                bad = int(np.argmin(np.isfinite(array)))
                raise ModelError(f"the {name} of sample {bad} is {array[bad]}, not a finite number; drop gaps first")
        if not np.all(np.diff(self.time) > 0):
            bad = int(np.argmin(np.diff(self.time) > 0)) + 1
            raise ModelError(
                f"times must ascend, but sample {bad} at {self.time[bad]:g} s does not follow its forerunner"
            )

    def __reduce__(self) -> tuple[type[Sampled], tuple[FloatArray, FloatArray, int]]:
        """To another process go the samples alone; the spline is soon made again."""
        return Sampled, (self.time, self.values, self.degree)

    def changed(self, later_s: float = 0.0, sign: float = 1.0) -> Sampled:
        """The input later by ``later_s`` [s], and times ``sign``."""
        return Sampled(self.time + later_s, sign * self.values, self.degree)

    @cached_property
    def _spline(self) -> BSpline[np.float64] | CubicSpline[np.float64]:
        # late: it takes longer than all else that a closed form needs
        from scipy.interpolate import CubicSpline, make_interp_spline

        if self.degree == 3:
            return CubicSpline(self.time, self.values)
        return make_interp_spline(self.time, self.values, self.degree)

    @cached_property
    def nodes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, first and second derivative at the samples, each (N,)."""
        return self.values, self._spline(self.time, 1), self._spline(self.time, 2)

    def _inside(self, t: FloatArray) -> FloatArray:
        return np.clip(t, self.time[0], self.time[-1])

    def position(self, t: FloatArray) -> FloatArray:
        inside = self._inside(t)
        value = self._spline(inside)
        return np.asarray(value if np.array_equal(inside, t) else value + (t - inside) * self._spline(inside, 1))

    def velocity(self, t: FloatArray) -> FloatArray:
        return np.asarray(self._spline(self._inside(t), 1))

    def acceleration(self, t: FloatArray) -> FloatArray:
        return np.asarray(np.where(self._inside(t) == t, self._spline(self._inside(t), 2), 0.0))


def by_name(text: str) -> Named:
    """The motion that a text names: its kind, and after a colon its numbers in the order of the class's fields.

    "sine:6,0.02" (Hz, rad); "hand-waved", "hand-waved:7" (seed, rad, Hz, Hz); "chirp:0.5,8,10,0.02" (Hz, Hz, s, rad);
    "step:0.1,0.05,1" (rad, rise s, start s).  Raises ModelError saying what is possible.
    """
    kind, _, rest = text.partition(":")
    if kind not in _KINDS:
        raise ModelError(f"no motion is called {kind!r}; there are {', '.join(_KINDS)}")
    try:
        numbers = [float(word) for word in rest.split(",")] if rest else []
        if not all(number == 0 or 1 / LARGEST <= abs(number) <= LARGEST for number in numbers):
            raise ValueError("not finite, or its acceleration would not be")
        return _KINDS[kind](*numbers)
    except ModelError:
        raise
    except (TypeError, ValueError) as error:
        raise ModelError(f"{text!r} is no motion; write for instance {_EXAMPLES[kind]!r}") from error


def _hand_waved(seed: float = 0, amplitude: float = 0.15, low: float = 0.5, high: float = 3.0) -> HandWaved:
    if not float(seed).is_integer():
        raise ValueError("a seed is a whole number")
    return HandWaved(int(seed), amplitude, low, high)


_KINDS: Mapping[str, Callable[..., Named]] = {"sine": Sine, "hand-waved": _hand_waved, "chirp": Chirp, "step": Step}
_EXAMPLES = {
    "sine": "sine:6,0.02",
    "hand-waved": "hand-waved:7,0.15",
    "chirp": "chirp:0.5,8,10,0.02",
    "step": "step:0.1,0.05",
}


def _require(motion: object, **holds: bool) -> None:
    """Raises ModelError naming the first field whose condition does not hold, or that is not finite."""
    for name, value in vars(motion).items():
        if not math.isfinite(value) or not holds.get(name, True):
            raise ModelError(f"{type(motion).__name__}: {name} cannot be {value:g}")
