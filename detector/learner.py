"""When noise and bar of a joint are learnt, and from which of its windows.  How is ``background``'s and ``bar``'s."""

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

__all__ = ["BarChange", "Change", "Learner", "is_learning", "settled"]

DUE = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""After so many windows the noise is learnt again, then every 10 000: an hour of motion or two."""
BLOCK = 100
"""Windows of each time, taken evenly from all since the last one."""
CHECK = 500
"""After so many windows the noise is compared with the one that is known."""
MOVED = 1.3
"""A noise that is so many times as loud as it was, or as quiet, is learnt at once."""
BAR_CHECK = 2000
"""After so many windows resonance and damping are looked at again, and until a look has found what is known also
whenever the noise is due but the first time: looks of the first ten minutes were 28 % of the main thread's work."""
REPORT_HZ, REPORT_ZETA = 0.02, 0.3
"""Shares by which resonance or damping have to have moved to be told."""
ROUNDS, FIRST_ROUNDS = 1, 3
"""Rounds of ``background.learning`` that are done with each window that is heard, so that no window waits long for
another one's score: a round of 100 windows of 250 samples costs 8 ms, all of them 0.2 to 0.4 s.  The second while no
noise is known."""
POINTS = 512


@dataclass(frozen=True, slots=True)
class Change:
    """The noise of a joint is another one: standard deviations before (NaN: none was known) and after [m/s²], and where
    in the spectrum the difference is largest [Hz]."""

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
    """Resonance [Hz] and damping ratio of a joint's bar are others than were told last: before and after."""

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
    """Whether the noise is to be learnt: not where it has been calibrated."""
    return settings.noise_ms2 is None and not settings.noise_colour


def settled(windows: Iterable[FloatArray], rate_hz: float, settings: DetectorSettings) -> DetectorSettings:
    """The settings with the noise that a ``Learner`` knows after all these windows of one length; as they are where
    the noise has been calibrated.  The bar is the given one."""
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
    """Noise and bar of one joint's windows of ``length`` samples, from the windows that it hears.

    given: the settings of the file; settings: the same with noise, resonance and damping as they are known by now;
    seen: how many windows; background: None until the first 20 windows have told the noise; bar: None until windows
    have shown it.  Learning goes on in steps, one with each window, so that the noise of a block is
    known some 10 to 40 windows after it.
    """

    def __init__(self, settings: DetectorSettings, rate_hz: float, length: int) -> None:
        self.given = self.settings = settings
        self.background: Background | None = None
        self.bar: Bar | None = None
        self.seen = 0
        self.rate_hz = rate_hz
        self._length = length
        self._usual_power = math.nan
        self._work: Generator[None, None, Change | BarChange | None] | None = None
        self._bar_due = DUE[1]
        self._reported = (settings.f_res_hz, settings.zeta)
        self._begin_block()

    def resume(self, background: Background | None, seen: int, bar: Bar | None = None) -> None:
        """Goes on from what an earlier run has learnt of windows of the same bar, rate and length."""
        if background is None or background.length == self._length:
            self.bar = bar if self.given.follow_bar else None
            self._set_settings(used(self.bar, self.given))
            if background is not None:
                self._set_background(background)
            self._reported = (self.settings.f_res_hz, self.settings.zeta)
            self.seen = seen
            self._begin_block()

    def update(self, accel: FloatArray) -> Change | BarChange | None:
        """Takes the tip acceleration [m/s²] of a window, shape (N,); what has changed, if anything."""
        there = np.isfinite(accel)
        if accel.size != self._length or there.sum() < LEAST_SHARE * accel.size or np.ptp(accel[there]) == 0:
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
        """Does what is left of the learning that has begun; what has changed, if anything."""
        return self._advance(None)

    def _advance(self, rounds: int | None) -> Change | BarChange | None:
        """So many more rounds, None for all."""
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
        # What was learnt with another resonance may hold rings that were taken for noise.
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
        found = yield from finding(windows, self.rate_hz, self.given)
        if found is not None:
            if agrees(self.bar, found, self.given):
                self._bar_due = self.seen + BAR_CHECK
            self.bar = moved(self.bar, found, self.given)
            bare = used(self.bar, self.given)
            self._set_settings(replace(self.settings, f_res_hz=bare.f_res_hz, zeta=bare.zeta))

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
        """Scores by these from now on."""
        if settings != self.settings:
            ringdown.forget(self._length, self.rate_hz, self.settings)
            self.settings = settings

    def _begin_block(self) -> None:
        """The next windows to learn from: evenly from now until it is next looked at."""
        self._due = next((due for due in DUE if due > self.seen), (self.seen // DUE[-1] + 1) * DUE[-1])
        self._next = min(self._due, self.seen + CHECK)
        self._stride = max((self._next - self.seen) // BLOCK, 1)
        self._block: list[np.ndarray[tuple[int], np.dtype[np.float32]]] = []

    def _is_usual(self, windows: FloatArray) -> bool:
        """Whether what neither motion nor rings explain is about as loud as when the noise was last learnt."""
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
