"""Windows without noise, of a joint with play and of the same joint without, by two simulators.

The model (eqs. 1-7) and MuJoCo, an independent one: a motor that follows the command exactly, a link with a small free
range behind it, a flexible bar on the link, and MuJoCo's own accelerometer at the bar's end.  No noise, no scores.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings
from lostmotion.model import HandWaved, Motion, Sampled, build_model

__all__ = [
    "LENGTH_M",
    "POLL_HZ",
    "RADIUS_M",
    "RECORD_S",
    "STEP_RAD",
    "Bar",
    "Gear",
    "Windows",
    "joined",
    "tip",
    "tip_without_play",
    "windows_of",
]

FloatArray = NDArray[np.float64]
RADIUS_M, LENGTH_M, MASS_KG = 0.010, 0.10, 0.02
POLL_HZ, STEP_RAD = 100.0, math.radians(300) / 1023
"""Rate and step of the commands of an AX-12A on a fast bus."""
LEAD_S, RECORD_S = 1.0, 13.0
STEPS = 4
"""MuJoCo's steps from one sample to the next, and no longer than 0.1 ms."""


@dataclass(frozen=True)
class Bar:
    """The oscillator and how it is sampled."""

    f_res_hz: float = 58.0
    zeta: float = 0.012
    rate_hz: float = 1000.0

    @property
    def values(self) -> dict[str, float]:
        """As parameters of the model."""
        omega = 2 * math.pi * self.f_res_hz
        return {"m": MASS_KG, "k": MASS_KG * omega**2, "b": 2 * self.zeta * MASS_KG * omega, "l": LENGTH_M}


@dataclass(frozen=True)
class Gear:
    """What of eqs. 1-5 and the catalogue's effects is not the model's default."""

    values: tuple[tuple[str, float], ...] = ()
    effects: tuple[str, ...] = ()


USUAL = Gear()


@dataclass(frozen=True, eq=False)
class Windows:
    """Tip acceleration [m/s²] with play and without, shape (M, N) each, of the same reversals; play [m], swing
    [rad/s²] and jerk [rad/s³] of the commanded acceleration, shape (M,)."""

    worn: FloatArray
    healthy: FloatArray
    play: FloatArray
    swing: FloatArray
    jerk: FloatArray


@lru_cache(maxsize=320)
def windows_of(
    seed: int, play_m: float, bar: Bar, window_s: float, mujoco: bool = False, gear: Gear = USUAL
) -> Windows:
    """The windows of twelve seconds of hand-waved motion: by eqs. 1-7, or by MuJoCo's joint with hard stops."""
    motion = HandWaved(seed)
    worn = tip(motion, _times(bar), play_m, bar, mujoco, gear)
    return _cut(motion, _times(bar), worn, _healthy(seed, bar), play_m, bar, window_s)


@lru_cache(maxsize=2)
def _healthy(seed: int, bar: Bar) -> FloatArray:
    """The same motion of a joint without play, for all of its plays."""
    return tip_without_play(HandWaved(seed), _times(bar), bar)


def _times(bar: Bar) -> FloatArray:
    return np.arange(round(RECORD_S * bar.rate_hz)) / bar.rate_hz


def tip(motion: Motion, times: FloatArray, play_m: float, bar: Bar, mujoco: bool, gear: Gear = USUAL) -> FloatArray:
    """Tip acceleration [m/s²] at times [s], evenly spaced from 0, of a joint with play, without noise.  MuJoCo's joint
    has hard stops instead of a gear."""
    if mujoco:
        return _mujoco(motion, times, play_m, bar)
    model = build_model("play", gear.effects, values={"d": play_m, **bar.values, **dict(gear.values)})
    return model.simulate(motion, times)["accel"]


def joined(parts: Iterator[Windows] | list[Windows]) -> Windows:
    """All of them as one."""
    parts = list(parts)
    names = ("worn", "healthy", "play", "swing", "jerk")
    return Windows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def tip_without_play(motion: Motion, times: FloatArray, bar: Bar) -> FloatArray:
    """The gear follows exactly: by eq. 7 the bar is an oscillator under the force -m l theta_1''."""
    values = {name: value for name, value in bar.values.items() if name != "l"}
    knots = np.arange(times[0], times[-1] + 0.01, 2e-3)
    force = Sampled(knots, -MASS_KG * LENGTH_M * motion.acceleration(knots))
    moved = build_model("oscillator", values=values).simulate(force, times)
    return np.asarray(moved["accel"] + LENGTH_M * motion.acceleration(times))


def _cut(
    motion: HandWaved, times: FloatArray, worn: FloatArray, healthy: FloatArray,
    play_m: float, bar: Bar, window_s: float,
) -> Windows:  # fmt: skip
    """The windows after the reversals that the service's own trigger finds in the commands."""
    polls = np.arange(0, times[-1], 1 / POLL_HZ)
    commands = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
    found = Trigger(DetectorSettings(f_res_hz=bar.f_res_hz), POLL_HZ, STEP_RAD).push(polls.tolist(), commands.tolist())
    length = round(window_s * bar.rate_hz)
    kept = [r for r in found if LEAD_S < r.time < times[-1] - window_s - 0.1]
    first = [math.ceil(r.time * bar.rate_hz) for r in kept]
    at = np.array([r.time for r in kept])
    jerk = (motion.acceleration(at + 1e-3) - motion.acceleration(at - 1e-3)) / 2e-3
    return Windows(
        np.array([worn[i : i + length] for i in first]),
        np.array([healthy[i : i + length] for i in first]),
        np.full(len(kept), play_m),
        np.array([abs(r.swing) for r in kept]),
        jerk,
    )


SCENE = """
<mujoco>
 <option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
 <worldbody>
  <body name="motor" mocap="true"/>
  <body name="link"><joint name="gap" axis="0 0 1" limited="true" range="{low} {high}" armature="{armature}"
    solreflimit="{stiff} 1" solimplimit="0.99 0.999 1e-5"/>
   <inertial pos="0 0 0" mass="0.05" diaginertia="1e-4 1e-4 {inertia}"/>
   <body name="tip" pos="{length} 0 0"><joint name="bar" type="slide" axis="0 1 0" stiffness="{k}" damping="{b}"/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/><site name="sensor"/></body>
  </body>
 </worldbody>
 <sensor><accelerometer site="sensor"/></sensor>
</mujoco>"""


def _mujoco(motion: Motion, times: FloatArray, play_m: float, bar: Bar) -> FloatArray:
    """Tip acceleration of a link that hangs with a free range on a moving shaft.

    In the shaft's frame: the link's angle against the shaft is limited to ± half the play, and feels the shaft's
    acceleration as the torque -J theta_1''; the bar's tip likewise.  What the accelerometer shows there lacks only the
    shaft's own part l theta_1'', which is added.  MuJoCo's limits are stiff and damped to stop without a rebound.
    """
    import mujoco  # type: ignore[import-not-found, unused-ignore]

    inertia, reaction = 2e-4, 1e-6
    many = max(STEPS, math.ceil(1e4 / bar.rate_hz))
    step = 1 / bar.rate_hz / many
    half = play_m / RADIUS_M / 2
    mass = reaction / LENGTH_M**2  # as in the paper the bar does not turn the joint back: its mass is small
    scale = mass / MASS_KG
    text = SCENE.format(step=step, low=math.degrees(-half), high=math.degrees(half), armature=0, stiff=5 * step,
                        inertia=inertia, length=LENGTH_M, k=bar.values["k"] * scale, b=bar.values["b"] * scale,
                        mass=mass)  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text.replace('<body name="motor" mocap="true"/>', ""))
    data = mujoco.MjData(model)
    shaft = motion.acceleration(np.arange(times.size * many) * step)
    out = np.empty(times.size)
    for i in range(times.size):
        for j in range(many):
            accel = shaft[i * many + j]
            data.qfrc_applied[0] = -(inertia + mass * LENGTH_M**2) * accel
            data.qfrc_applied[1] = -mass * LENGTH_M * accel
            mujoco.mj_step(model, data)
        out[i] = data.sensordata[1] + LENGTH_M * shaft[i * many + many - 1]
    return out
