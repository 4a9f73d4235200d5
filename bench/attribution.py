"""How well the joint with play is named: `python -m bench.attribution`.

Two joints with parallel axes and one bar (or two), each with play or without, commands of AX-12As (0.29°, 100 Hz), a
bar whose setting is 0.3 % off, noise of 0.1 m/s², lever arms 5 % wrong.  Motions: each joint waves on its own; or the
second one makes the first one's motion half of the time, so that its reversals fall on the other's then.  By the model,
whose joints add up at the bar; and by MuJoCo's arm of two links (``bench.arm``).  Seeds used nowhere else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bench.arm import arm
from bench.roc.waveforms import LENGTH_M, POLL_HZ, STEP_RAD, Bar, FloatArray, Gear, tip, tip_without_play
from lostmotion.detector.attribution import Evidence, Mover, attribute, evidence
from lostmotion.detector.commanded import BEFORE_S
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings
from lostmotion.detector.windows import cut
from lostmotion.model import HandWaved, Motion, Sampled

SEEDS, MUJOCO_SEEDS = range(9500, 9520), range(9500, 9508)
SECONDS, WINDOW_S, NOISE_MS2 = 16.0, 0.25, 0.1
TOGETHER_S = 2.0
"""Half a period of the motion that is the other joint's half of the time."""
SAME_S = 0.05
"""Reversals of both joints within so long of each other fall together."""
COUNTS = (5, 10, 20, 40)
"""Windows after which the answer is asked."""
KINDS = {"one": ((0,), (1,)), "none": ((),), "both": ((0, 1),)}
"""Which joints have play."""
BINS = (0.5, 0.8, 0.95, 0.99, 1.0001)


USUAL, USUAL_GEAR = Bar(), Gear()


@dataclass(frozen=True)
class Case:
    """Two joints; levers: of each at each accelerometer [m]."""

    name: str
    play_m: float = 40e-6
    bar: Bar = USUAL
    levers: tuple[tuple[float, ...], ...] = ((LENGTH_M,), (LENGTH_M,))
    together: bool = True
    mujoco: bool = False
    gear: Gear = USUAL_GEAR


FAR = ((0.25,), (0.10,))
CASES = (
    Case("waved on their own", together=False),
    Case("together half of the time"),
    *(Case(f"... play {play} µm", play * 1e-6) for play in (10, 20, 80, 200)),
    Case("... lever arms 0.25 and 0.10 m", levers=FAR),
    Case("... second accelerometer on the first link", levers=((0.25, 0.10), (0.10, 0.0))),
    Case("... 500 Hz", bar=Bar(rate_hz=500.0)),
    Case("... 200 Hz", bar=Bar(rate_hz=200.0)),
    Case("... 200 Hz, bar of 25 Hz", bar=Bar(25.0, rate_hz=200.0)),
    Case("MuJoCo's arm, on their own", levers=FAR, mujoco=True, together=False),
    Case("MuJoCo's arm, together half of the time", levers=FAR, mujoco=True),
)


def motions(seed: int, together: bool) -> tuple[Motion, Motion]:
    """The commands of both joints."""
    one, other = HandWaved(2 * seed), HandWaved(2 * seed + 1)
    if not together:
        return one, other
    knots = np.arange(-0.1, SECONDS + 0.1, 1e-3)
    share = 0.5 + 0.5 * np.tanh(4 * np.sin(np.pi * knots / TOGETHER_S))
    return one, Sampled(knots, share * one.position(knots) + (1 - share) * other.position(knots))


def measured(case: Case, moved: tuple[Motion, Motion], worn: Sequence[int], seed: int) -> tuple[FloatArray, FloatArray]:
    """Times [s], and tip acceleration at each accelerometer [m/s²], shape (S, N)."""
    times = np.arange(round(SECONDS * case.bar.rate_hz)) / case.bar.rate_hz
    if case.mujoco:
        tips = arm(moved, times, [case.play_m if joint in worn else 0.0 for joint in (0, 1)], case.bar)[None]
    else:
        felt = [
            tip(motion, times, case.play_m, case.bar, False, case.gear)
            if joint in worn
            else tip_without_play(motion, times, case.bar)
            for joint, motion in enumerate(moved)
        ]
        tips = np.array(case.levers).T @ np.array(felt) / LENGTH_M
    return times, tips + np.random.default_rng(seed).normal(0, NOISE_MS2, tips.shape)


def window_evidence(case: Case, seed: int, worn: Sequence[int]) -> tuple[list[Evidence], float]:
    """The evidence of the windows of one recording, and the share of the first joint's reversals that coincide with the
    other's."""
    moved = motions(seed, case.together)
    times, tips = measured(case, moved, worn, seed)
    polls = np.arange(0, SECONDS, 1 / POLL_HZ)
    settings = DetectorSettings(f_res_hz=case.bar.f_res_hz * 1.003, noise_ms2=NOISE_MS2)
    wrong = np.random.default_rng([seed, 1]).normal(1, 0.05, np.shape(case.levers))
    movers, reversals = [], []
    for motion, levers in zip(moved, np.array(case.levers) * wrong, strict=True):
        commands = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
        movers.append(Mover(polls, commands, tuple(levers)))
        reversals.append([found.time for found in Trigger(settings, POLL_HZ, STEP_RAD).push(polls, commands)])
    found: list[Evidence] = []
    for start in sorted(reversals[0] + reversals[1]):
        if not 1 < start < SECONDS - WINDOW_S - 0.1:
            continue
        length = BEFORE_S + WINDOW_S
        segments = [cut("", times, accel, start - BEFORE_S, length, case.bar.rate_hz) for accel in tips]
        told_by = evidence(segments, movers, [settings] * len(tips), max(start, found[-1].until if found else 0.0))
        found += [told_by] if told_by else []
    others = np.array(reversals[1])
    return found, float(np.mean([np.any(np.abs(others - at) < SAME_S) for at in reversals[0]]))


def answers(
    case: Case, kind: str, claims: list[tuple[float, bool]], seeds: Sequence[int] = ()
) -> tuple[list[float], float]:
    """Share of right answers after COUNTS windows, and of reversals that fall together; adds to claims how sure each
    answer on a joint was, and whether it was right."""
    right: list[list[bool]] = []
    shares = []
    for seed in seeds or (MUJOCO_SEEDS if case.mujoco else SEEDS):
        for worn in KINDS[kind]:
            found, share = window_evidence(case, seed, worn)
            shares.append(share)
            pooled = [attribute(found[:count], (0.5, 0.5)) for count in COUNTS]
            right.append([int(one.sets.argmax()) == sum(2**joint for joint in worn) for one in pooled])
            for one in pooled:
                claims += [(max(p, 1 - p), (p > 0.5) == (joint in worn)) for joint, p in enumerate(one.joints)]
    return list(np.mean(right, axis=0)), float(np.mean(shares))


def main() -> None:
    """The share of right answers, and how far the probabilities can be trusted."""
    counts = "/".join(map(str, COUNTS))
    print(
        f"right after {counts} windows [%]: which joints have play".ljust(46),
        "together   one of them      none",
        "both",
    )
    claims: dict[str, list[tuple[float, bool]]] = {kind: [] for kind in KINDS}
    for case in CASES:
        rows = {kind: answers(case, kind, claims[kind]) for kind in KINDS}
        shown = ["/".join(f"{100 * share:.0f}" for share in rows[kind][0]).rjust(16) for kind in KINDS]
        print(f"{case.name:46} {rows['one'][1]:7.0%}", *shown, flush=True)
    for kind, made in claims.items():
        sure, right = np.array([p for p, _ in made]), np.array([is_right for _, is_right in made])
        cells = [
            f"{low:.2f}-{min(high, 1):.2f}: {right[inside].mean():.1%} of {inside.sum()}"
            for low, high in pairwise(BINS)
            if (inside := (sure >= low) & (sure < high)).any()
        ]
        print(f"{kind}: right where the probability was", ", ".join(cells))


if __name__ == "__main__":
    main()
