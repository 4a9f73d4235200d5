"""What the recordings of a torque and an angle have in common: the band in which they are compared, and the delay
between the two.

Both are chosen with what a joint usually has, tau = J theta'' + b theta' + c sign(theta') + d sin + e cos + f, before
any effect is looked for.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.lab import policy
from lostmotion.lab.data.blocks import chance, numbered
from lostmotion.lab.data.experiment import FLAT_SHARE, Experiment
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.inverse.signals import LEAST_SAMPLES, Signals
from lostmotion.lab.results import Fit
from lostmotion.model import Sampled
from lostmotion.model.motion import FloatArray

__all__ = ["Channel"]

SHARES = (1.0, 0.5, 0.25, 0.125, 0.0625)
"""Ends of the band that are tried, as shares of the widest band in which the angle exceeds its noise, highest first."""
BLOCKS = 20
"""Number of parts of the recordings that count as independent."""
LONGEST, DELAYS = 0.25, 41
"""Periods of the end of the band, the longest delay that is tried: beyond it a torque leads instead of following; and
the number of delays that are tried."""
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Channel:
    """band_hz: the highest end of the band; delay_s: how much later than recorded the torque acts; is_turned: whether
    it was counted against the angle."""

    band_hz: float = math.inf
    delay_s: float = 0.0
    is_turned: bool = False

    @classmethod
    def of(cls, experiments: Sequence[Experiment]) -> Channel:
        """Of recordings with a measured torque; a delay is reported in a warning.

        The band is the highest that identifies the inertia of a driven joint nearly as well as the best one, each with
        its own delay.  Motion that the torque does not cause (a vibrating arm, a belt) has far larger accelerations
        than slow motion.  Least squares is efficient only for a white residual; generalised least squares is
        approximated by weights of 0 and 1 over frequency.  One end in hertz serves all recordings, as such a vibration
        has a fixed frequency: a share of each band left 7 of 94 samples of a slow pendulum beside a rattling one.
        """
        _check_torque(experiments)
        whole = [Signals.of(one) for one in experiments]
        _check_sizes(whole)
        widest = max(one.band_hz for one in whole)
        found = []
        for share in SHARES:
            usual = _Usual.of([Signals.of(one, True, share * widest) for one in experiments])
            is_turned = bool(usual and usual.fit().is_turned)
            if usual and is_turned:
                usual = replace(usual, sign=-1.0)
            delay_s, fit = _delayed(usual) if usual else (0.0, None)
            found.append((cls(share * widest, delay_s, is_turned), fit))
        clear = [(one, fit.unsure if fit else math.inf) for one, fit in found if not _is_blurred(fit, found)]
        least = min(unsure for _, unsure in clear)
        is_identified = least < policy.INERTIA_IDENTIFIED
        channel = next(one for one, unsure in clear if not is_identified or unsure <= policy.BAND_AS_WELL * least)
        if channel.is_turned:
            log.warning(
                "%s: the torque is counted against the angle, as friction would drive; it is turned round",
                experiments[0].name,
            )
        if channel.delay_s:
            log.warning(
                "%s: the torque acts %.2g ms %s than it was recorded; this delay is removed",
                experiments[0].name, 1e3 * abs(channel.delay_s), "later" if channel.delay_s > 0 else "earlier",
            )  # fmt: skip
        return channel

    def noted(self, fit: Fit) -> Fit:
        """A fit that says in which band and with which delay it was made."""
        return replace(fit, band_hz=self.band_hz, delay_s=self.delay_s)

    def signals(self, experiment: Experiment, is_force: bool = True, is_disturbed: bool = False) -> Signals:
        """Those of a recording; is_force, is_disturbed: see ``Signals.of``."""
        turned = experiment.turned() if self.is_turned else experiment
        return Signals.of(turned.delayed(self.delay_s), is_force, self.band_hz, is_disturbed)


def _check_torque(experiments: Sequence[Experiment]) -> None:
    """Rejects a torque that never changes: an unknown constant explains it, and no inertia is needed.  Warns of one
    that is a magnitude: where its readings end, at zero, is the end of a range."""
    found = [one.drive.values for one in experiments if isinstance(one.drive, Sampled)]
    values = np.concatenate(found) if found else np.arange(2.0)
    if np.ptp(values) <= FLAT_SHARE * np.abs(values).max():
        raise ExperimentError(
            f"{experiments[0].name}: found a torque of {values[0]:g} at all times, expected one that changes: record "
            "steps of several sizes, or both directions"
        )
    at_zero = int((values == 0).sum())
    if at_zero >= policy.RAILED and (values.min() == 0 or values.max() == 0):
        log.warning(
            "%s: the torque is zero in %d readings and has one sign in all others, as a magnitude has; "
            "to be explained, it needs the sign of its direction",
            experiments[0].name, at_zero,
        )  # fmt: skip


def _check_sizes(signals: Sequence[Signals]) -> None:
    """Rejects a torque of one size that acts along the motion wherever that is compared: dry friction of this size
    explains it to all digits, and no inertia is needed."""
    torque = np.concatenate([np.asarray(one.experiment.drive.position(one.time[one.kept])) for one in signals
                             if isinstance(one.experiment.drive, Sampled)] or [np.arange(2.0)])  # fmt: skip
    velocity = np.concatenate([one.velocity[one.kept] for one in signals])
    sizes = np.abs(torque)
    if velocity.size == torque.size and np.ptp(sizes) <= FLAT_SHARE * sizes.max() and (torque * velocity > 0).all():
        raise ExperimentError(
            f"{signals[0].experiment.name}: found a torque of {sizes[0]:g} along the motion at all times, expected one "
            "that changes: record steps of several sizes, or reversals in motion"
        )


@dataclass(frozen=True, eq=False)
class _Fit:
    """Least squares of the usual joint: its inertia [kg m²] and the mean power that friction takes [W], their standard
    deviations, robust to correlation of the residual within blocks (cluster-robust; Liang and Zeger 1986), and the
    residual (M,) [N m]."""

    inertia: float
    lost: float
    deviation: float
    lost_deviation: float
    residual: FloatArray

    @property
    def is_turned(self) -> bool:
        """Whether the torque is counted against the angle: friction drives, and of it and the inertia what is certain
        is negative.  A damper on a test bench has no inertia that shows."""
        both = ((self.inertia, self.deviation), (self.lost, self.lost_deviation))
        certain = [value for value, deviation in both if deviation < policy.INERTIA_IDENTIFIED * abs(value)]
        return self.lost < 0 and bool(certain) and max(certain) < 0

    @property
    def unsure(self) -> float:
        """The relative standard deviation of the inertia."""
        return self.deviation / max(abs(self.inertia), 1e-300)

    @property
    def error(self) -> float:
        """The sum of the squared residual."""
        return float(self.residual @ self.residual)


def _is_blurred(fit: _Fit | None, found: Sequence[tuple[Channel, _Fit | None]]) -> bool:
    """Whether a band has surely less than half of the inertia of another one: its acceleration is more noise than
    motion then, for which least squares takes an inertia for smaller (errors in variables).  The angle's own noise does
    not tell it where the angle is the integral of a noisy speed: a motor's inertia was 1e-5 instead of 7e-4."""
    surely = max((one.inertia - policy.BAND_AS_WELL * one.deviation for _, one in found if one), default=0.0)
    return fit is not None and surely > 0 and fit.inertia < surely / 2


@dataclass(frozen=True, eq=False)
class _Usual:
    """The usual joint in these recordings: filtered regressors (M, 6) of size one, their sizes (6,), and the inverse of
    their normal equations (6, 6)."""

    signals: Sequence[Signals]
    regressors: FloatArray
    size: FloatArray
    inverse: FloatArray
    sign: float = 1.0

    @classmethod
    def of(cls, signals: Sequence[Signals]) -> _Usual | None:
        """None where there are too few samples."""
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

    def fit(self, delay_s: float = 0.0) -> _Fit:
        """With a torque that acts so much later than it was recorded [s]."""
        torque = self.sign * np.concatenate([one.filtered(one.delayed(delay_s).torque) for one in self.signals])
        found = self.inverse @ (self.regressors.T @ torque)
        residual = torque - self.regressors @ found
        scores = np.add.reduceat(self.regressors * residual[:, None], np.arange(BLOCKS) * torque.size // BLOCKS)
        wanted = np.zeros((2, found.size))  # the inertia, and the power of viscous and Coulomb friction
        wanted[0, 0] = 1 / self.size[0]
        wanted[1, 1:3] = self.regressors[:, 1:3].T @ self.regressors[:, 1] * self.size[1] / torque.size
        inertia, lost = (wanted @ found).tolist()
        deviation, lost_deviation = np.linalg.norm(scores @ self.inverse @ wanted.T, axis=0).tolist()
        return _Fit(inertia, lost, deviation, lost_deviation, residual)


def _delayed(usual: _Usual) -> tuple[float, _Fit]:
    """How much later than recorded the torque acts [s], negative where it was recorded late, and the fit with that; 0
    where the recordings do not identify it.

    Bus, controller and filters delay one of the two signals.  An inertia's torque is then out of phase by 2 pi f d, and
    its quadrature part, -J (2 pi f)² d per unit of speed, hides friction or imitates it.  A delay is a property of the
    recording and no effect of the machine: an input delay (Ljung 1999, section 10.3), estimated once by profile least
    squares.  It counts like an effect: significant by the blocks' errors, worth a name, within the range that was
    tried.  Only an inertia identifies it: of a sine in phase with the speed alone it is friction.
    """
    now, most = usual.fit(), LONGEST / max(one.band_hz for one in usual.signals)
    delays = np.linspace(-most, most, DELAYS)
    fits = [usual.fit(float(delay)) for delay in delays]
    errors = np.array([fit.error for fit in fits])
    at = int(np.argmin(errors))
    best = fits[at]
    block = numbered([now.residual.size], now.residual.size / BLOCKS)
    is_worth = errors[at] < (1 - policy.LEAST_GAIN) * now.error
    is_significant = chance(now.residual**2, best.residual**2, block) < policy.FALSE_NAME
    is_inertia = best.inertia > 0 and now.inertia > 0 and max(best.unsure, now.unsure) < policy.INERTIA_IDENTIFIED
    if at in (0, DELAYS - 1) or not (is_worth and is_inertia and is_significant):
        return 0.0, now
    left, here, right = errors[at - 1 : at + 2]  # the parabola's minimum
    return float(delays[at] + (delays[1] - delays[0]) * 0.5 * (left - right) / (left - 2 * here + right)), best
