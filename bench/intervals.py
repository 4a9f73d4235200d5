"""How often the intervals of `lab fit` hold the truth where something disturbs a machine.

``python -m bench.intervals [--seed 1] [--count 12] [--kinds swing,joint,oscillator,motor]`` simulates pendulums that
swing freely, joints under control, masses on springs that a force drives, and motors whose torque was recorded some
milliseconds early and that drag strongly, as by a voltage, with equations written here.  A torque or force that no
column shows disturbs each for 0.1 to 5 s at a time (an Ornstein-Uhlenbeck process).  The right model is fitted
from the command line, and its 95 % intervals are compared with the true values.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

FloatArray = NDArray[np.float64]
KINDS = ("swing", "joint", "oscillator", "motor")
STEPS = 20
"""Steps of the simulation between two samples."""
TURN = 2 * math.pi
COUNT = TURN / 4096
"""Step of a 12-bit encoder [rad]."""


def disturbance(rng: np.random.Generator, size: int, step: float, lasts: float, deviation: float) -> FloatArray:
    """An Ornstein-Uhlenbeck process (N,) with this correlation time [s] and standard deviation."""
    kept = math.exp(-step / lasts)
    news = deviation * math.sqrt(1 - kept**2) * rng.standard_normal(size)
    found, now = np.empty(size), deviation * rng.standard_normal()
    for at, new in enumerate(news):
        found[at] = now = kept * now + new
    return found


def moved(
    inertia: float, viscous: float, dry: float, weight: float, spring: float, start: float, step: float,
    pushed: FloatArray, gains: tuple[float, float] = (0.0, 0.0), goal: tuple[FloatArray, FloatArray] | None = None,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """The place and the torque of a controller (N,) after each step (semi-implicit Euler; dry friction that sticks).

    pushed: (N,) all other torques; gains, goal: of a controller of place and speed.
    """
    places, torques, place, speed = np.empty(pushed.size), np.empty(pushed.size), start, 0.0
    sin = math.sin
    for at, push in enumerate(pushed.tolist()):
        torque = gains[0] * (goal[0][at] - place) + gains[1] * (goal[1][at] - speed) if goal else 0.0
        places[at], torques[at] = place, torque
        free = speed + step / inertia * (torque + push - viscous * speed - weight * sin(place) - spring * place)
        lost = step * dry / inertia
        speed = free - lost if free > lost else free + lost if free < -lost else 0.0
        place += step * speed
    return places, torques


def by_hand(rng: np.random.Generator, times: FloatArray, size: float, per_second: float) -> CubicSpline:
    """An irregular motion: a spline through random places."""
    knots = np.arange(times[0] - 1, times[-1] + 2, 1 / per_second)
    return CubicSpline(knots, size * rng.standard_normal(knots.size))


def simulated(kind: str, seed: int) -> tuple[str, list[dict[str, FloatArray]], dict[str, float]]:
    """A model file, recordings by column, and the true values of its parameters."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    lasts, share = 10 ** rng.uniform(-1, 0.7), rng.uniform(0.05, 0.4)
    found = []
    if kind == "swing":
        step, weight, viscous, dry = 0.01, rng.uniform(15, 80), rng.uniform(0.02, 0.2), rng.uniform(0.05, 0.5)
        size = int(rng.uniform(15, 40) / step)
        pushed = disturbance(rng, size * STEPS, step / STEPS, lasts, 2 * share * dry)
        angle = moved(1.0, viscous, dry, weight, 0.0, rng.uniform(0.4, 1.2), step / STEPS, pushed)[0][::STEPS]
        found = [{"time": step * np.arange(size), "position": np.round(angle / COUNT) * COUNT}]
        model = 'base = "joint"\neffects = ["gravity_torque", "viscous_friction", "coulomb_friction"]\n'
        model += "[parameters]\nJ = { value = 1.0, fixed = true }\n"
        return model, found, {
            "gravity_torque.tau_g": weight, "viscous_friction.b_v": viscous, "coulomb_friction.tau_c": dry
        }  # fmt: skip
    if kind in ("joint", "motor"):
        step, inertia, viscous, dry = 0.004, rng.uniform(0.05, 0.5), rng.uniform(0.1, 1.5), rng.uniform(0.2, 1.0)
        early = rng.uniform(0.003, 0.012) if kind == "motor" else 0.0
        viscous = rng.uniform(4, 20) * inertia if kind == "motor" else viscous
        for _ in range(rng.integers(1, 4)):
            times = step / STEPS * np.arange(int(rng.uniform(8, 20) / step) * STEPS)
            goal = by_hand(rng, times, 0.6, 2.0)
            pushed = disturbance(rng, times.size, step / STEPS, lasts, share * dry)
            places, torques = moved(
                inertia, viscous, dry, 0.0, 0.0, float(goal(0.0)), step / STEPS, pushed,
                (900 * inertia, 50 * inertia), (goal(times), goal(times, 1)),
            )  # fmt: skip
            noise = rng.standard_normal((2, times[::STEPS].size))
            found.append({
                "time": times[::STEPS], "position": places[::STEPS] + 2e-5 * noise[0],
                "torque": np.interp(times + early, times, torques)[::STEPS] + 0.02 * noise[1],
            })  # fmt: skip
        model = 'base = "joint"\neffects = ["viscous_friction", "coulomb_friction"]\n'
        return model, found, {"J": inertia, "viscous_friction.b_v": viscous, "coulomb_friction.tau_c": dry}
    mass, frequency, ratio = 0.05, rng.uniform(3, 15), rng.uniform(0.01, 0.06)
    step, stiffness = 1 / frequency / 25, mass * (TURN * frequency) ** 2
    viscous = 2 * ratio * math.sqrt(stiffness * mass)
    for _ in range(rng.integers(1, 4)):
        times = step / STEPS * np.arange(int(rng.uniform(20, 60) * 25) * STEPS)
        force = by_hand(rng, times, 1.0, 4 * frequency)(times)
        pushed = force + disturbance(rng, times.size, step / STEPS, lasts / frequency, share)
        places = moved(mass, viscous, 0.0, 0.0, stiffness, 0.0, step / STEPS, pushed)[0][::STEPS]
        places += 0.003 * places.std() * rng.standard_normal(places.size)
        found.append({"time": times[::STEPS], "force": force[::STEPS], "displacement": places})
    model = 'base = "oscillator"\n[parameters]\nm = { value = 0.05, fixed = true }\n'
    return model, found, {"k": stiffness, "b": viscous}


def fitted(kind: str, seed: int) -> dict[str, float]:
    """By parameter, how far the estimate is from the truth, in half widths of its interval."""
    model, recordings, truth = simulated(kind, seed)
    with TemporaryDirectory() as folder:
        files = [Path(folder) / f"{number}.csv" for number in range(len(recordings))]
        (Path(folder) / "model.toml").write_text(model)
        for file, columns in zip(files, recordings, strict=True):
            rows = np.stack(list(columns.values()), axis=1)
            np.savetxt(file, rows, "%.9g", ",", header=",".join(columns), comments="")
        call = [sys.executable, "-m", "lostmotion", "lab", "fit", f"{folder}/model.toml", *map(str, files), "--json",
                "-o", f"{folder}/out.toml"]  # fmt: skip
        answer = json.loads(subprocess.run(call, capture_output=True, text=True, check=True).stdout)
    return {
        name: 2 * (value - truth[name]) / (high - low)
        for name, (value, low, high) in answer["parameters"].items()
        if name in truth
    }


def main() -> None:
    """Prints how many intervals of each parameter hold the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--kinds", default=",".join(KINDS), help="with commas")
    given = parser.parse_args()
    for kind in given.kinds.split(","):
        held, every = Counter[str](), Counter[str]()
        for seed in range(given.seed, given.seed + given.count):
            off = fitted(kind, seed)
            every.update(list(off))
            held.update(name for name, one in off.items() if abs(one) <= 1)
            print(kind, seed, *(f"{name} {one:+.2f}" for name, one in off.items()), file=sys.stderr, flush=True)
        for name, count in every.items():
            print(f"{kind:10}  {name:24}  {held[name]} of {count}")


if __name__ == "__main__":
    main()
