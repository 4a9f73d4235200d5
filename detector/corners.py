"""Whether a joint's commanded motion is smooth or has corners, learnt from many windows.  No samples, no commands here.

A spline through the commands takes the motion's jerk for white noise of one strength.  A profile of constant
accelerations (a trapezoid of speed) has jerk at its corners only; smoothed like the rest it is wrong there by 2 to 4
mrad, with the sign of the acceleration and so with that of the flank, which looks like play.  Commands in steps of 5
mrad hardly tell the one from the other (0.1 nats a window).  The joint does: at a contact it moves as its gear does, so
D at all contacts of a window is far less likely under the wrong prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["CORNERS_UNKNOWN", "SMOOTH", "CornerLaw"]

MARGIN = 4.0
"""Evidence for a smooth motion [nats] that a window has to give, for neither prior is true: counted between -8 and 12,
trapezoids gave -1.4 to 2.4 on average, smooth motions 5.7 to 11.7, plays of 50 mrad, where it makes no difference, 0.1
to 0.5 (22 joints of ``bench.outside``, seeds 3000 to 3179)."""
MOST = 10.0
"""A single window counts at most so much [nats]."""
MEMORY = 0.9
"""Weight of what earlier windows told after each window: other moves follow."""
SURE, CLEAR = 3.0, 12.0
"""Corners are excluded from here on [nats]; both priors are tried in every window until one is so clear, and then in
one of EVERY, which makes the time of a window 1.1 times that of one prior."""
EVERY = 8


@dataclass(frozen=True, slots=True)
class CornerLaw:
    """Evidence against corners after a joint's windows so far [nats], and how many windows these were."""

    evidence: float = 0.0
    windows: int = 0

    @property
    def none(self) -> bool:
        """Whether the motion is known to have no corners."""
        return self.evidence > SURE

    @property
    def asks_both(self) -> bool:
        """Whether the next window has to tell which prior is right."""
        return abs(self.evidence) < CLEAR or (math.isfinite(self.evidence) and self.windows % EVERY == 0)

    def updated(self, evidence: float) -> CornerLaw:
        """The law after one more window, NaN if that told nothing."""
        if math.isnan(evidence):
            return CornerLaw(self.evidence, self.windows + 1)
        gained = min(max(evidence - MARGIN, -MOST), MOST)
        return CornerLaw(MEMORY * self.evidence + gained, self.windows + 1)


CORNERS_UNKNOWN = CornerLaw()
SMOOTH = CornerLaw(math.inf)
"""A motion that is known to be smooth."""
