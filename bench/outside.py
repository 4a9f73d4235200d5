"""The detector as a stranger would try it: `python -m bench.outside [--seed 0] [--count 120]` (ten minutes).

Recordings of fifteen seconds as CSV files, of joints drawn at random, go through `lostmotion score --json` in a process
of its own, with a configuration that knows the bar and nothing of the joint.  The joint is MuJoCo's: a hinge with a
free range and a bar that pushes it back.  Inertia 5e-5 to 2e-3 kg m², stops of 200 to 800 Hz and a restitution of 0 to
0.9, friction up to 3 rad/s², 0.1 to 5 g at the bar's end, a bar of 45 to 75 Hz set 0.3 % wrong, noise of 0.1 to 1 m/s²;
trapezoids, moves of minimum jerk, sums of sines to 3 and 10 Hz, from a servo that follows at once or 20 to
80 ms late (a pure delay and a second order, damped by 0.6 to 1.2);
commands in steps of 0.29° at 100 Hz; no play, or 0.2 to 100 mrad.  Nothing was ever tuned on it.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter
from scipy.stats import spearmanr

__all__ = ["Drawn", "Joint", "drawn", "scored"]

FloatArray = NDArray[np.float64]
RATE_HZ, STEPS, RECORD_S = 1000.0, 20, 15.0
"""Steps of the simulation from one sample to the next: the stiffest stop has 25 of them a period."""
LENGTH_M, ZETA = 0.10, 0.012
POLL_HZ, STEP_RAD = 100.0, math.radians(300) / 1023
MOTIONS = ("trapezoids", "minimum jerk", "sines to 3 Hz", "sines to 10 Hz")
CONFIG = """[robot]
name = "outside"
[[accelerometer]]
name = "tip"
driver = "replay"
port = "recording.csv"
rate_hz = 1000
oscillator = {{ f_res_hz = {f_res:.3f}, length_m = 0.10 }}
[[joint]]
name = "elbow"
driver = "replay"
port = "recording.csv"
accelerometer = "tip"
"""
SCENE = """<mujoco>
 <option timestep="{step}" integrator="implicitfast" gravity="0 0 0"/>
 <worldbody><body>
  <joint name="gap" axis="0 0 1" limited="true" range="{low} {high}" solreflimit="{spring} {damper}"
   solimplimit="0.99 0.999 1e-5"/>
  <inertial pos="0 0 0" mass="0.05" diaginertia="{inertia} {inertia} {inertia}"/>
  <body pos="0.10 0 0"><joint name="bar" type="slide" axis="0 1 0" stiffness="{k}" damping="{b}"/>
   <inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/><site name="sensor"/></body>
 </body></worldbody>
 <actuator><motor joint="gap"/><motor joint="bar"/></actuator>
 <sensor><accelerometer site="sensor"/></sensor></mujoco>"""


@dataclass(frozen=True)
class Joint:
    """inertia [kg m²], stop [Hz], friction [rad/s²], mass at the bar's end [kg], noise [m/s²], lag [s], play [rad];
    damping ratio of the servo that lags, and the share of its lag that is a pure delay."""

    seed: int
    motion: str
    inertia: float
    stop: float
    restitution: float
    friction: float
    mass: float
    f_res: float
    noise: float
    lag: float
    play: float
    damping: float
    pure: float


@dataclass(frozen=True, eq=False)
class Drawn:
    """A joint, the output of `score --json` for its windows, and their energy over the noise's variance [dB]."""

    joint: Joint
    scores: list[dict[str, float]]
    snr_db: FloatArray


def drawn(seed: int) -> Joint:
    """A joint at random."""
    rng = np.random.default_rng([seed, 15])
    lag = rng.uniform(0.02, 0.08) if rng.random() < 0.4 else 0.0
    play = 0.0 if rng.random() < 0.15 else math.exp(rng.uniform(math.log(2e-4), math.log(0.1)))
    logs = [math.exp(rng.uniform(math.log(a), math.log(b))) for a, b in ((5e-5, 2e-3), (200, 800), (1e-4, 5e-3))]
    inertia, stop, mass = logs
    mass = min(mass, 0.3 * inertia / LENGTH_M**2)
    return Joint(seed, MOTIONS[seed % 4], inertia, stop, rng.uniform(0, 0.9), rng.uniform(0, 3), mass,
                 rng.uniform(45, 75), math.exp(rng.uniform(math.log(0.1), 0.0)), lag, play, rng.uniform(0.6, 1.2),
                 rng.uniform(0, 0.5))  # fmt: skip


def commanded(joint: Joint, time: FloatArray) -> FloatArray:
    """The goal's acceleration [rad/s²]."""
    rng = np.random.default_rng([joint.seed, 16])
    if joint.motion.startswith("sines"):
        top = 3.0 if "3 Hz" in joint.motion else 10.0
        omega, phase = 2 * math.pi * rng.uniform(0.5, top, 7), rng.uniform(0, 2 * math.pi, 7)
        return np.asarray(rng.uniform(8, 25) * math.sqrt(2 / 7) * np.sin(np.outer(time, omega) + phase).sum(axis=1))
    accel, at, place = np.zeros(time.size), 0.2, 0.0
    while at < time[-1]:
        goal = rng.uniform(-0.5, 0.5)
        lasting = max(math.sqrt(abs(goal - place) / rng.uniform(2, 8)), 0.12)
        u = (time - at) / lasting
        shape = 60 * u * (1 - u) * (1 - 2 * u)
        if joint.motion == "trapezoids":
            shape = np.where(u < 0.3, 1, np.where(u < 0.7, 0, -1)) / 0.21
        accel += np.where((u >= 0) & (u < 1), shape * (goal - place) / lasting**2, 0.0)
        at, place = at + lasting + rng.uniform(0, 0.2), goal
    return accel


def moved(joint: Joint, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The goal's angle [rad], and the acceleration of the shaft, which follows late and by a second order."""
    step = time[1] - time[0]
    accel = commanded(joint, time)
    if "sines" not in joint.motion:  # a drive's own controller rounds corners
        accel = np.convolve(accel, np.full(80, 1 / 80), "same")
    goal = np.cumsum(np.cumsum(accel)) * step**2
    if "sines" in joint.motion:
        goal -= np.polyval(np.polyfit(time, goal, 1), time)
    if not joint.lag:
        return goal, accel
    followed, rate, omega = goal[0], 0.0, 2 * joint.damping / (joint.lag * (1 - joint.pure))
    felt = np.empty(time.size)
    late = np.concatenate([np.full(round(joint.lag * joint.pure / step), goal[0]), goal])[: goal.size]
    for i, wanted in enumerate(late.tolist()):
        felt[i] = pull = omega**2 * (wanted - followed) - 2 * joint.damping * omega * rate
        rate += pull * step
        followed += rate * step
    return goal, felt


def tips(joint: Joint, shaft: FloatArray) -> FloatArray:
    """Tip acceleration [m/s²] at RATE_HZ in the shaft's frame, whose acceleration acts as a torque and is added."""
    import mujoco  # type: ignore[import-not-found, unused-ignore]
    from mujoco import rollout  # type: ignore[import-not-found, unused-ignore]

    log = math.log(max(joint.restitution, 1e-3))
    damping, stop = -log / math.hypot(math.pi, log), 2 * math.pi * joint.stop
    omega, step = 2 * math.pi * joint.f_res, 1 / RATE_HZ / STEPS
    text = SCENE.format(step=step, low=-math.degrees(joint.play / 2), high=math.degrees(joint.play / 2),
                        spring=-(stop**2), damper=-2 * damping * stop, inertia=joint.inertia, mass=joint.mass,
                        k=joint.mass * omega**2, b=2 * ZETA * omega * joint.mass)  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    drag = joint.inertia * joint.friction * np.tanh(np.cumsum(shaft) * step / 1e-2)
    push = np.column_stack([-(joint.inertia + joint.mass * LENGTH_M**2) * shaft - drag, -joint.mass * LENGTH_M * shaft])
    state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    felt = rollout.rollout(model, mujoco.MjData(model), state[None], push[None])[1][0, :, 1]
    return np.asarray(felt[STEPS - 1 :: STEPS] + LENGTH_M * shaft[STEPS - 1 :: STEPS])


def without_play(joint: Joint, shaft: FloatArray) -> FloatArray:
    """The same of a joint that follows its shaft: the bar alone, by eq. 7."""
    omega = 2 * math.pi * joint.f_res
    damped = 2 * ZETA * omega
    above, below, _ = cont2discrete(([LENGTH_M * damped, LENGTH_M * omega**2], [1, damped, omega**2]),
                                    1 / RATE_HZ / STEPS)  # fmt: skip
    return np.asarray(lfilter(above.ravel(), below, shaft)[STEPS - 1 :: STEPS])


def scored(joint: Joint, folder: Path) -> Drawn:
    """One recording through the command line."""
    rng = np.random.default_rng([joint.seed, 17])
    time = np.arange(round(RECORD_S * RATE_HZ) * STEPS) / RATE_HZ / STEPS
    goal, shaft = moved(joint, time)
    none = without_play(joint, shaft)
    clean = tips(joint, shaft) if joint.play else none
    accel = clean + rng.normal(0, joint.noise, clean.size)
    rows, many = ["time,command,accel"], round(RATE_HZ / POLL_HZ)
    for i, value in enumerate(accel):
        command = f"{round(goal[i * STEPS] / STEP_RAD) * STEP_RAD:.6f}" if i % many == 0 else ""
        rows.append(f"{i / RATE_HZ:.3f},{command},{value:.4f}")
    (folder / "recording.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    right = joint.f_res * (1 + 0.003 * rng.normal())
    (folder / "robot.toml").write_text(CONFIG.format(f_res=right), encoding="utf-8")
    command = [
        str(Path(sys.executable).with_name("lostmotion")),
        "score",
        "recording.csv",
        "--config",
        "robot.toml",
        "--joint",
        "elbow",
        "--json",
    ]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    scores = [s for s in json.loads(done.stdout)["windows"] if 1 < s["time"] < RECORD_S - 0.4]
    energy = [np.sum((clean - none)[round(s["time"] * RATE_HZ) :][:250] ** 2) for s in scores]
    return Drawn(joint, scores, 10 * np.log10(np.maximum(energy, 1e-9) / joint.noise**2))


def row(name: str, some: Iterable[Drawn]) -> str:
    """A line of the table."""
    worn = [(one.joint.play, s, db) for one in some for s, db in zip(one.scores, one.snr_db, strict=True)
            if one.joint.play]  # fmt: skip
    sized = [(play, s) for play, s, _ in worn if s["play"] is not None]
    clear = [s["play"] is not None for _, s, db in worn if db > 30]
    known = [(play, s) for play, s, _ in worn if s["severity"] is not None]
    held = np.mean([s["play_low"] <= play <= s["play_high"] for play, s in sized]) if sized else math.nan
    sure = np.mean([s["severity_low"] <= play <= s["severity_high"] for play, s in known]) if known else math.nan
    off = np.median([s["play"] / play - 1 for play, s in sized]) if sized else math.nan
    ranked = len(known) > 9 and len({play for play, _ in known}) > 1
    order = spearmanr([p for p, _ in known], [s["severity"] for _, s in known])[0] if ranked else math.nan
    found = np.mean([s["impact"] for _, s, _ in worn]) if worn else math.nan
    return (f"| {name} | {len(worn)} | {found:.0%} | {np.mean(clear) if clear else math.nan:.0%} of {len(clear)} "
            f"| {held:.1%} of {len(sized)} | {off:+.0%} | {sure:.1%} | {order:.3f} |")  # fmt: skip


GROUPS: dict[str, Callable[[Joint], bool]] = {
    **{motion: (lambda j, m=motion: j.motion == m and not j.lag) for motion in MOTIONS},
    **{f"{motion}, lag": (lambda j, m=motion: j.motion == m and j.lag > 0) for motion in MOTIONS},
    "restitution below 0.3": lambda j: j.restitution < 0.3,
    "restitution above 0.6": lambda j: j.restitution > 0.6,
    "bar above 1/10 of the inertia": lambda j: j.mass * LENGTH_M**2 > 0.1 * j.inertia,
    "noise below 0.3 m/s²": lambda j: j.noise < 0.3,
    "play below 1 mrad": lambda j: j.play < 1e-3,
    "play of 1 to 20 mrad": lambda j: 1e-3 <= j.play < 20e-3,
    "play above 20 mrad": lambda j: j.play >= 20e-3,
    "all": lambda j: True,
}


def main() -> None:
    """The table, and what becomes of joints without play."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="the first joint")
    parser.add_argument("--count", type=int, default=120, help="so many joints")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        all_of_them = [scored(drawn(seed), Path(folder)) for seed in range(asked.seed, asked.seed + asked.count)]
    print("| joints | windows | found | estimated above 30 dB | intervals of the play that hold | median error "
          "| of the severity that hold | Spearman |\n|" + "---|" * 8)  # fmt: skip
    for name, belongs in GROUPS.items():
        print(row(name, [one for one in all_of_them if belongs(one.joint)]), flush=True)
    healthy = [s for one in all_of_them if not one.joint.play for s in one.scores]
    print(f"\nwithout play: {len(healthy)} windows, {np.mean([s['impact'] for s in healthy]):.1%} with an impact, "
          f"{np.mean([(s['severity_low'] or 0) > 0 for s in healthy]):.1%} whose severity excludes none, "
          f"{np.mean([s['play'] is not None for s in healthy]):.1%} that tell a play")  # fmt: skip


if __name__ == "__main__":
    main()
