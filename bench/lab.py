"""The lab beside others, on recordings of the hidden-effect bench: `python -m bench.lab`.

First a fit: the base's parameters and the start states of eight segments of half a second, by the lab and by what one
would write with SciPy (LSODA on a compiled right-hand side, least_squares with sparse finite differences), from the
same start, which is 1 % off.  Then the choice of what is missing: `lab explain` on three recordings, against PySINDy
(STLSQ) and SysIdentPy (FROLS), which choose among candidate terms for the residual of the same base fit.  They are
helped: they get the fitted base's motion, every term of the catalogue that can be written as a column, those on the
joint passed through the bar, and cases with such effects only.  Needs pysindy and sysidentpy; who is missing is left
out with a word.
"""

from __future__ import annotations

import importlib.util
import json
import math
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import odeint
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.signal import lfilter

from bench.hidden_effects.answers import ask
from bench.hidden_effects.cases import Case, write_case
from lostmotion.drivers.recording import read_recording
from lostmotion.lab.data.experiment import experiments
from lostmotion.lab.data.noise import noise_of
from lostmotion.lab.fitting.strategy import first_fit
from lostmotion.lab.models import modelfile
from lostmotion.lab.shooting.continuation import fitted, tiles
from lostmotion.lab.shooting.initial_state import find_start, segment_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Segment
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model

__all__ = ["main", "rhs", "through_bar"]

FloatArray = NDArray[np.float64]
Columns = Mapping[str, FloatArray]
SEED = 700
FREE = ("alpha", "d", "l", "b", "k", "bias")
OFF = 1.01
LIMIT_S = 600.0
NO_ANSWER = ["no answer"]
EFFECTS = (
    "viscous_friction", "coulomb_friction", "stribeck_friction", "gravity_torque", "load_dependent_friction",
    "hardening_spring", "quadratic_damping", "gravity_leakage", "centripetal_crosstalk", "sensor_lag", "clock_skew",
    "bias_drift",
)  # fmt: skip
"""Those that a column can stand for."""
NOTHING = 4


def main() -> None:
    """Prints two tables."""
    folder = Path(tempfile.mkdtemp(prefix="lostmotion-bench-lab-"))
    compare_fits(folder)
    compare_choices(folder)


# -- the same fit twice ------------------------------------------------------------------------------------------------


@njit(cache=True)
def rhs(y, t, p, start, step, coefficients):  # type: ignore[no-untyped-def]
    """Eqs. 1-7; p: alpha, d, l, b, k, bias, R1, R2, J2, beta, n, m."""
    i = min(max(int((t - start) / step), 0), coefficients.shape[0] - 1)
    u = t - start - i * step
    c3, c2, c1, c0 = coefficients[i]
    gap = y[0] * p[7] - (((c3 * u + c2) * u + c1) * u + c0) * p[6]
    gap_rate = y[1] * p[7] - ((3 * c3 * u + 2 * c2) * u + c1) * p[6]
    closed = gap / (p[1] / 2)
    flank = closed ** int(p[10])
    alpha2 = -(p[9] * flank + p[0] * gap_rate * flank * closed) * p[7] / p[8]
    out = np.empty(4)
    out[0], out[1], out[2] = y[1], alpha2, y[3]
    out[3] = -(p[3] * y[3] + p[4] * y[2]) / p[11] - p[2] * alpha2
    return out


def compare_fits(folder: Path) -> None:
    """One recording with nothing missing."""
    case = Case("fit", "nothing", (), "strong", "white", SEED)
    write_case(case, folder / case.name)
    truth = json.loads((folder / case.name / "truth.json").read_text())
    model = modelfile.load(folder / case.name / "model.toml").build()
    model = model.replace({name: truth["parameters"][name] for name in FREE})
    experiment = experiments(model, [read_recording(folder / case.name / "rec1.csv")])[0]
    noise = {"accel": truth["noise"][0]}
    substep = 1e-4
    segments = [find_start(model, segment_of(model, tile, noise), substep) for tile in tiles(experiment, 3)]
    model = model.replace({name: truth["parameters"][name] * OFF for name in FREE})
    fitted(model, Unknowns.of(model), segments[:1], substep, iterations=1)  # compiles
    begin = time.perf_counter()
    level = fitted(model, Unknowns.of(model), segments, substep, iterations=50, quadratic=True)
    ours = time.perf_counter() - begin
    print("fit of 6 parameters and 8 start states to 4 s at 800 Hz; residual: RMS over the noise's")
    print(f"{'':34}{'time [s]':>10}{'residual':>10}{'gain':>8}")
    print(f"{'lostmotion':34}{ours:10.2f}{level.rms:10.3f}{1:8.0f}")
    for rtol in (1e-6, 1e-9):
        seconds, residual = scipy_fit(model, segments, rtol)
        name = f"SciPy, LSODA rtol {rtol:.0e}, numba"
        print(f"{name:34}{seconds:10.2f}{residual:10.3f}{seconds / ours:8.0f}")


def scipy_fit(model: Model, segments: Sequence[Segment], rtol: float) -> tuple[float, float]:
    """Seconds, and the RMS of the residual over the noise."""
    value = {name: parameter.value for name, parameter in model.parameters.items()}
    fixed = [value[name] for name in ("R1", "R2", "J2", "beta", "n", "m")]
    begun = np.array([value[name] for name in FREE])
    drive: Any = segments[0].experiment.drive
    spline = CubicSpline(drive.time, drive.values)
    where = (float(spline.x[0]), float(spline.x[1] - spline.x[0]), np.ascontiguousarray(spline.c.T))
    solve: Any = odeint  # its stubs know no compiled functions

    def of(segment: Segment, x: FloatArray, state: FloatArray) -> FloatArray:
        p = np.array([*(begun * (1 + x)), *fixed])
        y = solve(rhs, state, segment.experiment.time, (p, *where), rtol=rtol, atol=1e-4 * rtol, mxstep=100_000)
        modelled = p[5] - (p[3] * y[:, 3] + p[4] * y[:, 2]) / p[11]
        return np.asarray((segment.experiment.measured["accel"] - modelled) / segment.noise["accel"])

    def residual(x: FloatArray) -> FloatArray:
        states = x[len(FREE) :].reshape(-1, 4)
        parts = (of(s, x[: len(FREE)], s.start + s.scale * own) for s, own in zip(segments, states, strict=True))
        return np.concatenate(list(parts))

    sizes = [len(segment.experiment.time) for segment in segments]
    pattern = np.zeros((sum(sizes), len(FREE) + 4 * len(segments)))
    pattern[:, : len(FREE)] = 1
    for i, end in enumerate(np.cumsum(sizes)):
        pattern[end - sizes[i] : end, len(FREE) + 4 * i : len(FREE) + 4 * i + 4] = 1
    x0 = np.zeros(pattern.shape[1])
    residual(x0)  # compiles
    begin = time.perf_counter()
    found = least_squares(residual, x0, jac_sparsity=pattern, diff_step=1e-5, ftol=1e-4, max_nfev=50)
    return time.perf_counter() - begin, float(np.sqrt(np.mean(found.fun**2)))


# -- what is missing ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Rival:
    """A way of choosing terms: columns (N,) of unit size and a residual (N,) in, names of terms out, largest first."""

    name: str
    package: str
    choose: Callable[[Columns, FloatArray], list[str]]


def sindy(columns: Columns, residual: FloatArray) -> list[str]:
    """Sequentially thresholded least squares with PySINDy's default threshold, residual and columns scaled to 1."""
    from pysindy import STLSQ

    matrix = np.column_stack(list(columns.values()))
    with warnings.catch_warnings(action="ignore"):  # it warns where it chooses nothing
        fit = STLSQ(threshold=0.1).fit(matrix, residual[:, None] / np.std(residual))
    size = np.abs(fit.coef_[0])
    return [list(columns)[i] for i in np.argsort(-size) if size[i] > 0]


def frols(columns: Columns, residual: FloatArray) -> list[str]:
    """Forward regression by error reduction, the number of terms by the BIC."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    matrix = np.column_stack(list(columns.values()))
    lags = [[1]] * matrix.shape[1]
    model = FROLS(xlag=lags, model_type="NFIR", info_criteria="bic", n_info_values=matrix.shape[1],
                  estimator=LeastSquares(), basis_function=Polynomial(degree=1))  # fmt: skip
    model.fit(X=np.roll(matrix, -1, axis=0), y=residual[:, None] / np.std(residual))
    codes = [int(code[-1]) for code in model.final_model if code[-1] > 0]
    return [list(columns)[code // 1000 - 2] for code in codes]


RIVALS = (Rival("PySINDy, STLSQ", "pysindy", sindy), Rival("SysIdentPy, FROLS", "sysidentpy", frols))


def compare_choices(folder: Path) -> None:
    """A strong case of each of EFFECTS, and some with nothing missing."""
    rivals = [rival for rival in RIVALS if importlib.util.find_spec(rival.package)]
    for rival in RIVALS:
        if rival not in rivals:
            print(f"left out {rival.name}: {rival.package} is not installed")
    names = ["lab explain", *(rival.name for rival in rivals)]
    right, alarms, seconds = (dict.fromkeys(names, 0.0) for _ in range(3))
    hidden = [*((effect,) for effect in EFFECTS), *((),) * NOTHING]
    for number, effects in enumerate(hidden):
        kind = "strong" if effects else "nothing"
        case = Case(f"{kind}-{number}", kind, effects, "strong", "white", SEED + number)
        write_case(case, folder / case.name)
        for name, (named, took) in _answers(folder / case.name, rivals).items():
            seconds[name] += took / len(hidden)
            right[name] += named[:1] == list(effects) if effects else 0
            alarms[name] += bool(named) and named != NO_ANSWER if not effects else 0
            print(
                f"{case.name:12}{(*effects, 'nothing')[0]:26}{name:20}{', '.join(named) or 'nothing'}", file=sys.stderr
            )
    print("choice of what is missing, three recordings of 4 s at 800 Hz; rivals choose on the lab's base fit")
    print(f"{'':22}{'right first':>14}{'false alarms':>14}{'time [s]':>10}")
    for name in names:
        first, alarm = f"{right[name]:.0f}/{len(EFFECTS)}", f"{alarms[name]:.0f}/{NOTHING}"
        print(f"{name:22}{first:>14}{alarm:>14}{seconds[name]:10.1f}")


def _answers(folder: Path, rivals: Sequence[Rival]) -> dict[str, tuple[list[str], float]]:
    """What each names, and how long it took without the base fit that the rivals are given [s]."""
    asked = ask([str(Path(sys.executable).with_name("lostmotion")), "lab", "explain"], folder, LIMIT_S)
    named = NO_ANSWER
    if asked.document:
        verdict = asked.document["verdict"]
        named = asked.document["missing"] or ([] if verdict == "nothing_missing" else [verdict])
    answers = {"lab explain": (named, asked.seconds)}
    columns, residual = _terms(folder)
    for rival in rivals:
        begin = time.perf_counter()
        chosen = [name.split()[0] for name in rival.choose(columns, residual)]
        answers[rival.name] = (list(dict.fromkeys(chosen)), time.perf_counter() - begin)
    return answers


def _terms(folder: Path) -> tuple[Columns, FloatArray]:
    """Candidate columns, of unit size and mean zero, and the residual of the base, of all recordings."""
    model = modelfile.load(folder / "model.toml").build()
    found = experiments(model, [read_recording(folder / f"rec{i}.csv") for i in (1, 2, 3)])
    noise = noise_of(found)
    with ThreadPoolExecutor(2) as pool:
        level = first_fit(model, Task.of(model, found, noise), pool)
    parts, residuals = [], []
    for segment in level.segments:
        run = segment.simulate(level.model, segment.start, None)
        parts.append(_columns(level.model, {**run.signals, "time": run.time}))
        residuals.append(segment.experiment.measured["accel"] - run["accel"])
    joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    centred = {name: column - column.mean() for name, column in joined.items()}
    residual = np.concatenate(residuals)
    return {name: column / np.std(column) for name, column in centred.items()}, residual - residual.mean()


def _columns(model: Model, s: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """What each effect adds to the reading for a small size, as far as it can be written down from the motion."""
    step = float(s["time"][1] - s["time"][0])
    omega, theta, q = s["velocity"], s["position"], s["displacement"]
    sign, speed = np.tanh(omega / 1e-2), np.gradient(q, step)
    jerk = np.gradient(s["accel"], step)
    torques = {
        "viscous_friction": -omega,
        "coulomb_friction": -sign,
        "stribeck_friction": -np.exp(-((omega / 0.2) ** 2)) * sign,
        "load_dependent_friction": -np.abs(s["force"]) * sign,
        "gravity_torque sin": -np.sin(theta),
        "gravity_torque cos": -np.cos(theta),
    }
    forces = {"hardening_spring": -(q**3), "quadratic_damping": -speed * np.abs(speed)}
    v = {name: parameter.value for name, parameter in model.parameters.items()}
    w, decay = math.sqrt(v["k"] / v["m"]), v["b"] / 2 / v["m"]
    return {
        **{name: through_bar(torque, step, w, decay) for name, torque in torques.items()},
        **{name: force + through_bar(force, step, w, decay) for name, force in forces.items()},
        "gravity_leakage sin": np.sin(theta),
        "gravity_leakage cos": np.cos(theta),
        "centripetal_crosstalk": omega**2,
        "sensor_lag": -jerk,
        "clock_skew": -s["time"] * jerk,  # a recording begins at 0
        "bias_drift": s["time"],
    }


def through_bar(push: FloatArray, step: float, w: float, decay: float) -> FloatArray:
    """The tip's acceleration to a push at the root: the bar's low-pass (w² + 2 decay s)/(s² + 2 decay s + w²)."""
    damped = math.sqrt(w * w - decay * decay)
    pole = np.exp((-decay + 1j * damped) * step)
    gain = w * w * step / damped * pole.imag
    return np.asarray(lfilter([0.0, gain], [1.0, -2 * pole.real, abs(pole) ** 2], push))


if __name__ == "__main__":
    main()
