"""The candidate effects of predictable motions, and their fits.

The likelihood asks for a fit of the model with each candidate.  A fit begins at those initial guesses of the effect
that, to first order, explain most of the residual of the present fit.  No selection here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.frequency_response import spectral_lines, usual_torque
from lostmotion.lab.data.series import rms
from lostmotion.lab.deadline import is_over
from lostmotion.lab.fitting.identifiability import with_free_states
from lostmotion.lab.inverse.effect_sizes import driven_exceeds_noise, exceeds_noise
from lostmotion.lab.inverse.first_values import guesses, initial_point, scant_guesses, turns_of
from lostmotion.lab.inverse.output_error import OutputError
from lostmotion.lab.inverse.problem import EquationError, InverseModel, Problem
from lostmotion.lab.inverse.regression import MOST_STEPS, Regression, can_run, regressed
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import follows_motion, inertia_of, simulable, softened
from lostmotion.lab.selection.evidence import are_consistent
from lostmotion.lab.selection.nesting import others, wider
from lostmotion.lab.shooting.initial_guess import initial_guesses, natural_frequency
from lostmotion.lab.shooting.parameters import free_names, held
from lostmotion.model import Model, ModelError
from lostmotion.model.effects import get_effect
from lostmotion.model.effects.base import ActsOn, Effect
from lostmotion.model.effects.guesses import MotionScales, Values
from lostmotion.model.motion import FloatArray

__all__ = [
    "SHORT",
    "candidates",
    "equation_error_fit",
    "equation_error_fit_with",
    "fitted_with",
    "refined",
    "resolved",
    "settled",
    "sizes_of",
    "tried",
    "with_values",
]

STARTS = 3
"""Largest number of initial guesses of an effect from which it is fitted, one after the other."""
TRAILS = 0.6
"""Share of the time by which a servo trails its command, for which an effect that delays it stands at first: the rest
is the response of its controller.  From 0.1 and 0.3 of it the fit above ends at 19 ms, from 0.6 at 36 ms."""
NOISE_RANGE = 6.0
"""Range of noise over its root mean square: three standard deviations on either side."""
VANISHED = 1e-3
"""Share of its initial value below which a parameter counts as zero."""
SHORT, LONG = 7, 150
"""Steps of the first fit of an effect to a simulated motion, and of the one that finishes it.  A servo behind a lag has
three poles, which are equal on the way from three real ones to a pair that swings: with 60 steps a fit ended there, at
1.3 times the noise, and a delay was named in the place of the lag.  Of 300 fits to simulated servos 11 take more."""


def equation_error_fit(model: Model, signals: Sequence[Signals]) -> Regression | None:
    """The fit of the model that minimises the equation error; None where the acceleration does not follow from the
    measured motion."""
    error = EquationError.driven(signals)
    return tried(softened(model, error.signals), [error], error.nuisance, MOST_STEPS) if _follow_motion(model) else None


def sizes_of(fit: Regression) -> MotionScales:
    """The magnitudes of the motion from which initial guesses of effects follow, and the lines of what a fit leaves."""
    model, data, signals = fit.model, fit.data, fit.data.signals
    position, speed, acceleration = (
        [getattr(one, what) for one in signals] for what in ("position", "velocity", "acceleration")
    )
    driving = [usual_torque(model, one.experiment) for one in signals if model.base == "servo"]
    torque = (
        data.signal_rms(model)
        if isinstance(data, InverseModel)
        else max(inertia_of(model) * rms(*acceleration), *driving, 0.0)
    )
    loudest = max(signals, key=lambda one: float(np.ptp(one.acceleration)))
    stiffness, damping, bias = (
        model.parameters[name].value if name in model.parameters else 0.0 for name in ("k", "b", "bias")
    )
    return MotionScales(
        torque=torque, speed=rms(*speed), span=max(float(np.ptp(one)) for one in position),
        bend=rms(*(one - one.mean() for one in position)), swing=rms(*speed) if stiffness else 0.0,
        reading=rms(*acceleration),
        peak=max(float(np.nanmax(np.abs(one.experiment.measured[one.column]))) for one in signals),
        k=stiffness, b=damping, d=0.0, inertia=inertia_of(model),
        length=max(float(one.time[-1]) for one in signals), resonance=natural_frequency(model),
        rest=bias / stiffness if stiffness and not data.is_driven else 0.0, lines=_lines(fit, loudest),
        noise=max(one.position_noise for one in signals),
    )  # fmt: skip


def _lines(fit: Regression, one: Signals) -> tuple[float, ...]:
    """The frequencies [Hz] of the lines in the spectrum of what a fit leaves of a recording, the strongest first.  What
    drives a bar may have more lines than it has resonances: of the readings of an arm under 100 sines the six strongest
    did not have that of its other resonance."""
    if not isinstance(fit.data, OutputError):
        return ()
    left = np.array(one.experiment.measured[one.column], dtype=float)
    parts = zip(fit.data.signals, fit.data.by_recording(fit.misfit), strict=True)
    left[~np.isnan(left)] = next(part for each, part in parts if each is one)
    return spectral_lines(left, one.experiment.rate_hz)


def candidates(model: Model, added: tuple[str, ...], data: Problem) -> Iterator[tuple[str, Model]]:
    """Yields the candidate effects, each with the model that includes it; added: the effects that the search has added.

    Where nothing is simulated, only effects that follow from the measured motion are candidates; on a linear axis, only
    those without an angle.  Of two nested laws the simpler one is a candidate first; once it was added, the general one
    is a candidate in its place.  Rivals of an effect come before it.
    """
    is_simulated = isinstance(data, OutputError)
    is_linear = any(one.experiment.is_linear for one in data.signals)
    nested = dict(found for part in added if (found := wider(model, part)))
    for name in others(model):
        effect = get_effect(name)
        if not (follows_motion(effect) or is_simulated) or (is_linear and _needs_angle(name)):
            continue
        if is_simulated and effect.along:  # takes short steps, and few swings show how they begin anew
            continue
        if not is_linear and turns_of(data.signals) > effect.most_turns:
            continue
        if rivals := [one for one in effect.rivals if one not in model.effects]:
            yield rivals[-1], reduce(Model.with_effect, rivals, model)
        if name in nested:
            yield name, nested[name]
        elif (simple := effect.simpler) is None or simple.effect in model.effects:
            wide = model.with_effect(name)
            if is_simulated:  # a mode of some hertz and centimetres, or of kilohertz and micrometres
                wide = simulable(wide, data.signals)
            yield name, wide if data.is_driven else with_free_states(_without_excitation(wide, effect))


def _without_excitation(wide: Model, effect: Effect) -> Model:
    """The model in which nothing but their initial values moves the free states of an effect, as no input does."""
    return wide.replace(dict.fromkeys(effect.amplitude_names if effect.free_states else (), 0.0))


def fitted_with(
    wide: tuple[str, Model], now: Regression, begun: Mapping[str, Regression], rough: Model
) -> Regression | None:
    """The best fit of a model with one more effect, from several initial values.

    wide: the effect, and the model with it; now: the fit of the present model; begun: fits to the acceleration, by
    effect; rough: the model of the file.  None where no fit is possible or the estimates contradict the definition of
    the effect.  A present fit that leaves no more than the noise of an angle or a place is nearly linear in what is
    missing: only the initial guesses are used there.
    """
    name, model = wide
    if not isinstance(now.data, OutputError):
        found = _fitted_from_guesses(name, softened(model, now.data.signals), now)
        return found if found and can_run(found.model, now.data.signals) else None
    fits = [_fitted_from_guesses(name, model, now)]
    if exceeds_noise(now):
        fits.append(_fitted_from_acceleration(name, model, now, begun.get(name), now.data))
        fits.append(_fitted_behind_command(name, model, now, now.data, rough))
    apt = (one for one in fits if one and are_consistent(one.model, [name]))
    return min(apt, key=lambda one: one.rms, default=None)


def equation_error_fit_with(wide: tuple[str, Model], now: Regression) -> Regression | None:
    """The fit of a model with one more effect that minimises the equation error; None where the acceleration does not
    follow from the measured motion.  wide: the effect, and the model with it; now: that fit of the present model."""
    name, model = wide
    if not _follow_motion(model):
        return None
    begun = with_values(softened(model, now.data.signals), now.model)
    return _fitted_from_guesses(name, begun, now)


def _fitted_from_guesses(name: str, wide: Model, now: Regression) -> Regression | None:
    """The fit from that of the ``STARTS`` best initial guesses, by what they explain of the residual, which first leads
    to one that fits the name; of a few steps where the motion is simulated.  None where there is none, or the time is
    up."""
    size = sizes_of(now)
    wide = _above_noise(wide, name, size)
    begin = [wide.replace(values) for values in initial_guesses(wide, name, size)]
    data = now.data.suited(begin)
    most = SHORT if isinstance(data, OutputError) else MOST_STEPS
    scant = scant_guesses(name, begin, now, data)[:STARTS] if driven_exceeds_noise(now) else []
    for guess in (*scant, *guesses(name, begin, now, data)[:STARTS]):
        start, nuisance = initial_point(name, guess, now, data)
        fit = None if is_over() else tried(start, [data], nuisance, most)
        fit = settled(fit) if fit and guess in scant else fit
        if fit and are_consistent(fit.model, [name]) and not (guess in scant and driven_exceeds_noise(fit)):
            return fit
    return None


def _fitted_from_acceleration(
    name: str, wide: Model, now: Regression, begun: Regression | None, data: OutputError
) -> Regression | None:
    """The fit of a simulated motion that begins at the estimates of a fit to the acceleration, and at the present
    values of what that took to zero, in the measured initial state: that of the present fit is nowhere near it where
    the weight of a pendulum is missing.  A free motion is fitted on a growing horizon."""
    if not begun or is_over():
        return None
    own = {full: p.value for full, p in begun.model.parameters.items() if full.startswith(f"{name}.")}
    start = _not_vanished(with_values(wide, begun.model).replace(own), now.model)
    data = data.suited([start])
    return tried(start, data.horizons, data.begun(start, now.data.nuisance), SHORT)


def _fitted_behind_command(
    name: str, wide: Model, now: Regression, data: OutputError, rough: Model
) -> Regression | None:
    """The fit of a simulated motion with an effect by which an actuator trails its command.

    The inertia and the damping of the present fit have absorbed it, and of the three poles of a servo behind a lag any
    one may be the lag.  So the best of its first values is held for the first steps, once beside the present values of
    the others, and once beside those of the model file from the measured initial state.
    """
    if get_effect(name).acts_on is not ActsOn.COMMAND or is_over():
        return None
    first, names = _trailing(name, wide, now), [one for one in free_names(wide) if one.startswith(f"{name}.")]
    begun = []
    for beside, nuisance in ((wide, now.nuisance), (with_values(wide, rough), data.nuisance)):
        starts = [_Start.of(beside.replace(values), nuisance, data) for values in first]
        best = min(starts, key=lambda one: one.rms)
        if not is_over() and (fit := tried(held(best.model, names), [best.data], best.nuisance, SHORT)):
            begun.append(fit)
    nearest = min(begun, key=lambda one: one.rms, default=None)
    if not nearest:
        return None
    freed = {full: replace(wide.parameters[full], value=nearest.model.parameters[full].value) for full in names}
    return tried(nearest.model.replace(freed), [nearest.data], nearest.nuisance, SHORT)


@dataclass(frozen=True, eq=False)
class _Start:
    """Where a fit to a simulated motion begins; rms: root mean square of its residual there."""

    model: Model
    data: OutputError
    nuisance: FloatArray
    rms: float

    @classmethod
    def of(cls, model: Model, nuisance: FloatArray, data: OutputError) -> _Start:
        """With the step and the free states that the model needs."""
        suited = data.suited([model])
        begun = suited.begun(model, nuisance)
        return cls(model, suited, begun, rms(suited.residual(model, begun)))


def _trailing(name: str, wide: Model, now: Regression) -> list[Values]:
    """First values of an effect by which an actuator trails its command: ``TRAILS`` of the time by which it does."""
    if not (delay := get_effect(name).delays_by):
        return initial_guesses(wide, name, sizes_of(now))
    lateness = [np.sum((one.driving - one.position) * one.velocity) for one in now.data.signals]
    trail = float(sum(lateness) / sum(np.sum(one.velocity**2) for one in now.data.signals))
    full = f"{name}.{delay}"
    return [{full: wide.parameters[full].clipped(TRAILS * trail)}]


def _follow_motion(model: Model) -> bool:
    """Whether all effects of a model follow from the measured motion."""
    return all(follows_motion(get_effect(name)) for name in model.effects)


def with_values(model: Model, other: Model) -> Model:
    """The model with the values of those free parameters that another one shares with it."""
    names = set(free_names(model)) & set(free_names(other))
    return model.replace({name: other.parameters[name].value for name in names})


def _above_noise(model: Model, name: str, size: MotionScales) -> Model:
    """The model with characteristic speeds of an effect above those that count as rest, and with distances of its path
    above the range of the noise.  Noise crosses a smaller play at rest: one of 0.13 mrad in noise of 0.1 was named for
    Coulomb friction."""
    least = {"rad/s": policy.UNSURE_SPEED * size.speed}
    if get_effect(name).along and get_effect(name).is_searched:  # a rival may be anything
        least["rad"] = NOISE_RANGE * size.noise
    raised = {
        full: replace(p, value=max(p.value, low), low=max(p.low, low), high=max(p.high, low))
        for full, p in model.parameters.items()
        if full.startswith(f"{name}.") and not p.fixed and (low := least.get(p.unit)) is not None
    }
    return model.replace(raised)


def _not_vanished(model: Model, start: Model) -> Model:
    """The model with the values of ``start`` for those parameters that a short horizon, or a fit to the acceleration,
    took to zero, as a later fit would not leave zero.  Without this, a mass that is damped within four swings had no
    damping.  A parameter of either sign, such as an angle, passes zero freely: where it began anew, a pendulum that had
    been followed to 0.08 rad had 1.4 left of a longer horizon, and its weight was not named."""
    shared = set(free_names(start)) & set(free_names(model))
    first = {name: start.parameters[name].value for name in shared if model.parameters[name].low >= 0}
    lost = {name: v for name, v in first.items() if model.parameters[name].value < VANISHED * v}
    return model.replace(lost) if lost else model


def refined(fit: Regression) -> Regression:
    """Continues a fit that was ended after a few steps, by at most ``LONG`` steps.  A model that was not fitted to the
    end makes every effect look needed: the bar of a flexible arm had 0.24 left, and 0.08 with a drag of zero."""
    return tried(fit.model, [fit.data], fit.nuisance, LONG) or fit


def settled(fit: Regression) -> Regression:
    """Continues a fit that was ended after a few steps by as many, as long as these take ``policy.LEAST_GAIN`` of its
    squared error.  Beside the weight of an arm that a servo lifts Coulomb friction leaves half as much as
    load-dependent friction after seven steps, and eleven times as much after 21."""
    before = math.inf
    while policy.is_less(fit.rms, before) and not is_over():
        before, fit = fit.rms, tried(fit.model, [fit.data], fit.nuisance, SHORT) or fit
    return fit


def resolved(fit: Regression) -> Regression:
    """The fit with an integration step whose error is small against the residual, if the time allows; see
    ``OutputError.resolved``."""
    if not isinstance(fit.data, OutputError) or is_over():
        return fit
    data = fit.data.resolved(fit.model, fit.nuisance)
    return fit if data is fit.data else refined(replace(fit, data=data))


def tried(
    model: Model, horizons: Sequence[Problem], nuisance: FloatArray, steps: int = MOST_STEPS
) -> Regression | None:
    """The fit of the last of these problems, which begins at that of the one before (a homotopy), with so many steps
    each; None where the motion cannot be simulated or a fit fails.  What a shorter horizon takes to zero begins anew,
    as a longer one would not leave zero."""
    found, start = None, model
    try:
        for part in horizons:
            found = regressed(_not_vanished(model, start), part, nuisance, steps)
            model, nuisance = found.model, found.nuisance
    except (ModelError, ValueError, np.linalg.LinAlgError):
        return None
    return found if found and np.isfinite(found.residual).all() else None


def _needs_angle(name: str) -> bool:
    """Whether an effect has a phase; a distance may be along a line."""
    effect = get_effect(name)
    return effect.along is None and any(parameter.unit == "rad" for parameter in effect.parameters.values())
