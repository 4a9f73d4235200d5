"""How fast the compiled solver is beside SciPy's, at the same error: `python -m bench.simulation`.

Two seconds at 1 kHz of the play model under a recorded hand-waved motion.  All three are held against one tight
reference (DOP853, rtol 1e-12).  LSODA's tolerance and our sub-step are the coarsest whose error is at most 1e-3 of the
acceleration's root mean square, well below any sensor's noise.  The numba right-hand side is the best we could write
(spline inlined), the Python one what one would write first (SciPy's spline, NumPy scalars).  Times are the best of
several warm rounds in which all take turns; the splines are made before.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from lostmotion.model import HandWaved, Model, Sampled, build_model

__all__ = ["main"]

FloatArray = NDArray[np.float64]
RightHandSide = Callable[[float, FloatArray], Any]
TARGET = 1e-3
ROUNDS = 6


def python_rhs(model: Model, motion: CubicSpline[np.float64]) -> RightHandSide:
    """Eqs. 1-7 as they stand."""
    v = {name: p.value for name, p in model.parameters.items()}
    n = int(v["n"])

    def rhs(t: float, state: FloatArray) -> list[float]:
        theta2, omega2, q, q_rate = state
        gap = theta2 * v["R2"] - motion(t) * v["R1"]
        gap_rate = omega2 * v["R2"] - motion(t, 1) * v["R1"]
        closed = gap / (v["d"] / 2)
        force = v["beta"] * closed**n + v["alpha"] * gap_rate * closed ** (n + 1)
        alpha2 = -force * v["R2"] / v["J2"]
        return [omega2, alpha2, q_rate, -(v["b"] * q_rate + v["k"] * q) / v["m"] - v["l"] * alpha2]

    return rhs


def numba_rhs(model: Model, motion: CubicSpline[np.float64]) -> RightHandSide:
    """The same, compiled, the evenly spaced spline evaluated in place."""
    R1, R2, J2, beta, alpha, n, d, l, m, b, k, _ = (p.value for p in model.parameters.values())  # noqa: E741
    power, coefficients, step = int(n), np.ascontiguousarray(motion.c.T), float(motion.x[1] - motion.x[0])

    @njit
    def rhs(t: float, state: FloatArray) -> FloatArray:
        i = min(max(int(t / step), 0), coefficients.shape[0] - 1)
        c3, c2, c1, c0 = coefficients[i]
        u = t - i * step
        gap = state[0] * R2 - (((c3 * u + c2) * u + c1) * u + c0) * R1
        gap_rate = state[1] * R2 - ((3 * c3 * u + 2 * c2) * u + c1) * R1
        closed = gap / (d / 2)
        flank = closed**power
        force = beta * flank + alpha * gap_rate * flank * closed
        alpha2 = -force * R2 / J2
        out = np.empty(4)
        out[0], out[1], out[2] = state[1], alpha2, state[3]
        out[3] = -(b * state[3] + k * state[2]) / m - l * alpha2
        return out

    return rhs  # type: ignore[no-any-return]


def best_times(runs: Sequence[tuple[Callable[[], FloatArray], int]]) -> list[float]:
    """Best time [s] of each run.  In every round each is repeated as often as told, so all meet the machine's moods."""
    best = [float("inf")] * len(runs)
    for _ in range(ROUNDS):
        for i, (run, repeats) in enumerate(runs):
            for _ in range(repeats):
                begin = time.perf_counter()
                run()
                best[i] = min(best[i], time.perf_counter() - begin)
    return best


def main() -> None:
    """Prints one table."""
    times = np.arange(2001) / 1000
    recorded = Sampled(times, HandWaved(seed=1).position(times))
    spline = CubicSpline(recorded.time, recorded.values)
    model = build_model("play")
    start = model.initial_state(recorded)
    b, k, m = (model.parameters[name].value for name in "bkm")

    def scipy_run(rhs: RightHandSide, method: Any, rtol: float) -> FloatArray:
        y = solve_ivp(rhs, (0.0, 2.0), start, method, t_eval=times, rtol=rtol, atol=1e-6 * rtol).y
        return np.asarray(-(b * y[3] + k * y[2]) / m)

    compiled, plain = numba_rhs(model, spline), python_rhs(model, spline)
    reference = scipy_run(compiled, "DOP853", 1e-12)
    scale = float(np.sqrt(np.mean(reference**2)))

    def error(accel: FloatArray) -> float:
        return float(np.sqrt(np.mean((accel - reference) ** 2))) / scale

    def coarsest(rhs: RightHandSide) -> float:
        return float(next(r for r in 10.0 ** np.arange(-3, -11, -0.25) if error(scipy_run(rhs, "LSODA", r)) <= TARGET))

    rtol, plain_rtol = coarsest(compiled), coarsest(plain)
    substep = next(
        h for h in 1e-3 / np.arange(1, 65) if error(model.simulate(recorded, times, substep_s=h)["accel"]) <= TARGET
    )
    rows = [
        ("LSODA, Python", f"rtol {plain_rtol:.0e}", lambda: scipy_run(plain, "LSODA", plain_rtol), 1),
        ("LSODA, numba", f"rtol {rtol:.0e}", lambda: scipy_run(compiled, "LSODA", rtol), 2),
        (
            "lostmotion",
            f"{substep * 1e6:.0f} µs",
            lambda: model.simulate(recorded, times, substep_s=substep)["accel"],
            50,
        ),
        ("lostmotion, own choice", "", lambda: model.simulate(recorded, times)["accel"], 20),
    ]
    seconds = best_times([(run, repeats) for _, _, run, repeats in rows])
    print("2 s at 1 kHz of the play model; error: RMS over the signal's RMS; gain: of lostmotion at the same error")
    print(f"{'':24}{'setting':>12}{'time [ms]':>12}{'error':>10}{'gain':>8}")
    for (name, setting, run, _), best in zip(rows, seconds, strict=True):
        print(f"{name:24}{setting:>12}{best * 1e3:12.2f}{error(run()):10.1e}{best / seconds[2]:8.0f}")


if __name__ == "__main__":
    main()
