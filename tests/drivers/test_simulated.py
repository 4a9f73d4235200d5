"""The model as a robot: what its joints and sensors tell, how its play shows and grows, at any speed of time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import msgspec
import numpy as np
import pytest
from numba import njit

from lostmotion.detector.series import score_series
from lostmotion.detector.window import DetectorSettings
from lostmotion.drivers.base import FloatArray, OscillatorOptions
from lostmotion.drivers.errors import DriverError
from lostmotion.drivers.pacing import Pace
from lostmotion.drivers.schedule import YEAR_S
from lostmotion.drivers.simulated import SimulatedAccelerometer, SimulatedJoints, SimulatedRobot, check
from lostmotion.drivers.simulated_options import (
    SimulatedAccelerometerOptions,
    SimulatedJointOptions,
    SimulatedOptions,
)
from lostmotion.drivers.simulated_parts import Gear

Recorded = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
SETTINGS = DetectorSettings(f_res_hz=58.0)


class Robot:
    """Joints a, b, … with these plays [m], an accelerometer each, read without waiting."""

    def __init__(self, plays: Sequence[float], joint: Any = None, sensor: Any = None, **options: Any) -> None:
        settings = SimulatedOptions(**({"speed": "max"} | options))
        self.names = "abcdef"[: len(plays)]
        self.clock = SimulatedRobot(settings, Pace(math.inf))
        self.joints = SimulatedJoints(
            [
                SimulatedJointOptions(name=name, driver="simulated", accelerometer=name, play_m=play, **(joint or {}))
                for name, play in zip(self.names, plays, strict=True)
            ],
            settings,
            self.clock,
        )
        bar = OscillatorOptions(f_res_hz=58.0)
        self.sensors = [
            SimulatedAccelerometer(
                SimulatedAccelerometerOptions(
                    name=name, driver="simulated", rate_hz=1000.0, oscillator=bar, **(sensor or {})
                ),
                settings,
                self.clock,
            )
            for name in self.names
        ]
        self.joints.open()
        for one in self.sensors:
            one.open()

    def record(self, steps: int) -> dict[str, Recorded]:
        """So many readings of each device: by joint, servo times, commands, accelerometer times, accelerations."""
        samples = [sample for _ in range(steps) for sample in self.joints.read().samples]
        recorded = {}
        for name, sensor in zip(self.names, self.sensors, strict=True):
            blocks = [sensor.read() for _ in range(steps)]
            mine = [sample for sample in samples if sample.joint == name]
            recorded[name] = (
                np.array([sample.time for sample in mine]),
                np.array([sample.command for sample in mine]),
                np.concatenate([block.time for block in blocks]),
                np.concatenate([block.accel for block in blocks]),
            )
        return recorded

    def scores(self, recorded: Recorded) -> tuple[FloatArray, FloatArray]:
        """Times and scores of all windows that are whole."""
        found = score_series(*recorded, SETTINGS, resolution=self.joints.resolution_rad)
        found = [score for score in found if score.quality == "ok"]
        return np.array([score.time for score in found]), np.array([score.score for score in found])


@pytest.mark.slow
def test_play_is_heard_and_its_absence_is_not() -> None:
    """Every window of a worn joint scores above every one of a sound one, and the level lies between them."""
    robot = Robot([0.0, 6e-5, 1e-4])
    recorded = robot.record(40)
    sound, worn, badly = (robot.scores(recorded[name])[1] for name in robot.names)
    assert len(sound) > 30
    assert sound.max() < SETTINGS.level < worn.min() < np.median(badly)
    assert np.median(worn) > 10 * np.median(sound)


@pytest.mark.slow
def test_samples_lie_on_the_devices_own_grids() -> None:
    """10 s bring 1000 commands at 100 Hz and 10,000 accelerations at 1 kHz, none twice and none missing."""
    times, commands, accel_times, accel = Robot([5e-5]).record(20)["a"]
    np.testing.assert_allclose(times, np.arange(1000) / 100)
    np.testing.assert_allclose(accel_times, np.arange(10000) / 1000)
    steps = commands / (math.radians(300) / 1023)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(commands)) > 20
    assert np.isfinite(accel).all()


def test_steps_join_without_a_seam() -> None:
    """Cut into steps of 0.05 s, the motion is the one made in steps of 0.5 s."""
    quiet = {"noise_ms2": 0.0, "resolution_ms2": 0.0}
    for play in (0.0, 8e-5):
        coarse = Robot([play], sensor=quiet).record(4)["a"]
        fine = Robot([play], sensor=quiet, speed=1.0).record(40)["a"]
        np.testing.assert_allclose(fine[2], coarse[2])
        np.testing.assert_allclose(fine[3], coarse[3], atol=0.02 * np.abs(coarse[3]).max())


def test_joint_without_play_follows_exactly() -> None:
    """Without play the tip feels l theta_1'', as far as the bar lets it: at 1 Hz that is 0.03 % more."""
    robot = Robot([0.0], sensor={"noise_ms2": 0.0, "resolution_ms2": 0.0}, motion="sine:1,0.1")
    accel = robot.record(8)["a"][3]
    assert np.abs(accel).max() == pytest.approx(0.1 * 0.1 * (2 * math.pi) ** 2, rel=2e-3)


def test_sensor_has_noise_range_and_resolution() -> None:
    """Readings are whole counts within the range, and as noisy as said."""
    robot = Robot([0.0], sensor={"noise_ms2": 0.5, "range_ms2": 1.2, "resolution_ms2": 0.1}, motion="sine:0.1,0.001")
    accel = robot.record(10)["a"][3]
    assert np.abs(accel).max() == pytest.approx(1.2)
    np.testing.assert_allclose(accel / 0.1, np.round(accel / 0.1), atol=1e-9)
    assert accel.std() == pytest.approx(0.49, abs=0.02)
    assert robot.sensors[0].range_ms2 == 1.2


def test_same_seed_same_robot() -> None:
    """A seed decides motion and noise, whoever reads first; joints move differently."""
    one, other = Robot([0.0, 5e-5], seed=7), Robot([0.0, 5e-5], seed=7)
    early = [other.sensors[1].read() for _ in range(4)]
    ours, theirs = one.record(4), other.record(4)
    np.testing.assert_array_equal(ours["b"][3], np.concatenate([block.accel for block in early]))
    np.testing.assert_array_equal(ours["a"][3], theirs["a"][3])
    assert not np.array_equal(ours["a"][1], ours["b"][1])
    assert not np.array_equal(ours["a"][3], Robot([0.0, 5e-5], seed=8).record(4)["a"][3])


def test_play_grows_with_use() -> None:
    """The gap of a joint grows by the law that its options document; one without play keeps none."""
    robot = Robot([0.0, 5e-5], joint={"wear_per_year": 1.5}, speed=YEAR_S / 2)
    robot.record(8 * 3)
    assert robot.clock.now() == pytest.approx(YEAR_S, rel=1e-3)
    found = [identity.found for identity in robot.joints.identify()]
    assert found == ["simulated joint, play 0 µm", f"simulated joint, play {50 * math.exp(1.5):.0f} µm"]


@pytest.mark.slow
def test_a_year_of_wear_shows_in_the_scores() -> None:
    """A year in 19 s: windows all over the year, each whole; the elbow's scores climb, the shoulder's do not."""
    robot = Robot([0.0, 3e-5], speed=YEAR_S / 18.75)
    recorded = robot.record(5 * 30)
    found = score_series(*recorded["b"], SETTINGS, resolution=robot.joints.resolution_rad)
    whole = [score for score in found if score.quality == "ok"]
    times, elbow = np.array([score.time for score in whole]), np.array([score.score for score in whole])
    shoulder = robot.scores(recorded["a"])[1]
    months = [elbow[(times >= YEAR_S * k / 12) & (times < YEAR_S * (k + 1) / 12)] for k in range(12)]
    assert min(len(month) for month in months) > 8
    assert len(elbow) > 0.95 * len(found)
    assert np.median(np.concatenate(months[9:])) > 1.15 * np.median(np.concatenate(months[:3]))
    assert np.quantile(shoulder, 0.99) < SETTINGS.level


def test_skipped_time_is_a_hole_for_all_devices() -> None:
    """Between two stretches nothing is told; the accelerometer is heard half a second longer than the servo."""
    times, _, accel_times, _ = Robot([5e-5], speed=1000.0).record(24)["a"]
    for measured, length in ((times, 3.5), (accel_times, 4.0)):
        holes = np.flatnonzero(np.diff(measured) > 1.0)
        assert len(holes) == 2
        np.testing.assert_allclose(measured[holes + 1], [1000.0, 2000.0])
        np.testing.assert_allclose(measured[holes], [length, 1000.0 + length], atol=0.011)


def test_real_time_is_waited_for() -> None:
    """At speed 1 half a second of samples takes at least as long."""
    settings = SimulatedOptions()
    clock = SimulatedRobot(settings)
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=200.0, oscillator=OscillatorOptions(f_res_hz=58.0)
    )
    sensor = SimulatedAccelerometer(options, settings, clock)
    sensor.open()
    begin, count = time.monotonic(), 0
    while count < 100:
        count += len(sensor.read().time)
    assert time.monotonic() - begin >= 0.4
    assert clock.now() == pytest.approx(0.5)


@pytest.mark.parametrize("speed", [1.0, 4.0])
def test_no_sample_is_ahead_of_the_clock_or_the_calendar(speed: float) -> None:
    """Whatever has been read lies in the past, by the robot's clock and by the host's."""
    settings = SimulatedOptions(speed=speed)
    clock = SimulatedRobot(settings)
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=200.0, oscillator=OscillatorOptions(f_res_hz=58.0)
    )
    sensor = SimulatedAccelerometer(options, settings, clock)
    sensor.open()
    for _ in range(6):
        last = sensor.read().time[-1]
        assert last < clock.now()
        assert clock.utc(last) < datetime.now(UTC)


def test_start_in_utc() -> None:
    """Robot time 0 is now, a year ago where time runs faster than real time, or what the options say."""
    now = datetime.now(UTC)
    for speed in (0.5, 1.0):
        assert abs(Robot([0.0], speed=speed).clock.utc(0) - now) < timedelta(minutes=1)
    for speed in (1.5, 4.0, 525600.0, "max"):
        assert abs(Robot([0.0], speed=speed).clock.utc(YEAR_S) - now) < timedelta(minutes=1)
    assert Robot([0.0], start=datetime(2026, 1, 1)).clock.utc(60) == datetime(2026, 1, 1, 0, 1, tzinfo=UTC)


def test_time_begins_with_the_motion() -> None:
    """However long the model is compiled, the stamps of the first samples are those of now."""
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=200.0, oscillator=OscillatorOptions(f_res_hz=58.0)
    )
    for start in (None, datetime(2026, 1, 1, tzinfo=UTC)):
        settings = SimulatedOptions(speed=1.0, start=start)
        clock = SimulatedRobot(settings)
        sensor = SimulatedAccelerometer(options, settings, clock)
        sensor.open()
        made = clock.utc(0)
        time.sleep(0.3)
        sensor.read()
        later = clock.utc(0) - made
        assert later == timedelta(0) if start else later > timedelta(seconds=0.29)


def prepares_late(monkeypatch: pytest.MonkeyPatch, work: Callable[[], object]) -> None:
    """Before a joint's model is there, work is done."""
    prepare = Gear.prepare
    monkeypatch.setattr(Gear, "prepare", lambda gear, *given: (work(), prepare(gear, *given)))


@pytest.mark.slow
def test_a_slow_start_is_not_told_as_a_compilation(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slow computer that needs 2.5 s of processor time to load a model compiles nothing."""

    def burn() -> None:
        end = time.thread_time() + 2.5
        while time.thread_time() < end:
            pass

    Robot([0.0])
    prepares_late(monkeypatch, burn)
    with caplog.at_level("INFO"):
        Robot([0.0])
    assert "compiled" not in caplog.text


def test_a_compilation_is_told_while_it_goes_on(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What Numba has not compiled yet: a line when it begins, however quick it is, and one when it is done."""
    told = []

    @njit
    def new(x: float) -> float:
        return x + 1.0

    prepares_late(monkeypatch, lambda: (new(1.0), told.append(caplog.text)))
    with caplog.at_level("INFO"):
        Robot([0.0])
    assert "the model is being compiled" in told[0]
    assert "the model was compiled in" not in told[0]
    assert "the model was compiled in" in caplog.text


def test_two_joints_may_share_an_accelerometer() -> None:
    """A bar that two joints move feels the sum of both."""
    quiet = {"noise_ms2": 0.0, "resolution_ms2": 0.0}
    alone = Robot([0.0], sensor=quiet, motion="sine:1,0.1").record(4)["a"][3]
    settings = SimulatedOptions(speed="max", motion="sine:1,0.1")
    clock = SimulatedRobot(settings)
    joints = [SimulatedJointOptions(name=name, driver="simulated", accelerometer="tip") for name in "ab"]
    bus = SimulatedJoints(joints, settings, clock)
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=1000.0, oscillator=OscillatorOptions(f_res_hz=58.0), **quiet
    )
    sensor = SimulatedAccelerometer(options, settings, clock)
    bus.open()
    sensor.open()
    np.testing.assert_allclose(np.concatenate([sensor.read().accel for _ in range(4)]), 2 * alone)
    samples = bus.read().samples
    assert [sample.joint for sample in samples[:4]] == ["a", "b", "a", "b"]


def test_sensor_of_no_joint_rides_on_a_sound_one() -> None:
    """Alone, an accelerometer feels the hand that waves it."""
    settings = SimulatedOptions(speed="max", motion="sine:1,0.1")
    clock = SimulatedRobot(settings)
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=1000.0, oscillator=OscillatorOptions(f_res_hz=58.0), noise_ms2=0.0
    )
    sensor = SimulatedAccelerometer(options, settings, clock)
    sensor.open()
    accel = np.concatenate([sensor.read().accel for _ in range(4)])
    assert np.abs(accel).max() == pytest.approx(0.1 * 0.1 * (2 * math.pi) ** 2, abs=0.01)


def test_closed_device_keeps_nothing() -> None:
    """Closing twice is allowed; opened again, a device goes on at the present time."""
    robot = Robot([5e-5])
    first = robot.sensors[0].read()
    robot.sensors[0].close()
    robot.sensors[0].close()
    robot.joints.read()
    robot.joints.read()
    robot.joints.read()
    robot.sensors[0].open()
    assert robot.sensors[0].read().time[0] > first.time[-1] + 0.9


@pytest.mark.slow
def test_a_motion_that_no_gear_follows_is_refused_when_it_is_read() -> None:
    """A jump of 1e12 rad was an internal error; motions up to the limit that the check has are followed."""
    for motion in ("step:1e12,1e-12,0", "step:1,1e-3", "sine:50,1", "hand-waved:1,1e12", "chirp:1,1e6,1"):
        with pytest.raises(
            DriverError, match=r"simulated.motion: '.*' reaches .* rad/s², expected at most 10000 of each"
        ):
            check(SimulatedOptions(motion=motion))
    for motion in ("step:1700,1,0", "step:5,0.06,0", "sine:20,0.6", "sine:1000,1e-4", "sine:0.15,9900"):
        check(SimulatedOptions(motion=motion))
        assert np.isfinite(Robot([8e-5], motion=motion).record(2)["a"][3]).all()


def test_wrong_motion_is_told_at_the_start() -> None:
    """A motion that does not exist is an error of one line, with those that do."""
    with pytest.raises(DriverError, match="a: no motion is called 'wobble'; there are sine"):
        Robot([0.0], motion="wobble")


@pytest.mark.parametrize("table", [{"speed": 0}, {"speed": "fast"}, {"seed": -1}, {"colour": "red"}])
def test_wrong_options_are_refused(table: dict[str, Any]) -> None:
    """Speeds and seeds that make no sense, and unknown keys, never get as far as a robot."""
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(table, SimulatedOptions)


def shared(levers: Sequence[float], plays: Sequence[float]) -> FloatArray:
    """Tip acceleration of two joints on one bar of 0.1 m, with these lever arms [m], for five seconds."""
    settings = SimulatedOptions(speed="max")
    clock = SimulatedRobot(settings, Pace(math.inf))
    joints = [
        SimulatedJointOptions(name=name, driver="simulated", accelerometer="tip", play_m=play, levers_m={"tip": lever})
        for name, lever, play in zip("ab", levers, plays, strict=True)
    ]
    bus = SimulatedJoints(joints, settings, clock)
    options = SimulatedAccelerometerOptions(
        name="tip", driver="simulated", rate_hz=1000.0, oscillator=OscillatorOptions(f_res_hz=58.0), noise_ms2=0.0,
        resolution_ms2=0.0,
    )  # fmt: skip
    sensor = SimulatedAccelerometer(options, settings, clock)
    bus.open()
    sensor.open()
    return np.concatenate([sensor.read().accel for _ in range(10)])


def test_joints_on_one_bar_add_up_by_their_lever_arms() -> None:
    """What two joints do to one tip is the sum of what each does alone, as many times as its lever arm is long."""
    plays = (0.0, 6e-5)
    one, other = shared((0.1, 1e-9), plays), shared((1e-9, 0.1), plays)
    np.testing.assert_allclose(shared((0.25, -0.1), plays), 2.5 * one - other, atol=1e-6)
    assert other.std() > 1.2 * one.std()


def test_a_joint_that_should_move_other_accelerometers_is_refused() -> None:
    """The simulated joints move their own accelerometer only; a lever arm at another one is an error that says so."""
    clock = SimulatedRobot(SimulatedOptions(speed="max"), Pace(math.inf))
    options = SimulatedJointOptions(name="a", driver="simulated", accelerometer="tip", levers_m={"upper": 0.1})
    bus = SimulatedJoints([options], SimulatedOptions(speed="max"), clock)
    with pytest.raises(DriverError, match="a: levers_m: found upper, expected only tip"):
        bus.open()
