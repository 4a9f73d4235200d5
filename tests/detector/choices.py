"""The measurements behind docs/decisions/0002-score.md and 0003-trigger.md: ``python -m tests.detector.choices``."""

from __future__ import annotations

import itertools
import math

import numpy as np

from lostmotion.detector.score import batch
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings
from tests.detector.synthetic import FloatArray, HandWaved, Scene, quantise

SETTINGS = DetectorSettings(f_res_hz=58.0)
AX_12, X_SERIES = math.radians(300 / 1024), math.radians(360 / 4096)
COUNT = 3000


def drawn(scene: Scene, rate_hz: float, duration: float) -> tuple[FloatArray, FloatArray]:
    """The same healthy and worn windows for every choice."""
    rng = np.random.default_rng(1)
    worn = [scene.worn(rng, COUNT // 10, rate_hz, duration) for _ in range(10)]
    return scene.healthy(rng, COUNT, rate_hz, duration), np.concatenate(worn)


def verdict(healthy: FloatArray, worn: FloatArray) -> str:
    """Area under the ROC curve, and impacts missed when 1 % of the healthy windows cry wolf."""
    area = np.searchsorted(np.sort(healthy), worn).mean() / healthy.size
    return f"{area:.4f} {np.mean(worn <= np.quantile(healthy, 0.99)):6.1%}"


def candidate(accel: FloatArray, rate_hz: float, taper: float, order: int, power: int) -> FloatArray:
    """Eq. 8 with a Tukey window of any taper (0 rectangular, 1 Hann), any detrending, amplitudes or powers."""
    length = accel.shape[1]
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1, 1, length), order + 1))
    edge = np.minimum(np.arange(length) + 0.5, length - np.arange(length) - 0.5) / length
    slope = 0.5 - 0.5 * np.cos(2 * np.pi * edge / max(taper, 1e-9))
    rest = (accel - accel @ basis @ basis.T if order >= 0 else accel) * np.where(edge < taper / 2, slope, 1)
    spectrum = np.abs(np.fft.rfft(rest)) ** power
    mask, norm = (
        slice(*(min(math.ceil(f * length / rate_hz - 1e-9), (length + 1) // 2) for f in band))
        for band in ((52, 64), (80, 120))
    )
    return np.asarray(spectrum[:, mask].sum(axis=1) / spectrum[:, norm].mean(axis=1))


def shapes() -> None:
    """Window function, detrending, amplitude or power."""
    print("shape detrend     | amplitude, power at 200 Hz | amplitude, power at 1000 Hz")
    windows = {rate: drawn(Scene(impact=4), rate, 0.25) for rate in (200, 1000)}
    for (name, taper), order in itertools.product(
        (("rectangular", 0), ("Tukey 0.25", 0.25), ("Hann", 1)), (-1, 0, 1, 3)
    ):
        row = [
            verdict(*(candidate(x, rate, taper, order, power) for x in windows[rate]))
            for rate, power in itertools.product((200, 1000), (1, 2))
        ]
        print(f"{name:12s} {order:2d} | " + " | ".join(row))


def lengths() -> None:
    """Window length against the ring-down's time constant."""
    for zeta in (0.006, 0.012, 0.03):
        print(f"zeta {zeta}: 1.26 tau = {1.2564 / (2 * math.pi * 58 * zeta):.3f} s")
        for duration in (0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7):
            rows = (drawn(Scene(zeta=zeta, impact=4), rate, duration) for rate in (200, 1000))
            results = (
                verdict(batch(h, r, SETTINGS), batch(w, r, SETTINGS))
                for (h, w), r in zip(rows, (200, 1000), strict=True)
            )
            print(f"  {duration:4.2f} s | " + " | ".join(results))


def levels() -> None:
    """What a level does: healthy windows above it, worn windows below it."""
    for name, scene in (("white noise", Scene(coloured=0, shaken=0)), ("coloured", Scene()), ("weak", Scene(impact=4))):
        for rate in (200, 500, 1000):
            healthy, worn = (batch(x, rate, SETTINGS) for x in drawn(scene, rate, 0.25))
            shares = (
                f"{level}: {np.mean(healthy > level):.1%}/{np.mean(worn <= level):.1%}" for level in (4, 6, 8, 10)
            )
            middle = f"median {np.median(healthy):.1f} and {np.median(worn):.1f}"
            print(f"{name:12s} {rate:4d} Hz {middle}; " + ", ".join(shares))


def reversals() -> None:
    """Recall of strong reversals, precision, timing and latency of the trigger on hand-waved motions."""
    motions = ((0.5, 0.9, 0.3), (0.8, 1.2, 0.3), (1.5, 3.0, 0.15), (0.5, 3.0, 0.05))
    for rate, step, jitter in itertools.product((50, 100, 1000), (AX_12, X_SERIES, 0.0), (0, 1)):
        if step or not jitter:
            row = " | ".join(_reversals(rate, step, jitter, *motion) for motion in motions)
            print(f"{rate:4d} Hz {math.degrees(step):.3f}° {'±1 step' if jitter else '       '} {row}")


def _reversals(rate: int, step: float, jitter: int, low: float, high: float, rms: float) -> str:
    duration, strong, hit, found = 40.0, 0, 0, 0
    errors: list[float] = []
    delays: list[float] = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        motion = HandWaved.draw(rng, low, high, rms)
        time = np.arange(0, duration, 1 / rate)
        angle = quantise(motion.angle(time), step) + jitter * step * rng.integers(-1, 2, time.size)
        seen = [r for r in Trigger(SETTINGS, rate, step).push(time, angle) if 0.5 < r.time < duration - 0.5]
        truth = motion.reversals(duration)
        least = 0.5 * float(np.sqrt(np.mean(motion.acceleration(time) ** 2)))
        wanted = motion.reversals(duration, least)
        wanted = wanted[(wanted > 0.6) & (wanted < duration - 0.6)]
        times = np.array([r.time for r in seen])
        nearest = truth[np.abs(truth - times[:, None]).argmin(axis=1)] if seen else times
        right = np.abs(nearest - times) < 0.1
        errors += list((times - nearest)[right])
        delays += [r.seen - t for r, t, good in zip(seen, nearest, right, strict=True) if good]
        found += len(seen)
        strong += wanted.size
        hit += sum(bool((np.abs(times - t) < 0.1).any()) for t in wanted)
    late = np.quantile(delays, (0.5, 0.95)) * 1e3
    return (
        f"{hit / strong:6.1%} {len(errors) / found:6.1%} {np.std(errors) * 1e3:3.0f} ms {late[0]:.0f}/{late[1]:.0f} ms"
    )


if __name__ == "__main__":
    for table in (shapes, lengths, levels, reversals):
        print(f"\n{table.__doc__}")
        table()
