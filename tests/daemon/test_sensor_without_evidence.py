"""A sensor that measures nothing of its joint is a device alarm with its cause, and the joint is never OK by it: the
service on emulated hardware, asked by the command line."""

from __future__ import annotations

import json
import re
import signal
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from time import monotonic

import numpy as np
import pytest

from lostmotion.daemon import config
from lostmotion.daemon.alarm import JointMonitor
from lostmotion.daemon.losses import Losses
from lostmotion.daemon.options import AlarmOptions
from lostmotion.daemon.poller import DeviceState
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import Health, JointRow, ScoreRow
from lostmotion.daemon.ring import Ring
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.sensorcheck import FIRST_PACE_S, LAST, SensorCheck
from lostmotion.daemon.waker import Waker
from lostmotion.detector.window import Score, Window
from lostmotion.drivers.base import AccelBlock, FloatArray, ServoSample
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine, WitMotionStream
from tests.daemon.cli_world import HARDWARE, call
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config

Start = Callable[..., Running]


class Railed(Motion):
    """The sensor stays at the end of its range."""

    def tip(self, rate_hz: float) -> FloatArray:
        return np.full(round(20 * rate_hz), 400.0)


class Loud(Motion):
    """The bar moves far beyond the sensor's range."""

    def tip(self, rate_hz: float) -> FloatArray:
        return 100 * super().tip(rate_hz)


class Elsewhere(Motion):
    """The sensor is on another link, and shows nothing but its noise."""

    def tip(self, rate_hz: float) -> FloatArray:
        return np.random.default_rng(5).normal(0, 0.05, round(20 * rate_hz))


class Turned(Motion):
    """The sensor is mounted the other way round."""

    def tip(self, rate_hz: float) -> FloatArray:
        return -super().tip(rate_hz)


def configured(folder: Path, emulator: Emulator, axis: str = "x") -> Path:
    """An arm with one joint, on the emulator's ports."""
    servos, sensor = emulator.paths
    text = HARDWARE.replace("no-such-port-0", servos).replace("no-such-port-1", sensor)
    path = folder / "robot.toml"
    path.write_text(text.replace("history.db", str(folder / "history.db")).replace(
        "rate_hz = 200", f'rate_hz = 200\naxis = "{axis}"') + "[alarm]\noff_delay_s = 0\n")  # fmt: skip
    return path


def is_healthy(folder: Path) -> bool:
    """What `lostmotion status --fail` says by its exit status and its only joint."""
    told = call("status", "--database", folder / "history.db", "--fail", "--json")
    (joint,) = json.loads(told.stdout)["joints"]
    assert told.exit_code == bool(joint["alarms"])
    return bool(joint["health"] == "OK")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "said"),
    [
        (Railed(), "tip stays at the end of its range, 157 m/s²: a broken wire, or gravity and a small range"),
        (
            Loud(),
            "tip reaches the end of its range in every window: its range is too small for this bar",
        ),
    ],
)
def test_a_sensor_at_the_end_of_its_range(tmp_path: Path, start: Start, motion: Motion, said: str) -> None:
    """It stays there, or reaches it in every window: an alarm that says which after ten windows, and never OK."""
    with Emulator(ServoLine.of("AX-12A", [3], motion), WitMotionStream(motion)) as emulator:
        service = start(configured(tmp_path, emulator))
        # On a busy machine a servo that answers late may be the first alarm.
        service.wait_for(f"{said} (no sound window in 10)")
        service.wait_for("alarm joint=elbow cause=device severity=error event=raised")
        wait_until(lambda: not is_healthy(tmp_path))
        assert service.stop(signal.SIGTERM) == 0
    assert "health=OK" not in service.log.read_text()


@pytest.mark.slow
def test_a_column_that_is_a_clock(tmp_path: Path, start: Start) -> None:
    """Lines of time and value of which the time is read as acceleration: a device alarm with the cause, and neither OK
    nor play."""
    motion = Motion()
    with Emulator(ServoLine.of("AX-12A", [3], motion), CsvStream(motion, 800.0)) as emulator:
        path = configured(tmp_path, emulator)
        text = path.read_text().replace('"witmotion"', '"csv_serial"').replace("rate_hz = 200", "rate_hz = 800")
        path.write_text(text.replace('axis = "x"', "column = 0"))
        service = start(path)
        service.wait_for(
            "tip shows what no accelerometer does, values without noise or beyond all numbers: another column"
        )
        wait_until(lambda: not is_healthy(tmp_path))
        assert service.stop(signal.SIGTERM) == 0
    assert "health=OK" not in service.log.read_text()
    assert "cause=play" not in service.log.read_text()


@pytest.mark.slow
def test_a_value_that_is_held(tmp_path: Path, start: Start) -> None:
    """A joint that is OK is not any more when its sensor hangs, and is again when the sensor moves on."""
    motion = Motion(play=0.0)
    stream = WitMotionStream(motion)
    with Emulator(ServoLine.of("AX-12A", [3], motion), stream) as emulator:
        service = start(configured(tmp_path, emulator))
        service.wait_for("health joint=elbow health=OK")
        wait_until(lambda: is_healthy(tmp_path))
        stream.held = True
        log = service.wait_for("tip shows the same value all the time")
        wait_until(lambda: not is_healthy(tmp_path))  # the log is written before the database
        stream.held = False
        service.wait_for("health joint=elbow health=OK", 2)
        assert service.stop(signal.SIGTERM) == 0
    assert re.search(r"tip shows the same value all the time, -?\d\.\d+ m/s²: wrong axis, a broken wire, or a", log)


@pytest.mark.slow
def test_the_wrong_axis_is_told_within_a_minute(tmp_path: Path, start: Start) -> None:
    """An arm measured along y while the bar moves along x: noise looks sound, and shows none of the motion."""
    motion = Motion()
    with Emulator(ServoLine.of("AX-12A", [3], motion), WitMotionStream(motion)) as emulator:
        service = start(configured(tmp_path, emulator, axis="y"))
        # On a busy machine a servo that answers late may be the first alarm.
        service.wait_for("tip does not feel the motion of elbow: wrong axis, loose, or on another link", timeout_s=60)
        wait_until(lambda: not is_healthy(tmp_path))
        assert service.stop(signal.SIGTERM) == 0


@pytest.mark.slow
def test_a_sensor_that_never_felt_the_motion_is_doubted_before_the_alarm(tmp_path: Path, start: Start) -> None:
    """A quick sensor on another link, whose noise looks like a sound joint: it is not OK before the first comparison,
    after five seconds, nor until the alarm, after twenty-five."""
    motion = Elsewhere(play=0.0)
    with Emulator(ServoLine.of("AX-12A", [3], motion), CsvStream(motion, 800.0)) as emulator:
        path = configured(tmp_path, emulator)
        text = path.read_text().replace('"witmotion"', '"csv_serial"').replace("rate_hz = 200", "rate_hz = 800")
        path.write_text(text.replace('axis = "x"', "") + "severity_warning = 0.5\nseverity_error = 1.0\n")
        service = start(path)
        log = service.wait_for("tip does not feel the motion of elbow: wrong axis, loose, or on another link")
        wait_until(lambda: not is_healthy(tmp_path))
        assert "health=OK" not in log
        assert service.stop(signal.SIGTERM) == 0


@pytest.mark.slow
def test_a_line_that_loses_three_bytes_of_ten(tmp_path: Path, start: Start) -> None:
    """Hardly any frame of eleven bytes is whole: an alarm that tells the loss, or the windows that follow from it,
    within a minute."""
    motion = Motion(play=0.0)
    stream = WitMotionStream(motion)
    with Emulator(ServoLine.of("AX-12A", [3], motion), stream) as emulator:
        service = start(configured(tmp_path, emulator))
        service.wait_for("health joint=elbow health=OK")
        stream.lossy = 0.3
        service.wait_for("event=raised", timeout_s=60)
        wait_until(lambda: not is_healthy(tmp_path))
        wait_until(lambda: re.search(r"tip: \d\d% of the samples were lost within", service.log.read_text()), 60)
        assert service.stop(signal.SIGTERM) == 0


# --- without hardware: the two checks alone ---------------------------------------------------------------------------


def check(
    levers: dict[str, float], felt: dict[str, float], noise: float = 0.05, seconds: float = 60.0, late_s: float = 0.0
) -> SensorCheck:
    """A check that has seen a minute of two joints that move, and of a sensor that feels ``felt`` of them [m]."""
    rng, rate = np.random.default_rng(7), 200.0
    ring = Ring(8000, Waker())
    sensor = SensorCheck("tip", ring, levers)
    shift = {"elbow": 0.0, "wrist": 1.7}
    times = np.arange(0, seconds, 1 / rate)
    waves = {name: Motion().goal for name in levers}
    accel = rng.normal(0, noise, times.size)
    for name, arm in felt.items():
        fine = np.array([waves[name](time + shift[name]) for time in np.arange(-0.1, seconds + 0.1, 1e-3)])
        curved = np.gradient(np.gradient(np.convolve(fine, np.ones(20) / 20, "same"), 1e-3), 1e-3)
        accel += arm * np.interp(times - late_s, np.arange(-0.1, seconds + 0.1, 1e-3), curved)
    step = FIRST_PACE_S
    for begin in np.arange(0, seconds, step):
        at = (times >= begin) & (times < begin + step)
        ring.push(AccelBlock(times[at], accel[at]))
        for time in np.arange(begin, begin + step, 0.01):
            sensor.moved(ServoSample(name, time, 0.0, waves[name](time + shift[name])) for name in levers)
        sensor.look(begin + step)
    return sensor


@pytest.mark.parametrize(
    ("felt", "missing"),
    [
        ({"elbow": 0.1, "wrist": 0.1}, []),
        ({"elbow": -0.05, "wrist": 0.3}, []),
        ({"elbow": 0.1}, ["wrist"]),
        ({}, ["elbow", "wrist"]),
    ],
)
def test_which_joints_a_sensor_feels(felt: dict[str, float], missing: list[str]) -> None:
    """Of two joints with arms of 0.1 m those that move the sensor not at all are told, half an arm and the other sign
    are not."""
    sensor = check({"elbow": 0.1, "wrist": 0.1}, felt)
    assert [joint for joint in ("elbow", "wrist") if "does not feel" in sensor.fault(joint)] == missing


def test_a_motion_that_was_never_felt_is_a_doubt_before_it_is_a_fault() -> None:
    """After one comparison the joint that is not felt is in doubt, after five the sensor is at fault; one that is felt
    is in no doubt, and none is before anything was compared."""
    levers = {"elbow": 0.1, "wrist": 0.1}
    for seconds, doubted, at_fault in (
        (2.0, False, False),
        (5.0, True, False),
        (20.0, True, False),
        (25.0, True, True),
    ):
        sensor = check(levers, {"elbow": 0.1}, seconds=seconds)
        assert (sensor.doubt("elbow"), sensor.fault("elbow")) == ("", "")
        assert sensor.doubt("wrist") == ("tip has not felt the motion of wrist yet" if doubted else "")
        assert ("does not feel the motion of wrist" in sensor.fault("wrist")) is at_fault


@pytest.mark.parametrize(("lever", "told"), [(0.1, True), (-0.1, False)])
def test_a_sensor_that_is_turned_round_is_a_fault(lever: float, told: bool) -> None:
    """A healthy joint was an ERROR of more than a degree of play by a sensor with the opposite sign: after five
    comparisons it is told, unless the sign of the lever says the same."""
    sensor = check({"elbow": lever}, {"elbow": -0.1}, seconds=25.0)
    assert ("tip feels the motion of elbow with the opposite sign" in sensor.fault("elbow")) is told
    assert bool(sensor.doubt("elbow")) is told


@pytest.mark.parametrize(("late_s", "is_fault"), [(0.1, False), (0.3, True), (0.4, True), (-0.5, True)])
def test_readings_of_another_time_are_a_fault(late_s: float, is_fault: bool) -> None:
    """A healthy joint was an ERROR of two degrees of play by readings that came 0.4 s late: after five comparisons that
    is a fault, and it stays one; a tenth of a second is none."""
    for seconds in (30.0, 95.0):
        sensor = check({"elbow": 0.1}, {"elbow": 0.1}, seconds=seconds, late_s=late_s)
        assert ("tip feels the motion of elbow at another time" in sensor.fault("elbow")) is is_fault
        assert bool(sensor.doubt("elbow")) is is_fault


def test_a_doubt_keeps_a_joint_from_being_ok() -> None:
    """Twenty sound windows are not enough while there is one; it is told as the reason, and is no alarm."""
    noon = datetime(2026, 1, 31, 12, tzinfo=UTC)
    windows = [ScoreRow("elbow", noon + timedelta(seconds=k), 0.25, 1.0, 8.0, False) for k in range(20)]
    monitor = JointMonitor(JointRow("elbow"), AlarmOptions(), windows)
    assert monitor.tick(noon) == []
    assert monitor.row.health is Health.OK
    assert monitor.compared("tip has not felt the motion of elbow yet", 1, noon) == []
    assert monitor.tick(noon) == [monitor.row]
    told = (Health.DEGRADED, "not judged yet: tip has not felt the motion of elbow yet")
    assert (monitor.row.health, monitor.row.reason) == told
    monitor.compared("", None, noon)
    assert monitor.tick(noon) == [monitor.row]
    assert monitor.row.health is Health.OK


def test_a_sensor_in_doubt_raises_no_alarm_of_play() -> None:
    """Windows of large scores count neither for play nor for OK while the sensor has not felt the motion, and do as
    soon as it has."""
    noon = datetime(2026, 1, 31, 12, tzinfo=UTC)
    loud = [ScoreRow("elbow", noon + timedelta(seconds=k), 0.25, 99.0, 8.0, True) for k in range(10)]
    monitor = JointMonitor(JointRow("elbow"), AlarmOptions())
    monitor.compared("tip has not felt the motion of elbow yet", 1, noon)
    assert [change for score in loud for change in monitor.scored(score)] == []
    monitor.tick(noon)
    assert monitor.row.reason == "not judged yet: tip has not felt the motion of elbow yet"
    monitor.compared("", None, noon)
    assert [change for score in loud for change in monitor.scored(score)] != []
    assert monitor.row.health is Health.WARNING


@pytest.mark.parametrize(
    ("doubt", "comparisons", "health"),
    [
        ("", 1, Health.DEGRADED),
        ("", 2, Health.WARNING),
        ("", None, Health.WARNING),
        ("tip has not felt the motion of elbow yet", 2, Health.DEGRADED),
    ],
)
def test_windows_wait_for_the_next_comparison(doubt: str, comparisons: int | None, health: Health) -> None:
    """Until the sensor is known to feel its joint, windows count once a later comparison, even one without a result,
    has found nothing against them; what the sensor shows after it waits again."""
    noon = datetime(2026, 1, 31, 12, tzinfo=UTC)
    loud = [ScoreRow("elbow", noon + timedelta(seconds=k), 0.25, 99.0, 8.0, True) for k in range(10)]
    monitor = JointMonitor(JointRow("elbow"), AlarmOptions())
    assert [change for score in loud for change in monitor.scored(score, None, 1)] == []
    assert monitor.scored(loud[0], None, 2) == []
    monitor.compared(doubt, comparisons, noon + timedelta(seconds=20))
    assert monitor.row.health is health
    assert len(monitor.windows) == {1: 0, 2: 10 if not doubt else 0, None: 11}[comparisons]


@pytest.mark.slow
def test_a_turned_sensor_raises_no_alarm_of_play(tmp_path: Path, start: Start) -> None:
    """A healthy joint was an ERROR of play within three seconds, before readings and motion were first compared: there
    is an alarm of the device, none of play, and the joint is never OK."""
    motion = Turned(play=0.0)
    with Emulator(ServoLine.of("AX-12A", [3], motion), CsvStream(motion, 800.0)) as emulator:
        path = configured(tmp_path, emulator)
        text = path.read_text().replace('"witmotion"', '"csv_serial"').replace("rate_hz = 200", "rate_hz = 800")
        path.write_text(text.replace('axis = "x"', "") + "severity_warning = 0.005\nseverity_error = 0.01\n")
        service = start(path)
        service.wait_for("tip feels the motion of elbow with the opposite sign")
        assert service.stop(signal.SIGTERM) == 0
    log = service.log.read_text()
    assert "cause=play" not in log
    assert "health=OK" not in log


def test_a_joint_at_rest_accuses_no_sensor() -> None:
    """An angle that flickers by a servo's step of 5 mrad, and one that hardly moves, are no motion to be felt."""
    rng, ring = np.random.default_rng(3), Ring(8000, Waker())
    sensor = SensorCheck("tip", ring, {"elbow": 0.1, "wrist": 0.1})
    for begin in range(0, 100, 5):
        times = np.arange(begin, begin + 5, 0.005)
        ring.push(AccelBlock(times, rng.normal(0, 1e-3, times.size)))
        flicker = rng.integers(0, 2, 500) * 5.1e-3
        for time, angle in zip(np.arange(begin, begin + 5, 0.01), flicker, strict=True):
            slow = 0.3 * np.sin(0.5 * time)
            sensor.moved([ServoSample("elbow", time, 0.0, angle), ServoSample("wrist", time, 0.0, slow)])
        sensor.look(begin + 5.0)
    assert sensor.fault("elbow") == sensor.fault("wrist") == ""


def window(quality: str, value: float = 0.0) -> tuple[Window, Score]:
    """A window of this quality."""
    accel = np.full(50, value)
    return Window("elbow", 0.0, 0.25, np.arange(50) / 200, accel, 200.0), Score(
        "elbow", 0.0, 0.25, 1.0, 8.0, impact=False, quality=quality
    )


def test_ten_unsound_windows_are_a_fault_and_five_sound_ones_its_end() -> None:
    """Nine are none; gentle ones count as neither; the words stay the same until all ten have another cause."""
    sensor = SensorCheck("tip", Ring(1000, Waker()), {"elbow": 0.1})
    for _ in range(LAST - 1):
        sensor.scored(*window("flat"))
        sensor.scored(*window("gentle"))
    assert sensor.fault("elbow") == ""
    sensor.scored(*window("flat,gentle"))
    assert sensor.fault("elbow").startswith("tip shows the same value all the time, 0 m/s²")
    for quality in (*["gappy"] * 9, *["ok"] * 4):
        sensor.scored(*window(quality))
        assert sensor.fault("elbow").startswith("tip shows the same value all the time, 0 m/s²")
    for _ in range(LAST):
        sensor.scored(*window("gappy"))
    assert sensor.fault("elbow").startswith("tip loses samples in every window")
    for _ in range(4):
        sensor.scored(*window("ok"))
    sensor.scored(*window("ok"))
    assert sensor.fault("elbow") == ""


def test_losses_hide_no_held_value(tmp_path: Path, fake_driver: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a service that was stopped: both are told; windows with gaps follow from the losses and are not."""
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path))
    robot = Robot(config.load(path))
    (joint,), check = robot.config.joints, robot._checks["tip"]
    for poller in robot.pollers:
        poller.status.state = DeviceState.READING
        poller.status.last_seen.update(dict.fromkeys(poller.members, monotonic()))
    assert robot.fault(joint) == ""
    monkeypatch.setattr(Losses, "fault", lambda *_: "30% of the samples were lost within 12 s")
    for _ in range(LAST):
        check.scored(*window("flat"))
    told = robot.fault(joint)
    assert told is not None
    assert "elbow: 30% of the samples were lost" in told
    assert "; tip shows the same value all the time, 0 m/s²" in told
    for _ in range(LAST):
        check.scored(*window("gappy"))
    told = robot.fault(joint)
    assert told is not None
    assert "in every window" not in told


@pytest.mark.parametrize(("share", "told"), [(0.18, ""), (0.22, "22% of the samples were lost within 10 s")])
def test_a_rate_of_losses(share: float, told: str) -> None:
    """More than a fifth, over ten seconds at least, is told; it is over when under a tenth is lost in half a minute."""
    losses = Losses()
    said = [losses.fault(float(s), 200.0 * s, 200.0 * s * (1 - share)) for s in range(61)]
    assert set(said[:10]) == {""}
    assert said[60] == told
    got = 200.0 * 60 * (1 - share)
    later = [losses.fault(60.0 + s, 200.0 * (60 + s), got + 200.0 * s) for s in range(31)]
    assert later[5] == told
    assert later[-1] == ""


def test_a_fresh_joint_is_not_ok(tmp_path: Path, start: Start) -> None:
    """A servo that holds still: nothing is wrong and nothing is known, so no alarm, and DEGRADED with the reason."""
    motion = Motion()
    line, stream = ServoLine.of("AX-12A", [3], motion), WitMotionStream(motion)
    line.servos[3].hold()
    with Emulator(line, stream) as emulator:
        service = start(configured(tmp_path, emulator))
        service.wait_for("tip: reading")
        wait_until(lambda: (tmp_path / "history.db").exists())
        assert not is_healthy(tmp_path)
        assert service.stop(signal.SIGTERM) == 0
    with open_readonly(tmp_path / "history.db") as reader:
        (row,) = reader.joints()
        assert (row.health, row.reason) == (Health.DEGRADED, "not judged yet: too few sound windows")
        assert reader.alarms() == []
