"""When a joint's noise and bar are estimated, and from which windows.  ``background`` and ``bar`` have the methods."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from dataclasses import dataclass, replace

import numpy as np

from lostmotion.detector import ringdown
from lostmotion.detector.background import LEAST_WINDOWS, Background, applied, followed, learning
from lostmotion.detector.bar import Bar, agrees, finding, moved, used
from lostmotion.detector.quality import LEAST_SHARE
from lostmotion.detector.whitening import spectrum
from lostmotion.detector.window import DetectorSettings, FloatArray

__all__ = ["BarChange", "BarLooks", "Change", "Learner", "is_learning", "settled"]

DUE = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""After so many windows the noise is learnt again, then every 10 000: an hour of motion or two."""
BLOCK = 100
"""Windows for each estimate, taken evenly from those since the last one."""
CHECK = 500
"""After so many windows the noise is compared with its last estimate."""
MOVED = 1.3
"""The noise is learnt at once if its power has changed by this factor."""
BAR_CHECK = 2000
"""After so many windows resonance and damping are estimated again.  Until an estimate confirms the known values, they
are also estimated whenever the noise is, except for the first time. (They take time: those of the first ten minutes
were 28 % of the main thread's work.)"""
REPORT_HZ, REPORT_ZETA = 0.02, 0.3
"""Relative changes of resonance or damping that are reported."""
ROUNDS, FIRST_ROUNDS = 1, 3
"""Rounds of ``background.learning`` with each window, so that the score of no window is delayed for long: a round of
100 windows of 250 samples costs 8 ms, all of them 0.2 to 0.4 s.  The second value is used while no noise is known."""
PATIENCE = 100
"""Rounds for which a joint waits for another one's look at their bar, which takes 66: it may have come to rest."""
POINTS = 512


@dataclass(slots=True, eq=False)
class BarLooks:
    """The looks at one bar by the joints that share its accelerometer, one at a time: what one has confirmed serves all
    of them once.  Six looks of six joints took as much time in the first minute as all the rest of the main thread."""

    under_way: bool = False
    confirmed: Bar | None = None


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a joint's noise: standard deviations before (NaN: none was known) and after [m/s²], and the frequency
    of the largest difference of the spectra [Hz]."""

    before: float
    after: float
    near_hz: float

    @property
    def is_first(self) -> bool:
        """Whether no noise was known before."""
        return math.isnan(self.before)

    def __str__(self) -> str:
        if self.is_first:
            return f"noise learnt: {self.after:.3g} m/s²"
        return f"noise has changed from {self.before:.3g} to {self.after:.3g} m/s², most near {self.near_hz:.0f} Hz"


@dataclass(frozen=True, slots=True)
class BarChange:
    """A change of resonance [Hz] and damping ratio of a joint's bar since the last report: before and after."""

    before: tuple[float, float]
    after: tuple[float, float]

    is_first = False

    def __str__(self) -> str:
        (f_before, zeta_before), (f_after, zeta_after) = self.before, self.after
        return (
            f"resonance and damping of the bar have moved from {f_before:.4g} Hz, {zeta_before:.2g} "
            f"to {f_after:.4g} Hz, {zeta_after:.2g}"
        )


def is_learning(settings: DetectorSettings) -> bool:
    """Whether the noise is learnt: not where it is calibrated."""
    return settings.noise_ms2 is None and not settings.noise_colour


def settled(windows: Iterable[FloatArray], rate_hz: float, settings: DetectorSettings) -> DetectorSettings:
    """The settings with the noise that a ``Learner`` estimates from these windows of one length; unchanged where the
    noise is calibrated.  The bar is the given one."""
    given = replace(settings, follow_bar=False)
    learner: Learner | None = None
    for accel in windows if is_learning(settings) else ():
        learner = learner or Learner(given, rate_hz, accel.size)
        learner.update(accel)
    if learner is None:
        return settings
    learner.finish()
    return replace(learner.settings, follow_bar=settings.follow_bar)


class Learner:
    """Noise and bar of one joint, estimated from its windows of ``length`` samples.

    given: the settings of the file; settings: the same with the current estimates of noise, resonance and damping;
    looks: those at the same bar, of all its joints; seen: number of windows; background: None until it is estimated
    from the first 20 windows; bar: None until windows show it.  The estimation proceeds in steps, one with each window,
    so that the noise of a block is known some 10 to 40 windows after it.
    """

    def __init__(
        self, settings: DetectorSettings, rate_hz: float, length: int, looks: BarLooks | None = None
    ) -> None:  # fmt: skip
        self.given = self.settings = settings
        self.background: Background | None = None
        self.bar: Bar | None = None
        self.seen = 0
        self.rate_hz = rate_hz
        self._length = length
        self._usual_power = math.nan
        self._work: Generator[None, None, Change | BarChange | None] | None = None
        self._bar_due = DUE[1]
        self._looks = looks or BarLooks()
        self._served = self._looks.confirmed
        self._reported = (settings.f_res_hz, settings.zeta)
        self._begin_block()

    def resume(self, background: Background | None, seen: int, bar: Bar | None = None) -> None:
        """Continues from the estimates of an earlier run with the same bar, rate and length of windows."""
        if background is None or background.length == self._length:
            self.bar = bar if self.given.follow_bar else None
            self._set_settings(used(self.bar, self.given))
            if background is not None:
                self._set_background(background)
            self._reported = (self.settings.f_res_hz, self.settings.zeta)
            self.seen = seen
            self._begin_block()

    def update(self, accel: FloatArray) -> Change | BarChange | None:
        """Takes the tip acceleration [m/s²] of a window, shape (N,); returns a change to report, or None."""
        values = accel[np.isfinite(accel)]
        if accel.size != self._length or values.size < LEAST_SHARE * accel.size or values.max() == values.min():
            return None
        self.seen += 1
        if self.seen % self._stride == 0 and len(self._block) < BLOCK:
            self._block.append(ringdown.filled(accel, self.rate_hz, self.settings).astype(np.float32))
        change = self._advance(ROUNDS if self.background else FIRST_ROUNDS)
        if self.seen >= self._next and len(self._block) >= LEAST_WINDOWS and self._work is None:
            self._work = self._learn(np.array(self._block, dtype=float), self.seen >= self._due)
            self._begin_block()
        return change

    def finish(self) -> Change | BarChange | None:
        """Completes the current estimation; returns a change to report, or None."""
        return self._advance(None)

    def _advance(self, rounds: int | None) -> Change | BarChange | None:
        """Runs so many more rounds, None for all."""
        while self._work is not None and rounds != 0:
            rounds = rounds and rounds - 1
            try:
                next(self._work)
            except StopIteration as finished:
                self._work = None
                change: Change | BarChange | None = finished.value
                return change
        return None

    def _learn(self, windows: FloatArray, is_due: bool) -> Generator[None, None, Change | BarChange | None]:
        before = self.settings
        if self.given.follow_bar and self.seen >= self._bar_due:
            self._bar_due = min(self._due, self.seen + BAR_CHECK)
            yield from self._update_bar(windows)
        has_moved = (self.settings.f_res_hz, self.settings.zeta) != (before.f_res_hz, before.zeta)
        if not is_due and not has_moved and self._is_usual(windows):
            return None
        yield
        # A noise estimated with another resonance may contain rings.
        known = None if has_moved else self.background
        found = yield from learning(windows, self.rate_hz, used(self.bar, self.given), known)
        change: Change | BarChange | None = self._change_of_bar()
        if found is not None:
            pooled, is_other = followed(known, found)
            if change is None and (is_other or self.background is None):
                change = self._change(self.background, pooled)
            self._set_background(pooled)
        elif has_moved:
            self.background = None
            self._set_settings(used(self.bar, self.given))
        self._usual_power = self._leftover(windows)
        return change

    def _update_bar(self, windows: FloatArray) -> Generator[None, None, None]:
        """Takes the bar that another joint's look has confirmed, or looks."""
        for _ in range(PATIENCE):
            if not self._looks.under_way:
                break
            yield
        if self._looks.confirmed is not self._served:
            self.bar, self._bar_due = self._looks.confirmed, self.seen + BAR_CHECK
        else:
            yield from self._look_at_bar(windows)
        self._served = self._looks.confirmed
        bare = used(self.bar, self.given)
        self._set_settings(replace(self.settings, f_res_hz=bare.f_res_hz, zeta=bare.zeta))

    def _look_at_bar(self, windows: FloatArray) -> Generator[None, None, None]:
        self._looks.under_way = True
        try:
            found = yield from finding(windows, self.rate_hz, self.given)
        finally:
            self._looks.under_way = False
        if found is None:
            return
        is_confirmed = agrees(self.bar, found, self.given)
        self.bar = moved(self.bar, found, self.given)
        if is_confirmed:
            self._bar_due, self._looks.confirmed = self.seen + BAR_CHECK, self.bar

    def _change_of_bar(self) -> BarChange | None:
        f_res, zeta = self.settings.f_res_hz, self.settings.zeta
        if abs(f_res / self._reported[0] - 1) < REPORT_HZ and abs(zeta / self._reported[1] - 1) < REPORT_ZETA:
            return None
        change = BarChange(self._reported, (f_res, zeta))
        self._reported = (f_res, zeta)
        return change

    def _set_background(self, background: Background) -> None:
        self.background = background
        self._set_settings(applied(background, used(self.bar, self.given)))

    def _set_settings(self, settings: DetectorSettings) -> None:
        """Replaces the settings, and drops the bank of the old ones."""
        if settings != self.settings:
            ringdown.forget(self._length, self.rate_hz, self.settings)
            self.settings = settings

    def _begin_block(self) -> None:
        """Begins the next block: windows taken evenly until the next comparison."""
        self._due = next((due for due in DUE if due > self.seen), (self.seen // DUE[-1] + 1) * DUE[-1])
        self._next = min(self._due, self.seen + CHECK)
        self._stride = max((self._next - self.seen) // BLOCK, 1)
        self._block: list[np.ndarray[tuple[int], np.dtype[np.float32]]] = []

    def _is_usual(self, windows: FloatArray) -> bool:
        """Whether the power of the residual of motion and rings is about that of the last estimate."""
        now = self._leftover(windows)
        if math.isnan(self._usual_power):
            self._usual_power = now
        return 1 / MOVED < now / self._usual_power < MOVED

    def _leftover(self, windows: FloatArray) -> float:
        return ringdown.leftover(windows, self.rate_hz, self.settings)

    def _change(self, before: Background | None, after: Background) -> Change:
        if before is None:
            return Change(math.nan, after.deviation, math.nan)
        difference = np.abs(spectrum(after.noise, POINTS) - spectrum(before.noise, POINTS))
        near_hz = float(np.argmax(difference)) / POINTS * self.rate_hz / 2
        return Change(before.deviation, after.deviation, near_hz)
