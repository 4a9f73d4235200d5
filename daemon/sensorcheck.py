"""Whether an accelerometer measures its joints at all, judged by their windows and their motion.

A joint without sound evidence must not be called healthy.  Two kinds of evidence are followed here: the quality of the
last windows, and whether the readings follow the measured motion.  The poller reports what a driver notices (a missing
port, no bytes), ``losses.py`` lost samples.  No clock, no I/O.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from lostmotion.daemon.ring import Ring
from lostmotion.detector.lever import LONGEST_DELAY_S, Lever, delay, levers
from lostmotion.detector.quality import FULL_SCALE, IMPLAUSIBLE
from lostmotion.detector.window import FloatArray, Score, Window
from lostmotion.drivers.base import ServoSample

__all__ = ["LAST", "SensorCheck"]

LAST, SOUND_AGAIN = 10, 5
"""windows that are looked at; with none of them sound the sensor has failed, until so many are sound again"""
SPAN_S = 4.0
"""segment of motion that is compared with the readings [s]"""
DELAYED_SPAN_S = SPAN_S + 2 * LONGEST_DELAY_S
"""the same for readings that may come early or late [s]"""
FIRST_PACE_S, PACE_S = 5.0, 30.0
"""how often it is compared: until the verdicts are in, and then [s]"""
VERDICTS = 5
"""so many comparisons in a row have to find no motion, the opposite one, or one at another time"""
FELT = 0.25
"""a sensor shows less than this share of the lever: it does not measure the joint's motion.  A bar mounted askew by 45
degrees shows 0.7, a lever that nobody has configured more than 1"""
SURE = 3.0
"""standard errors between the lever and that share"""
BRISK = 3.0
"""rms of the joint's acceleration that is compared [rad/s²]: an angle that flickers by 5 mrad at rest shows 0.3"""
LARGEST_STEP = 0.5
"""angles that jump by more between two samples are those of a counter that has wrapped [rad]"""
FAULTS = {
    0: "does not feel the motion of {}: wrong axis, loose, or on another link",
    -1: "feels the motion of {} with the opposite sign: mounted the other way round; change the sign of axis or scale",
    -2: "feels the motion of {} at another time: its line or the servos' holds readings back, or stamps them wrongly",
}
"""what comparisons find that do not find the motion, which is 1"""
KINDS = ("flat", IMPLAUSIBLE, "clipped", "gappy", "short")
OF_LOSSES = ("gappy", "short")
CAUSES = {
    IMPLAUSIBLE: "shows what no accelerometer does, values without noise or beyond all numbers: "
    "another column, such as that of a clock, or a wrong unit",
    "clipped": "reaches the end of its range in every window: its range is too small for this bar",
    "gappy": "loses samples in every window: the line is too slow or noisy, or rate_hz is wrong",
    "short": "has no samples for part of every window: the line is too slow or noisy, or rate_hz is wrong",
}


class SensorCheck:
    """One accelerometer and the joints that move it; levers: their arms [m], by name."""

    def __init__(self, sensor: str, ring: Ring, levers_m: Mapping[str, float]) -> None:
        self._sensor = sensor
        self._ring = ring
        self._levers = dict(levers_m)
        self._moved = {joint: (array("d"), array("d")) for joint in levers_m}
        self._due = -math.inf
        self._windows: dict[str, deque[str]] = {joint: deque(maxlen=LAST) for joint in levers_m}
        self._unsound: dict[str, tuple[str, str]] = {}
        self._felt: dict[str, deque[int]] = {joint: deque(maxlen=VERDICTS) for joint in levers_m}
        self._comparisons = 0

    def moved(self, samples: Iterable[ServoSample]) -> None:
        """Takes measured angles of the joints, each in time order; others' samples are passed over."""
        for sample in samples:
            if sample.joint in self._moved and sample.position == sample.position:
                times, angles = self._moved[sample.joint]
                times.append(sample.time)
                angles.append(sample.position)

    def scored(self, window: Window, score: Score) -> None:
        """Takes a window of one of the joints.  One of little excitation is no evidence about the sensor, unless it has
        another fault."""
        kinds = set(score.quality.split(",")) - {"gentle"}
        if not kinds:
            return
        seen = self._windows[window.joint]
        seen.append("ok" if kinds == {"ok"} else next((kind for kind in KINDS if kind in kinds), "gappy"))
        sound = seen.count("ok")
        if sound >= SOUND_AGAIN:
            self._unsound.pop(window.joint, None)
        if sound or len(seen) < LAST:
            return
        (kind, often), *_ = Counter(seen).most_common()
        reported, _ = self._unsound.get(window.joint, ("", ""))
        # The most frequent cause is reported first; another one replaces it only when all windows have it.
        if not reported or (kind != reported and often == LAST):
            cause = _held(window.accel, self._ring.range_ms2) if kind == "flat" else CAUSES[kind]
            self._unsound[window.joint] = (kind, f"{self._sensor} {cause} (no sound window in {LAST})")

    def look(self, now: float, *, is_last: bool = False) -> None:
        """Compares readings and motion when that is due, or there will be no more, at robot time ``now`` [s]."""
        if now < self._due and not is_last:
            return
        decided = all(len(felt) == VERDICTS and len(set(felt)) == 1 for felt in self._felt.values())
        self._due = now + (PACE_S if decided else FIRST_PACE_S)
        self._comparisons += 1
        angles = self._stretch()
        found = levers(*self._ring.slice(now - SPAN_S, math.inf), [_last(*one) for one in angles]) if angles else ()
        brisk = {joint: lever for joint, lever in zip(self._moved, found or (), strict=False) if lever.motion >= BRISK}
        verdicts = {joint: self._verdict(joint, lever) for joint, lever in brisk.items()}
        is_known = all(felt.count(1) == VERDICTS for felt in self._felt.values())
        if brisk and not is_known and delay(*self._ring.slice(now - DELAYED_SPAN_S, math.inf), angles):
            verdicts = dict.fromkeys(brisk, -2)
        for joint, verdict in verdicts.items():
            if verdict is not None:
                self._felt[joint].append(verdict)

    def fault(self, joint: str, is_lossy: bool = False) -> str:
        """What keeps the sensor from measuring this joint, "" for nothing known; is_lossy: what follows from lost
        samples is known already."""
        kind, reported = self._unsound.get(joint, ("", ""))
        if reported and not (is_lossy and kind in OF_LOSSES):
            return reported
        felt = self._felt[joint]
        if len(felt) == VERDICTS and max(felt) < 1:
            return f"{self._sensor} {FAULTS[max(FAULTS, key=felt.count)]}".format(joint)
        return ""

    def doubt(self, joint: str) -> str:
        """Why the sensor may not measure this joint, "" for no reason: it was compared, and has never felt the motion,
        or only the opposite one.  One comparison may err, so this is no fault; it only makes windows no evidence."""
        felt = self._felt[joint]
        return f"{self._sensor} has not felt the motion of {joint} yet" if felt and max(felt) < 1 else ""

    def comparisons(self, joint: str) -> int | None:
        """How many comparisons there have been, conclusive or not; None when the sensor is known to feel this joint, or
        the servo reports no angle that could be compared."""
        is_measured = bool(self._moved[joint][0])
        return self._comparisons if is_measured and 1 not in self._felt[joint] else None

    def _verdict(self, joint: str, lever: Lever) -> int | None:
        """What a comparison has found of a joint that moves; None where it is not sure."""
        limit = FELT * abs(self._levers[joint])
        if abs(abs(lever.value) - limit) <= SURE * lever.error:
            return None
        return 0 if abs(lever.value) < limit else 1 if lever.value * self._levers[joint] > 0 else -1

    def _stretch(self) -> Sequence[tuple[FloatArray, FloatArray]]:
        """The last angles of every joint; none where one of them is not measured, or has jumped."""
        for times, angles in self._moved.values():
            gone = bisect_left(times, times[-1] - DELAYED_SPAN_S) if times else 0
            del times[:gone], angles[:gone]
        segments = [(np.array(times), np.array(angles)) for times, angles in self._moved.values()]
        whole = all(
            len(times) > 2 and (np.diff(times) > 0).all() and np.abs(np.diff(angles)).max() < LARGEST_STEP
            for times, angles in segments
        )
        return segments if whole else ()


def _last(times: FloatArray, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Those of the last ``SPAN_S``."""
    first = np.searchsorted(times, times[-1] - SPAN_S)
    return times[first:], angles[first:]


def _held(accel: FloatArray, range_ms2: float) -> str:
    """What a sensor that shows one value may suffer from."""
    finite = accel[np.isfinite(accel)]
    value = float(finite[0]) if finite.size else math.nan
    if abs(value) >= FULL_SCALE * range_ms2:
        return f"stays at the end of its range, {value:.3g} m/s²: a broken wire, or gravity and a small range"
    return f"shows the same value all the time, {value:.3g} m/s²: wrong axis, a broken wire, or a sensor that hangs"
