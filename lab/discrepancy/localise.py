"""Localises a misfit: the equation on which it acts (joint, oscillator, command or sensor), and the state on which it
depends.

Each equation in turn gets an unknown input, estimated by a Kalman filter (input_estimation.py).  A missing torque
shifts impacts and excites the bar through its resonance; a force on the bar acts at once; an error of the sensor does
not change the motion.  In the right equation a small input explains all; the likelihood weighs that.  The estimated
input is then related to every state.

How often it is right, thorough and with the base's parameters known, on recordings of the hidden-effect bench that were
not used before (seed 77, strong, 3 of 1 s, noise estimated, half of it coloured): 14 of 20 of the catalogue (contact
counted as joint or command), 5 of 7 outside of it.  Near misses: joint and command for what moves impacts, oscillator
and sensor for effects that show in the ring only.  Wrong parameters cause a misfit of their own: fit them first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lostmotion.lab.data.autoregression import NoiseModel
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.deadline import is_over
from lostmotion.lab.discrepancy.input_estimation import InputProcess, Track, Tracker
from lostmotion.lab.discrepancy.residual_maps import ResidualMap, finding, residual_maps
from lostmotion.lab.parallel import Threads, cores
from lostmotion.lab.quantity import quantity
from lostmotion.lab.results import Finding
from lostmotion.lab.shooting.segment import state_scales
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["Localisation", "localise"]

MEMORIES_S = (1e-2, 1e-1)
ONE_MEMORY_S = 3e-2
FLOOR = 1e-3
FIRST, FACTOR, FURTHEST = 0.03, 10**0.5, 4
"""Sizes of the unknown input that are tried: the first one, as a share of what already acts there, and the factor
between them."""
UNITS = {"joint": "N m", "oscillator": "N", "command": "rad"}


@dataclass(frozen=True, eq=False)
class Localisation:
    """The equation in which the model misses something.

    acts_on: the equation; behind: by equation, the difference of its log-likelihood from the best; size, unit: root
    mean square of the estimated input; maps: its dependence on each variable, best first.
    """

    acts_on: str
    behind: Mapping[str, float]
    size: float
    unit: str
    maps: tuple[ResidualMap, ...]

    def finding(self) -> Finding:
        """The result in the form common to all commands."""
        what = {"joint": "a torque on the joint", "oscillator": "a force on the oscillator",
                "command": "an offset of the driving gear", "sensor": "an error of the sensor"}  # fmt: skip
        text = f"{what[self.acts_on]} of about {quantity(self.size, self.unit, 2)} is missing"
        return finding(self.acts_on, text, self.unit, self.maps)


def localise(
    model: Model,
    experiments: Sequence[Experiment],
    starts: Sequence[FloatArray],
    noise: Mapping[str, NoiseModel],
    samples: int = 4000,
    *,
    thorough: bool = False,
) -> Localisation | None:
    """Finds the equation, from the first samples of the experiments, this number in all.

    starts: the state (n,) at the first sample of each; noise: by column; thorough: twice the work.  None where the
    filter diverges.
    """
    cuts = [_first(experiment, samples // len(experiments)) for experiment in experiments]
    trackers = [
        Tracker(model, experiment, noise, state_scales(model, experiment), start)
        for experiment, start in zip(cuts, starts, strict=True)
    ]
    sizes = _sizes(model, cuts)
    tries = [
        (equation, memory)
        for equation in trackers[0].equations
        for memory in (MEMORIES_S if thorough else (ONE_MEMORY_S,))
    ]
    with Threads(cores()) as pool:
        climbs = list(pool.map(lambda entry: _climb(trackers, entry[0], entry[1], sizes[entry[0]]), tries))
        best: dict[str, tuple[float, InputProcess]] = {}
        for score, process in climbs:
            if process.equation not in best or score > best[process.equation][0]:
                best[process.equation] = (score, process)
        culprit = max(best, key=lambda equation: best[equation][0])
        top, process = best[culprit]
        if not np.isfinite(top):
            return None
        tracks = list(pool.map(lambda tracker: tracker.run(process, smooth=True), trackers))
    behind = {equation: top - score for equation, (score, _) in best.items()}
    return _localisation(culprit, behind, trackers, tracks)


def _first(experiment: Experiment, samples: int) -> Experiment:
    return experiment.between(experiment.time[0], experiment.time[min(samples, experiment.time.size - 1)])


def _climb(trackers: Sequence[Tracker], equation: str, memory: float, unit: float) -> tuple[float, InputProcess]:
    """The size at which the likelihood is largest."""

    def tried(step: int) -> tuple[float, InputProcess]:
        process = InputProcess(equation, FIRST * FACTOR**step * unit, memory, FLOOR)
        return _likelihood(trackers, process), process

    best = tried(0)
    for direction in (1, -1):
        for step in range(1, FURTHEST):
            found = tried(direction * step)
            if not found[0] > best[0] or is_over():
                break
            best = found
        if is_over() or best[1].deviation > FIRST * unit * 1.01:
            break
    return best


def _likelihood(trackers: Sequence[Tracker], process: InputProcess) -> float:
    total = 0.0
    for tracker in trackers:
        score = tracker.run(process).log_likelihood
        if not np.isfinite(score):
            return -np.inf
        total += score
    return total


def _sizes(model: Model, experiments: Sequence[Experiment]) -> dict[str, float]:
    """Root mean square of what already acts in each equation: a torque, a force, half the play, the sensor's signal."""
    spread = {name: float(np.mean([np.nanstd(e.measured[name]) for e in experiments]))
              for name in experiments[0].measured}  # fmt: skip
    values = {name: parameter.value for name, parameter in model.parameters.items()}
    first = next(iter(spread))
    sizes = {"sensor": spread[first]}
    if model.base == "play":
        accel = spread.get("accel", 1.0)
        sizes |= {"joint": values["J2"] * accel / values["l"], "oscillator": values["m"] * accel,
                  "command": values["d"] / values["R1"]}  # fmt: skip
    elif model.base == "oscillator":
        sizes["oscillator"] = values["k"] * spread[first] if first == "displacement" else values["m"] * spread[first]
    else:
        turn = spread["position"]
        acceleration = np.nanmean([_acceleration(e) for e in experiments])
        sizes |= {"joint": values["J"] * float(acceleration), "command": turn}
    return sizes


def _acceleration(experiment: Experiment) -> float:
    """Root mean square of a measured angle's second derivative, from a smooth curve over some 20 samples [rad/s²]."""
    angle = experiment.measured["position"]
    seen = np.isfinite(angle)
    step = max(int(seen.sum()) // 400, 10)
    time, angle = experiment.time[seen][::step], angle[seen][::step]
    return float(np.sqrt(np.mean(np.gradient(np.gradient(angle, time), time) ** 2)))


def _localisation(
    culprit: str, behind: Mapping[str, float], trackers: Sequence[Tracker], tracks: Sequence[Track]
) -> Localisation:
    signals = [tracker.signals(track.states) for tracker, track in zip(trackers, tracks, strict=True)]
    u = tuple(track.u for track in tracks)
    found = residual_maps(u, {name: [one[name] for one in signals] for name in signals[0]})
    unit = UNITS.get(culprit, trackers[0].unit)
    size = float(np.sqrt(np.mean(np.concatenate(u) ** 2)))
    return Localisation(culprit, behind, size, unit, found)
