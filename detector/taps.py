"""The oscillator from recordings of taps on the bar: finds the taps, removes mains hum, pools.

``oscillator_id`` has one ring-down; here are whole recordings, and the test for aliasing by two rates.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lostmotion.detector.errors import DetectorError
from lostmotion.detector.oscillator_id import LOWEST_HZ, Oscillator, identify
from lostmotion.detector.pooling import Z
from lostmotion.detector.window import FloatArray

__all__ = ["Calibrated", "Estimate", "TapRecording", "find_taps", "pooled", "true_frequency"]

BLOCK_S = 0.025
"""Length of the blocks in which loudness is computed: no shorter than a period of most bars."""
JUMP = 3.0
"""A tap is at least so many times as loud as the three blocks before it ..."""
SHARE = 0.1
"""... and as this share of the loudest one."""
LONGEST_S = 5.0
"""Longest part of a ring-down that is used."""
MAINS_HZ = (50.0, 60.0)
MAINS_OFF_HZ = 0.3
"""How far mains, or the sensor's clock, may be off."""
HARMONICS = 4
SIGNIFICANT, PARTS = 5.0, 8
"""Amplitude of a line in standard deviations from which it is hum: in those of white noise, and in those found from
the line's amplitudes in so many parts of the recording.  Hum is steady.  The ends of rings are not: without the parts
18 of 100 recordings of a bar of 58 Hz had a line of 60 Hz (6 taps in 12 s, noise of 0.1 m/s²)."""
SILENT, TAIL = 1.5, 8
"""A ring-down ends at so many times the noise floor; twice its length and so many blocks are used."""
QUIET = 0.3
"""Share of the quietest blocks, from which noise and hum are estimated."""
NEAR_NYQUIST = 0.9
LEAST_ZETA = 1e-3
"""Least damping of a clamped bar with a sensor: an estimate below it is residual hum."""
UNUSUAL_ZETA = 0.03
"""A clamped metal bar is damped less; more means a loose clamp, or a resonance that is aliased to a low frequency."""
SAME = 0.01
"""Two frequencies that differ by less than this share are the same."""
ALIASES = 8
"""Multiples of the sampling rate that are tried."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value and the ends of its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class TapRecording:
    """The result of one recording: the ring-downs, its rate [Hz], the standard deviation of that as a share of it, and
    the mains frequency that was removed, or None."""

    rings: tuple[Oscillator, ...]
    rate_hz: float
    rate_error: float
    mains_hz: float | None

    @property
    def f_res_hz(self) -> float:
        """The median of the apparent resonance at this rate [Hz]."""
        return float(np.median([ring.f_res_hz for ring in self.rings]))


@dataclass(frozen=True, slots=True)
class Calibrated:
    """The oscillator, pooled over all taps; warnings: one line each."""

    f_res_hz: Estimate
    zeta: Estimate
    taps: int
    mains_hz: float | None
    warnings: tuple[str, ...]


def find_taps(times: FloatArray, accel: FloatArray) -> TapRecording:
    """Every ring-down in tip acceleration [m/s²] at times [s], shape (N,), that can be measured.

    Hum is a steady line within 0.3 Hz of mains or its harmonics, fitted where nothing rings.  Raises DetectorError when
    no tap is found, with the reason of the first that could not be measured.
    """
    values, rate_hz, rate_error = _on_grid(times, accel)
    if values.size < rate_hz / LOWEST_HZ:
        raise DetectorError(f"found {values.size / rate_hz:.2g} s of samples, expected a recording of some seconds")
    there = np.isfinite(values)
    rest = np.where(there, values - _moving_mean(values, there, round(rate_hz / LOWEST_HZ)), 0.0)
    hum, lines = np.zeros(rest.size), tuple[float, ...]()
    for _ in range(2):  # the quiet blocks are found better without the hum
        hum, lines = _hum(rest, there & _quiet(rest - hum, rate_hz), rate_hz)
    rest -= hum
    rings: list[Oscillator] = []
    refused = ""
    for begin, end in _segments(rest, rate_hz):
        try:
            ring = identify((values - hum)[begin:end], rate_hz, lines)
            rings += [ring] if ring.zeta > LEAST_ZETA else []
        except DetectorError as error:
            refused = refused or str(error)
    if not rings:
        raise DetectorError(refused or "nothing in it is sudden and then decays; expected taps: was the bar tapped?")
    mains_hz = min(MAINS_HZ, key=lambda mains: abs(mains - lines[0])) if lines else None
    return TapRecording(tuple(_alike(rings)), rate_hz, rate_error, mains_hz)


def pooled(recordings: Sequence[TapRecording]) -> Calibrated:
    """Weighted means over all taps; where taps scatter more than their noise explains, the intervals grow (Birge 1932).

    Recordings at several rates decide whether the resonance is aliased (``true_frequency``); with one rate there is a
    warning where it may be.  Raises DetectorError when recordings of one rate disagree.
    """
    true_hz = true_frequency([(r.f_res_hz, r.rate_hz) for r in recordings])
    several_rates = len({round(r.rate_hz) for r in recordings}) > 1
    fastest = max(recordings, key=lambda r: r.rate_hz)
    kept = [r for r in recordings if abs(r.f_res_hz / fastest.f_res_hz - 1) < SAME]
    rings = [ring for r in kept for ring in r.rings]
    if len(kept) < len(recordings) and true_hz is None:
        shown = ", ".join(f"{r.f_res_hz:.1f} Hz at {r.rate_hz:.4g} samples a second" for r in recordings)
        raise DetectorError(f"the recordings show different resonances: {shown}; expected taps on one and the same bar")
    f_res = _mean([(ring.f_res_hz, ring.f_res_std) for ring in rings], _common_error(kept))
    zeta = _mean([(ring.zeta, ring.zeta_std) for ring in rings])
    warnings = _aliasing(f_res.value, zeta.value, fastest.rate_hz, true_hz if several_rates else None)
    if len(rings) < 3:
        warnings.append(f"{len(rings)} tap(s) are too few to see how well they agree; expected at least 3")
    mains = next((r.mains_hz for r in recordings if r.mains_hz), None)
    return Calibrated(f_res, zeta, len(rings), mains, tuple(warnings))


def true_frequency(shown: Sequence[tuple[float, float]]) -> float | None:
    """The lowest frequency [Hz] with each of these (apparent frequency, rate) [Hz]; None when there is none.  A
    frequency f sampled at a rate r appears at the least |f - k r| over integers k.
    """
    first, rate = shown[0]
    for candidate in sorted(abs(k * rate + sign * first) for k in range(ALIASES + 1) for sign in (-1, 1)):
        if all(abs(_shown(candidate, r) - f) < SAME * f for f, r in shown):
            return candidate
    return None


def _aliasing(f_res: float, zeta: float, rate: float, true_hz: float | None) -> list[str]:
    if true_hz is not None:
        if abs(true_hz / f_res - 1) < SAME:
            return []
        shows = f"of which {rate:.4g} samples a second show {f_res:.1f} Hz (aliased)"
        return [f"the bar rings at {true_hz:.1f} Hz, {shows}: take a faster sensor or a longer bar"]
    if f_res <= NEAR_NYQUIST * rate / 2 and zeta <= UNUSUAL_ZETA:
        return []
    others = ", ".join(f"{abs(k * rate + sign * f_res):.0f}" for k, sign in ((1, -1), (1, 1), (2, -1)))
    why = f"{f_res:.1f} Hz is near half of the rate" if zeta <= UNUSUAL_ZETA else f"zeta {zeta:.3f} is high for a bar"
    doubt = f"{why}: the bar may really ring at {others} Hz (aliased); taps recorded at another rate as well decide it"
    return [doubt]


def _common_error(recordings: Sequence[TapRecording]) -> float:
    """Standard deviation, as a share, of the resonance by errors of the rates, each of which is that of all taps of a
    recording."""
    taps = np.array([len(recording.rings) for recording in recordings])
    return float(np.linalg.norm(taps * [recording.rate_error for recording in recordings]) / taps.sum())


def _mean(estimates: list[tuple[float, float]], common: float = 0.0) -> Estimate:
    """Weighted mean and its interval: by the estimates' own standard deviations or by their scatter, whichever is
    wider; common: standard deviation of an error of all of them, as a share."""
    values, stds = (np.array(column) for column in zip(*estimates, strict=True))
    # No clock and no bar is steadier than this, whatever the standard deviation of the fit.
    weights = 1 / (stds**2 + (1e-5 * values) ** 2)
    mean = float(np.sum(weights * values) / weights.sum())
    scatter = float(np.sum(weights * (values - mean) ** 2)) / max(values.size - 1, 1)
    half = max(Z, _student(values.size - 1) * math.sqrt(scatter)) / math.sqrt(float(weights.sum()))
    half = math.hypot(half, Z * common * mean)
    return Estimate(mean, mean - half, mean + half)


def _student(freedom: int) -> float:
    """97.5 % quantile of Student's t (Cornish-Fisher, within 3 % from 2 degrees on); of one tap that of the normal."""
    if freedom < 1:
        return Z
    n, z = max(freedom, 2), Z
    return z + (z**3 + z) / (4 * n) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2) + 0.24 * (n == 2)


def _alike(rings: list[Oscillator]) -> list[Oscillator]:
    """Without resonances more than 5 % from that with the least standard deviation: they are no taps on this bar."""
    best = min(rings, key=lambda ring: ring.f_res_std / ring.f_res_hz)
    return [ring for ring in rings if abs(ring.f_res_hz / best.f_res_hz - 1) < 5 * SAME]


def _on_grid(times: FloatArray, accel: FloatArray) -> tuple[FloatArray, float, float]:
    """The samples at even steps, NaN where there is none, their rate [Hz] and its standard deviation as a share of it.

    A sensor samples evenly; what its samples are stamped with, a clock of the host, may wander by milliseconds.  The
    period is therefore the slope of all times over the samples' numbers.  A long step of time is of samples that are
    missing or of the stamps alone: whichever leaves the smaller residuals.
    """
    steps = np.diff(times)
    usual = steps[steps < 1.5 * float(np.mean(steps))] if steps.size > 1 else steps
    period = float(np.mean(usual)) if usual.size else 0.0
    if not period > 0:
        raise DetectorError(f"samples: found {times.size}, expected a recording of some seconds with ascending times")
    apart = np.maximum(np.rint(steps / period), 1).astype(np.intp)
    each = [_line_through(np.concatenate([[0], np.cumsum(jump)]), times) for jump in (np.ones_like(apart), apart)]
    number, period, error = min(each, key=lambda one: one[0])[1:]
    values = np.full(number[-1] + 1, np.nan)
    values[number] = accel
    return values, 1 / period, error / period


def _line_through(number: NDArray[np.intp], times: FloatArray) -> tuple[float, NDArray[np.intp], float, float]:
    """Least squares of times over the samples' numbers: sum of squared residuals, the numbers, the slope, and its
    standard deviation from the residuals of ``PARTS`` parts, as neighbours wander together."""
    away = number - number.mean()
    power = float(away @ away)
    slope = float(away @ times) / power
    left = times - times.mean() - slope * away
    of_parts = np.add.reduceat(away * left, np.linspace(0, times.size, PARTS, endpoint=False).astype(np.intp))
    error = math.sqrt(PARTS / (PARTS - 2) * float(of_parts @ of_parts)) / power
    return float(left @ left), number, slope, error


def _moving_mean(values: FloatArray, there: NDArray[np.bool_], width: int) -> FloatArray:
    """Mean over ``width`` samples around each, without the missing ones."""
    box = np.ones(max(width, 1))
    total = np.convolve(np.where(there, values, 0.0), box, mode="same")
    return np.asarray(total / np.maximum(np.convolve(there, box, mode="same"), 1))


def _loudness(rest: FloatArray, rate_hz: float) -> tuple[FloatArray, int]:
    """Root mean square of each block, and the samples of a block."""
    length = max(round(BLOCK_S * rate_hz), 2)
    blocks = rest[: rest.size // length * length].reshape(-1, length)
    return np.asarray(np.sqrt(np.mean(blocks**2, axis=1))), length


def _quiet(rest: FloatArray, rate_hz: float) -> NDArray[np.bool_]:
    """Which samples lie in the quietest blocks."""
    loudness, length = _loudness(rest, rate_hz)
    calm = np.repeat(loudness <= np.quantile(loudness, QUIET), length) if loudness.size else np.empty(0, bool)
    return np.pad(calm, (0, rest.size - calm.size))


def _hum(rest: FloatArray, quiet: NDArray[np.bool_], rate_hz: float) -> tuple[FloatArray, tuple[float, ...]]:
    """Steady lines of mains and harmonics, fitted to the quiet samples, over all samples; their frequencies [Hz]."""
    time = np.arange(rest.size) / rate_hz
    t, y = time[quiet], rest[quiet]
    columns: list[FloatArray] = []
    lines: list[float] = []
    left = y
    for mains in sorted(MAINS_HZ, key=lambda mains: -abs(np.exp(-2j * np.pi * mains * t) @ y)):
        for harmonic in range(1, HARMONICS + 1):
            shown = [_shown(line, rate_hz) for line in (mains * harmonic, *lines)]
            if shown[0] < LOWEST_HZ or min(abs(shown[0] - other) for other in (*shown[1:], math.inf)) < 1:
                continue  # the slow motion, or a line that is removed already, covers it
            found = _line(t, left, mains * harmonic, float(time[-1])) if t.size > 4 * HARMONICS else None
            if found is None:
                break
            lines.append(found)
            columns += [np.cos(2 * np.pi * found * time), np.sin(2 * np.pi * found * time)]
            basis = np.column_stack(columns)
            size = np.linalg.lstsq(basis[quiet], y, rcond=None)[0]
            left = y - basis[quiet] @ size
    return (basis @ size if lines else np.zeros(rest.size)), tuple(lines)


def _shown(frequency_hz: float, rate_hz: float) -> float:
    """The apparent frequency [Hz] of one that may be above half of the rate."""
    return abs(frequency_hz - round(frequency_hz / rate_hz) * rate_hz)


def _line(t: FloatArray, values: FloatArray, near_hz: float, duration: float) -> float | None:
    """Frequency [Hz] of a line near ``near_hz``, None where none is significant."""
    step = 0.2 / max(duration, 1.0)
    tried = near_hz + np.arange(-MAINS_OFF_HZ, MAINS_OFF_HZ + step, step)
    sizes = np.abs(np.exp(-2j * np.pi * np.outer(tried, t)) @ values) * 2 / t.size
    top = int(np.argmax(sizes))
    if sizes[top] < SIGNIFICANT * float(np.std(values)) * math.sqrt(2 / t.size) or not _is_steady(
        t, values, tried[top]
    ):
        return None
    if not 0 < top < tried.size - 1:
        return float(tried[top])
    low, middle, high = sizes[top - 1 : top + 2]
    return float(tried[top] + 0.5 * step * (low - high) / (low - 2 * middle + high))


def _is_steady(t: FloatArray, values: FloatArray, frequency_hz: float) -> bool:
    """Whether one amplitude A explains those of all parts of the samples, A and conj(A) times the mirror image's."""
    turn = np.exp(-2j * np.pi * frequency_hz * t)
    each, image = (
        np.array([part.mean() for part in np.array_split(one, PARTS)]) for one in (turn * values, turn * turn)
    )
    parts = np.column_stack([1 + image, 1j * (1 - image)])
    design, seen = (np.concatenate([one.real, one.imag]) for one in (parts, each))
    explained = float(np.sum((np.linalg.qr(design)[0].T @ seen) ** 2))
    return bool(explained > SIGNIFICANT**2 * (float(seen @ seen) - explained) / (seen.size - 2))


def _segments(rest: FloatArray, rate_hz: float) -> list[tuple[int, int]]:
    """First and last sample of the segment after each sudden rise of loudness, with as much silence at its end."""
    loudness, length = _loudness(rest, rate_hz)
    before = np.array([np.max(loudness[max(i - 3, 0) : i], initial=0.0) for i in range(loudness.size)])
    floor = float(np.quantile(loudness, 0.1)) if loudness.size else 0.0
    loud = (loudness > JUMP * np.maximum(before, floor)) & (loudness > SHARE * np.max(loudness, initial=0.0))
    onsets = [int(i) for i in np.flatnonzero(loud) if i > 0]
    found = []
    for onset, following in zip(onsets, [*onsets, loudness.size + 1][1:], strict=True):
        silent = np.flatnonzero(loudness[onset:] < SILENT * floor)
        decay = int(silent[0]) if silent.size else loudness.size
        end = min(onset + 2 * decay + TAIL, following - 1, onset + round(LONGEST_S / BLOCK_S))
        if end - onset > 2:
            found.append(((onset - 1) * length, end * length))
    return found
