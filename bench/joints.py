"""Simulated joints with play that judge ``bench.play_size``: eqs. 1-7, a hard-stop simulator and MuJoCo's hinge.

The hard stops know nothing of eq. 1: restitution, Coulomb friction of the output shaft, and a bar whose reaction turns
the joint.  Tip acceleration without noise at even times; the motions are classes with position, velocity, acceleration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from lostmotion.model import HandWaved, Motion, Sampled, build_model

__all__ = ["F_RES_HZ", "LENGTH_M", "RADIUS_M", "Gear", "Lagging", "motion_of", "mujoco_tip", "tip"]

FloatArray = NDArray[np.float64]
RADIUS_M, LENGTH_M = 0.010, 0.10
F_RES_HZ, ZETA = 58.0, 0.012
STEP_S = 2e-5
"""Step of the hard-stop simulator [s]."""
STICK = 3e-3
"""Slower contacts do not bounce [rad/s]."""
INERTIA, BEAM_KG = 2e-4, 0.02


@dataclass(frozen=True)
class Gear:
    """kind: "eq1", "stops" or "mujoco"; inertia: J2 as a multiple of 2e-4 kg m²; exponent: n of eq. 1, alpha its
    viscous term as a multiple; restitution and friction [rad/s²] of hard stops; reaction: m l² of the bar over J2."""

    kind: str = "stops"
    inertia: float = 1.0
    exponent: int = 11
    alpha: float = 1.0
    restitution: float = 0.3
    friction: float = 0.0
    reaction: float = 0.0


@dataclass(frozen=True)
class Lagging:
    """A servo that follows its goal behind a critically damped filter of the second order."""

    goal: Motion
    corner_hz: float = 12.0

    def position(self, t: FloatArray) -> FloatArray:
        return np.asarray(self.followed.position(t))

    def velocity(self, t: FloatArray) -> FloatArray:
        return np.asarray(self.followed.velocity(t))

    def acceleration(self, t: FloatArray) -> FloatArray:
        return np.asarray(self.followed.acceleration(t))

    @property
    def followed(self) -> Sampled:
        """What the servo does, sampled."""
        step, omega = 1e-3, 2 * math.pi * self.corner_hz
        time = np.arange(-1.0, 15.0, step)
        wanted = self.goal.position(time)
        pole = math.exp(-omega * step)
        once = lfilter([1 - pole], [1, -pole], wanted - wanted[0])
        return Sampled(time, lfilter([1 - pole], [1, -pole], once) + wanted[0])


def motion_of(kind: str, seed: int) -> Motion:
    """The motion of that name: hand, sines2, sines6, sines10 (sums up to so many Hz), trapezoid, least-jerk."""
    if kind == "hand":
        return HandWaved(seed)
    if kind.startswith("sines"):
        top = {"sines2": 2.4, "sines6": 6.0, "sines10": 10.0}[kind]
        return HandWaved(seed, amplitude_rad=0.3 / top, low_hz=0.5, high_hz=top)
    return _moves(kind, seed)


def _moves(kind: str, seed: int) -> Motion:
    """Point-to-point moves of 0.1 to 0.4 rad to and fro, with a pause between them of up to 0.15 s."""
    rng, step = np.random.default_rng(seed), 1e-3
    time = np.arange(-0.5, 15.0, step)
    accel = np.zeros(time.size)
    at, sign, place = 0.5, 1.0, 0.0
    while at < 14.0:
        target = sign * rng.uniform(0.05, 0.2)
        reach, lasting = target - place, rng.uniform(0.3, 0.5)
        u = (time - at) / lasting
        inside = (u >= 0) & (u < 1)
        if kind == "trapezoid":  # a third of the time each: accelerating, steady, braking
            shape = np.where(u < 1 / 3, 4.5, np.where(u < 2 / 3, 0.0, -4.5))
        else:
            shape = 60 * u * (1 - u) * (1 - 2 * u)
        accel += np.where(inside, shape * reach / lasting**2, 0.0)
        at, place, sign = at + lasting + rng.uniform(0.0, 0.15), target, -sign
    return _Twice(time, accel)


class _Twice:
    """The motion of which the acceleration is given on a grid, straight between its points."""

    def __init__(self, time: FloatArray, accel: FloatArray) -> None:
        step = time[1] - time[0]
        self._time, self._accel = time, accel
        self._rate = np.concatenate([[0.0], np.cumsum((accel[1:] + accel[:-1]) / 2 * step)])
        change = self._rate[:-1] * step + (accel[:-1] / 3 + accel[1:] / 6) * step**2
        self._angle = np.concatenate([[0.0], np.cumsum(change)])

    def _parts(self, t: FloatArray) -> tuple[NDArray[np.intp], FloatArray, FloatArray]:
        index = np.clip(np.searchsorted(self._time, t, side="right") - 1, 0, self._time.size - 2)
        return (
            index,
            t - self._time[index],
            (self._accel[index + 1] - self._accel[index]) / (self._time[1] - self._time[0]),
        )

    def position(self, t: FloatArray) -> FloatArray:
        i, u, slope = self._parts(t)
        return self._angle[i] + self._rate[i] * u + self._accel[i] * u**2 / 2 + slope * u**3 / 6

    def velocity(self, t: FloatArray) -> FloatArray:
        i, u, slope = self._parts(t)
        return self._rate[i] + self._accel[i] * u + slope * u**2 / 2

    def acceleration(self, t: FloatArray) -> FloatArray:
        i, u, slope = self._parts(t)
        return self._accel[i] + slope * u


def tip(motion: Motion, times: FloatArray, play_m: float, gear: Gear) -> FloatArray:
    """Tip acceleration [m/s²] at times [s], evenly spaced from 0, without noise."""
    if gear.kind == "eq1":
        omega = 2 * math.pi * F_RES_HZ
        values = {
            "d": play_m, "m": BEAM_KG, "k": BEAM_KG * omega**2, "b": 2 * ZETA * BEAM_KG * omega, "l": LENGTH_M,
            "J2": INERTIA * gear.inertia, "n": float(gear.exponent), "alpha": ALPHA * gear.alpha,
        }  # fmt: skip
        return build_model("play", values=values).simulate(motion, times)["accel"]
    if gear.kind == "mujoco":
        return mujoco_tip(motion, times, play_m, gear)
    return stops(motion, times, play_m / RADIUS_M, gear)[0]


ALPHA = 4000.0
"""Viscous term of eq. 1 in the model [N s/m]."""


def stops(motion: Motion, times: FloatArray, play: float, gear: Gear) -> tuple[FloatArray, FloatArray]:
    """Tip acceleration and the joint's angle against the shaft [rad] between hard stops, at times [s]."""
    many = round((times[1] - times[0]) / STEP_S)
    fine = np.arange(times.size * many) * STEP_S
    return _stops(motion.position(fine), motion.velocity(fine), motion.acceleration(fine), many, play / 2,
                  gear.restitution, gear.friction, gear.reaction, 2 * math.pi * F_RES_HZ, ZETA)  # fmt: skip


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _stops(angle, rate, accel, many, half, restitution, friction, reaction, omega, zeta):  # type: ignore[no-untyped-def]
    count = angle.size // many
    out, apart = np.empty(count), np.empty(count)
    place, speed = angle[0], rate[0]
    bent, bending = 0.0, 0.0
    for i in range(angle.size):
        felt = -(2 * zeta * omega * bending + omega * omega * bent)
        if i % many == 0:
            out[i // many], apart[i // many] = felt, place - angle[i]
        if i + 1 == angle.size:
            break
        free = -reaction * felt / 0.1 - friction * np.tanh(speed / 1e-3)
        before = speed
        speed += free * 2e-5
        place += speed * 2e-5
        off, toward = place - angle[i + 1], speed - rate[i + 1]
        if abs(off) > half:
            side = 1.0 if off > 0 else -1.0
            place = angle[i + 1] + side * half
            if toward * side > 0:
                speed = rate[i + 1] - (restitution * toward if abs(toward) > 3e-3 else 0.0)
        bending += felt * 2e-5 - 0.1 * (speed - before)
        bent += bending * 2e-5
    return out, apart


SCENE = """
<mujoco>
 <option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
 <worldbody>
  <body name="link"><joint name="gap" axis="0 0 1" limited="true" range="{low} {high}"
    solreflimit="{spring} {damper}" solimplimit="0.99 0.999 1e-5"/>
   <inertial pos="0 0 0" mass="0.05" diaginertia="1e-4 1e-4 {inertia}"/>
   <body name="tip" pos="{length} 0 0"><joint name="bar" type="slide" axis="0 1 0" stiffness="{k}" damping="{b}"/>
    <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/><site name="sensor"/></body>
  </body>
 </worldbody>
 <sensor><accelerometer site="sensor"/></sensor>
</mujoco>"""
STOP_HZ = 150.0
"""Natural frequency of MuJoCo's stops: they give by some hundredths of the impact speed over it."""


def mujoco_tip(motion: Motion, times: FloatArray, play_m: float, gear: Gear) -> FloatArray:
    """The same by MuJoCo: a hinge of free range ± half the play in the shaft's frame, its limits damped springs."""
    import mujoco  # type: ignore[import-not-found, unused-ignore]

    rate = 1 / (times[1] - times[0])
    many = math.ceil(1e4 / rate)
    step, half = 1 / rate / many, play_m / RADIUS_M / 2
    mass = max(gear.reaction, 1e-3) * INERTIA / LENGTH_M**2
    omega, stop = 2 * math.pi * F_RES_HZ, 2 * math.pi * STOP_HZ
    log = math.log(max(gear.restitution, 1e-3))
    damping = -log / math.sqrt(math.pi**2 + log**2)
    text = SCENE.format(step=step, low=math.degrees(-half), high=math.degrees(half), inertia=INERTIA, length=LENGTH_M,
                        spring=-(stop**2), damper=-2 * damping * stop,
                        k=mass * omega**2, b=2 * ZETA * omega * mass, mass=mass)  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    fine = np.arange(times.size * many) * step
    shaft, turning = motion.acceleration(fine), motion.velocity(fine)
    out = np.empty(times.size)
    for i in range(fine.size):
        drag = INERTIA * gear.friction * math.tanh((turning[i] + data.qvel[0]) / 1e-3)
        data.qfrc_applied[0] = -(INERTIA + mass * LENGTH_M**2) * shaft[i] - drag
        data.qfrc_applied[1] = -mass * LENGTH_M * shaft[i]
        mujoco.mj_step(model, data)
        if i % many == many - 1:
            out[i // many] = data.sensordata[1] + LENGTH_M * shaft[i]
    return out
