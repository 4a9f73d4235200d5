"""How fast windows are scored and commands are watched: `python -m bench.detector`.

Windows of 0.25 s at 1 kHz: all at once, beside the same steps written plainly with SciPy, window by window; and one by
one as the service gets them.  Commands
of one joint at 100 Hz, pushed one by one as the service does, beside `numpy.polyfit` through the same span.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy import fft, signal

from lostmotion.detector.attribution import Mover, evidence
from lostmotion.detector.play_size import play_size
from lostmotion.detector.score import batch, score_window
from lostmotion.detector.trigger import SPAN, Trigger
from lostmotion.detector.window import DetectorSettings, FloatArray, Window

__all__ = ["main"]

SETTINGS = DetectorSettings(f_res_hz=58.0, statistic="band")
RINGDOWN = DetectorSettings(f_res_hz=58.0, statistic="ringdown", noise_ms2=1.0)
JOINTS, POLL_HZ = 6, 100
JOINTS_MOVED = ((1.5, 0.10), (1.1, 0.25))
"""Rates [Hz] and lever arms [m] of two joints on one accelerometer."""


def plain(windows: FloatArray) -> FloatArray:
    """Eq. 8 as one writes it with SciPy: detrend, Tukey window, rfft, mean over 80-120 Hz, sum over 52-64 Hz."""
    taper = signal.windows.tukey(250, 0.25)
    scores = np.empty(len(windows))
    for index, accel in enumerate(windows):
        spectrum = np.abs(fft.rfft(signal.detrend(accel) * taper))
        scores[index] = np.sum(spectrum[13:16] / np.mean(spectrum[20:30]))
    return scores


def polyfits(times: list[float], angles: list[float]) -> None:
    """The trigger's parabola by its definition, at each sample."""
    points = round(SPAN * POLL_HZ) + 1
    for end in range(points, len(times)):
        np.polyfit(times[end - points : end], angles[end - points : end], 2)


def best(work: Callable[[], object], repeats: int = 5) -> float:
    """Shortest of several runs [s]."""
    spans = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        spans.append(time.perf_counter() - start)
    return min(spans)


def in_service(windows: FloatArray) -> dict[str, float]:
    """Seconds for each window that comes alone: its quality and score, on top the size of the play and whose it is."""
    time_s = np.arange(windows.shape[1]) / 1000
    cut = [Window("elbow", 0.0, 0.25, time_s, accel, 1000.0, 20.0) for accel in windows]
    long = np.random.default_rng(1).normal(size=(200, 450))
    segments = [Window("elbow", 0.0, 0.45, np.arange(450) / 1000, accel, 1000.0) for accel in 20 * long]
    polls = np.arange(-0.2, 0.45, 0.01)
    angles = 0.3 * np.sin(2 * np.pi * 1.5 * polls)

    def score_all(settings: DetectorSettings) -> None:
        for window in cut:
            score_window(window, settings)

    def size_all() -> None:
        for segment in segments:
            play_size(segment, polls, angles, RINGDOWN)

    polled = np.array(polls)
    movers = [Mover(polled, 0.3 * np.sin(2 * np.pi * rate * polled), (lever,)) for rate, lever in JOINTS_MOVED]

    def attribute_all() -> None:
        for segment in segments:
            evidence([segment], movers, [RINGDOWN], 0.2)

    return {
        "eq. 8": best(lambda: score_all(SETTINGS)) / len(cut),
        "ringdown": best(lambda: score_all(RINGDOWN)) / len(cut),
        "size of the play": best(size_all, 3) / len(segments),
        "which of two joints": best(attribute_all, 3) / len(segments),
    }


def push_all(times: list[float], angles: list[float]) -> None:
    """One sample a push."""
    trigger = Trigger(SETTINGS, POLL_HZ, np.radians(300 / 1024))
    for moment, angle in zip(times, angles, strict=True):
        trigger.push((moment,), (angle,))


def main() -> None:
    """Prints both tables."""
    windows = np.random.default_rng(0).normal(size=(20_000, 250))
    ours, theirs = best(lambda: batch(windows, 1000.0, SETTINGS)), best(lambda: plain(windows), 2)
    count = len(windows)
    print(f"eq. 8   {count / ours:9,.0f} windows/s  plain SciPy {count / theirs:9,.0f}  x {theirs / ours:.1f}")
    knowing = best(lambda: batch(windows, 1000.0, RINGDOWN), 2)
    print(f"ringdown{count / knowing:9,.0f} windows/s  plain SciPy {count / theirs:9,.0f}  x {theirs / knowing:.1f}")
    for name, span in in_service(windows[:500]).items():
        print(f"{name:24} {span * 1e6:7.0f} µs a window, one by one as in service")
    seconds = np.arange(0, 60, 1 / POLL_HZ)
    angles = np.round(0.3 * np.sin(2 * np.pi * 0.8 * seconds) * 1024 / np.radians(300)) * np.radians(300) / 1024
    pushed = best(lambda: push_all(seconds.tolist(), angles.tolist())) / seconds.size
    fitted = best(lambda: polyfits(seconds.tolist(), angles.tolist()), 1) / seconds.size
    print(f"trigger {pushed * 1e6:9.1f} µs a sample  polyfit {fitted * 1e6:13.1f}  x {fitted / pushed:.1f}")
    print(f"        {JOINTS} joints at {POLL_HZ} Hz: {JOINTS * POLL_HZ * pushed:.2%} of a core")


if __name__ == "__main__":
    main()
