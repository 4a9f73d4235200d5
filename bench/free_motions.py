"""What `lab explain` says of short free motions: ``python -m bench.free_motions [--seed 400] [--count 12]``.

Pendulums by their angle and masses on springs by their place, 1.5 to 9 swings of them, simulated by SciPy's Radau with
equations written here, with rates, sizes and noise over decades; half of them with what films and sonars do to a
measurement.  Only short ones are drawn: over many swings every effect is found.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explain, open_executor
from lostmotion.model import build_model

LEAST_SAMPLES = 60
KINDS = ("viscous", "coulomb", "drag", "both", "stiff", "none", "dropped")
SENSORS = ("clean", "colour", "scale", "lens", "jitter", "zero")
"""White noise; noise of an autoregression of 0.9; 3 % of the size; 1 % of curvature; times off by 3 %; a zero that is a
tenth of the swing away."""
NAMED = {
    ("joint", "viscous"): ("viscous_friction",), ("joint", "coulomb"): ("coulomb_friction",),
    ("joint", "drag"): ("quadratic_damping",), ("joint", "both"): ("coulomb_friction", "viscous_friction"),
    ("joint", "dropped"): ("coulomb_friction", "viscous_friction"),
    ("oscillator", "coulomb"): ("coulomb_friction",), ("oscillator", "drag"): ("quadratic_damping",),
    ("oscillator", "both"): ("coulomb_friction",), ("oscillator", "stiff"): ("hardening_spring",),
}  # fmt: skip
"""What is not in the model: a pendulum has its weight, a mass its spring and viscous damping."""


@dataclass(frozen=True)
class Swing:
    """One motion: frequency [Hz], number of periods, samples a period, noise over amplitude, amplitude [rad or m],
    share of it that is left at the end; stiff: cubic over linear force; part: of the viscous damping, where there are
    two."""

    kind: str
    base: str
    frequency: float
    periods: float
    rate: float
    noise: float
    amplitude: float
    left: float
    stiff: float
    part: float
    phase: float
    is_coarse: bool
    sensor: str
    seed: int


def drawn(kind: str, seed: int) -> Swing:
    """A random motion."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    known = {"stiff": "oscillator", "dropped": "joint"}
    base = known.get(kind) or str(rng.choice(["joint", "oscillator"]))
    periods = 10 ** rng.uniform(math.log10(1.5), math.log10(9))
    least = max(LEAST_SAMPLES / periods, 15.0)
    return Swing(
        kind=kind,
        base=base,
        frequency=10 ** rng.uniform(-0.7, 1.3),
        periods=periods,
        rate=10 ** rng.uniform(math.log10(least), math.log10(4 * least)),
        noise=10 ** rng.uniform(-3, -1.5),
        amplitude=10 ** (rng.uniform(-1, 0.3) if base == "joint" else rng.uniform(-3.5, 0)),
        left=10 ** rng.uniform(-1.1, -0.1),
        stiff=float(rng.choice([-1, 1])) * 10 ** rng.uniform(-1.3, -0.4),
        part=rng.uniform(0.25, 0.75),
        phase=rng.uniform(0, 2 * math.pi),
        is_coarse=bool(rng.random() < 0.3),
        sensor=str(rng.choice(SENSORS)),
        seed=seed,
    )


def forces(swing: Swing) -> dict[str, float]:
    """Viscous damping [1/s], dry friction [1/s²], drag and cubic stiffness per inertia, such that the share is left."""
    length, amplitude, left = swing.periods / swing.frequency, swing.amplitude, swing.left
    w, rate = 2 * math.pi * swing.frequency, math.log(1 / swing.left) / length
    slow = rate * swing.part
    rest = amplitude * (math.exp(-slow * length) - left) * slow / (1 - math.exp(-slow * length))
    found = {
        "viscous": {"b": 2 * rate},
        "coulomb": {"tau": amplitude * (1 - left) / swing.periods * w**2 / 4},
        "drag": {"d": (1 / left - 1) / length * 3 * math.pi / 4 / (w * amplitude)},
        "both": {"b": 2 * slow, "tau": rest * math.pi * w / 2},
        "stiff": {"b": 2 * rate, "k3": swing.stiff * w**2 / amplitude**2},
        "none": {"b": 2 * rate} if swing.base == "oscillator" else {},
    }
    return {"b": 0.0, "tau": 0.0, "d": 0.0, "k3": 0.0, **found[swing.kind]}


def recorded(swing: Swing) -> Recording:
    """What a sensor measures of it."""
    force, w, amplitude = forces(swing), 2 * math.pi * swing.frequency, swing.amplitude

    def slope(_: float, x: Any) -> list[float]:
        place, speed = x
        back = w * w * (math.sin(place) if swing.base == "joint" else place) + force["k3"] * place**3
        lost = force["b"] * speed + force["d"] * speed * abs(speed)
        return [speed, -back - lost - force["tau"] * math.tanh(speed / (1e-4 * w * amplitude))]

    length = swing.periods / swing.frequency
    times = np.arange(0, length, 1 / (swing.frequency * swing.rate))
    start = [amplitude * math.cos(0.3 * math.sin(swing.phase)), 0.3 * w * amplitude * math.sin(swing.phase)]
    found = solve_ivp(slope, (0, length), start, "Radau", times, rtol=1e-7, atol=1e-9 * amplitude).y[0]
    rng = np.random.default_rng([swing.seed, 77, KINDS.index(swing.kind)])
    if swing.sensor == "scale":
        found = found * (1 + 0.03 * rng.choice([-1, 1]))
    if swing.sensor == "lens":
        found = found + 0.01 * amplitude * ((found / amplitude) ** 2 - (found / amplitude) ** 3)
    if swing.sensor == "zero":
        found = found + 0.1 * amplitude
    if swing.sensor == "jitter":
        times = np.sort(times + 0.03 / swing.frequency / swing.rate * rng.standard_normal(times.size))
    error = rng.standard_normal(times.size)
    if swing.sensor == "colour":
        error = lfilter([math.sqrt(1 - 0.81)], [1, -0.9], error)
    found, step = found + swing.noise * amplitude * error, 3 * swing.noise * amplitude
    found = np.round(found / step) * step if swing.is_coarse else found
    return Recording(times, {"position" if swing.base == "joint" else "displacement": found}, name="swing")


def dropped(seed: int) -> list[Recording]:
    """Three recordings of an arm that a hand holds and lets go, read by an encoder; it hangs still for most of them."""
    rng = np.random.default_rng([seed, KINDS.index("dropped")])
    w, damping, friction = 2 * math.pi * 10 ** rng.uniform(-0.3, 0.5), rng.uniform(0.1, 0.7), rng.uniform(0.02, 0.12)
    length, step, zero = rng.uniform(4, 12) * 2 * math.pi / w, 10 ** rng.uniform(-3.5, -2.5), rng.uniform(-0.1, 0.1)
    times = np.arange(0, length, 2 * math.pi / w / rng.uniform(60, 200))

    def slope(_: float, x: Any) -> list[float]:
        return [x[1], -w * w * (math.sin(x[0]) + friction * math.tanh(x[1] / (1e-3 * w))) - 2 * damping * w * x[1]]

    found = []
    for number in range(3):
        start, held = rng.choice([-1, 1]) * rng.uniform(0.5, 2.0), rng.choice([0.0, rng.uniform(0, length / 4)])
        free = times[times >= held] - held
        fall = solve_ivp(slope, (0, length), [start, 0.0], "Radau", free, rtol=1e-7, atol=1e-9).y[0]
        angle = zero + np.concatenate([np.full(times.size - free.size, start), fall])
        found.append(Recording(times, {"position": np.round(angle / step) * step}, name=f"drop {number}"))
    return found


def graded(swing: Swing) -> str:
    """right; tie: the truth is reported as not distinguished from what was named; part: one of two; unnamed; extra; or
    wrong."""
    model = build_model(swing.base, ["gravity_torque"] if swing.base == "joint" else [])
    truth = set(NAMED.get((swing.base, swing.kind), ()))
    held = experiments(model, dropped(swing.seed) if swing.kind == "dropped" else [recorded(swing)])
    with open_executor("threads:1") as pool:
        answer = explain(model, held, pool, budget_s=120)
    got = set(answer.missing)
    if got == truth:
        return "right"
    if not got:
        return "unnamed"
    if truth < got:
        return "extra"
    if got < truth:
        return "part"
    tied = {name for group in answer.confusable for name in group}
    return "tie" if truth and truth - got <= tied else "wrong"


def main() -> None:
    """Prints the counts by kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=400)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--kinds", default=",".join(KINDS), help="with commas")
    given = parser.parse_args()
    grades = ("right", "tie", "part", "unnamed", "extra", "wrong")
    table = Table("hidden", *grades, box=None)
    for kind in given.kinds.split(","):
        counts = Counter[str]()
        for seed in range(given.seed, given.seed + given.count):
            counts[grade := graded(drawn(kind, seed))] += 1
            print(f"{kind} {seed}: {grade}", file=sys.stderr, flush=True)
        table.add_row(kind, *(str(counts[grade]) for grade in grades))
    Console().print(table)


if __name__ == "__main__":
    main()
