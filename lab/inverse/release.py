"""Selects the part of a recording without an input in which the motion is free.

``released`` leaves out what comes before the release: a hand that holds a pendulum up, a motor that still drives, a
blow on a beam.  The acceleration of a free motion is a function of position and speed.  This function is fitted where
the motion is surely free, from its largest speed on.  The motion counts as free back to where the function no longer
explains the acceleration.

It is applied before any fit of a search (lab/explanation.py).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab import policy
from lostmotion.lab.data.energy import energy_gain, energy_loss, gains_energy, loses_none
from lostmotion.lab.data.experiment import ACCEL, Experiment
from lostmotion.lab.data.series import is_onward
from lostmotion.lab.errors import ExperimentError
from lostmotion.lab.fitting.identifiability import coasts
from lostmotion.lab.inverse.signals import LEAST_SAMPLES, REGRESSORS, Signals, is_moving
from lostmotion.model.motion import FloatArray

__all__ = ["released"]

ORDER = 5
"""Degree of a local polynomial: over a third of a period of a sine its second derivative is right to 0.5 %."""
SMALL = 0.1
"""Share of the usual acceleration: the smallest error that counts."""
PERIOD = 3
"""Widths of the local polynomials in a period."""
TURNING = 0.1
"""Share of a period: the longest time in which a free motion turns."""
LEAST_HELD, RELEASES = 8, 200
"""Least number of readings to distinguish a rest that ends from a cubic: twice its parameters; and of times of release
that are tried: with 25, 50 and 1000, 24 simulated pendulums that are held for up to 20 s are cut at the same sample."""
TOP = 0.98
"""Share of the largest speed above which a shaft may still be driven: a driven shaft keeps its speed, apart from noise,
and a coasting one slows down at once."""
COAST_TURNS = 20
"""Number of turns after which a coasting shaft has slowed down by more than that: it does so unless dry friction stops
it after more than 260 turns, viscous friction after more than 500, while a wheel that stops after 60 turns has 0.97 of
its first half in the second one after five turns, and 0.99 after two.  A flywheel under speed control, with 100 turns
after its run-up, turned 1.5 % farther in the second half."""
COASTS = 0.1
"""What stands for the period of a shaft that coasts down, which has none: a share of the time that it takes."""
PAUSE = 3.0
"""Longest rest within one motion, in periods of the end of the band; a longer one separates two motions."""

BEFORE = "a hand, a motor or a blow acts there"
LOSSLESS = "if something drives it, choose its series with --map torque=SERIES (or current=, voltage=)"
log = logging.getLogger(__name__)


def released(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments, those without an input reduced to their free part; warnings report what is left out, and motions
    that lose no energy.  Raises ExperimentError for a shaft that keeps its speed without an input, and for a motion
    that gains energy."""
    free = {at: Signals.of(one) for at, one in enumerate(experiments) if not one.is_driven}
    parts = {at: _free_part(signals) for at, signals in free.items()}
    lossless = {at: many for at, one in free.items() if one.column != ACCEL and (many := _passages(one, parts[at]))}
    begins = {at: part.begins for at, part in parts.items() if part.begins > experiments[at].time[0]}
    _warn(experiments, begins, f"moves freely only from %s s on; what is before is left out ({BEFORE})")
    ends = {at: part.ends for at, part in parts.items() if part.acts_again}
    _warn(experiments, ends, "moves freely only until %s s; what is after is left out (something acts on it again)")
    _warn(experiments, lossless, f"passes a place %s times and loses no energy, as a motion that is driven; {LOSSLESS}")
    return tuple(
        one.between(parts[at].begins, parts[at].ends) if at in parts else one for at, one in enumerate(experiments)
    )


def _warn(experiments: Sequence[Experiment], told: Mapping[int, float], message: str) -> None:
    """Logs a message of one or more experiments once, with the number of the first, and the range of those of others;
    told: the number for each, by its place."""
    if not told:
        return
    (first, number), *others = told.items()
    name, said = experiments[first].name, f"{number:.4g}"
    if rest := [each for _, each in others]:
        name, said = f"{name} and {len(rest)} more", f"{said} ({min(rest):.4g} to {max(rest):.4g})"
    log.warning(f"%s: {message}", name, said)


def _passages(signals: Signals, part: _FreePart) -> int:
    """How often a part that loses no energy passes a place, 0 for any other.  Raises ExperimentError for one that gains
    energy, as a joint under control does, or one whose neighbour swings, and for one that loses none beside what may
    drive it and is not used.  The second mode of a mass may give it energy back."""
    free = (signals.time >= part.begins) & (signals.time <= part.ends)
    position, velocity = signals.position[free], signals.velocity[free]
    gain, (loss, passages) = energy_gain(position, velocity), energy_loss(position, velocity)
    if signals.column == "position" and gains_energy(gain, loss):
        raise ExperimentError(
            f"{signals.experiment.name}: found a motion that gains energy, as no free one does (where it passes a "
            f"place again, the square of its speed is larger by up to {100 * gain:.0f} % of the largest), and nothing "
            "that drives it; expected what does: choose its series with --map torque=SERIES (or current=, voltage=), "
            "or cut out the part that moves by itself"
        )
    if loses_none(loss) and (said := signals.experiment.left_drive):
        raise ExperimentError(
            f"{signals.experiment.name}: found a motion that passes a place {passages} times and loses no energy, as "
            f"one that is driven, and what may drive it is not used: {said}; if it moves freely all the same, use "
            "--map torque="
        )
    return passages if loses_none(loss) else 0


class _FreePart(NamedTuple):
    """The times between which a motion is free [s], and whether something acts again after it."""

    begins: float
    ends: float
    acts_again: bool


def _free_part(signals: Signals) -> _FreePart:
    """The part of a recording in which the motion is free.

    It begins after the last time at which the error of the acceleration, averaged over a third of a period, exceeds
    ``policy.MISSED`` times that of the surely free part.  Of an oscillator less than a period is not left out, as a
    second mode that dies down looks alike, unless it has less energy than the part after it.  A joint has no second
    mode, and a hand deflects it within half a period.

    A rest before the motion is left out if it is longer than that of a free motion at its turning points, or ends like
    one that is held: a pendulum that falls from the upright hardly accelerates there, and no simulation from there
    follows it.  For an accelerometer half a period after it is left out as well, the longest time in which a blow does
    not push against the motion.

    The part ends with a rest that is at most as long as the motion, as the noise of a longer one narrows the band, or
    with the motion where something acts again afterwards.

    Raises ExperimentError for a part that keeps its speed all the same, as a motor's shaft does, and for a motion that
    is too short; see ``_check_length``.
    """
    motion, time = _LocalMotion.of(signals), signals.time
    _check_length(signals, motion)
    free, width, release, acts_again = motion.free, motion.width, 0, False
    if free.stop - free.start >= max(LEAST_SAMPLES, width) * REGRESSORS:  # a width is as good as one sample
        release, acts_again = _by_acceleration(signals, motion)
    begins, ends = motion.whole.start, motion.whole.stop
    is_held = signals.column != ACCEL and _is_held(motion.readings[: 2 * begins])
    if begins > TURNING * motion.period or is_held:
        release = max(release, begins + (motion.period // 2 if signals.column == ACCEL else 0))
    is_angle = signals.column == "position" and not signals.experiment.is_linear
    if is_angle and _keeps_speed(signals.position[max(begins, release) : ends]):
        raise _driven_error(signals)
    end = free.stop - 1 if acts_again else 2 * ends - begins
    return _FreePart(
        float(time[release]) if release else -math.inf, float(time[end]) if end < time.size else math.inf, acts_again
    )


def _check_length(signals: Signals, motion: _LocalMotion) -> None:
    """Raises ExperimentError for a motion of fewer samples than a local polynomial has, as a step of a controller, and
    for one that is at rest sooner after its largest speed than such a polynomial has parameters: 3 samples of a motor
    that is switched off, 77 and more of dropped arms."""
    name = signals.experiment.name
    if (found := motion.whole.stop - motion.whole.start) < motion.width:
        raise ExperimentError(
            f"{name}: found a motion of {found} samples and rests before and after it, expected at least "
            f"{motion.width} in motion: was it recorded too slowly, or was it moved by a step?"
        )
    found = motion.free.stop - motion.free.start
    if found <= ORDER and motion.whole.stop + motion.width < signals.time.size:
        raise ExperimentError(
            f"{name}: found a motion that rests {found} samples after its largest speed, expected more than {ORDER} of "
            "one that nothing drives: was it stopped by a drive or a brake, or is it no angle?"
        )


def _by_acceleration(signals: Signals, motion: _LocalMotion) -> tuple[int, bool]:
    """The sample of the release, by the error of the acceleration, 0 where nothing is left out; and whether something
    acts again after the motion."""
    free, width, off = motion.free, motion.width, motion.unexplained(signals.experiment.is_linear)
    usual = np.sqrt(max(np.mean(off[free] ** 2), SMALL**2 * np.mean(motion.acceleration[free] ** 2)))
    mean = np.sqrt(np.convolve(off**2, np.ones(width) / width, mode="same"))
    wrong = np.flatnonzero(mean[width : free.start] > policy.MISSED * usual)
    release = width + int(wrong[-1]) + 1 if wrong.size else 0
    after = mean[free.stop + width : -width] > policy.MISSED * usual
    acts_again = bool(signals.moving[motion.whole.stop :].any() if motion.coasts else after.any())
    shortest = 0 if signals.column == "position" or _is_pushed(signals, motion, release) else PERIOD * width
    return release if release >= shortest else 0, acts_again


def _is_pushed(signals: Signals, motion: _LocalMotion, release: int) -> bool:
    """Whether a mass has less energy before a sample than in as many after it, as one that a hand moves: a second mode
    adds energy, and no free motion gains some.  An accelerometer feels a blow, whatever it does to the energy."""
    if signals.column == ACCEL or not release:
        return False
    energy = motion.energy()
    return float(energy[:release].mean()) < float(energy[release : 2 * release].mean())


def _is_held(readings: FloatArray) -> bool:
    """Whether these first readings (N,) are a rest that ends suddenly: whether a constant up to some sample, and a
    square and a cube of the time since then, leave less than 1/``policy.MISSED`` of what a cubic leaves, which has as
    many parameters and follows a motion that is free from the first reading on."""
    if readings.size < LEAST_HELD:
        return False
    time = np.arange(readings.size, dtype=float)

    def left(*columns: FloatArray) -> float:
        inputs = np.stack([np.ones_like(time), *columns], axis=1)
        return float(np.linalg.norm(readings - inputs @ np.linalg.lstsq(inputs, readings)[0]))

    starts = np.unique(np.linspace(1, readings.size // 2, RELEASES, dtype=int))
    held = min(left((since := np.maximum(time - start, 0.0)) ** 2, since**3) for start in starts)
    return bool(policy.MISSED * held < left(time, time**2, time**3))


def _keeps_speed(angle: FloatArray) -> bool:
    """Whether a part with these angles (N,) turns more than once, in one direction, and farther in the second half of
    the time than in the first, beyond noise; or keeps its speed for ``COAST_TURNS``.  A weight or a spring turns a part
    on by a turn at most before it slows down."""
    first, second = np.abs(np.diff(angle[[0, angle.size // 2, -1]]))
    turns = np.ptp(angle) / (2 * np.pi)
    least = 1 / TOP if turns < COAST_TURNS else TOP
    return bool(turns > 1 and is_onward(angle) and second > least * first)


def _driven_error(signals: Signals) -> ExperimentError:
    """The error to raise for a shaft that does not slow down, as a free one does."""
    turns = np.ptp(signals.position) / (2 * np.pi)
    return ExperimentError(
        f"{signals.experiment.name}: found {turns:.3g} turns that do not slow down, and nothing that drives them; "
        "expected what does, or a shaft that coasts: choose its series with --map torque=SERIES (or current=, voltage=)"
    )


def _largest_motion(signals: Signals) -> slice:
    """The samples of the motion that covers the longest distance, of several that are separated by rests longer than a
    swing, as a free part does not begin to move again after one."""
    moving = np.flatnonzero(signals.moving)
    swing = 0.0 if coasts(signals.position[moving], signals.experiment.is_linear) else _period(signals, moving)
    rest = max(PAUSE / signals.band_hz, swing) / signals.step_s
    parts = np.split(moving, np.flatnonzero(np.diff(moving) > rest) + 1)
    largest = max(parts, key=lambda part: float(np.abs(signals.velocity[part]).sum()))
    return slice(int(largest[0]), int(largest[-1]) + 1)


def _last_fastest(velocity: FloatArray, share: float) -> int:
    """The index of the last of these samples (N,) whose speed is at least this share of the largest speed."""
    speed = np.abs(velocity)
    return int(np.flatnonzero(speed >= share * speed.max())[-1])


def _period(signals: Signals, part: slice | NDArray[np.intp]) -> float:
    """The period of a sine with the same mean squares of angle and speed as this part of a motion [s]."""
    swing = signals.position[part] - signals.position[part].mean()
    return float(2 * np.pi * np.sqrt(np.mean(swing**2) / np.mean(signals.velocity[part] ** 2)))


@dataclass(frozen=True, eq=False)
class _LocalMotion:
    """The readings, and position, speed and acceleration (N,) by local polynomials (Savitzky and Golay).

    width: of the polynomials, a third of a period [samples]; free: where the motion is surely free, from its largest
    speed until rest; whole: all samples of the motion; period: that of the motion [samples]; coasts: whether it is that
    of a shaft that nothing pulls back.
    """

    readings: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    width: int
    free: slice
    whole: slice
    period: int
    coasts: bool

    @classmethod
    def of(cls, signals: Signals) -> _LocalMotion:
        """The polynomials of the readings, not of the filtered position, as that has a transient at the beginning of a
        recording."""
        from scipy.signal import savgol_filter  # late, as everywhere in the lab

        step = signals.step_s
        moved = _largest_motion(signals)
        is_coast = coasts(signals.position[moved], signals.experiment.is_linear)
        top = TOP if is_coast else 1.0
        free = slice(moved.start + _last_fastest(signals.velocity[moved], top), moved.stop)
        coast = COASTS * (free.stop - free.start)
        period = coast if is_coast else _period(signals, free) / step
        width = max(2 * round(period / 6) + 1, ORDER + 3 + ORDER % 2)
        # the acceleration of a bar follows the same equation as its place
        raw = signals.experiment.interpolated(signals.column, signals.time)
        position, velocity, acceleration = (savgol_filter(raw, width, ORDER, order, step) for order in range(3))
        begin = max(moved.start, width)
        first = _last_fastest(velocity[begin : moved.stop], top) + begin
        last = int(np.flatnonzero(is_moving(velocity[begin : moved.stop]))[-1]) + begin + 1
        whole = round(coast if is_coast else _period(signals, moved) / step)
        return cls(raw, position, velocity, acceleration, width, slice(first, last), moved, whole, is_coast)

    def unexplained(self, is_linear: bool) -> FloatArray:
        """The acceleration less a function of position and speed (N,), which is fitted where the motion is surely free;
        is_linear: whether the position is a length."""
        inputs, found = self._law(is_linear)
        return np.asarray(self.acceleration - inputs @ found)

    def energy(self) -> FloatArray:
        """The energy of a mass on a spring with a cubic part, by that function (N,), per mass."""
        q, (constant, linear, cubic) = self.position, self._law(True)[1][:3]
        return np.asarray(self.velocity**2 / 2 - constant * q - linear * q**2 / 2 - cubic * q**4 / 4)

    def _law(self, is_linear: bool) -> tuple[FloatArray, FloatArray]:
        """The regressors of the acceleration (N, K), those of the position first, and their coefficients (K,)."""
        q, v = self.position, self.velocity
        laws = [np.ones_like(q), q, q**3, *([] if is_linear else [np.sin(q), np.cos(q)])]
        inputs = np.stack([*([] if self.coasts else laws), v, np.sign(v), v * np.abs(v)], axis=1)
        size = np.maximum(np.linalg.norm(inputs[self.free], axis=0), 1e-300)
        found = np.linalg.lstsq(inputs[self.free] / size, self.acceleration[self.free], rcond=1e-6)[0]
        return inputs, np.asarray(found / size)
