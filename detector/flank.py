"""The elasticity of a joint's tooth flanks under load, estimated from many windows.  No samples, no commands here.

In eq. 1 the flank is elastic: under the acceleration a of the joint its teeth are X = (|a| / A)^(1/n) of half the play
away from the middle.  Hard teeth have 1/n = 0.  Equation 1 stays the same when the play is multiplied by c and beta by
c^n, so motion alone determines n and the play times A^(-1/n), not the play of soft teeth itself.  A = beta R2 / J2 is
therefore uncertain, from a hundredth to thirty times the model's value, unless the settings give it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["CONTACT_ACCEL", "SOFTNESS", "FlankLaw", "SizeEstimate", "law_of"]

SOFTNESS = np.array([0.0, 0.02, 0.04, 0.065, 1 / 11, 0.12, 0.16, 0.2])
"""Values of 1/n that are compared: from hard teeth to n = 5."""
CONTACT_ACCEL = 1000.0
"""A of the model [rad/s²]: beta R2 / J2 = 20 N * 10 mm / 2e-4 kg m²."""
DECADES = (-2.0, 1.5)
"""The range of A, in decades from the model's: a gear may be stiffer or lighter, or its teeth may be springs, so
that the play is the gap under the loads of the motion itself.  For a gear with a tenth of the model's inertia, whose
A is ten times as large, and a play of 80 um, 88 % of the intervals held with one decade above (seed 8231), 94.1 %
with 1.5, and 95.9 % with two (seeds 8220 and 8222).  With two, hard stops of 30 um were estimated 21 % too large
instead of less than 20 %."""
MEMORY = 0.998
"""Weight of earlier windows in the estimate of 1/n after each window: worn teeth change, over some 500 windows."""
OVERLAP = 0.3
"""Weight of a window's likelihood: segments of 0.85 s that end after reversals 0.1 to 0.4 s apart share two thirds
of their samples and more.  With a weight of 1 the estimate of 1/n on a gear of eq. 1 (a tenth of the inertia, n = 11,
80 um) was 0.065 ± 0.013 after 80 windows, and 84 % of the intervals of the play held.  With 0.3 99 % hold, and the
intervals of hard stops are no wider."""
PLACES = 7
"""Number of values of A that are averaged over."""


@dataclass(frozen=True, slots=True, eq=False)
class SizeEstimate:
    """The estimate from one window for each value of SOFTNESS: play [rad], standard deviation, log-likelihood; (S,)."""

    play: FloatArray
    deviation: FloatArray
    likelihood: FloatArray


@dataclass(frozen=True, slots=True)
class FlankLaw:
    """Log-likelihood of each value of SOFTNESS after a joint's windows so far, and the range of A [decades]."""

    likelihood: tuple[float, ...] = (0.0,) * len(SOFTNESS)
    decades: tuple[float, float] = DECADES

    @property
    def weights(self) -> FloatArray:
        """Probability of each value of SOFTNESS, shape (S,)."""
        odds = np.exp(np.array(self.likelihood) - max(self.likelihood))
        return np.asarray(odds / odds.sum())

    @property
    def is_learnt(self) -> bool:
        """Whether it is estimated from windows: not where the settings fix it."""
        return -math.inf not in self.likelihood

    @property
    def softness(self) -> tuple[float, float, float]:
        """Median of 1/n and the ends of its 95 % interval, to the resolution of SOFTNESS."""
        below = np.cumsum(self.weights)
        low, middle, high = (float(SOFTNESS[int(np.searchsorted(below, share))]) for share in (0.025, 0.5, 0.975))
        return middle, low, high

    def updated(self, estimate: SizeEstimate) -> FlankLaw:
        """The law after one more window; unchanged where the settings fix it."""
        if not self.is_learnt:
            return self
        gained = MEMORY * np.array(self.likelihood) + OVERLAP * (estimate.likelihood - np.max(estimate.likelihood))
        return FlankLaw(tuple((gained - np.max(gained)).tolist()), self.decades)

    def interval(self, estimate: SizeEstimate, z: float) -> tuple[float, float, float]:
        """Median, low and high end of the play [rad] under this law, truncated at 0; the interval has the probability
        of ± z standard deviations of a normal value."""
        factor = 10.0 ** (SOFTNESS[:, None] * np.linspace(*self.decades, PLACES))
        means, spreads = estimate.play[:, None] * factor, estimate.deviation[:, None] * factor
        values = np.linspace(float(np.min(means - 4 * spreads)), float(np.max(means + 4 * spreads)), 200)
        below = np.sum(self.weights[:, None] / PLACES * _normal((values[:, None, None] - means) / spreads), axis=(1, 2))
        share = math.erf(z / math.sqrt(2)) / 2
        negative = float(np.interp(0.0, values, below))
        below = (below - negative) / max(1 - negative, 1e-9)
        middle, low, high = np.interp((0.5, 0.5 - share, 0.5 + share), below, values)
        return float(middle), float(low), float(high)


def law_of(settings: DetectorSettings) -> FlankLaw:
    """The law before the first window."""
    decades, likelihood = DECADES, (0.0,) * SOFTNESS.size
    if settings.contact_accel is not None:
        decades = (math.log10(settings.contact_accel / CONTACT_ACCEL),) * 2
    if settings.flank_exponent is not None:
        nearest = int(np.argmin(np.abs(SOFTNESS - 1 / settings.flank_exponent)))
        likelihood = tuple(0.0 if i == nearest else -math.inf for i in range(SOFTNESS.size))
    return FlankLaw(likelihood, decades)


def _normal(u: FloatArray) -> FloatArray:
    """The normal distribution function to 2e-4."""
    u = np.clip(u, -6.0, 6.0)
    return np.asarray(1 / (1 + np.exp(-u * (1.5976 + 0.070566 * u**2))))
