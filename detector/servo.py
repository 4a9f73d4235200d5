"""The response of a servo to its goal, a lag, estimated from many windows of a joint.  No samples here.

theta_1 is not the commanded angle: a servo lags its goal by some 5 to 80 ms.  The candidates are a pure delay, a lag of
the first order (a position controller in front of a speed) and one of the second order (a position controller in front
of a torque), critically damped or less, without or after a pure delay.  Play is bounded and acts at reversals only,
unlike such a lag: a single window may not distinguish the two, many windows with different motions do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.window import FloatArray

__all__ = [
    "AT_ONCE",
    "DELAYS",
    "GRID_S",
    "SHAPES",
    "SPAN_S",
    "UNKNOWN",
    "USUAL",
    "LagInformation",
    "ServoLaw",
    "delayed",
    "followed",
    "smoothing",
]

GRID_S = 0.004
"""Grid of the commands, and of the delays that are compared [s]."""
SPAN_S = 0.5
"""Commands up to this long before a segment affect it [s]: five times the longest lag."""
LONGEST_S, SHORTEST_LAG_S = 0.1, 0.008
"""Delays up to this are compared (servos of 20 to 80 ms were tried); shorter lags than this are pure delays."""
_PURE = np.arange(0.0, LONGEST_S + GRID_S / 2, GRID_S)
_LAGS = np.arange(SHORTEST_LAG_S, LONGEST_S + GRID_S / 2, GRID_S)
DELAYS: FloatArray = np.concatenate([_PURE, *[_LAGS] * 5])
"""The delay of each candidate response [s], shape (G,)."""
SHAPES: NDArray[np.intp] = np.repeat([0, 1, 2, 3, 4, 5], [_PURE.size, *[_LAGS.size] * 5])
"""The shape of each candidate, an index of PURE and DAMPING; shape (G,)."""
PURE, DAMPING = np.array([1.0, 0.0, 0.0, 0.0, 0.4, 0.4]), np.array([math.nan, math.inf, 1.0, 0.6, 0.6, 1.0])
"""Of each shape the share of the delay that is pure, and the damping ratio of a second order behind it: a pure delay, a
first order, and the corners of the square in which servos were tried (damped by 0.6 to 1.2, up to half a pure delay).

A lag is its delay T and higher coefficients; the second is an angle in proportion to the acceleration and looks like
play, and at 10 Hz and 70 ms no series of coefficients converges.  The nearest candidate is 1.5 to 2.4 mrad from
servos of 50 to 80 ms (medians of 25, by motion), without the last corner 3.0 to 4.0: docs/decisions/0013."""
SECOND = PURE * (1 - PURE / 2) + (1 - PURE) ** 2 * np.where(PURE < 1, 1 - 1 / (4 * DAMPING**2), 0.0)
"""The second coefficient of each shape's lag, as a share of the delay's square: 0.31 to 1."""
COEFFICIENTS: FloatArray = np.column_stack([DELAYS, SECOND[SHAPES] * DELAYS**2])
"""Delay [s] and second coefficient [s²] of each candidate, shape (G, 2)."""
USUAL = 0.65
"""Usual ratio of the second coefficient to the delay's square: the mean of SECOND."""
ALIKE = 0.006
"""Standard deviation of the error that is common to the lag from contacts in all windows [s], of the delay and,
times the delay, of the second coefficient: 1.3 ms times the root of the 20 windows that MEMORY keeps.  With 0.003,
0.006 and 0.012 s 95.0, 95.5 and 95.3 % of the intervals of the size of the play held, and 96.2, 97.4 and 96.7 %
above 20 mrad (60 joints of ``bench.outside`` that lag or have more than 10 mrad, seeds 7000 to 7119)."""
SETTLED = 100.0
"""Delays after which a step response is 1 to the last bit."""
TRIED = 8.0
"""Candidates so much less likely [nats] than the best are not evaluated, until MEMORY has reduced the difference."""
PROBABLE = 0.003
"""Candidates that are less probable are left out of the mean response: 3 to 25 remain after a recording of 15 s."""
MEMORY = 0.95
"""Weight of earlier windows after each window: the response changes with the load.  With 0.99 the delays were as
accurate, but their intervals too narrow: 85 % of the intervals of the size of the play held behind servos of other
shapes, with 0.95 and the second coefficient of ``relative_motion.SHAPE`` 87 % (14 joints of seeds 100 to 139)."""


@dataclass(frozen=True, slots=True, eq=False)
class LagInformation:
    """Information from the contacts of one window on the errors of a law's lag: of its delay [s], and of its second
    coefficient [s²] in addition to 2 USUAL delay times that error.

    score (2,) and information (2, 2) of their likelihood where both have Gaussian priors with these variances (2,)
    already; weight: the power of the likelihood.
    """

    score: FloatArray
    information: FloatArray
    prior: FloatArray
    weight: float


@dataclass(frozen=True, slots=True)
class ServoLaw:
    """Log-likelihood of each candidate response after a joint's windows so far, shape (G,)."""

    likelihood: tuple[float, ...] = (0.0,) * len(DELAYS)

    @property
    def chosen(self) -> NDArray[np.intp]:
        """Indices of the candidates that are likely enough to be evaluated."""
        likelihood = np.array(self.likelihood)
        return np.flatnonzero(likelihood > likelihood.max() - TRIED)

    @property
    def odds(self) -> FloatArray:
        """Probability of each candidate, shape (G,); 0 where it is below PROBABLE."""
        odds = np.exp(np.array(self.likelihood) - max(self.likelihood))
        odds[odds < PROBABLE * odds.sum()] = 0.0
        return np.asarray(odds / odds.sum())

    @property
    def delay(self) -> tuple[float, float]:
        """Mean of the delay and its standard deviation [s]."""
        odds = self.odds
        mean = float(odds @ DELAYS)
        return mean, float(np.sqrt(odds @ (DELAYS - mean) ** 2))

    @property
    def is_learnt(self) -> bool:
        """Whether it is estimated from windows: not where it is known."""
        return -math.inf not in self.likelihood

    def updated(self, chosen: NDArray[np.intp], evidence: FloatArray) -> ServoLaw:
        """The law after one more window; evidence: log-likelihood of the chosen candidates."""
        if not self.is_learnt:
            return self
        gained = MEMORY * np.array(self.likelihood)
        gained[chosen] += evidence - np.max(evidence)
        return ServoLaw(tuple((gained - np.max(gained)).tolist()))

    def corrected(self, lag: LagInformation) -> ServoLaw:
        """The law after the information from a window's contacts: without its priors, with ALIKE."""
        if not self.is_learnt:
            return self
        delay = self.delay[0]
        error = COEFFICIENTS - self.odds @ COEFFICIENTS
        error[:, 1] -= 2 * USUAL * delay * error[:, 0]
        alike = np.array([ALIKE, ALIKE * delay]) ** 2
        kept = np.linalg.inv(np.eye(2) + lag.information * (alike - lag.prior))
        evidence = error @ (kept @ lag.score) - np.sum((error @ (kept @ lag.information)) * error, axis=1) / 2
        gained = np.array(self.likelihood) + lag.weight * evidence
        return ServoLaw(tuple((gained - np.max(gained)).tolist()))


UNKNOWN = ServoLaw()
AT_ONCE = ServoLaw((0.0,) + (-math.inf,) * (len(DELAYS) - 1))
"""A servo that is known to have no lag."""


def followed(times: FloatArray, commands: FloatArray, start: float, count: int, chosen: NDArray[np.intp]) -> FloatArray:
    """theta_1 [rad] of a servo with each of the chosen responses to the commands, shape (C, count), on a grid of GRID_S
    from ``start`` [s] on."""
    before = round(SPAN_S / GRID_S)
    grid = start + GRID_S * np.arange(-before, count)
    return delayed(np.interp(grid, times, commands), chosen)[:, before:]


def delayed(goal: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
    """Each of the chosen responses, shape (C, count), to a goal on a grid of GRID_S, (count,), constant before."""
    taps = responses().shape[1]
    rows = np.lib.stride_tricks.sliding_window_view(np.concatenate([np.full(taps - 1, goal[0]), goal]), taps)
    return np.asarray((rows @ responses()[chosen].T).T)


def smoothing(count: int, odds: FloatArray, chosen: NDArray[np.intp]) -> FloatArray:
    """The mean of the chosen responses as a matrix, shape (count, count)."""
    response = np.zeros(2 * count)
    mean = (odds @ responses()[chosen])[::-1][:count]
    response[count : count + mean.size] = mean
    ago = np.arange(count)[:, None] - np.arange(count)
    matrix = response[ago + count]
    matrix[:, 0] += 1 - matrix.sum(axis=1)
    return np.asarray(matrix)


def _step_response(since: FloatArray, way: int) -> FloatArray:
    """Response so long after a unit step of the goal [s]."""
    pure, damping = float(PURE[SHAPES[way]]), float(DAMPING[SHAPES[way]])
    since, delay = since - pure * float(DELAYS[way]), (1 - pure) * float(DELAYS[way])
    if pure == 1:
        return np.asarray(since > 0, dtype=np.float64)
    since = np.clip(since, 0.0, SETTLED * delay)  # the response is at its final value there
    if math.isinf(damping):
        return np.asarray(-np.expm1(-since / delay))
    decay = 2 * damping**2 / delay
    if damping == 1:
        return np.asarray(1 - (1 + decay * since) * np.exp(-decay * since))
    root = math.sqrt(1 / damping**2 - 1)
    swing = root * decay * since
    return np.asarray(1 - np.exp(-decay * since) * (np.cos(swing) + np.sin(swing) / root))


@lru_cache(maxsize=1)
def responses() -> FloatArray:
    """Weights of the commands from SPAN_S ago to now, shape (G, SPAN_S / GRID_S + 1): differences of step responses."""
    edges = np.maximum((np.arange(round(SPAN_S / GRID_S) + 2) - 0.5) * GRID_S, 0.0)
    steps = np.array([_step_response(edges, way) for way in range(DELAYS.size)])
    weights = np.diff(steps, axis=1)[:, ::-1]
    weights /= weights.sum(axis=1, keepdims=True)
    return np.asarray(weights)
