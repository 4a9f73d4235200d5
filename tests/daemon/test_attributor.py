"""Joints that share accelerometers, from samples to the joint that has the play; impulses by an independent
simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lostmotion.daemon.attributor import Attributor, CommandHistory, SharedSensor
from lostmotion.daemon.monitored_joint import JointPlan
from lostmotion.daemon.pipeline import Pipeline, Scored
from lostmotion.daemon.records import SURE, Origin
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.waker import Waker
from lostmotion.detector.attribution import Evidence
from lostmotion.detector.window import DetectorSettings, Window
from lostmotion.drivers.base import AccelBlock, ServoSample
from tests.detector.test_attribution import PLAY, RATE, SECONDS, shaft, tip

SETTINGS = DetectorSettings(f_res_hz=58.0, noise_ms2=0.1, flank_exponent=1e4)
SEEDS = {"elbow": 11, "shoulder": 12}


def shared(*levers: dict[str, float]) -> list[SharedSensor]:
    """Accelerometers of which each joint is so far away [m]."""
    return [SharedSensor(f"s{k}", RATE, SETTINGS, arms) for k, arms in enumerate(levers)]


def heard(listeners: Sequence[SharedSensor], worn: str, attributor: Attributor, pieces: int = 16) -> list[Scored]:
    """The windows of eight seconds in which both joints move and one has play; samples come piece by piece."""
    rings = {sensor.accelerometer: Ring(20_000, Waker()) for sensor in listeners}
    plans = [
        JointPlan(joint, "s0", RATE, 100.0, replace(SETTINGS, length_m=listeners[0].levers[joint])) for joint in SEEDS
    ]
    pipeline = Pipeline(plans, rings, virtual=True, attributors=[attributor])
    times, polls = np.arange(0, SECONDS, 1 / RATE), np.arange(0, SECONDS, 0.01)
    commands = {joint: shaft(seed, polls, 0) for joint, seed in SEEDS.items()}
    noise = np.random.default_rng(3)
    tips = {}
    for sensor in listeners:
        felt = [arm / 0.1 * tip(SEEDS[joint], joint == worn) for joint, arm in sensor.levers.items()]
        tips[sensor.accelerometer] = np.sum(felt, axis=0) + noise.normal(0, 0.1, times.size)
    done = []
    for part in range(pieces):
        a, b = (round(times.size * k / pieces) for k in (part, part + 1))
        c, d = (round(polls.size * k / pieces) for k in (part, part + 1))
        for name, ring in rings.items():
            ring.push(AccelBlock(times[a:b], tips[name][a:b]))
        for joint, angles in commands.items():
            said = zip(polls[c:d].tolist(), angles[c:d].tolist(), strict=True)
            pipeline.servo([ServoSample(joint, time, angle, angle) for time, angle in said], 0.0)
        done += pipeline.step(0.0)
    return done


@pytest.mark.slow
@pytest.mark.parametrize("worn", ["elbow", "shoulder"])
def test_pipeline_names_the_joint(worn: str) -> None:
    """Two joints on one accelerometer: after eight seconds the one with play is named, and the other is sound."""
    listeners = shared({"elbow": 0.1, "shoulder": 0.25})
    origin = heard(listeners, worn, attributor := Attributor(listeners))[-1].origin
    (other,) = SEEDS.keys() - {worn}
    assert origin is not None
    assert origin.probabilities[worn] > SURE
    assert origin.probabilities[other] < 1 - SURE
    assert origin.spares(other)
    assert not origin.spares(worn)
    assert attributor.origin.windows >= 20


@pytest.mark.slow
def test_two_accelerometers() -> None:
    """One more on the first link, which the elbow does not move: six windows are enough to be sure of both joints."""
    listeners = shared({"elbow": 0.1, "shoulder": 0.25}, {"shoulder": 0.1})
    done = heard(listeners, "elbow", Attributor(listeners), pieces=64)
    first = next(scored.origin for scored in done if scored.origin and scored.origin.spares("shoulder"))
    assert first.probabilities["elbow"] > SURE
    assert first.windows <= 6


def test_play_is_sized_without_the_other_joints_motion() -> None:
    """The median size is right within 15 % though the other joint moves as much, and only the named joint has one."""
    listeners = shared({"elbow": 0.1, "shoulder": 0.25})
    attributor = Attributor(listeners)
    attributor.resume([Origin({"elbow": 1.0, "shoulder": 0.0}, 100)])
    done = heard(listeners, "elbow", attributor)
    sizes = [scored.score.play for scored in done if scored.score.joint == "elbow" and scored.score.play > 0]
    assert len(sizes) >= 5
    assert np.median(sizes) == pytest.approx(PLAY, rel=0.15)
    assert all(np.isnan(scored.score.play) for scored in done if scored.score.joint == "shoulder")


def test_an_earlier_run_is_remembered_with_doubt() -> None:
    """What was certain is 96 % at the next start, which names the joint; another group's knowledge is none of ours."""
    attributor = Attributor(shared({"elbow": 0.1, "shoulder": 0.25}))
    attributor.resume([Origin({"elbow": 0.2, "wrist": 0.9}, 50), Origin({"shoulder": 1.0, "elbow": 0.0}, 100)])
    assert attributor.origin.probabilities == pytest.approx({"elbow": 0.04, "shoulder": 0.96})
    assert attributor.origin.spares("elbow")


def test_a_joint_that_says_nothing_holds_nothing_up() -> None:
    """Windows whose other joint stays silent are given up a second later, and nobody is named."""
    listeners = shared({"elbow": 0.1, "shoulder": 0.25})
    ring = Ring(20_000, Waker())
    attributor = Attributor(listeners)
    plans = [JointPlan(joint, "s0", RATE, 100.0, SETTINGS) for joint in SEEDS]
    pipeline = Pipeline(plans, {"s0": ring}, attributors=[attributor])
    times, polls = np.arange(0, SECONDS, 1 / RATE), np.arange(0, SECONDS, 0.01)
    ring.push(AccelBlock(times, tip(11, True)))
    angles = shaft(11, polls, 0).tolist()
    pipeline.servo([ServoSample("elbow", t, a, a) for t, a in zip(polls.tolist(), angles, strict=True)], 0.0)
    assert len(pipeline.step(SECONDS)) > 10
    assert attributor.origin.windows == 0
    assert attributor.origin.is_open


def test_in_words() -> None:
    """One named, several open, none."""
    assert str(Origin({"left": 0.9991, "right": 0.01}, 9)) == "most probably of left (over 99%)"
    assert str(Origin({"left": 0.96, "right": 0.97}, 9)) == "most probably of left (96%) and right (97%)"
    assert str(Origin({"left": 0.6, "right": 0.5}, 9)) == "of left or right: not identified yet"
    assert str(Origin({"left": 0.01, "right": 0.02}, 9)) == "most probably of none of left, right"


def test_known_joints_are_weighed_seldom(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five windows at once, the next ones PACE_S apart, though the joints reverse several times in that."""
    starts: list[float] = []

    class Noting(Attributor):
        def _weigh(self, window: Window, rings: Sequence[Ring], joints: Sequence[CommandHistory]) -> Evidence | None:
            starts.append(window.start)
            return super()._weigh(window, rings, joints)

    monkeypatch.setattr("lostmotion.daemon.attributor.WINDOWS", 5)
    monkeypatch.setattr("lostmotion.daemon.attributor.PACE_S", 1.0)
    listeners = shared({"elbow": 0.1, "shoulder": 0.25})
    scored = heard(listeners, "elbow", Noting(listeners), pieces=64)
    assert len(scored) > 3 * len(starts)
    assert np.diff(starts[-4:]).min() >= 1.0


def test_the_next_one_goes_on_with_the_windows() -> None:
    """Its windows, its probabilities and its pace are those of the earlier one."""
    listeners = shared({"elbow": 0.1, "shoulder": 0.25})
    heard(listeners, "elbow", first := Attributor(listeners), pieces=4)
    assert first.origin.windows > 2
    following = Attributor(listeners)
    following.resume([first.origin])
    assert following.origin.windows == 0
    following.continue_from(first)
    assert following.origin == first.origin
