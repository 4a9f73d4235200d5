"""Recordings of a joint that MuJoCo moves: torque in, angle out, something hidden in the joint.  Needs mujoco."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["HIDDEN", "available", "write_joint"]

FloatArray = NDArray[np.float64]
Values = dict[str, float]
HIDDEN = ("viscous_friction", "coulomb_friction", "gravity_torque", "nothing")
RATE_HZ, DURATION, LEAD, RECORDINGS = 800.0, 4.0, 0.5, 3
STEPS = 8
"""MuJoCo's steps from one sample to the next."""
G = 9.80665
SCENE = """
<mujoco>
 <option timestep="{step}" integrator="RK4" gravity="0 0 -{G}"/>
 <worldbody>
  <body><joint name="joint" axis="0 1 0" damping="{damping}" frictionloss="{dry}" solreffriction="0.001 1"/>
   <inertial pos="{x} 0 {z}" mass="{mass}" diaginertia="{own} {own} {own}"/></body>
 </worldbody>
 <actuator><motor joint="joint"/></actuator>
</mujoco>"""


def available() -> bool:
    """Whether mujoco is installed."""
    return importlib.util.find_spec("mujoco") is not None


def write_joint(effect: str, colour_seed: int, folder: Path) -> None:
    """Three recordings with the effect of HIDDEN, a rough model file with J up to 30 % off, the truth."""
    rng = np.random.default_rng(colour_seed)
    values = {"J": float(rng.uniform(2e-4, 6e-4)), "bias": 0.0, **_hidden(effect, rng)}
    noise = float(rng.uniform(1e-4, 4e-4))
    folder.mkdir(parents=True, exist_ok=True)
    count = 2 * math.pi / 2**14
    rms = []
    for i in range(1, RECORDINGS + 1):
        torque, angle = _swing(values, rng)
        readings = np.round((angle + rng.normal(0, noise, angle.size)) / count) * count
        rms.append(float(np.std(readings - angle)))
        rows = zip(np.arange(angle.size) / RATE_HZ, torque, readings, strict=True)
        lines = [f"{time:.6f},{tau:.10g},{theta:.8g}" for time, tau, theta in rows]
        (folder / f"rec{i}.csv").write_text("\n".join(["time,torque,position", *lines, ""]))
    rough = values["J"] * rng.uniform(0.7, 1.3)
    (folder / "model.toml").write_text(
        f'base = "joint"\n[parameters]\nJ = {{ value = {rough:.6g}, unit = "kg m^2" }}\n'
    )
    truth = {"kind": "joint", "size": "strong", "effects": [] if effect == "nothing" else [effect], "count": count,
             "parameters": values, "noise": rms, "colour": "white", "ratio": [], "seed": colour_seed}  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def _hidden(effect: str, rng: np.random.Generator) -> Values:
    size = float(rng.uniform(0.7, 1.4))
    if effect == "viscous_friction":
        return {"viscous_friction.b_v": 3e-4 * size}
    if effect == "coulomb_friction":
        return {"coulomb_friction.tau_c": 5e-4 * size}
    if effect == "gravity_torque":
        return {"gravity_torque.tau_g": 3e-3 * size, "gravity_torque.phi": float(rng.uniform(-0.5, 0.5))}
    return {}


def _swing(values: Values, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Torque and angle at the samples, after LEAD s that are dropped."""
    import mujoco  # type: ignore[import-not-found, unused-ignore]

    tau_g, phi = values.get("gravity_torque.tau_g", 0.0), values.get("gravity_torque.phi", 0.0)
    mass, arm = 0.02, tau_g / (0.02 * G)
    model = mujoco.MjModel.from_xml_string(SCENE.format(
        step=1 / RATE_HZ / STEPS, G=G, mass=mass, own=values["J"] - mass * arm**2, x=-arm * math.sin(phi),
        z=-arm * math.cos(phi), damping=values.get("viscous_friction.b_v", 0.0),
        dry=values.get("coulomb_friction.tau_c", 0.0)))  # fmt: skip
    data = mujoco.MjData(model)
    step = 1 / RATE_HZ / STEPS
    rates = 2 * np.pi * np.exp(rng.uniform(np.log(0.5), np.log(3.0), 6))
    phases, sizes = rng.uniform(0, 2 * np.pi, 6), rng.uniform(0.4, 1.0, 6) / rates
    sizes *= 0.6 / np.linalg.norm(sizes)

    def torque(times: FloatArray) -> FloatArray:
        return np.asarray(-values["J"] * np.sin(np.outer(times, rates) + phases) @ (sizes * rates**2))

    data.qpos[0], data.qvel[0] = np.sum(sizes * np.sin(phases)), np.sum(sizes * rates * np.cos(phases))
    angle = np.empty(round((LEAD + DURATION) * RATE_HZ))
    for i, tau in enumerate(torque(np.linspace(0.5, angle.size * STEPS - 0.5, angle.size * STEPS) * step)):
        if i % STEPS == 0:
            angle[i // STEPS] = data.qpos[0]
        data.ctrl[0] = tau
        mujoco.mj_step(model, data)
    first = round(LEAD * RATE_HZ)
    return torque(np.arange(first, angle.size) / RATE_HZ), angle[first:]
