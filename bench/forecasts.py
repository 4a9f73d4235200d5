"""How far forecasts of a wearing joint's end are off, by score and by severity: `python -m bench.forecasts`.

Lives of a year, in which the play grows from 3 to 17.5 mrad (10' to 1°, ``severity_error``) by four laws of wear, are
made of windows of simulated gears with ever other motions (``bench.severity``).  Seen to 40, 60 and 80 % of a life,
each quantity's forecast is for the value that it has at the end: of the score the median over windows there, which a
user would have to know.  The error is that of the day of the end, as a share of the life that is left, at most 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from bench.roc.waveforms import RADIUS_M, Bar, FloatArray
from bench.severity import FIGURES, recorded
from lostmotion.detector.forecast import forecast

NEW, LIMIT = 3e-3, 17.5e-3
GRID = np.geomspace(NEW, LIMIT, 6)
SEEDS = range(8450, 8452)
MOTIONS = ("hand-waved", "sines to 2.4 Hz", "sines to 6 Hz")
SEEN = (0.4, 0.6, 0.8)
LIVES, WINDOWS, DAY = 30, 4000, 86400.0
LAWS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "even": lambda x: x,
    "quadratic": lambda x: x**2,
    "exponential": lambda x: np.expm1(1.8 * x) / np.expm1(1.8),
    "slowing down": np.sqrt,
}


def library(simulator: str, noise: float) -> list[FloatArray]:
    """For each play of GRID the figures of its windows, shape (M, 3)."""
    found = []
    for play in GRID:
        scores = [s for name in MOTIONS for seed in SEEDS
                  for s in recorded(simulator, name, seed, play * RADIUS_M, Bar(), noise)]  # fmt: skip
        found.append(np.array([[getattr(score, figure) for figure in FIGURES] for score in scores]))
    return found


def life(rng: np.random.Generator, law: str, windows: list[FloatArray], seen: float) -> tuple[FloatArray, FloatArray]:
    """Times [s] and figures, shape (WINDOWS, 3): each a window of the nearest play of the library, its severity scaled
    by how far that play is off."""
    x = np.sort(rng.uniform(0, seen, WINDOWS))
    play = NEW + (LIMIT - NEW) * LAWS[law](x)
    nearest = np.abs(np.log(play[:, None] / GRID)).argmin(axis=1)
    rows = np.array([windows[k][rng.integers(len(windows[k]))] for k in nearest])
    rows[:, 2] *= play / GRID[nearest]
    return 365 * DAY * x, rows


def errors(simulator: str, noise: float) -> FloatArray:
    """Errors, shape (lives, figures)."""
    windows, rng = library(simulator, noise), np.random.default_rng(8460)
    ends = np.nanmedian(windows[-1], axis=0)
    found = []
    for law in LAWS:
        for k in range(LIVES):
            time, rows = life(rng, law, windows, SEEN[k % len(SEEN)])
            left = 365 * DAY - time[-1]
            forecasts = [forecast(time, rows[:, i], float(ends[i])) for i in range(len(FIGURES))]
            found.append([1.0 if one is None else min(abs(one.likely / left - 1), 1.0) for one in forecasts])
    return np.array(found)


def main() -> None:
    """A row for each simulator."""
    print("simulator  median error: eq. 8  ringdown  severity      within a third: eq. 8  ringdown  severity")
    for simulator in ("stops", "MuJoCo", "model"):
        off = errors(simulator, 0.5)
        middle, good = np.median(off, axis=0), np.mean(off < 1 / 3, axis=0)
        row = "".join(f"{value:10.0%}" for value in middle) + " " * 16 + "".join(f"{value:10.0%}" for value in good)
        print(f"{simulator:9}        {row}", flush=True)
    assert math.isfinite(off.sum())


if __name__ == "__main__":
    main()
