"""Describes a residual that no effect of the catalogue explains, by an unknown function with a shape and a formula.

Every function of basis.py is fitted together with the model.  For gears it is fitted to observer runs, which do not
need the true play as an initial value, first with a high gain and then with a medium one.  The function with the least
error is reported, with the curve of a fit to free segments if that fit succeeds.  A function that explains little is
reported without its shape.  This is the last stage of a search of gears, and of a comparison.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np

from lostmotion.lab import policy, words
from lostmotion.lab.discrepancy.basis import Guess, guesses, wave_guess
from lostmotion.lab.discrepancy.wave import best_wave
from lostmotion.lab.fitting.fit import fit_of
from lostmotion.lab.fitting.strategy import full_fit
from lostmotion.lab.observer.descent import Descent
from lostmotion.lab.observer.filter import TIGHT, can_follow
from lostmotion.lab.observer.objective import Follower
from lostmotion.lab.parallel import Threads, cores
from lostmotion.lab.quantity import quantity
from lostmotion.lab.results import Curve, Finding
from lostmotion.lab.shooting.continuation import Level, fitted
from lostmotion.lab.shooting.initial_guess import scales_of
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.task import Task
from lostmotion.model import Model
from lostmotion.model.effects.registry import registered
from lostmotion.model.motion import FloatArray
from lostmotion.model.signals import BAR_FORCE, GAP, SENSOR, TORQUE

__all__ = ["described"]

FORMULA = 0.9
"""Least share of the weighted square of a curve that a formula has to explain."""
LEAST_POINTS = 3
"""Least number of identified values for a curve."""
FORMS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "{a}": np.ones_like,
    "{a} {x}": lambda x: x,
    "{a} sign({x})": np.sign,
    "{a} {x}²": np.square,
    "{a} {x} |{x}|": lambda x: x * np.abs(x),
    "{a} {x}³": lambda x: x**3,
}
"""Formulas of one term that are compared with a curve."""
IMITATED = {("sensor", "accel"): 1, ("oscillator", "q"): 1, ("oscillator", "q'"): 1, ("sensor", "theta_2"): 0,
            ("sensor", "omega_2"): 0}  # fmt: skip
"""By equation and variable, the degree of the polynomial that bias, stiffness, damping or length of the base can
imitate.  It is removed from a curve."""
WHAT = {"joint": "a torque on the joint", "oscillator": "a force on the oscillator", "sensor": "an error of the sensor"}
"""By part that a function acts on, what is missing."""


Heights = Mapping[str, tuple[float, float]]
"""By parameter of a function, its value and half the width of its 95 % interval."""


@dataclass(frozen=True, eq=False)
class _Trial:
    """A function, the fitted model with it, and its gain, the logarithmic decrease of the cost of observer runs."""

    guess: Guess
    model: Model
    gain: float


def described(level: Level, task: Task) -> Finding | None:
    """The function that explains most of the residual of a fit on the shortest segments; None where no observer follows
    the motion.  Raises ModelError where the model cannot be simulated."""
    size = scales_of(level.model, level.segments, task.substep_s)
    acting = {TORQUE: size.torque, BAR_FORCE: size.k * size.bend, SENSOR: size.reading, GAP: size.d}
    found = guesses(level.model, level.segments, acting, task.substep_s)
    with registered([guess.effect for guess in found]), Threads(cores()) as pool:
        if not can_follow(level.model, *task.experiments):
            fits = list(pool.map(partial(_direct, level=level, task=task), found))
            fit, guess = min(zip(fits, found, strict=True), key=lambda pair: pair[0].typical)
            return _finding(guess, _heights(fit, task)) if _clear(fit, level) else _unclear(guess)
        trial = _nearest(level.model, found, acting, task, pool)
        if trial is None:
            return None
        if trial.gain < policy.LEAST_GAIN:
            return _unclear(trial.guess)
        if trial.guess.is_wave:
            return _wave(trial)
        fit = full_fit(trial.model, task, policy.LOST_SHARE)
        return _finding(trial.guess, _heights(fit, task)) if _clear(fit, level) else _finding(trial.guess)


def _clear(fit: Level, level: Level) -> bool:
    """Whether a fit with a function explains ``policy.FOLLOWS_STATE`` of the squared error without it."""
    return fit.typical**2 < (1 - policy.FOLLOWS_STATE) * level.typical**2


def _direct(guess: Guess, level: Level, task: Task) -> Level:
    """The fit with a function on the segments of a level."""
    model = level.model.with_effect(guess.effect.id)
    return fitted(model, Unknowns.of(model, task.rough), level.segments, task.substep_s)


def _nearest(
    model: Model, found: Sequence[Guess], acting: Mapping[int, float], task: Task, pool: Executor
) -> _Trial | None:
    """The function with the largest gain; None where the observers diverge.  Sines are fitted to one recording, as
    their phase differs between recordings.  acting: by signal, the magnitude of what already acts there."""
    follower = Follower.of(task, model)
    both = Descent.of(model, follower, TIGHT)
    if not math.isfinite(both.cost):
        return None
    tried = _compared(model, both, found, follower, pool)
    alone = follower.alone()
    tight = Descent.of(model, alone, TIGHT)
    waves = [wave_guess(model.base, target, best_wave(tight.model, alone, target), acting[target])
             for target in (TORQUE, SENSOR)]  # fmt: skip
    with registered([wave.effect for wave in waves]):
        tried += _compared(model, tight, waves, alone, pool)
    return max(tried, key=lambda trial: trial.gain, default=None)


def _compared(
    model: Model, base_tight: Descent, found: Sequence[Guess], follower: Follower, pool: Executor
) -> list[_Trial]:
    """The functions after fits with a high gain, and of the best of them after fits with a medium gain, from the values
    of the first fit and from the initial ones; base_tight: the fit without a function, with the high gain."""
    base = min((Descent.of(start, follower) for start in (base_tight.model, model)), key=attrgetter("cost"))
    if not math.isfinite(base.cost):
        return []
    models = [base.model.with_effect(guess.effect.id) for guess in found]
    tight = pool.map(partial(Descent.of, follower=follower, coupling=TIGHT), models)
    best = sorted(zip(tight, found, models, strict=True), key=lambda one: one[0].cost)[: policy.FINISHED]
    loose = partial(Descent.of, follower=follower)
    direct = pool.map(loose, [model for *_, model in best])
    after = pool.map(loose, [much.model for much, *_ in best])
    trials = []
    for (much, guess, _), *little in zip(best, direct, after, strict=True):
        less = min(little, key=attrgetter("cost"))
        trials.append(_Trial(guess, less.model, _gain(base_tight, much) + _gain(base, less)))
    return trials


def _gain(before: Descent, after: Descent) -> float:
    """The logarithm of the ratio of two costs; minus infinity where the observers diverge."""
    is_less = math.isfinite(after.cost) and before.cost > 0
    return math.log(before.cost / max(after.cost, sys.float_info.min)) if is_less else -math.inf


def _heights(level: Level, task: Task) -> Heights:
    return {e.name: (e.value, (e.high - e.low) / 2) for e in fit_of(level, task).estimates}


def _wave(trial: _Trial) -> Finding:
    f, a, b = (trial.model.parameters[f"{trial.guess.effect.id}.{name}"].value for name in ("f", "a", "b"))
    size, acts_on = math.hypot(a, b), str(trial.guess.effect.acts_on)
    text = f"{WHAT[acts_on]} is missing: a wave of {quantity(size, trial.guess.unit, 2)} at {f:.4g} Hz"
    return Finding(acts_on, trial.guess.depends_on, text, None, f"{size:.3g} sin(2π {f:.4g} Hz t)")


def _unclear(guess: Guess) -> Finding:
    """The description where the best function explains little."""
    acts_on = str(guess.effect.acts_on)
    return Finding(acts_on, (), f"{WHAT[acts_on]} is missing; it follows no single state")


def _finding(guess: Guess, heights: Heights | None = None) -> Finding:
    """The description; with curve and formula where the heights are those of free segments."""
    acts_on, rubs = str(guess.effect.acts_on), len(guess.depends_on) > 1
    variable = words.variable(guess.depends_on[0])[0]
    what = "dry friction" if rubs else WHAT[acts_on]
    follows = f"its size follows {variable}" if rubs else f"it is a function of {variable}"
    if heights is None:
        return Finding(acts_on, guess.depends_on, f"{what} is missing; {follows}")
    degree = IMITATED.get((acts_on, guess.depends_on[0]), -1)
    curve = _curve(guess, heights, degree)
    if len(curve.x) < LEAST_POINTS or not curve.mean.any():  # a fit without time leaves the heights at zero
        return _finding(guess)
    size = quantity(float(np.max(np.abs(curve.mean))), guess.unit, 2)
    formula = _formula(curve, degree)
    if rubs and formula and curve.variable not in formula:  # the same at every angle
        return Finding(
            acts_on, guess.depends_on[1:], f"{what} of about {size} is missing", curve, f"{formula} sign(omega_2)"
        )
    text = f"{what} of up to {size} is missing; {follows}"
    return Finding(acts_on, guess.depends_on, text, curve, None if rubs else formula)


def _curve(guess: Guess, heights: Heights, degree: int) -> Curve:
    """The heights within the range of the motion, without the polynomial that the base's parameters can imitate.

    What the base imitates is known to rounding only, and is the same share of the half widths of all heights: those of
    a friction with the cube of the speed are 0.09 or 0.16, by the rounding, and differ by 3 %.  Heights that the motion
    does not reach have 0.55, from their prior, and are left out.
    """
    x = guess.x[guess.seen]
    mean, half_width = np.array([heights[n] for n, s in zip(guess.heights, guess.seen, strict=True) if s]).T
    variable = guess.depends_on[0]
    mean = _beyond(mean, x, half_width, degree)
    known = half_width < max(float(np.ptp(mean)), 2 * float(np.min(half_width)))
    x, mean, half_width = x[known], mean[known], half_width[known]
    unit = words.variable(variable)[1]
    return Curve(variable, unit, x, mean, mean - half_width, mean + half_width, guess.unit)


def _beyond(values: FloatArray, x: FloatArray, deviation: FloatArray, degree: int) -> FloatArray:
    """Values without the polynomial of a degree that fits them best."""
    if degree < 0 or len(x) <= degree + 1:
        return values
    return np.asarray(values - np.polyval(np.polyfit(x, values, degree, w=1 / deviation), x))


def _formula(curve: Curve, degree: int) -> str | None:
    """A one-term formula that fits the curve, if there is one."""
    deviation = (curve.high - curve.low) / 2
    best, text = 1 - FORMULA, None
    total = float(np.sum((curve.mean / deviation) ** 2))
    for form, function in FORMS.items():
        shape = _beyond(function(curve.x), curve.x, deviation, degree)
        power = float(np.sum((shape / deviation) ** 2))
        if power <= 1e-9 * float(np.sum((function(curve.x) / deviation) ** 2)):
            continue  # the base imitates it
        a = float(np.sum(shape * curve.mean / deviation**2)) / power
        left = float(np.sum(((curve.mean - a * shape) / deviation) ** 2)) / total
        if left < best:
            best, text = left, form.format(a=f"{a:.3g}", x=curve.variable)
    return text
