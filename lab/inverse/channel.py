"""The relation between a recorded torque and a recorded angle: the band in which they are compared, the delay between
the two, and whether their signs agree.

All are estimated before the search, with a joint that has the usual torques,
tau = J theta'' + b theta' + c sign(theta') + d sin(theta) + e cos(theta) + f.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import numbered
from lostmotion.lab.data.checks import FLAT_SHARE
from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.data.series import direction, is_onward
from lostmotion.lab.data.supply import SUPPLIES
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.inverse.signals import LEAST_SAMPLES, Signals
from lostmotion.lab.results import Fit
from lostmotion.lab.selection.evidence import Predictions
from lostmotion.model import Sampled
from lostmotion.model.motion import FloatArray

__all__ = ["Channel"]

SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)
"""Ends of the band that are tried, as shares of the widest band in which the angle exceeds its noise, highest first."""
BLOCKS = 20
"""Number of parts of the recordings that count as independent.  With twelve, as in the search, a delay of 0.8 ms was
found in a simulated joint that has none, and the inertia at a screw was 4.7e-4 instead of 2.7e-3 kg m²."""
LONGEST, DELAYS = 0.25, 20
"""Longest delay that is tried, in periods of the root mean square frequency of the torque, as a sine beyond a quarter
of a period leads instead of following, but at most one period of the end of the band; and the number of delays in a
quarter of the latter.  While a quarter of it was the longest, no delay was found of a geared motor to which voltages
are switched (12 ms, in a band of 50 Hz), which had Stribeck friction, nor of one under chirps (6.5 ms): 0.37 instead
of 0.14 V were left."""
BRAKES = 0.01
"""Share of the samples in motion below which those that a switched voltage brakes do not tell inertia and friction
apart: J theta'' + b theta' is constant in all others, as dry friction is.  Of seven simulated motors without dry
friction those with 0.006, 0.007 and 0.009 had the voltage as Coulomb friction, and those with 0.011 to 0.26 none."""
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Channel:
    """band_hz: the highest end of the band; delay_s: how much later than recorded the torque acts; is_reversed: whether
    torque and angle have opposite positive directions; share: of the torque's variance in the widest band, that of this
    one."""

    band_hz: float = math.inf
    delay_s: float = 0.0
    is_reversed: bool = False
    share: float = 1.0

    @classmethod
    def of(cls, experiments: Sequence[Experiment]) -> Channel:
        """The channel of recordings with a measured torque.  Raises ExperimentError for a torque that any
        friction or constant explains.

        The band is the widest one that identifies the inertia nearly as well as the best one does, each with its own
        delay.  Motion that the torque does not cause (of a vibrating arm or a belt) has far larger accelerations than
        slow motion.  Least squares is efficient only for a white residual; here generalised least squares is
        approximated by weights of 0 and 1 over frequency.  All recordings have the same end of the band in hertz, as
        such a vibration has a fixed frequency.
        """
        whole = [Signals.of(one) for one in experiments]
        _check_sizes(whole)
        _check_sign(whole)
        widest = max(one.band_hz for one in whole)
        found = [cls._of_band(experiments, share * widest) for share in SHARES]
        found = [(one, fit) for one, fit in found if not _is_slow(fit, found)]
        clear = [
            (one, fit.relative_deviation if fit else math.inf) for one, fit in found if not _is_blurred(fit, found)
        ]
        least = min(deviation for _, deviation in clear)
        is_identified = least < policy.INERTIA_IDENTIFIED
        chosen = next(one for one, sd in clear if not is_identified or sd <= policy.BAND_AS_WELL * least)
        power = next((fit.power for one, fit in found if fit and one is chosen), math.nan)
        whole_power = float(np.var(np.concatenate([one.driving[one.kept] for one in whole])))
        return replace(chosen, share=power / max(whole_power, 1e-300))

    @classmethod
    def _of_band(cls, experiments: Sequence[Experiment], end_hz: float) -> tuple[Channel, _JointFit | None]:
        """The channel with this end of the band [Hz], and the fit with it; None where there are too few samples."""
        usual = _UsualJoint.of([Signals.of(one, True, end_hz) for one in experiments])
        if usual is None:
            return cls(end_hz), None
        is_reversed = usual.fit().is_reversed
        delay_s, fit = _delayed(replace(usual, sign=-1.0) if is_reversed else usual)
        return cls(end_hz, delay_s, is_reversed), fit

    def warn(self, name: str) -> None:
        """Reports a reversed sign and a delay; name: of a recording."""
        if self.is_reversed:
            log.warning(
                "%s: the torque is counted against the angle, as friction would drive; it is turned round", name
            )
        if self.delay_s:
            log.warning(
                "%s: the torque acts %.2g ms %s than it was recorded; this delay is removed",
                name, 1e3 * abs(self.delay_s), "later" if self.delay_s > 0 else "earlier",
            )  # fmt: skip

        if self.share < 1 / 2:
            log.warning(
                "%s: the motion is compared below %.2g Hz, where the inertia is identified best; only %.0f %% of the "
                "torque's variance is there: the rest is noise, or hardly moves the joint, as cogging does",
                name, self.band_hz, 100 * self.share,
            )  # fmt: skip

    def annotated(self, fit: Fit) -> Fit:
        """The fit with the band and the delay of this channel."""
        return replace(fit, band_hz=self.band_hz, delay_s=self.delay_s)

    def signals(self, experiment: Experiment, is_force: bool = True, is_disturbed: bool = False) -> Signals:
        """The signals of a recording in the band, without the delay; is_force, is_disturbed: see ``Signals.of``."""
        experiment = experiment.with_reversed_input() if self.is_reversed else experiment
        found = Signals.of(experiment.delayed(self.delay_s), is_force, self.band_hz, is_disturbed)
        return replace(found, is_delayed=bool(self.delay_s))


def _check_sizes(signals: Sequence[Signals]) -> None:
    """Raises ExperimentError for a torque of one size that is constant, or acts along the motion, in all samples that
    are compared: an unknown constant, or dry friction of this size, explains it exactly, without an inertia."""
    torque, velocity = (
        np.concatenate([values[one.kept] for one, values in zip(signals, parts, strict=True)])
        for parts in ([one.driving for one in signals], [one.velocity for one in signals])
    )
    size = np.abs(torque)
    is_constant, is_along = np.ptp(torque) <= FLAT_SHARE * size.max(), (torque * velocity > 0).all()
    is_one = np.ptp(size) <= FLAT_SHARE * size.max() and (is_constant or is_along)
    if is_one or _is_switched(signals):
        shown = torque[0] if is_constant else size[0] if is_one else float(np.median(size))
        raise ExperimentError(
            f"{signals[0].experiment.name}: found a {'torque' if is_one else 'voltage'} of {shown:.4g} "
            f"{'' if is_constant else 'along the motion '}at all times, expected one that changes: record steps of "
            "several sizes, or reversals in motion"
        )


def _is_switched(signals: Sequence[Signals]) -> bool:
    """Whether a voltage is that of one supply in all recordings, of either sign, along the motion in nearly all samples
    of it: it is what moves the part, and is none of its friction.  Supplies of several sizes tell these apart."""
    drives = [one.experiment.drive for one in signals]
    if None in drives or any(one.experiment.drive_unit != "V" for one in signals):
        return False
    sided = [
        np.asarray(drive.position(one.time)) * np.sign(one.velocity)
        for drive, one in zip(drives, signals, strict=True)
        if drive
    ]
    moving = [np.abs(one.velocity) > one.rest_speed for one in signals]
    along = np.concatenate([values[where] for values, where in zip(sided, moving, strict=True)])
    return bool(along.size) and float(np.mean(along < SUPPLIES * along.max())) < BRAKES


def _check_sign(signals: Sequence[Signals]) -> None:
    """Warns of a torque that is a magnitude: it is never on the other side of zero, where many of its readings are.  A
    motion in one direction may have such a torque."""
    drives = [one.experiment.drive for one in signals]
    values = np.concatenate([np.empty(0), *(drive.values for drive in drives if isinstance(drive, Sampled))])
    are_onward = all(is_onward(one.experiment.measured[one.column]) for one in signals)
    at_zero = int((values == 0).sum())
    if at_zero >= policy.RAILED and (values.min() == 0 or values.max() == 0) and not are_onward:
        log.warning(
            "%s: the torque is zero in %d readings and has one sign in all others, as a magnitude has; "
            "to be explained, it needs the sign of its direction",
            signals[0].experiment.name, at_zero,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _JointFit:
    """A least-squares fit of the usual joint.

    inertia [kg m²]; lost: mean power of viscous and Coulomb friction [W], and of the constant where the motion has one
    direction; deviation, lost_deviation: their standard deviations, robust to correlation of the residual within blocks
    (cluster-robust: Liang and Zeger 1986); residual: (M,) [N m]; rubs: whether friction has more of the torque than the
    inertia; power: variance of the torque within the band; motion: power of the speed there, also at rest [rad²/s²].
    """

    inertia: float
    lost: float
    deviation: float
    lost_deviation: float
    residual: FloatArray
    rubs: bool
    power: float
    motion: float

    @property
    def is_reversed(self) -> bool:
        """Whether torque and angle have opposite positive directions: friction adds power, and whichever of friction
        and inertia is identified is negative.  The inertia counts only if it has more of the torque than friction: a
        delay below an eighth of a period makes friction add power, too, but with less torque than the inertia has."""
        both = ((self.lost, self.lost_deviation), *(() if self.rubs else ((self.inertia, self.deviation),)))
        certain = [value for value, deviation in both if deviation < policy.INERTIA_IDENTIFIED * abs(value)]
        return self.lost < 0 and bool(certain) and max(certain) < 0

    @property
    def relative_deviation(self) -> float:
        """The relative standard deviation of the inertia."""
        return self.deviation / max(abs(self.inertia), 1e-300)

    @property
    def error(self) -> float:
        """The sum of the squared residual."""
        return float(self.residual @ self.residual)


def _is_blurred(fit: _JointFit | None, found: Sequence[tuple[Channel, _JointFit | None]]) -> bool:
    """Whether the inertia of a fit is significantly less than half of that in another band.  The acceleration in its
    band is then more noise than motion, so that least squares underestimates the inertia (errors in variables).  The
    noise of the angle does not show this where the angle is the integral of a noisy speed."""
    surely = max((one.inertia - policy.BAND_AS_WELL * one.deviation for _, one in found if one), default=0.0)
    return fit is not None and surely > 0 and fit.inertia < surely / 2


def _is_slow(fit: _JointFit | None, found: Sequence[tuple[Channel, _JointFit | None]]) -> bool:
    """Whether the band of a fit lacks a part of the motion (``policy.BAND_MOTION``), or has too few samples for a fit
    while others have enough."""
    most = max((one.motion for _, one in found if one), default=0.0)
    return (fit.motion if fit else 0.0) < policy.BAND_MOTION * most


@dataclass(frozen=True, eq=False)
class _UsualJoint:
    """The regression of the usual joint: filtered regressors (M, 6), scaled to unit norm; size: their norms (6,);
    inverse: of the normal matrix (6, 6); sign: that of the torque."""

    signals: Sequence[Signals]
    regressors: FloatArray
    size: FloatArray
    inverse: FloatArray
    sign: float = 1.0

    @classmethod
    def of(cls, signals: Sequence[Signals]) -> _UsualJoint | None:
        """The regression on these recordings; None where they have too few samples."""
        parts = []
        for one in signals:
            q, v = one.position, one.velocity
            parts.append(
                one.filtered(np.stack([one.acceleration, v, np.sign(v), np.sin(q), np.cos(q), np.ones_like(q)]))
            )
        regressors = np.concatenate(parts, axis=1).T
        if regressors.shape[0] < LEAST_SAMPLES * regressors.shape[1]:
            return None
        size = np.maximum(np.linalg.norm(regressors, axis=0), 1e-300)
        regressors = regressors / size
        return cls(signals, regressors, size, np.linalg.pinv(regressors.T @ regressors, rcond=1e-9, hermitian=True))

    def fit(self, delay_s: float = 0.0) -> _JointFit:
        """The fit to a torque that acts ``delay_s`` later than it was recorded [s]."""
        torque = self.sign * np.concatenate([one.filtered(one.delayed(delay_s).torque) for one in self.signals])
        found = self.inverse @ (self.regressors.T @ torque)
        residual = torque - self.regressors @ found
        scores = np.add.reduceat(self.regressors * residual[:, None], np.arange(BLOCKS) * torque.size // BLOCKS)
        losing = self.losing
        wanted = np.zeros((2, found.size))
        wanted[0, 0] = 1 / self.size[0]
        wanted[1, losing] = self.regressors[:, losing].T @ self.regressors[:, 1] * self.size[1] / torque.size
        inertia, lost = (wanted @ found).tolist()
        rubs = bool(np.linalg.norm(self.regressors[:, 1:3] @ found[1:3]) > abs(found[0]))
        deviation, lost_deviation = np.linalg.norm(scores @ self.inverse @ wanted.T, axis=0).tolist()
        motion = sum(float(np.mean(one.smooth(one.velocity) ** 2)) for one in self.signals)
        return _JointFit(inertia, lost, deviation, lost_deviation, residual, rubs, float(torque.var()), motion)

    @cached_property
    def losing(self) -> list[int]:
        """The regressors of friction; one direction does not distinguish it from the constant."""
        is_one_way = direction(one.experiment.measured[one.column] for one in self.signals)
        return [1, 2, 5] if is_one_way else [1, 2]

    @property
    def torque_hz(self) -> float:
        """The root mean square frequency of the torque [Hz]."""
        torque = np.concatenate([one.filtered(one.torque) for one in self.signals])
        change = np.concatenate([one.torque_by_delay for one in self.signals])
        return float(change.std() / max(torque.std(), 1e-300)) / math.tau

    def own_share(self, delay_s: float) -> float:
        """The share of the power of the torque's derivative by the delay [s] that the regressors do not explain."""
        change = np.concatenate([one.delayed(delay_s).torque_by_delay for one in self.signals])
        own = change - self.regressors @ (self.inverse @ (self.regressors.T @ change))
        return float(own @ own) / max(float(change @ change), 1e-300)


def _delayed(usual: _UsualJoint) -> tuple[float, _JointFit]:
    """How much later than recorded the torque acts [s], and the fit with this delay.  It is negative where the torque
    was recorded late, and 0 where the recordings do not identify it.

    Bus, controller and filters delay one of the two signals.  The torque of an inertia is then out of phase by 2 pi f
    d, and its quadrature part, -J (2 pi f)² d per unit of speed, hides friction or imitates it.  A delay is a property
    of the recording and not an effect of the machine.  It is an input delay (Ljung 1999, section 10.3), estimated once
    by profile least squares.  As for an effect, it must be significant by the errors of blocks and take a large enough
    share of the error; it must also lie inside of the range that was tried.  Only an inertia identifies it, and only
    with several frequencies: in a sinusoid a torque in phase with the speed is friction, one out of phase inertia.
    """
    now, end_hz = usual.fit(), max(one.band_hz for one in usual.signals)
    most = LONGEST / min(max(usual.torque_hz, LONGEST * end_hz), end_hz)
    many = 2 * math.ceil(most * end_hz / LONGEST * DELAYS) + 1
    delays = np.linspace(-most, most, many)
    fits = [usual.fit(float(delay)) for delay in delays]
    errors = np.array([fit.error for fit in fits])
    at = int(np.argmin(errors))
    best = fits[at]
    block = numbered([now.residual.size], now.residual.size / BLOCKS)
    is_better = Predictions(now.residual**2, best.residual**2, block).is_better()
    is_inertia = (
        best.inertia > 0
        and now.inertia > 0
        and max(best.relative_deviation, now.relative_deviation) < policy.INERTIA_IDENTIFIED
    )
    is_inside = 0 < at < delays.size - 1
    if not (is_inside and is_better and is_inertia and usual.own_share(float(delays[at])) > policy.DELAY_SHARE):
        return 0.0, now
    left, here, right = errors[at - 1 : at + 2]  # the parabola's minimum
    return float(delays[at] + (delays[1] - delays[0]) * 0.5 * (left - right) / (left - 2 * here + right)), best
