"""An arm of two links with parallel axes in MuJoCo, play in either joint, a bar with an accelerometer at its end.

Independent of our equations: hard stops, moving lever arms, centrifugal and Coriolis forces, impacts that shake the
other joint.  Needs mujoco.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from bench.roc.waveforms import LENGTH_M, RADIUS_M, Bar, FloatArray
from lostmotion.model import Motion

__all__ = ["LINK_M", "arm"]

LINK_M = 0.15
"""From the first axis to the second [m]."""
ROTOR = 0.1
"""Inertia of a motor behind its gear [kg m²]: large, so that it follows the command whatever the link does."""
STIFF_HZ = 20.0
STEP_S = 1e-4
SCENE = """
<mujoco>
 <option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
 <default><joint axis="0 0 1" solreflimit="{stiff} 1" solimplimit="0.99 0.999 1e-5"/></default>
 <worldbody>
  <body><joint name="motor1" armature="{rotor}"/><inertial pos="0 0 0" mass="1e-3" diaginertia="1e-7 1e-7 1e-7"/>
  <body>{gap1}<inertial pos="{middle} 0 0" mass="0.03" diaginertia="1e-5 6e-5 6e-5"/>
   <body pos="{link} 0 0"><joint name="motor2" armature="{rotor}"/>
   <inertial pos="0 0 0" mass="0.05" diaginertia="1e-5 1e-5 1e-5"/>
   <body>{gap2}<inertial pos="0 0 0" mass="0.03" diaginertia="1e-4 2e-4 2e-4"/>
    <body pos="{length} 0 0"><joint name="bar" type="slide" axis="0 1 0" stiffness="{k}" damping="{b}"/>
     <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/><site name="sensor"/></body>
   </body></body>
  </body></body>
 </worldbody>
 <sensor><accelerometer site="sensor"/></sensor>
</mujoco>"""


def arm(moved: Sequence[Motion], times: FloatArray, plays_m: Sequence[float], bar: Bar) -> FloatArray:
    """Tip acceleration [m/s²] at times [s], evenly spaced from 0, under both joints' commands.

    plays_m: gap between the teeth of each joint [m] on gears of 10 mm, 0 for none.  The motors' accelerations are those
    of the commands, held by a critically damped spring of STIFF_HZ.
    """
    import mujoco  # type: ignore[import-not-found, unused-ignore]

    many = math.ceil(1 / bar.rate_hz / STEP_S)
    step, mass = 1 / bar.rate_hz / many, 1e-4
    gaps = {
        f"gap{i}": f'<joint name="gap{i}" limited="true" range="{-half} {half}"/>' if half else ""
        for i, half in enumerate((math.degrees(play / RADIUS_M / 2) for play in plays_m), start=1)
    }
    scale = mass / bar.values["m"]
    text = SCENE.format(step=step, stiff=5 * step, rotor=ROTOR, middle=LINK_M / 2, link=LINK_M, length=LENGTH_M,
                        k=bar.values["k"] * scale, b=bar.values["b"] * scale, mass=mass, **gaps)  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    motors = [model.joint(f"motor{i}").qposadr[0] for i in (1, 2)]
    fine = np.arange(times.size * many) * step
    wanted = np.array([[motion.position(fine), motion.velocity(fine), motion.acceleration(fine)] for motion in moved])
    data.qpos[motors], data.qvel[motors] = wanted[:, 0, 0], wanted[:, 1, 0]
    stiff, damp = ROTOR * (2 * math.pi * STIFF_HZ) ** 2, 2 * ROTOR * 2 * math.pi * STIFF_HZ
    out = np.empty(times.size)
    for i in range(fine.size):
        angle, rate, accel = wanted[:, :, i].T
        hold = stiff * (angle - data.qpos[motors]) + damp * (rate - data.qvel[motors])
        data.qfrc_applied[motors] = ROTOR * accel + hold
        mujoco.mj_step(model, data)
        if i % many == many - 1:
            out[i // many] = data.sensordata[1]
    return out
