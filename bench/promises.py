"""How often what is promised holds: `python -m bench.promises` (false alarms, forecasts, which joint).

False alarms: levels for 1 % learnt from as many healthy windows as are asked for, twenty in each kind of noise, counted
on fresh windows; the noise of the calibrated ring-down is learnt from the same windows as its level.
Forecasts: lives of gears by five laws of wear unknown to the forecast, from 10 to 80 µm; each history is made of
the severities of simulated windows, and its limit is what the gear's severity is at 80 µm; 80 % intervals.
Which joint: probabilities after 5 to 40 windows, in ``bench.attribution``'s case of joints that move alike half of the
time.
Play intervals are ``bench.play_size``'s.  Seeds used nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from bench.attribution import CASES, KINDS, Case, answers
from bench.gears import GEARS
from bench.roc.noises import KINDS as NOISES
from bench.roc.noises import draw
from bench.roc.waveforms import POLL_HZ, RECORD_S, STEP_RAD, Bar, FloatArray, Gear, tip
from lostmotion.detector.forecast import forecast
from lostmotion.detector.level import from_healthy, windows_needed
from lostmotion.detector.score import batch
from lostmotion.detector.series import score_series
from lostmotion.detector.tuning import noisy
from lostmotion.detector.window import DetectorSettings
from lostmotion.model import HandWaved

PROMISED, LEVELS, FRESH = 0.01, 20, 40_000
RATE_HZ, WINDOW, F_RES_HZ = 200.0, 50, 58.0
BAND = DetectorSettings(f_res_hz=F_RES_HZ, f_norm_hz=85.0, f_norm_width_hz=30.0, statistic="band")
RINGDOWN = DetectorSettings(f_res_hz=F_RES_HZ, statistic="ringdown")
DAY_S = 86400.0
FIRST_M, LAST_M, PLAYS = 10e-6, 80e-6, 8
"""Play at the begin of a life and at its limit [m]; severities are simulated at so many plays up to there."""
SCORES, LIVES = 300, 18
"""Of each history; histories of each gear and law."""
LAWS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "even": lambda x: x,
    "speeding up": lambda x: x**1.5,
    "quadratic": lambda x: x**2,
    "exponential": lambda x: np.expm1(1.2 * x) / np.expm1(1.2),
    "slowing down": lambda x: np.sqrt(x),
}
SEVERITY_SEEDS, ATTRIBUTION_SEEDS = range(22000, 22003), range(22100, 22105)
SURE = 0.95


def false_alarms(kind: str, settings: DetectorSettings, is_taught: bool) -> FloatArray:
    """Rates on fresh windows of LEVELS levels that promise PROMISED."""
    rng = np.random.default_rng([22200, NOISES.index(kind)])

    def windows(count: int) -> FloatArray:
        return draw(rng, kind, count, WINDOW, RATE_HZ, F_RES_HZ)

    fresh, rates = windows(FRESH), []
    for _ in range(LEVELS):
        healthy = windows(windows_needed(PROMISED))
        chosen = noisy(healthy, RATE_HZ, settings) if is_taught else settings
        limit = from_healthy(batch(healthy, RATE_HZ, chosen), PROMISED).value
        rates.append(float(np.mean(batch(fresh, RATE_HZ, chosen) > limit)))
    return np.array(rates)


def severities(gear: Gear, mujoco: bool) -> tuple[FloatArray, list[FloatArray]]:
    """Plays [m], and the severities [rad] of simulated windows with each."""
    plays = np.geomspace(FIRST_M, LAST_M, PLAYS)
    settings, bar = DetectorSettings(f_res_hz=F_RES_HZ * 1.003, noise_ms2=0.1), Bar()
    polls, times = np.arange(0, RECORD_S, 1 / POLL_HZ), np.arange(round(RECORD_S * bar.rate_hz)) / bar.rate_hz
    samples: list[FloatArray] = []
    for play in plays:
        found: list[float] = []
        for seed in SEVERITY_SEEDS:
            motion = HandWaved(seed)
            accel = tip(motion, times, play, bar, mujoco, gear)
            accel = accel + np.random.default_rng(seed).normal(0, 0.1, accel.size)
            commands = np.round(motion.position(polls) / STEP_RAD) * STEP_RAD
            found += [score.severity for score in score_series(polls, commands, times, accel, settings)]
        samples.append(np.array([value for value in found if np.isfinite(value)]))
    return plays, samples


def lives(plays: FloatArray, samples: list[FloatArray], law: str, seed: int) -> tuple[int, int, int]:
    """Of LIVES histories seen to 40, 60 and 80 % of the way: forecasts, those whose interval holds the day, and those
    whose middle is within a factor of two of the time that is left."""
    rng, limit = np.random.default_rng([22300, seed]), float(np.median(samples[-1]))
    count = hits = near = 0
    for i in range(LIVES):
        x = np.sort(rng.uniform(0, (0.4, 0.6, 0.8)[i % 3], SCORES))
        start = rng.uniform(FIRST_M, LAST_M / 3)
        play = start + (LAST_M - start) * LAWS[law](x)
        which = np.abs(np.log(play[:, None] / plays)).argmin(axis=1)
        value = np.array([rng.choice(samples[k]) * one / plays[k] for one, k in zip(play, which, strict=True)])
        found = forecast(365 * DAY_S * x, value, limit)
        if found:
            left = 365 * DAY_S * (1 - x[-1])
            count += 1
            hits += found.earliest <= left <= found.latest
            near += 0.5 <= found.likely / left <= 2
    return count, hits, near


def claims(case: Case) -> list[tuple[float, bool]]:
    """How sure each answer on a joint was, and whether it was right: one, none or both of two joints have play."""
    made: list[tuple[float, bool]] = []
    for kind in KINDS:
        answers(case, kind, made, ATTRIBUTION_SEEDS)
    return made


def main() -> None:
    """Three tables."""
    print(
        f"\nfalse alarms [%] where {PROMISED:.0%} is promised: mean of {LEVELS} levels, the least and largest of them\n"
    )
    print("| noise | eq. 8 | ring-down, own noise | ring-down, calibrated |\n|---|---|---|---|")
    for kind in NOISES:
        rates = [false_alarms(kind, s, taught) for s, taught in ((BAND, False), (RINGDOWN, False), (RINGDOWN, True))]
        shown = [f"{100 * r.mean():.2f} ({100 * r.min():.2f} to {100 * r.max():.2f})" for r in rates]
        print(f"| {kind} | " + " | ".join(shown) + " |", flush=True)
    gears = [(name, gear, False) for name, gear in GEARS.items()] + [("MuJoCo, hard stops", Gear(), True)]
    print("\nforecasts: 80 % intervals that hold the day [%], by law; middle within a factor of two [%]\n")
    print("| gear | " + " | ".join(LAWS) + " | all | factor of two |\n" + "|---" * (len(LAWS) + 3) + "|")
    for name, gear, mujoco in gears:
        plays, samples = severities(gear, mujoco)
        rows = np.array([lives(plays, samples, law, seed) for seed, law in enumerate(LAWS)])
        shown = [f"{100 * hits / max(count, 1):.0f}" for count, hits, _ in (*rows, rows.sum(axis=0))]
        print(f"| {name} | " + " | ".join(shown) + f" | {100 * rows[:, 2].sum() / rows[:, 0].sum():.0f} |", flush=True)
    print(f"\nwhich joint: answers with at least {SURE:.0%}, their share, right ones, and right ones of all\n")
    print("| gear | answers | sure [%] | of these right [%] | of all right [%] |\n|---|---|---|---|---|")
    usual = next(case for case in CASES if case.name == "together half of the time")
    arm = next(case for case in CASES if case.mujoco and case.together)
    for name, gear, mujoco in gears:
        made = claims(arm if mujoco else replace(usual, gear=gear))
        sure = np.array([p >= SURE for p, _ in made])
        right = np.array([is_right for _, is_right in made])
        print(f"| {name} | {sure.size} | {100 * sure.mean():.0f} | {100 * right[sure].mean():.1f} | "
              f"{100 * right.mean():.1f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
