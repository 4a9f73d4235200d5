"""The search for missing effects in a model with one moving part: its preparation and its result.

Angle and torque are filtered to the band in which the motion exceeds its noise, and the delay between them is removed
(channel.py).  The search is selection/forward.py, with the likelihood of likelihood.py.  The errors that are reported
are those on the last recording, to which no parameter is fitted.  It decides between effects that explain the others
equally well, and is one more fold where there is only one other recording.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from lostmotion.lab import policy, words
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.frequency_response import from_spectra
from lostmotion.lab.deadline import Progress, is_over, within
from lostmotion.lab.fitting.identifiability import coasts, with_scale
from lostmotion.lab.inverse.channel import Channel
from lostmotion.lab.inverse.constancy import warn_of_differing
from lostmotion.lab.inverse.describe import described
from lostmotion.lab.inverse.effect_sizes import amplitudes, shares
from lostmotion.lab.inverse.fitted import Fitted, error_on, fit_on, interval, is_disturbed, is_noise
from lostmotion.lab.inverse.likelihood import Method, WholeMotion
from lostmotion.lab.inverse.output_error import OutputError, initial_state
from lostmotion.lab.inverse.problem import InverseModel
from lostmotion.lab.inverse.regression import Regression, can_run
from lostmotion.lab.inverse.saturation import with_saturation
from lostmotion.lab.inverse.scale import scaled
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import can_invert, noise_floor
from lostmotion.lab.quantity import of_axis
from lostmotion.lab.results import Errors, Estimate, Explanation, Fit
from lostmotion.lab.selection.evidence import Candidate, Predictions
from lostmotion.lab.selection.forward import distinguished, selected
from lostmotion.lab.selection.outcome import advice, ladder, ranking, strongest_first, unshown
from lostmotion.lab.selection.search import Selection, Step
from lostmotion.lab.shooting.task import fine_substep
from lostmotion.model import Model, ModelError, build_model
from lostmotion.model.motion import FloatArray

__all__ = ["explained", "fitted"]

KT_RATIO = 2.0
"""Ratio of the fitted kt to that of the model file from which on a warning reports it: data sheets are not that wrong,
and a delay of 60 ms made 4.9 N m/A of a motor that has 1.2."""
SHARPER = 20.0
"""Largest factor by which dry friction is narrower in a simulated motion than in the fit, a fiftieth of the usual
speed: 2 mrad/s are 1e-5 of the speed of a bare motor, and simulating 0.8 s in steps of a microsecond took over a
minute."""
log = logging.getLogger(__name__)


def explained(
    model: Model, train: Sequence[Experiment], last: Experiment, method: Method, noise: dict[str, float],
    pool: Executor, progress: Progress, budget_s: float,
) -> Explanation:  # fmt: skip
    """Searches the effects that are missing from the model.

    train: the experiments of the fits; last: the one on which errors are reported; noise: root mean square of the noise
    of each column; budget_s: time of the search [s].  Raises ModelError where the model cannot be run.
    """
    progress("fitting what is there", 0.0)
    model, held = with_scale(with_saturation(model, [*train, last]), train)
    rough = from_spectra(model, train)
    with within(budget_s):
        with within(policy.STAGE_SHARE * budget_s):
            channel, unseen, selection = _searched(rough, train, last, method, pool, progress)
        progress("judging", 0.9)
        channel.warn(train[0].name)
        told = _explanation(selection, model, train, unseen, noise, pool)
        _warn_of_motor_constant(model, told.best.model, train[0].name)
    fit_on.cache_clear()
    progress("done", 1.0)
    base, best = (channel.annotated(fit) for fit in (told.base, told.best))
    return replace(told, held=(*held, *told.held), base=base, best=best)


def _searched(
    model: Model, train: Sequence[Experiment], last: Experiment, method: Method, pool: Executor, progress: Progress
) -> tuple[Channel, Signals, Selection[Fitted]]:
    """The channel, the signals of the last recording in it, and the search with the delay of the recordings, or that
    without it where its effects predict better, by the test of an effect.

    The delay is estimated before any effect is known, and an effect that the model lacks may look like one, such as a
    ripple.  Where much is left, the search goes on with a whitened misfit, unless what it names predicts the last
    recording worse: of a motor at four steady speeds it dropped a friction that took 0.033 to 0.0007 V (p = 1e-13).
    In ten other recordings with much left the whitened search predicts better or as well.
    """

    def likelihood(channel: Channel, is_whitened: bool = False) -> WholeMotion:
        *signals, unseen = (channel.signals(one, model.base != "servo", is_whitened) for one in (*train, last))
        is_fold = len(train) < policy.ENOUGH_RECORDINGS
        return WholeMotion(method, model, signals, unseen, is_fold, pool, is_whitened)

    channel = Channel.of(train) if method is Method.TORQUE else Channel()
    found = selected(own := likelihood(channel), progress)
    if channel.delay_s and not is_over():
        undelayed = replace(channel, delay_s=0.0)
        other = selected(less := likelihood(undelayed), progress)
        one, two = other.fits[-1].generalised, found.fits[-1].generalised
        if Predictions(two.predicted**2, one.predicted**2, one.block).is_better():
            channel, own, found = undelayed, less, other
    if is_disturbed(found.fits[-1].ordinary):
        white = likelihood(channel, is_whitened=True)
        other = selected(white, progress, found)
        on_last = white.on_last(other.fits[-1], found.fits[-1])
        if not (on_last and on_last.is_preferred):
            own, found = white, other
    assert own.unseen
    return channel, own.unseen, distinguished(found, own)


def _warn_of_motor_constant(rough: Model, fitted: Model, name: str) -> None:
    """Warns where the fitted motor constant of a servo is far from that of the model.

    kt/(U kp error_gain) is the time by which a servo trails its command at a steady speed.  A delay, a lag and viscous
    friction add to this time, and a slow motion does not distinguish them from kt.
    """
    if rough.base != "servo" or rough.parameters["kt"].fixed:
        return
    given, now = rough.parameters["kt"].value, fitted.parameters["kt"].value
    if not 1 / KT_RATIO < now / given < KT_RATIO:
        log.warning(
            "%s: kt is fitted as %.2g N m/A, the model has %.2g: it stands for all by which the servo trails its "
            "command, also a delay or viscous friction; if kt and kp are known, give them, kt with fixed = true",
            name, now, given,
        )  # fmt: skip


def _explanation(
    selection: Selection[Fitted], model: Model, train: Sequence[Experiment], unseen: Signals, noise: dict[str, float],
    pool: Executor,
) -> Explanation:  # fmt: skip
    """The result of a search, with errors on the unseen recording."""
    fits, known = _scaled(selection, model)
    base, best, column = fits[0], fits[-1], fits[-1].data.column
    power = shares(best.model, selection.added, best.data.signals) if _has_powers(best) else None
    errors = [error_on(fit, unseen) for fit in fits]
    share = strongest_first(selection, errors, power)
    floors = _floors(noise, best, unseen)
    complete = all(is_noise(one.misfit, floors[column]) for one in (best, fit_on(best, unseen)) if one)
    noise_rms = min(floors[column], best.error)  # an estimate that exceeds what a model leaves is too large
    error = Errors(errors[0], errors[-1], noise_rms, words.column(column, *best.data.axis)[1])
    found = Explanation(
        missing=tuple(share),
        share=share,
        unshown=unshown(selection, lambda one: error_on(one.surest, unseen)),
        confusable=selection.confusable,
        ranking=ranking(
            selection,
            errors,
            lambda one: _error(one, unseen, errors[0]),
            lambda one: _estimates(one.generalised, floors[column]),
            _estimates(best, floors[column]),
        ),
        error=error,
        residual=None if complete else described(selection.fits[-1].ordinary),
        advice=advice(selection, train, noise, pool),
        detectable=_detectable(selection.steps[-1]) if complete and not share else {},
        base=_fit(base, model, floors | {column: noise_rms}, unseen),
        best=_fit(best, model, floors | {column: noise_rms}, unseen),
        rungs=ladder(selection, errors, error.noise, error.unit),
        complete=complete,
        columns={column: error},
        untried=selection.untried,
        held=known,
    )
    warn_of_differing(best, (*best.data.signals, unseen), floors[column], pool)  # last, in the time that is left
    return found


def _scaled(selection: Selection[Fitted], model: Model) -> tuple[list[Regression], tuple[Estimate, ...]]:
    """The fits of a search to report, with the scale that they do not identify held at one value for all of them, where
    they can have it, and that scale."""
    *before, last = (one.surest for one in selection.fits)
    last, known = scaled(last, model)
    rough = model.replace({one.name: one.value for one in known})
    return [*(scaled(one, rough)[0] for one in before), last], known


def _has_powers(fit: Regression) -> bool:
    """Whether the torques of the effects divide the squared error: not on a shaft that turns in one direction, whose
    dry friction is the constant that they leave out."""
    shafts = (coasts(one.experiment.measured[one.column], one.experiment.is_linear) for one in fit.data.signals)
    return can_invert(fit.model) and not all(shafts)


def _floors(noise: dict[str, float], fit: Regression, *unseen: Signals) -> dict[str, float]:
    """The noise of each column; for the torque the largest of all recordings within the band, for a simulated motion at
    least its error of integration."""
    every, column = (*unseen, *fit.data.signals), fit.data.column
    least = fit.data.accuracy if isinstance(fit.data, OutputError) else 0.0
    noise = {**noise, column: max(noise.get(column, 0.0), least)}
    if column == "torque":
        return {**noise, column: max(noise_floor(one, fit.model) for one in every)}
    if column == "accel":
        return noise
    return {**noise, column: min(noise[column], max(*(one.position_noise for one in every), least))}


def fitted(model: Model, experiments: Sequence[Experiment], method: Method, noise: dict[str, float]) -> Fit:
    """Fits the free parameters of the model to all of these experiments; noise: root mean square of the noise of each
    column.  Raises ModelError where the model cannot be run."""
    model, held = with_scale(with_saturation(model, experiments), experiments)
    channel = Channel.of(experiments) if method is Method.TORQUE else Channel()
    channel.warn(experiments[0].name)
    signals = [channel.signals(one, model.base != "servo") for one in experiments]
    fit, known = scaled(WholeMotion(method, from_spectra(model, experiments), signals).first.generalised, model)
    return replace(channel.annotated(_fit(fit, model, _floors(noise, fit))), held=(*held, *known))


def _error(one: Candidate[Fitted], unseen: Signals, before: float) -> float:
    """The error on the unseen recording with a candidate; before: that without it.

    For a candidate that improves no prediction it is the error without it, as its fit may be far off, and take a minute
    to simulate.  When the time is up, it is estimated from the folds.
    """
    if one.gain <= 0:
        return before
    return before * math.sqrt(1 - one.gain) if is_over() else error_on(one.fit.generalised, unseen)


def _detectable(step: Step[Fitted]) -> dict[str, tuple[str, float]]:
    """By effect, the name of its first amplitude and the size at which it would be significant with probability 1/2."""
    sizes = {}
    for one in step.judged:
        fit = one.fit.generalised
        names = amplitudes(one.effect, fit)
        if not names:
            continue
        limit = float(-stdtrit(fit.freedom, policy.FALSE_NAME / len(step.judged)))
        sizes[one.effect] = (names[0].removeprefix(f"{one.effect}."), limit * fit.deviations[names[0]])
    return sizes


def _estimates(fit: Regression, floor: float) -> tuple[Estimate, ...]:
    """The parameters with confidence intervals; floor: root mean square of the noise of the sensors."""
    deviation, freedom = interval(fit, floor)
    width = float(-stdtrit(freedom, (1 - policy.CONFIDENCE) / 2))
    found = fit.unknowns.estimates(fit.model, fit.z, deviation, width)
    return tuple(replace(one, unit=of_axis(one.unit, *fit.data.axis)) for one in found)


def _fit(fit: Regression, rough: Model, noise: dict[str, float], *unseen: Signals) -> Fit:
    """A regression as a result, with unseen recordings in front of those of the fit."""
    covariance = fit.covariance()
    deviation = np.sqrt(np.maximum(np.diag(covariance), 1e-100))
    sharp = _sharp(fit.model, rough)
    model = sharp if can_run(sharp, fit.data.signals) else fit.model
    beside = [there for one in unseen if (there := fit_on(fit, one))]
    shown = [part for one in beside for part in _shown(one, ", not fitted")] + _shown(fit)
    substep = _substep(fit, model, [experiment for experiment, _ in shown])
    return Fit(
        model=model,
        experiments=tuple(experiment for experiment, _ in shown),
        starts=tuple(start for _, start in shown if start is not None),
        estimates=_estimates(fit, noise[fit.data.column]),
        correlation=np.asarray(covariance / np.outer(deviation, deviation)),
        noise=noise,
        rms={fit.data.column: fit.error},
        substep_s=substep,
        complete=is_noise(fit.misfit, noise[fit.data.column]),
    )


def _substep(fit: Regression, model: Model, shown: Sequence[Experiment]) -> float:
    """The integration step [s] with which the result is simulated: the model's own choice for a motion from rest, or
    the step of the fit where that motion diverges, as that of a bar which softens may."""
    try:
        return fine_substep(model, shown)
    except ModelError:
        if isinstance(fit.data, OutputError):
            return fit.data.substep_s
        raise


def _sharp(model: Model, rough: Model) -> Model:
    """The model with the speeds at which dry friction changes its sign as its file or its effects state them, not as
    the filter of the fit needs them, but at most ``SHARPER`` times as small."""
    bare = build_model(model.base, model.effects)
    stated = {name: p for name, p in {**bare.parameters, **rough.parameters}.items() if name.endswith(".omega_0")}
    widths = {
        name: p.updated(max(p.value, model.parameters[name].value / SHARPER))
        for name, p in stated.items()
        if name in model.parameters
    }
    return replace(model, parameters={name: widths.get(name, p) for name, p in model.parameters.items()})


def _shown(fit: Regression, remark: str = "") -> list[tuple[Experiment, FloatArray | None]]:
    """The experiments of a fit with their fitted initial states, None where no motion is simulated; remark: added to
    their names."""
    if isinstance(fit.data, InverseModel):
        return [(_renamed(one, remark), None) for one in fit.data.signals]
    assert isinstance(fit.data, OutputError)
    zeros, starts = fit.data.zeros(fit.model, fit.nuisance), fit.data.starts(fit.nuisance)
    shown = [_renamed(one.shifted(-zero), remark) for one, zero in zip(fit.data.signals, zeros, strict=True)]
    return [
        (one, initial_state(one.model(fit.model), one, start, fit.data.free))
        for one, start in zip(shown, starts, strict=True)
    ]


def _renamed(signals: Signals, remark: str) -> Experiment:
    return replace(signals.experiment, name=f"{signals.experiment.name}{remark}")
