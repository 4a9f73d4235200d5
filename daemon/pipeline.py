"""Servo samples and tip acceleration in, scored windows out.  Reads no clock, owns no thread, does no I/O."""

from __future__ import annotations

import heapq
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lostmotion.daemon.attributor import Attributor
from lostmotion.daemon.monitored_joint import Counts, JointPlan, MonitoredJoint, PendingWindow
from lostmotion.daemon.records import Origin
from lostmotion.daemon.ring import Ring
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.flank import FlankLaw
from lostmotion.detector.learner import BarChange, BarLooks, Change, Learner
from lostmotion.detector.play_size import HISTORY_S, learnt_play, near_part, segment_of
from lostmotion.detector.score import score_window
from lostmotion.detector.servo import ServoLaw
from lostmotion.detector.severity import with_severity
from lostmotion.detector.window import FloatArray, Score, Window
from lostmotion.detector.windows import cut
from lostmotion.drivers.base import ServoSample

__all__ = ["Learnt", "Pipeline", "Scored"]

LOOK_BACK_S, LOOK_BACK_POLLS = 2.0, 10
"""a reversal is certain only some time after it; the acceleration is kept for so many seconds and polls longer"""
GIVE_UP_S = 1.0
"""how long after its end a window waits for late acceleration [s]"""
MOST_TO_LEARN = 12
"""two windows of each of six joints, which often end at the same time"""
SERVO_SILENT_S = 5.0
"""a joint without samples for so long no longer holds back the release of acceleration [s]"""


@dataclass(frozen=True, slots=True)
class Scored:
    """A window and its score; origin: which joint the play comes from, for joints that share accelerometers;
    commands: times [s] and angles [rad] from COMMANDED_S before the window to its end, shape (2, M);
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


class Pipeline:
    """All joints of a robot.  ``rings`` by accelerometer; ``virtual``: data may come late and is waited for;
    ``attributors``: for joints that share accelerometers.

    Call ``servo`` with the new samples, then ``step``; then ``learn``, when no score is due.
    """

    def __init__(
        self,
        plans: Iterable[JointPlan],
        rings: Mapping[str, Ring],
        virtual: bool = False,
        attributors: Iterable[Attributor] = (),
    ) -> None:
        looks: defaultdict[str, BarLooks] = defaultdict(BarLooks)
        self._joints = {plan.joint: MonitoredJoint(plan, looks[plan.accelerometer]) for plan in plans}
        self._rings = rings
        self._virtual = virtual
        self._closed = False
        self.attributors = tuple(attributors)
        self._learnt: list[Learnt] = []
        self._to_learn: deque[tuple[MonitoredJoint, Window]] = deque()
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

    def _is_felt(self, joint: MonitoredJoint, accelerometer: str) -> bool:
        """Whether windows of this joint need that accelerometer."""
        shared = self._shared.get(joint.plan.joint)
        return accelerometer in (shared.accelerometers if shared else (joint.plan.accelerometer,))

    def _finish(self, joint: MonitoredJoint, now: float) -> Iterable[Scored]:
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

    def _score(self, joint: MonitoredJoint, pending: PendingWindow, ring: Ring) -> Scored | None:
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

    def _sized(self, joint: MonitoredJoint, score: Score, ring: Ring) -> Score:
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

    def _needed(self, joint: MonitoredJoint, ring: Ring) -> float:
        """From when on a joint may still need acceleration [s]."""
        oldest = joint.newest - LOOK_BACK_S - LOOK_BACK_POLLS / joint.plan.poll_hz
        if not self._virtual:
            oldest = max(oldest, ring.newest - SERVO_SILENT_S)
        starts = [pending.start for pending in joint.pending]
        return min([oldest, *starts]) - HISTORY_S - 1 / joint.plan.rate_hz
