"""Where a fit begins: the unknown start state of a stretch, the frequency in the spectrum.  No parameters are fitted.

A recording starts in the middle of the motion.  On gears the cost has a valley for every impact that may have come
before, so the gap's position and speed are scanned; the bar's share is linear and follows from each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lostmotion.lab.experiment import Experiment
from lostmotion.lab.levenberg import Problem, minimise
from lostmotion.lab.stretch import Stretch, state_scales
from lostmotion.lab.unknowns import Unknowns
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["find_start", "repaired", "ringing_hz", "stretch_of"]

SCAN_S = 0.2
GAPS = np.array([-0.95, -0.6, -0.25, 0.0, 0.25, 0.6, 0.95])
SPEEDS = np.array([-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0])
REPAIR_S = 0.35
MISSED = 2.0
BEST = 3
NOBODY = Unknowns((), np.empty(0))


def stretch_of(model: Model, experiment: Experiment, noise: dict[str, float]) -> Stretch:
    """The stretch with its scales, starting along with the input."""
    own = experiment.model(model)
    rest = own.initial_state(experiment.drive, float(experiment.time[0]))
    return Stretch(experiment, noise, state_scales(model, experiment), rest)


def find_start(model: Model, stretch: Stretch, substep_s: float | None, polish: int = 6) -> Stretch:
    """The stretch with the start state from which the model comes closest to its beginning."""
    own = stretch.experiment.model(model)
    if model.base != "play":
        return _polished(model, stretch, [_measured_state(own, stretch)], substep_s, polish)
    short = _first(stretch, SCAN_S)
    best = _polished(model, short, _scan(own, short, substep_s), substep_s, polish)
    return stretch.starting(best.start)


def repaired(model: Model, stretches: Sequence[Stretch], substep_s: float | None) -> tuple[Stretch, ...]:
    """The stretches, those that the model misses begun anew: where the one before ended, or where a new scan says.

    A stretch is missed when its error is twice that of the better ones.  For gears; other motions forget their start.
    """
    errors = [_error(model, stretch, substep_s) for stretch in stretches]
    limit = MISSED * max(float(np.quantile(errors, 0.25)), 1.0)
    done: list[Stretch] = []
    for stretch, error in zip(stretches, errors, strict=True):
        done.append(_begun_anew(model, stretch, done, substep_s) if error > limit else stretch)
    return tuple(done)


def _begun_anew(model: Model, stretch: Stretch, before: Sequence[Stretch], substep_s: float | None) -> Stretch:
    own = stretch.experiment.model(model)
    short = _first(stretch, REPAIR_S)
    states = [stretch.start, *_scan(own, short, substep_s, finer=True)]
    begin = float(stretch.experiment.time[0])
    if before and before[-1].experiment.name == stretch.experiment.name:
        last = before[-1]
        times = np.append(last.experiment.time, begin)
        states.append(own.simulate(last.experiment.drive, times, last.start, substep_s=substep_s).state)
    found = [_polished(model, short, [state], substep_s, 8) for state in states]
    whole = [_polished(model, stretch, [s.start], substep_s, 3) for s in found]
    return min(whole, key=lambda s: _error(model, s, substep_s))


def _first(stretch: Stretch, length: float) -> Stretch:
    begin = stretch.experiment.time[0]
    return replace(stretch, experiment=stretch.experiment.between(begin, begin + length))


def _polished(
    model: Model, stretch: Stretch, states: Sequence[FloatArray], substep_s: float | None, iterations: int
) -> Stretch:
    """The best of these start states after some steps of the fit, the parameters held."""
    own = stretch.experiment.model(model)
    problem = Problem(model, NOBODY, np.empty(0), substep_s, huber=_huber(stretch, own, states[0], substep_s))
    found = [minimise(problem, np.empty(0), [stretch.starting(state)], iterations=iterations) for state in states]
    return min(found, key=lambda solution: solution.cost).stretches[0]


def _error(model: Model, stretch: Stretch, substep_s: float | None) -> float:
    r = stretch.residual(stretch.experiment.model(model), stretch.start, substep_s)
    return float(np.sqrt(np.mean(r**2)))


def ringing_hz(experiment: Experiment, low: float, high: float) -> float:
    """The strongest line of accel (else displacement) between two frequencies [Hz], to a tenth of its width.

    The spectrum is weighted with the fourth power of frequency, as far as it is displacement's; none of it is needed to
    be a ring of one impact.
    """
    column = "accel" if "accel" in experiment.measured else "displacement"
    values = experiment.measured[column]
    time = np.arange(experiment.time[0], experiment.time[-1], 1 / experiment.rate_hz)
    seen = ~np.isnan(values)
    even = np.interp(time, experiment.time[seen], values[seen])
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), 4 * even.size)) ** 2
    hz = np.fft.rfftfreq(4 * even.size, 1 / experiment.rate_hz)
    width = max(int(0.75 / hz[1]), 1)
    smooth = np.convolve(spectrum, np.hanning(2 * width + 1)[1:-1], "same")
    inside = (hz >= low) & (hz <= high)
    return float(hz[inside][np.argmax(smooth[inside])]) if inside.any() else math.sqrt(low * high)


def _scan(model: Model, stretch: Stretch, substep_s: float | None, finer: bool = False) -> list[FloatArray]:
    """The best start states on a grid of gap and speed, the bar's two states by linear least squares at each."""
    drive, begin = stretch.experiment.drive, float(stretch.experiment.time[0])
    turn, speed, bend, swing = stretch.scale[:4]
    rest = model.initial_state(drive, begin)

    def state(gap: float, rate: float, q: float = 0.0, dq: float = 0.0) -> FloatArray:
        given = {"theta_2": rest[0] + gap * turn, "omega_2": rest[1] + rate * speed, "q": q, "q'": dq}
        return model.initial_state(drive, begin, **given)

    r0 = stretch.residual(model, state(0, 0), substep_s)
    bar = np.stack([stretch.residual(model, state(0, 0, bend, 0), substep_s) - r0,
                    stretch.residual(model, state(0, 0, 0, swing), substep_s) - r0], axis=1)  # fmt: skip
    inverse = np.linalg.pinv(bar) if np.all(np.isfinite(bar)) else np.zeros((2, r0.size))
    tried = []
    gaps, speeds = (_between(GAPS), _between(SPEEDS)) if finer else (GAPS, SPEEDS)
    for gap in gaps:
        for rate in speeds:
            r = stretch.residual(model, state(gap, rate), substep_s)
            if not np.all(np.isfinite(r)):
                continue
            share = -inverse @ r
            tried.append((float(np.sum(np.abs(r + bar @ share))), gap, rate, share))
    tried.sort(key=lambda entry: entry[0])
    best = [state(gap, rate, share[0] * bend, share[1] * swing) for _, gap, rate, share in tried[:BEST]]
    return best or [rest]


def _between(grid: FloatArray) -> FloatArray:
    """The grid with the middles of its intervals."""
    return np.sort(np.concatenate((grid, (grid[1:] + grid[:-1]) / 2)))


def _measured_state(model: Model, stretch: Stretch) -> FloatArray:
    """Position and speed as the first samples show them; a bar at rest."""
    experiment = stretch.experiment
    column = "displacement" if model.base == "oscillator" else "position"
    begin = float(experiment.time[0])
    if column not in experiment.measured:
        return model.initial_state(experiment.drive, begin)
    seen = np.flatnonzero(~np.isnan(experiment.measured[column]))[:8]
    time, values = experiment.time[seen] - begin, experiment.measured[column][seen]
    value, rate = np.polynomial.polynomial.polyfit(time, values, 1)
    names = ("q", "q'") if model.base == "oscillator" else ("theta_2", "omega_2")
    return model.initial_state(experiment.drive, begin, **dict(zip(names, (float(value), float(rate)), strict=True)))


def _huber(stretch: Stretch, model: Model, state: FloatArray, substep_s: float | None) -> float:
    r = stretch.residual(model, state, substep_s)
    return max(3.0, 2 * float(np.median(np.abs(r)))) if np.all(np.isfinite(r)) else math.inf
