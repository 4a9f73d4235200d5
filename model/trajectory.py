"""What a simulation hands over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lostmotion.model.motion import FloatArray

__all__ = ["Trajectory"]


@dataclass(frozen=True)
class Trajectory:
    """Signals at the output times.

    time: (N,) [s]; signals: by name, each (N,), SI units (play: command, position [rad], velocity, acceleration,
    accel [m/s²], force [N], torque [N m], displacement, gap [m]); states: (N, n), all states at those times; state: the
    last of them, to go on from with ``simulate(…, state=…)``; substep_s: the step that was used [s].
    """

    time: FloatArray
    signals: Mapping[str, FloatArray]
    states: FloatArray
    state: FloatArray
    substep_s: float

    def __getitem__(self, name: str) -> FloatArray:
        """The signal of that name.  Raises KeyError, which names those that exist, for another one."""
        if name not in self.signals:
            raise KeyError(f"no signal {name!r}; there are {', '.join(self.signals)}")
        return self.signals[name]

    def __repr__(self) -> str:
        """Its length and signals, without the arrays."""
        span = f"{self.time.size} times, {self.time[0]:.6g} to {self.time[-1]:.6g} s"
        return f"<Trajectory: {span}: {', '.join(self.signals)}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """To another process goes a plain dict; read-only views of one cannot be pickled."""
        return Trajectory, (self.time, dict(self.signals), self.states, self.state, self.substep_s)
