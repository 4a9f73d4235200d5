"""Unknown functions of the motion as effects: curves for a residual that no effect of the catalogue explains.

A torque, a force or an error of the sensor may be any function of one state, a dry friction whose amplitude depends on
the angle, or a sine in time.  A curve is linear between knots, which are closest near the middle of the range, where
friction changes its sign.  describe.py fits these functions after the search; no fitting here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.shooting.segment import Segment, motions
from lostmotion.model import Domain, Model, Parameter
from lostmotion.model.base import Term
from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.kernel import Kernel, Slots, jitted, kernel
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import BAR_FORCE, FORCE, GAP, OMEGA2, Q_RATE, SENSOR, THETA1, THETA2, TIME, TIP, TORQUE, Q

__all__ = ["KNOTS", "Guess", "guesses", "wave_guess"]

KNOTS = 13
"""Number of knots of a curve."""
WIDEST = 0.995
"""The quantile of the variable at which a curve ends."""
BEND = 0.3
"""Share of the range, from its middle, within which the knots are about evenly spaced."""
MOST = 10.0
"""Bound of a curve, in units of the magnitude of what already acts in the equation."""
SMOOTH = 5e-3  # rad/s, as dry friction changes its sign
UNITS = {TORQUE: "N m", BAR_FORCE: "N", SENSOR: "m/s^2", GAP: "m"}
"""By signal, the unit of what acts on it."""
ACTS_ON = {TORQUE: ActsOn.JOINT, BAR_FORCE: ActsOn.OSCILLATOR, SENSOR: ActsOn.SENSOR, GAP: ActsOn.JOINT}
"""By signal, the part that an effect on it acts on."""
VARIABLES = {THETA2: "theta_2", OMEGA2: "omega_2", FORCE: "load", Q: "q", Q_RATE: "q'", TIP: "accel", THETA1: "command"}
"""By signal, the name of the variable of a curve."""
SHOWN = {"theta_2": "position", "omega_2": "velocity", "load": "force", "accel": "accel", "command": "command"}
"""The name of a variable in a trajectory; q and q' are states."""
PAIRS: Mapping[str, Sequence[tuple[int, int]]] = {
    "play": ((TORQUE, THETA2), (TORQUE, OMEGA2), (TORQUE, FORCE), (BAR_FORCE, Q), (BAR_FORCE, Q_RATE), (SENSOR, TIP),
             (SENSOR, THETA2), (SENSOR, OMEGA2), (GAP, THETA1)),
    "oscillator": ((BAR_FORCE, Q), (BAR_FORCE, Q_RATE)),
    "joint": ((TORQUE, THETA2), (TORQUE, OMEGA2)),
    "servo": ((TORQUE, THETA2), (TORQUE, OMEGA2)),
}  # fmt: skip
"""By base, the equations and the variables of the functions that may act on them."""
_numbers = count()


@jitted
def _height(s: Slots, p: Slots) -> float:
    """The value of a curve; p: the number of its variable, centre, scale, reach, KNOTS heights.  The knots are evenly
    spaced in asinh((variable - centre)/scale) within +-reach."""
    along = (math.asinh((s[int(p[0])] - p[1]) / p[2]) / p[3] + 1.0) * (0.5 * (KNOTS - 1))
    along = min(max(along, 0.0), KNOTS - 1.000001)
    i = int(along)
    return p[4 + i] + (along - i) * (p[5 + i] - p[4 + i])


@kernel
def curve(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """A function of one signal."""
    return _height(s, p)


@kernel
def dry_friction(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """Dry friction with an amplitude that is a function of one signal."""
    return _height(s, p) * math.tanh(s[OMEGA2] / SMOOTH)


@kernel
def wave(s: Slots, x: Slots, dx: Slots, p: Slots) -> float:
    """a sin(2 pi f t) + b cos(2 pi f t); p: f, a, b."""
    angle = 2 * math.pi * p[0] * s[TIME]
    return p[1] * math.sin(angle) + p[2] * math.cos(angle)


@dataclass(frozen=True, eq=False)
class Guess:
    """An unknown function.

    effect: with the free parameters of the function; unit: of its values; depends_on: its variables, that of the curve
    first; x: the knots (KNOTS,); seen: whether the motion reaches each of them (KNOTS,).  Both are empty for a sine.
    """

    effect: Effect
    unit: str
    depends_on: tuple[str, ...]
    x: FloatArray
    seen: NDArray[np.bool_]

    @property
    def is_wave(self) -> bool:
        """Whether the function is a sine in time with the parameters f, a and b, not a curve."""
        return not len(self.x)

    @property
    def heights(self) -> list[str]:
        """The full names of the parameters that are the values of the curve at its knots."""
        return [f"{self.effect.id}.c{i}" for i in range(len(self.x))]


def guesses(model: Model, segments: Sequence[Segment], size: Mapping[int, float], substep_s: float) -> list[Guess]:
    """All functions to fit to a residual of a model, with knots over the range of the motion in these segments.

    size: by signal, the magnitude of what already acts there.  Raises ModelError where no segment can be simulated.
    """
    motion = _motion(model, segments, substep_s)
    found = [_curve(model.base, target, source, motion, size[target]) for target, source in PAIRS[model.base]]
    if (TORQUE, THETA2) in PAIRS[model.base]:
        found.append(_curve(model.base, TORQUE, THETA2, motion, size[TORQUE], rubs=True))
    return found


def wave_guess(base: str, target: int, hz: float, size: float) -> Guess:
    """A sine with a frequency of about ``hz`` [Hz] on a signal (target); size: the magnitude of what already acts
    there."""
    parameters = {
        "f": Parameter(hz, "Hz", 0.9 * hz, 1.1 * hz, False, "searched", "frequency", Domain.POSITIVE),
        "a": _free(UNITS[target], size),
        "b": _free(UNITS[target], size),
    }
    return Guess(
        _effect(base, target, wave, parameters), UNITS[target], ("time",), np.empty(0), np.empty(0, dtype=bool)
    )


def _curve(
    base: str, target: int, source: int, motion: Mapping[str, FloatArray], size: float, rubs: bool = False
) -> Guess:
    variable = VARIABLES[source]
    values = motion[variable]
    centre = 0.0 if source != THETA2 and source != THETA1 else float(np.median(values))
    farthest = max(float(np.quantile(np.abs(values - centre), WIDEST)), 1e-12)
    scale = BEND * farthest
    reach = math.asinh(farthest / scale)
    fixed = {"source": float(source), "centre": centre, "scale": scale, "reach": reach}
    parameters = {
        name: Parameter(value, "", -math.inf, math.inf, True, "of the motion") for name, value in fixed.items()
    }
    parameters |= {f"c{i}": _free(UNITS[target], size) for i in range(KNOTS)}
    effect = _effect(base, target, dry_friction if rubs else curve, parameters)
    x = centre + scale * np.sinh(reach * np.linspace(-1, 1, KNOTS))
    near = np.abs(values[:, None] - x).argmin(axis=1)
    seen = np.bincount(near, minlength=KNOTS) > len(values) / 1000
    return Guess(effect, UNITS[target], (variable, "omega_2") if rubs else (variable,), x, seen)


def _effect(base: str, target: int, acting: Kernel, parameters: Mapping[str, Parameter]) -> Effect:
    return Effect(
        id=f"unknown_{next(_numbers)}", equation="an unknown function", summary="an unknown function",
        acts_on=ACTS_ON[target], bases=(base,), parameters=parameters,
        terms={base: (Term(target, acting, tuple(parameters)),)},
    )  # fmt: skip


def _free(unit: str, size: float) -> Parameter:
    return Parameter(0.0, unit, -MOST * size, MOST * size, False, "unknown", "height of the curve")


def _motion(model: Model, segments: Sequence[Segment], substep_s: float) -> dict[str, FloatArray]:
    """The values of each variable in the modelled motion over these segments (N,), by name."""
    runs = motions(model, segments, substep_s)
    found = {
        name: np.concatenate([run[signal] for run in runs])
        for name, signal in SHOWN.items()
        if all(signal in run.signals for run in runs)
    }
    states = np.concatenate([run.states for run in runs])
    return found | {name: states[:, i] for i, name in enumerate(model.state_names) if name in ("q", "q'")}
