"""Estimates the initial state of a segment with the parameters held; and the bar's frequency from a spectrum.

A segment begins in the middle of a motion.  For gears the cost has a local minimum for every impact that may have come
before.  So a grid of positions and speeds within the gap is scanned; the residual is linear in the state of the bar,
which follows by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.shooting.continuation import are_missed, errors
from lostmotion.lab.shooting.least_squares import robust
from lostmotion.lab.shooting.segment import STEP, Segment, in_motion, state_scales
from lostmotion.model import Model, ModelError
from lostmotion.model.motion import FloatArray
from lostmotion.model.run import run_each

__all__ = ["FINE", "find_start", "repaired", "ringing_hz", "segment_of", "with_best_starts"]

SCAN_S = 0.1
"""Length of the part of a segment on which states are scanned [s]."""
LAST = 2
"""Steps of the fit on the whole segment."""
RENEWED, MORE = 4, 2
"""Number of steps that share derivatives, with corrections by secants in between, and number of additional steps for
it.  It takes a third fewer simulations, and of 28 initial states none is 10 % worse (three are 10 % better)."""


@dataclass(frozen=True)
class Effort:
    """The effort of a search for an initial state.

    gaps, speeds: the grid of positions in the gap [half plays] and of speeds [speeds that cross the gap]; scanned: the
    number of states of the grid that are kept; stages: the growing horizon after it, each with its length [s], the
    number of states that are kept, and the steps of the fit.
    """

    gaps: FloatArray
    speeds: FloatArray
    scanned: int
    stages: tuple[tuple[float, int, int], ...]


QUICK = Effort(
    np.array([-0.95, -0.6, -0.25, 0.0, 0.25, 0.6, 0.95]),
    np.array([-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0]),
    5,
    ((0.1, 3, 3), (0.2, 2, 2)),
)
"""For the first estimate of every segment."""
FINE = Effort(
    np.array([-1.0, -0.95, -0.85, -0.7, -0.45, -0.2, 0.0, 0.2, 0.45, 0.7, 0.85, 0.95, 1.0]),
    np.array([-3.0, -2.2, -1.6, -1.1, -0.7, -0.35, 0.0, 0.35, 0.7, 1.1, 1.6, 2.2, 3.0]),
    16,
    ((0.1, 10, 3), (0.15, 6, 3), (0.25, 4, 3), (0.35, 3, 3), *((0.5 * 1.2**i, 2, 3) for i in range(20))),
)
"""For segments that are missed, and long ones."""


def segment_of(model: Model, experiment: Experiment, noise: dict[str, float]) -> Segment:
    """The segment of an experiment with its scales, starting at rest relative to the input."""
    own = experiment.model(model)
    rest = in_motion(own, experiment.drive, float(experiment.time[0]))
    return Segment(experiment, noise, state_scales(model, experiment), rest)


def find_start(
    model: Model, segment: Segment, substep_s: float, also: Sequence[FloatArray] = (), effort: Effort = QUICK
) -> Segment:
    """The segment with the initial state that minimises its error, the parameters being held.

    also: initial guesses (n,) beside those of the scan; effort: that of the scan, which is for gears only.
    """
    own = segment.experiment.model(model)
    if model.base != "play":
        return with_best_starts(model, [segment], [np.array([_measured_state(own, segment), *also])], substep_s, 6)[0]
    states = np.array([*_scan(own, _first(segment, SCAN_S), substep_s, effort), *also])
    for length, kept, iterations in effort.stages:
        if length < segment.experiment.duration:
            (states,) = polished_each(model, [_first(segment, length)], [states], substep_s, iterations)
            states = states[:kept]
    return with_best_starts(model, [segment], [states], substep_s, LAST)[0]


def with_best_starts(
    model: Model, segments: Sequence[Segment], states: Sequence[FloatArray], substep_s: float, iterations: int
) -> list[Segment]:
    """The segments with the best initial states that some steps from these (K_i, n) lead to; see ``polished_each``."""
    found = polished_each(model, segments, states, substep_s, iterations)
    return [segment.starting(best[0]) for segment, best in zip(segments, found, strict=True)]


def polished_each(
    model: Model, segments: Sequence[Segment], states: Sequence[FloatArray], substep_s: float, iterations: int
) -> list[FloatArray]:
    """The initial states (K_i, n) of each segment after some Levenberg-Marquardt steps of all of them at once, the one
    with the least robust cost first; those of all segments are simulated side by side."""
    runs = [segment.prepared(segment.experiment.model(model)) for segment in segments]
    found = list(states)
    under_way = {i: _polishing(segment, states[i], iterations) for i, segment in enumerate(segments)}
    asked = {i: next(steps) for i, steps in under_way.items()}
    while asked:
        each = [i for i, wanted in asked.items() for _ in wanted]
        outputs = iter(run_each([runs[i] for i in each], np.concatenate([*asked.values()]), substep_s))
        answers = {i: [next(outputs) for _ in wanted] for i, wanted in asked.items()}
        asked = {}
        for i, out in answers.items():
            try:
                asked[i] = under_way[i].send(segments[i].residuals_of(out))
            except StopIteration as end:
                found[i] = end.value
    return found


def _polishing(
    segment: Segment, states: FloatArray, iterations: int
) -> Generator[FloatArray, FloatArray, FloatArray]:  # fmt: skip
    """The steps of ``polished_each``: yields the states (K, n) of which it needs the residuals (K, M), and returns the
    result."""
    K, n = states.shape
    states = states.copy()
    steps = STEP * np.diag(segment.scale)
    r = yield states
    finite = np.isfinite(r[:, 0])
    if not finite.any():
        return states
    huber = max(3.0, 2 * float(np.median(np.abs(r[finite]).min(axis=0))))
    cost, damping = robust(r, huber), np.full(K, 1e-2)
    slopes = np.empty((K, n, r.shape[1]))
    for i in range(iterations + MORE):
        if i % RENEWED == 0:
            there = yield (states[:, None] + steps[None]).reshape(K * n, n)
            with np.errstate(invalid="ignore"):  # a simulation that fails has infinite errors
                slopes = (there.reshape(K, n, -1) - r[:, None]) / STEP
            slopes[~np.isfinite(slopes)] = 0.0
        step = _damped_step(slopes, r, huber, damping)
        trial = states + step * segment.scale
        there = yield trial
        if (i + 1) % RENEWED:
            slopes += _secant(slopes, step, r, there)
        new = robust(there, huber)
        better = new < cost
        states[better], r[better], cost[better] = trial[better], there[better], new[better]
        damping = np.where(better, damping / 10, damping * 10)
    return np.asarray(states[np.argsort(cost)])


def _damped_step(slopes: FloatArray, r: FloatArray, huber: float, damping: FloatArray) -> FloatArray:
    """The damped Gauss-Newton steps (K, n) for residuals r (K, M), their derivatives (K, n, M) and dampings (K,)."""
    n = slopes.shape[1]
    w = 1 / np.maximum(1.0, np.abs(np.where(np.isfinite(r), r, 1.0)) / huber)
    weighted = slopes * w[:, None]
    H = weighted @ slopes.transpose(0, 2, 1)
    H[:, range(n), range(n)] = H[:, range(n), range(n)] * (1 + damping[:, None]) + 1e-3
    g = (weighted @ np.where(np.isfinite(r), r, 0.0)[:, :, None])[:, :, 0]
    return np.asarray(-np.clip(np.linalg.solve(H, g[:, :, None])[:, :, 0], -1.0, 1.0))


def _secant(slopes: FloatArray, step: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """The least correction of derivatives (K, n, M) that explains the change of residuals (K, M) by steps (K, n)
    (Broyden 1965); zero where the motion cannot be simulated."""
    with np.errstate(invalid="ignore", divide="ignore"):
        missed = after - before - (step[:, None] @ slopes)[:, 0]
        found = step[:, :, None] * (missed / np.sum(step**2, axis=1, keepdims=True))[:, None]
    return np.where(np.isfinite(found).all(axis=(1, 2), keepdims=True), found, 0.0)


def repaired(
    model: Model, segments: Sequence[Segment], substep_s: float, max_missed: float = 1.0
) -> tuple[Segment, ...]:
    """The segments, with new initial states for those that the model misses: from the end of the segment before, or
    from a finer scan; for gears only.

    max_missed: the share of missed segments above which no initial state is searched for again.
    """
    if model.base != "play":
        return tuple(segments)
    missed = are_missed(model, segments, substep_s)
    if np.mean(missed) > max_missed:
        return tuple(segments)
    done: list[Segment] = []
    for segment, out in zip(segments, missed, strict=True):
        done.append(_begun_anew(model, segment, done, substep_s) if out else segment)
    return tuple(done)


def _begun_anew(model: Model, segment: Segment, before: Sequence[Segment], substep_s: float) -> Segment:
    """The segment with a new initial state, if that lowers its error; before: the segments before it, already
    repaired."""
    own = segment.experiment.model(model)
    also = [segment.start]
    if before and before[-1].experiment.name == segment.experiment.name:
        last = before[-1]
        times = np.append(last.experiment.time, segment.experiment.time[0])
        with suppress(ModelError):  # the segment before diverges
            also.append(own.simulate(last.experiment.drive, times, last.start, substep_s=substep_s).state)
    anew = find_start(model, segment, substep_s, also, FINE)
    error = errors(model, [anew, segment], substep_s)
    return anew if error[0] < error[1] else segment


def _first(segment: Segment, length: float) -> Segment:
    """The first part of a segment; length: of it [s]."""
    begin = segment.experiment.time[0]
    return replace(segment, experiment=segment.experiment.between(begin, begin + length))


def ringing_hz(experiment: Experiment, low: float, high: float) -> float:
    """The frequency [Hz] of the strongest line of the bar's acceleration between two frequencies, accurate to a tenth
    of the width of the line."""
    even = experiment.interpolated(ACCEL, np.arange(experiment.time[0], experiment.time[-1], 1 / experiment.rate_hz))
    spectrum = np.abs(np.fft.rfft((even - even.mean()) * np.hanning(even.size), 4 * even.size)) ** 2
    hz = np.fft.rfftfreq(4 * even.size, 1 / experiment.rate_hz)
    width = max(int(0.75 / hz[1]), 1)
    smooth = np.convolve(spectrum, np.hanning(2 * width + 1)[1:-1], "same")
    inside = (hz >= low) & (hz <= high)
    return float(hz[inside][np.argmax(smooth[inside])]) if inside.any() else math.sqrt(low * high)


def _scan(model: Model, segment: Segment, substep_s: float, effort: Effort) -> list[FloatArray]:
    """The initial states (n,) with the least sum of |r| on a grid of positions and speeds in the gap, with the two
    states of the bar by linear least squares at each point."""
    rest, slopes = _by_base_state(model, segment)
    grid = np.stack(np.meshgrid(effort.gaps, effort.speeds, indexing="ij"), axis=-1).reshape(-1, 2)
    begins = rest + grid @ slopes[:2]
    every = segment.residuals(model, np.vstack([rest, rest + slopes[2:], begins]), substep_s)
    if not np.isfinite(every[:3]).all():
        return [rest]
    bar, r = (every[1:3] - every[0]).T, every[3:]
    usable = np.isfinite(r[:, 0])
    if not usable.any():
        return [rest]
    share = -r[usable] @ np.linalg.pinv(bar).T
    cost = np.sum(np.abs(r[usable] + share @ bar.T), axis=1)
    order = np.argsort(cost)[: effort.scanned]
    found: FloatArray = begins[usable][order] + share[order] @ slopes[2:]
    return list(found)


def _by_base_state(model: Model, segment: Segment) -> tuple[FloatArray, FloatArray]:
    """The state at rest relative to the input (n,), with an undeflected bar, and the change of the state by one scale
    of each of the four states of the base (4, n).  States of effects are in equilibrium with them."""
    drive, begin = segment.experiment.drive, float(segment.experiment.time[0])
    at_rest = in_motion(model, drive, begin)
    own = at_rest.size > 4

    def moved(i: int) -> FloatArray:
        if not own:
            return np.asarray(np.eye(4)[i] * segment.scale[i])
        given = {name: float(x) for name, x in zip(model.state_names[:4], at_rest, strict=False)}
        given[model.state_names[i]] += float(segment.scale[i])
        return in_motion(model, drive, begin, **given) - at_rest

    slopes = np.array([moved(i) for i in range(4)])
    rest = at_rest - at_rest[2] / segment.scale[2] * slopes[2] - at_rest[3] / segment.scale[3] * slopes[3]
    return np.asarray(rest), slopes


def _measured_state(model: Model, segment: Segment) -> FloatArray:
    """The initial state (n,) with position and speed from a line through the first samples, all else at rest."""
    experiment = segment.experiment
    column = "displacement" if model.base == "oscillator" else "position"
    begin = float(experiment.time[0])
    if column not in experiment.measured:
        return in_motion(model, experiment.drive, begin)
    seen = np.flatnonzero(~np.isnan(experiment.measured[column]))[:8]
    time, values = experiment.time[seen] - begin, experiment.measured[column][seen]
    one_only = time.size == 1  # times in a wrong unit are so far apart
    value, rate = (values[0], 0.0) if one_only else np.polynomial.polynomial.polyfit(time, values, 1)
    names = ("q", "q'") if model.base == "oscillator" else ("theta_2", "omega_2")
    return in_motion(model, experiment.drive, begin, **dict(zip(names, (float(value), float(rate)), strict=True)))
