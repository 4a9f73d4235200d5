"""The pipeline: which windows are opened, when they are scored, and what is said of those that are lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lostmotion.daemon import pipeline
from lostmotion.daemon.monitored_joint import JointPlan
from lostmotion.daemon.pipeline import GIVE_UP_S, Pipeline, Scored
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.waker import Waker
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.base import AccelBlock, ServoSample

SETTINGS = DetectorSettings(f_res_hz=58.0)
RATE_HZ, POLL_HZ = 1000.0, 100.0
WAVE_HZ = 1.0


class World:
    """One joint that swings at WAVE_HZ, and its ring, both fed by hand."""

    def __init__(self, virtual: bool = False, range_ms2: float = 100.0) -> None:
        self.waker = Waker()
        self.ring = Ring(20_000, self.waker)
        self.ring.range_ms2 = range_ms2
        plan = JointPlan("elbow", "tip", RATE_HZ, POLL_HZ, SETTINGS)
        self.pipeline = Pipeline([plan], {"tip": self.ring}, virtual)

    def move(self, start: float, end: float) -> None:
        """The joint's samples from ``start`` to ``end`` [s]."""
        times = np.arange(round(start * POLL_HZ), round(end * POLL_HZ)) / POLL_HZ
        commands = 0.5 * np.sin(2 * math.pi * WAVE_HZ * times)
        samples = [
            ServoSample("elbow", float(t), float(c), 0.0, temperature=41.0)
            for t, c in zip(times, commands, strict=True)
        ]
        self.pipeline.servo(samples, 0.0)

    def feel(self, start: float, end: float, rings_at: float = math.inf) -> None:
        """Noise of 0.1 m/s² from ``start`` to ``end`` [s], and a ring-down of 5 m/s² at 58 Hz from ``rings_at`` on."""
        times = np.arange(round(start * RATE_HZ), round(end * RATE_HZ)) / RATE_HZ
        since = np.clip(times - rings_at, 0, None)
        accel = np.random.default_rng(1).normal(0, 0.1, len(times))
        accel += 5 * np.exp(-0.012 * 2 * math.pi * 58 * since) * np.sin(2 * math.pi * 58 * since)
        self.ring.push(AccelBlock(times, accel))


def starts(done: list[Scored]) -> list[float]:
    """When the windows began [s]."""
    return [scored.window.start for scored in done]


def test_every_reversal_is_scored() -> None:
    """A sine of 1 Hz reverses its acceleration every 0.5 s, and each is one window with excitation and temperature."""
    world = World()
    world.feel(0.0, 10.0)
    world.move(0.0, 9.0)
    done = world.pipeline.step(10.0)
    assert np.diff(starts(done)) == pytest.approx(np.full(len(done) - 1, 0.5), abs=0.01)
    assert 15 <= len(done) <= 17
    peak = 0.5 * (2 * math.pi * WAVE_HZ) ** 2
    assert done[-1].score.excitation == pytest.approx(peak, rel=0.3)
    assert done[-1].score.temperature == 41.0
    assert world.pipeline.counts["elbow"].scored == len(done)
    assert world.pipeline.counts["elbow"].lost.total() == 0
    times, angles = done[-1].commands
    start = done[-1].window.start
    assert (times[0], times[-1]) == pytest.approx((start - 0.5, start + done[-1].window.duration), abs=0.021)
    assert angles == pytest.approx(0.5 * np.sin(2 * math.pi * WAVE_HZ * times), abs=1e-9)


def test_no_score_waits_for_learning() -> None:
    """Windows are learnt from one by one when ``learn`` is called, after all of them have been scored; where time is
    not real, at once."""
    for virtual in (False, True):
        world = World(virtual)
        world.feel(0.0, 10.0)
        world.move(0.0, 9.0)
        count = len(world.pipeline.step(10.0))
        learner = world.pipeline.learners["elbow"]
        assert learner.seen == (count if virtual else 0)
        assert world.pipeline.is_behind == (not virtual)
        while world.pipeline.learn():
            pass
        assert learner.seen == count


def test_an_impact_scores_higher_than_none() -> None:
    """The window in which the bar rings stands out of the others by far."""
    world = World()
    world.feel(0.0, 10.0, rings_at=5.05)
    world.move(0.0, 9.0)
    done = world.pipeline.step(10.0)
    loud = [scored.score for scored in done if 4.9 < scored.window.start < 5.1]
    quiet = [scored.score.score for scored in done if scored.window.start < 4.6]
    assert len(loud) == 1
    assert loud[0].impact
    assert loud[0].score > 3 * max(quiet)


def test_a_score_survives_an_error_in_the_size_of_the_play(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the estimate of the play breaks down, every window is scored all the same, and carries the error."""
    broken = ZeroDivisionError("deep in the estimate")

    def breaks(*_: object) -> None:
        raise broken

    monkeypatch.setattr(pipeline, "learnt_play", breaks)
    world = World()
    world.feel(0.0, 10.0, rings_at=5.05)
    world.move(0.0, 9.0)
    done = world.pipeline.step(10.0)
    assert 15 <= len(done) <= 17
    assert world.pipeline.counts["elbow"].scored == len(done)
    assert any(scored.score.impact for scored in done if 4.9 < scored.window.start < 5.1)
    assert {scored.failure for scored in done} == {broken}
    assert {scored.score.play_reason for scored in done} == {"internal error"}


def test_a_window_waits_for_its_end_and_no_longer() -> None:
    """The sample at its end completes it."""
    world = World()
    world.feel(0.0, 1.74)
    world.move(0.0, 1.7)
    assert world.pipeline.step(1.74)
    assert world.pipeline.open_windows == 1
    assert world.pipeline.step(1.8) == []
    world.feel(1.74, 1.76)
    assert len(world.pipeline.step(1.8)) == 1


def test_a_window_without_acceleration_is_given_up_with_a_reason() -> None:
    """On hardware it is not waited for ever; what is there is scored, and nothing at all is counted as lost."""
    world = World()
    world.feel(0.0, 1.0)
    world.move(0.0, 2.0)
    done = world.pipeline.step(2.0)
    waiting = world.pipeline.open_windows
    assert waiting > 0
    done = world.pipeline.step(2.0 + GIVE_UP_S + 1.0)
    assert world.pipeline.open_windows == 0
    lost = world.pipeline.counts["elbow"].lost
    assert lost.total() == waiting
    assert lost["no acceleration"] >= 1
    assert all(math.isnan(scored.score.score) for scored in done)


def test_a_virtual_sensor_is_waited_for() -> None:
    """However late, the windows of a virtual robot are complete; only its end gives them up."""
    world = World(virtual=True)
    world.move(0.0, 5.0)
    assert world.pipeline.step(1e9) == []
    opened = world.pipeline.open_windows
    world.feel(0.0, 6.0)
    assert len(world.pipeline.step(1e9)) == opened
    assert world.pipeline.counts["elbow"].lost.total() == 0


def test_who_is_read_first_changes_no_virtual_score() -> None:
    """Commands from before a jump of time are kept for the windows that wait, and waited for: scores are the same
    whether a virtual robot's servos or its sensor are read first, on a busy computer too."""
    late, scores = 864_000.0, []
    for order in ("move move feel feel", "feel move feel move"):
        world, begins = World(virtual=True), {"move": iter((0.0, late)), "feel": iter((0.0, late))}
        done = []
        for what in order.split():
            begin = next(begins[what])
            if what == "move":
                world.move(begin, begin + 4.0)
            else:
                world.feel(begin, begin + 4.5, rings_at=begin + 2.3)
            done += world.pipeline.step(1e9)
        scores.append([(one.score.time, one.score.score, one.score.play, one.score.severity) for one in done])
    assert len(scores[0]) > 10
    assert np.array(scores[0]) == pytest.approx(np.array(scores[1]), nan_ok=True)


def test_reversals_before_the_sensor_speaks_open_no_window() -> None:
    """While the accelerometer is still being opened nothing can be lost."""
    world = World()
    world.move(0.0, 3.0)
    world.feel(3.0, 6.0)
    world.move(3.0, 5.5)
    done = world.pipeline.step(6.0)
    assert min(starts(done)) >= 3.0
    assert world.pipeline.counts["elbow"].lost.total() == 0


@pytest.mark.slow
def test_acceleration_is_released_behind_the_oldest_need() -> None:
    """Half a minute of motion passes through a ring of 20 s, half of which is enough, and nothing is overwritten."""
    world = World()
    for second in range(30):
        world.feel(second, second + 1)
        world.move(second, second + 1)
        world.pipeline.step(second + 1.0)
    assert len(world.ring.slice(-1.0, 1e9)[0]) <= 11 * RATE_HZ
    assert world.ring.overwritten == 0


def test_clipped_samples_are_told() -> None:
    """Samples at the sensor's range make the quality "clipped"."""
    world = World(range_ms2=2.0)
    world.feel(0.0, 6.0, rings_at=4.05)
    world.move(0.0, 5.0)
    clipped = [s.window.start for s in world.pipeline.step(6.0) if "clipped" in s.score.quality]
    assert clipped[0] == pytest.approx(4.0, abs=0.05)


def test_a_closed_pipeline_only_finishes() -> None:
    """After close no reversal opens a window, and the open ones are scored."""
    world = World()
    world.feel(0.0, 2.0)
    world.move(0.0, 2.0)
    before = len(world.pipeline.step(2.0))
    opened = world.pipeline.open_windows
    world.pipeline.close()
    world.move(2.0, 5.0)
    world.feel(2.0, 6.0)
    assert len(world.pipeline.step(6.0)) == opened
    assert world.pipeline.counts["elbow"].triggered == before + opened
