"""Servo samples and tip acceleration in, scored windows out.  Reads no clock, owns no thread, does no I/O."""

from __future__ import annotations

import heapq
import math
from array import array
from bisect import bisect_left
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lostmotion.daemon.attributor import Attributor
from lostmotion.daemon.records import Origin
from lostmotion.daemon.ring import Ring
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.flank import FlankLaw, law_of
from lostmotion.detector.learner import BarChange, Change, Learner, is_learning
from lostmotion.detector.play_size import HISTORY_S, SizeLaw, learnt_play, near_part, segment_of
from lostmotion.detector.score import score_window
from lostmotion.detector.servo import UNKNOWN, ServoLaw
from lostmotion.detector.severity import with_severity
from lostmotion.detector.trigger import Trigger
from lostmotion.detector.window import DetectorSettings, FloatArray, Score, Window
from lostmotion.detector.windows import cut, window_length
from lostmotion.drivers.base import ServoSample

__all__ = ["TOGETHER_S", "TOGETHER_STORE_ONLY_S", "Counts", "JointPlan", "Learnt", "Pipeline", "Scored"]

LOOK_BACK_S, LOOK_BACK_POLLS = 2.0, 10
"""a reversal is certain only some time after it; the acceleration is kept for so many seconds and polls longer"""
GIVE_UP_S = 1.0
"""how long after its end a window waits for late acceleration [s]"""
TOGETHER_S, TOGETHER_STORE_ONLY_S = 0.008, 0.03
"""windows that end within so long of each other are scored together [s]: each wake-up costs as much as a score; the
longer one without network sinks, when windows only have to be on the disk a quarter of a second after their end"""
MOST_TO_LEARN = 12
"""two windows of each of six joints, which often end at the same time"""
COMMANDS_S = 4.0
"""commands are kept for so long before the newest one, or before a window that waits: for the size of the play [s]"""
COMMANDED_S = 0.5
"""so much of the commanded motion before a window is kept with it: the reversal and what led to it [s]"""
SERVO_SILENT_S = 5.0
"""a joint without samples for so long no longer holds back the release of acceleration [s]"""


@dataclass(frozen=True, slots=True)
class JointPlan:
    """How one joint is monitored: its accelerometer, that one's rate, and the rate of the joint's commands [Hz]."""

    joint: str
    accelerometer: str
    rate_hz: float
    poll_hz: float
    settings: DetectorSettings


@dataclass(frozen=True, slots=True)
class Scored:
    """A window and its score; origin: which joint the play comes from, for joints that share accelerometers;
    commands: times [s] and angles [rad] from ``COMMANDED_S`` before the window to its end, shape (2, M);
    failure: the error that ended the estimate of the play and its severity, which the score then lacks."""

    window: Window
    score: Score
    origin: Origin | None = None
    commands: FloatArray = field(default_factory=lambda: np.empty((2, 0)))
    failure: Exception | None = None


@dataclass(frozen=True, slots=True)
class Learnt:
    """Noise or bar of a joint have been learnt again at that robot time [s]; change: whether it is another one."""

    joint: str
    time: float
    learner: Learner
    change: Change | BarChange | None


@dataclass(slots=True)
class Counts:
    """Windows of one joint: opened, scored, and lost by reason."""

    triggered: int = 0
    scored: int = 0
    lost: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True, order=True)
class _Pending:
    """A window that waits for its acceleration."""

    end: float
    start: float
    excitation: float
    temperature: float


class _Joint:
    """What is known of one joint while it runs."""

    def __init__(self, plan: JointPlan) -> None:
        self.plan = plan
        self.length = window_length(plan.settings, plan.rate_hz)
        self.trigger: Trigger | None = None
        self.pending: list[_Pending] = []
        self.newest = -math.inf
        self.temperature = math.nan
        self.law, self.law_windows, self.servo, self.size_law = law_of(plan.settings), 0, UNKNOWN, SizeLaw()
        self._times, self._angles = array("d"), array("d")
        self.counts = Counts()
        count = round(self.length * plan.rate_hz)
        self.learner = Learner(plan.settings, plan.rate_hz, count) if is_learning(plan.settings) else None

    @property
    def settings(self) -> DetectorSettings:
        """Those of the plan, with noise and bar as they are known by now."""
        return self.learner.settings if self.learner else self.plan.settings

    @property
    def bar_settings(self) -> DetectorSettings:
        """Those of the plan, with the bar as it is known by now."""
        given, known = self.plan.settings, self.settings
        if (given.f_res_hz, given.zeta) == (known.f_res_hz, known.zeta):
            return given
        return replace(given, f_res_hz=known.f_res_hz, zeta=known.zeta)

    def take(self, samples: list[ServoSample], resolution_rad: float, since: float) -> None:
        """Opens a window for every reversal in these samples' commands at or after ``since``."""
        if self.trigger is None:
            self.trigger = Trigger(self.plan.settings, self.plan.poll_hz, resolution_rad)
        last = samples[-1]
        self.newest = max(self.newest, last.time)
        if math.isfinite(last.temperature):
            self.temperature = last.temperature
        times, angles = [sample.time for sample in samples], [sample.command for sample in samples]
        self._times.extend(times)
        self._angles.extend(angles)
        for reversal in self.trigger.push(times, angles):
            if reversal.time < since:
                continue
            self.counts.triggered += 1
            window = _Pending(reversal.time + self.length, reversal.time, abs(reversal.swing), self.temperature)
            heapq.heappush(self.pending, window)
        waiting = self.pending[0].start if self.pending else math.inf
        gone = bisect_left(self._times, min(self.newest, waiting) - COMMANDS_S)
        del self._times[:gone], self._angles[:gone]

    @property
    def commands(self) -> FloatArray:
        """The last ones: times [s] and angles [rad], shape (2, M)."""
        return np.array((self._times, self._angles))

    def commanded(self, window: _Pending) -> FloatArray:
        """Those from shortly before a window to its end."""
        first = bisect_left(self._times, window.start - COMMANDED_S)
        last = bisect_left(self._times, window.end)
        return np.array((self._times[first:last], self._angles[first:last]))


class Pipeline:
    """All joints of a robot.  ``rings`` by accelerometer; ``virtual``: data may come late and is waited for;
    ``attributors``: for joints that share accelerometers; ``together_s``: windows that end within so long of each other
    are scored together [s].

    Call ``servo`` with the new samples, then ``step``; then ``learn``, when no score is due.
    """

    def __init__(
        self, plans: Iterable[JointPlan], rings: Mapping[str, Ring], virtual: bool = False,
        attributors: Iterable[Attributor] = (), together_s: float = TOGETHER_S,
    ) -> None:  # fmt: skip
        self._joints = {plan.joint: _Joint(plan) for plan in plans}
        self._rings = rings
        self._virtual = virtual
        self._together_s = together_s
        self._closed = False
        self.attributors = tuple(attributors)
        self._learnt: list[Learnt] = []
        self._to_learn: deque[tuple[_Joint, Window]] = deque()
        self._shared = {joint: attributor for attributor in self.attributors for joint in attributor.joints}
        self._behind = {
            name: [joint for joint in self._joints.values() if self._is_felt(joint, name)] for name in rings
        }

    @property
    def counts(self) -> dict[str, Counts]:
        """What became of the windows, by joint."""
        return {name: joint.counts for name, joint in self._joints.items()}

    @property
    def learners(self) -> dict[str, Learner]:
        """What learns the noise of each joint's windows; none for a joint whose noise has been calibrated."""
        return {name: joint.learner for name, joint in self._joints.items() if joint.learner}

    @property
    def laws(self) -> dict[str, tuple[FlankLaw, int, ServoLaw]]:
        """Each joint's flank law, the number of windows it was estimated from, and its servo law; joints whose flanks
        the settings fix are left out."""
        return {
            name: (joint.law, joint.law_windows, joint.servo)
            for name, joint in self._joints.items()
            if joint.law.is_learnt
        }

    def resume_law(
        self, joint: str, likelihood: tuple[float, ...], windows: int, servo: tuple[float, ...] = ()
    ) -> None:
        """Goes on from what an earlier run has learnt of a joint's flanks and servo, unless the settings fix it."""
        known = self._joints.get(joint)
        if known and known.law.is_learnt and len(likelihood) == len(known.law.likelihood):
            known.law, known.law_windows = replace(known.law, likelihood=likelihood), windows
        if known and len(servo) == len(known.servo.likelihood):
            known.servo = ServoLaw(servo)

    def learnt(self) -> list[Learnt]:
        """What has been learnt since the last call."""
        changes, self._learnt = self._learnt, []
        return changes

    @property
    def open_windows(self) -> int:
        """How many windows wait for their acceleration."""
        return sum(len(joint.pending) for joint in self._joints.values())

    def servo(self, samples: Iterable[ServoSample], resolution_rad: float) -> None:
        """Takes the samples of one bus, whose commands have steps of ``resolution_rad``."""
        if self._closed:
            return
        by_joint: dict[str, list[ServoSample]] = defaultdict(list)
        for sample in samples:
            by_joint[sample.joint].append(sample)
        for name, group in by_joint.items():
            joint = self._joints[name]
            # Hardware that has not begun to measure cannot lose a window; a virtual sensor may just be behind.
            since = -math.inf if self._virtual else self._rings[joint.plan.accelerometer].oldest
            joint.take(group, resolution_rad, since)

    def servo_ended(self, joint: str) -> None:
        """No more samples of this joint will come."""
        self._joints[joint].newest = math.inf

    def close(self) -> None:
        """Opens no more windows; those that are open are still finished by ``step``."""
        self._closed = True

    def step(self, now: float) -> list[Scored]:
        """The windows whose acceleration is there, or for which it is no longer waited at robot time ``now`` [s]."""
        done = [scored for joint in self._joints.values() if joint.pending for scored in self._finish(joint, now)]
        if self.attributors:
            done = self._attribute(done)
        for name, ring in self._rings.items():
            joints = self._behind[name]
            if self._virtual or ring.crowded:
                ring.release(min((self._needed(joint, ring) for joint in joints), default=math.inf))
            ends = (pending.end for joint in joints for pending in joint.pending)
            ring.expect(_together(ends, self._together_s))
        while self._virtual and self.learn():
            pass
        return done

    def learn(self) -> bool:
        """Holds the windows to come against the noise of those so far, by the next one that has been scored: some 8 ms
        of work, for which no other window's score shall wait.  Whether there was one."""
        if not self._to_learn:
            return False
        joint, window = self._to_learn.popleft()
        assert joint.learner is not None
        known = joint.learner.background, joint.learner.bar
        change = joint.learner.update(window.accel)
        now = joint.learner.background, joint.learner.bar
        if any(one is not other for one, other in zip(known, now, strict=True)):
            self._learnt.append(Learnt(joint.plan.joint, window.start + window.duration, joint.learner, change))
        return True

    @property
    def is_behind(self) -> bool:
        """Whether so many windows wait to be learnt from that it shall wait no longer."""
        return len(self._to_learn) > MOST_TO_LEARN

    def _attribute(self, done: list[Scored]) -> list[Scored]:
        """The same in time order, each with the present estimate of which joint has the play."""
        done.sort(key=lambda scored: scored.window.start)
        for scored in done:
            if scored.window.joint in self._shared:
                self._shared[scored.window.joint].add_window(scored.window)
        for attributor in self.attributors:
            attributor.step(self._rings, self._joints)
        if not done:
            return done
        origins = {joint: attributor.origin for joint, attributor in self._shared.items()}
        return [replace(scored, origin=origins.get(scored.window.joint)) for scored in done]

    def _is_felt(self, joint: _Joint, accelerometer: str) -> bool:
        """Whether windows of this joint need that accelerometer."""
        shared = self._shared.get(joint.plan.joint)
        return accelerometer in (shared.accelerometers if shared else (joint.plan.accelerometer,))

    def _finish(self, joint: _Joint, now: float) -> Iterable[Scored]:
        ring = self._rings[joint.plan.accelerometer]
        while joint.pending:
            end = joint.pending[0].end
            newest = min(ring.newest, joint.newest) if self._virtual and not self._closed else ring.newest
            late = not self._virtual and now > end + GIVE_UP_S
            if not (newest >= end or late):
                return
            scored = self._score(joint, heapq.heappop(joint.pending), ring)
            if scored:
                yield scored

    def _score(self, joint: _Joint, pending: _Pending, ring: Ring) -> Scored | None:
        plan = joint.plan
        period = 1 / plan.rate_hz
        times, accel = ring.slice(pending.start - period, pending.end + period)
        if not len(times):
            joint.counts.lost["no acceleration"] += 1
            return None
        window = cut(
            plan.joint, times, accel, pending.start, joint.length, plan.rate_hz, pending.excitation, pending.temperature
        )
        try:
            score = score_window(window, joint.settings, ring.range_ms2)
        except DetectorError as error:
            joint.counts.lost[str(error)] += 1
            return None
        if math.isnan(score.score):
            joint.counts.lost[score.quality] += 1
        else:
            joint.counts.scored += 1
        failure: Exception | None = None
        try:
            score = self._sized(joint, score, ring)
        except Exception as error:  # noqa: BLE001 - whether there was an impact is known all the same
            failure, score = error, replace(score, play_reason="internal error")
        scored = Scored(window, score, commands=joint.commanded(pending), failure=failure)
        if joint.learner is not None:
            self._to_learn.append((joint, window))
        return scored

    def _sized(self, joint: _Joint, score: Score, ring: Ring) -> Score:
        """The score with the size of the play and its severity, from before its reversal on."""
        plan, period, shared = joint.plan, 1 / joint.plan.rate_hz, self._shared.get(joint.plan.joint)
        if shared and not shared.is_sure(plan.joint):
            return replace(score, play_reason="another joint may have struck")
        around = ring.slice(score.time - HISTORY_S - period, score.time + score.duration + period)
        segment = segment_of(score, *around, plan.rate_hz)
        alone = shared.alone(segment, plan.accelerometer, self._joints) if shared else segment
        if alone is None:
            return replace(score, play_reason="too few commands of the other joints")
        times, angles = joint.commands
        settings, before = joint.bar_settings, joint.law
        sized, joint.law, joint.size_law, joint.servo = learnt_play(
            score, alone, times, angles, settings, joint.law, joint.servo, joint.size_law
        )
        joint.law_windows += joint.law is not before
        scored, joint.servo = with_severity(sized, near_part(score, alone), times, angles, settings, joint.servo)
        return scored

    def _needed(self, joint: _Joint, ring: Ring) -> float:
        """From when on a joint may still need acceleration [s]."""
        oldest = joint.newest - LOOK_BACK_S - LOOK_BACK_POLLS / joint.plan.poll_hz
        if not self._virtual:
            oldest = max(oldest, ring.newest - SERVO_SILENT_S)
        starts = [pending.start for pending in joint.pending]
        return min([oldest, *starts]) - HISTORY_S - 1 / joint.plan.rate_hz


def _together(ends: Iterable[float], within_s: float) -> list[float]:
    """Times in order: the last one of each group that lies within so long of its first."""
    groups: list[float] = []
    first = -math.inf
    for end in sorted(ends):
        if end <= first + within_s:
            groups[-1] = end
        else:
            groups.append(end)
            first = end
    return groups
