"""The service as a whole: real processes, real signals, emulated devices on pseudo-terminals, recordings."""

from __future__ import annotations

import json
import os
import re
import resource
import signal
import socket
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import AlarmEvent, AlarmRow, AlarmState, Cause, Health, JointRow, Request, Verb
from lostmotion.daemon.requests import ask
from lostmotion.daemon.store import Store
from lostmotion.drivers.emulator import CsvStream, Emulator, Motion, ServoLine, TextStream
from tests.daemon.cli_world import SECOND_JOINT, SIMULATED, call
from tests.daemon.conftest import Running, SmallDisk, wait_until
from tests.daemon.fakes import fake_config, files_up_to
from tests.drivers.test_holders import SLEEPING, program

Start = Callable[..., Running]


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    """A file that configures the fake robot."""
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path))
    return path


def count(database: Path, joint: str = "elbow") -> int:
    """How many scores of a joint are committed; 0 while there is no database."""
    try:
        with closing(sqlite3.connect(f"{database.as_uri()}?mode=ro", uri=True)) as db:
            return int(db.execute("SELECT count(*) FROM scores WHERE joint = ?", [joint]).fetchone()[0])
    except sqlite3.OperationalError:
        return 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_finishes_what_is_open(configuration: Path, start: Start, number: signal.Signals) -> None:
    """Exit 0, and every window that was triggered is in the database: the open one was finished, not dropped."""
    service = start(configuration)
    wait_until(lambda: count(configuration.parent / "history.db") >= 3)
    assert service.stop(number) == 0
    triggered, scored, lost = re.findall(r"triggered=(\d+) scored=(\d+) lost: (.*)", service.log.read_text())[-1]
    assert triggered == scored
    assert lost == "none"
    assert count(configuration.parent / "history.db") == int(scored)


@pytest.mark.slow
def test_windows_follow_the_commands_rhythm(configuration: Path, start: Start) -> None:
    """The fake joint reverses its acceleration every 250 ms: so are the windows' times, in UTC of now."""
    service = start(configuration)
    wait_until(lambda: count(configuration.parent / "history.db") >= 6)
    service.stop(signal.SIGTERM)
    with open_readonly(configuration.parent / "history.db") as reader:
        times = np.array([row.time.timestamp() for row in reader.scores("elbow")])
        assert [row.temperature for row in reader.scores("elbow", limit=1)] == [40.0]
        assert reader.joints()[0].health is Health.OK
        assert {device.state for device in reader.devices()} == {"reading"}
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.25), abs=0.02)
    assert abs(times[-1] - time.time()) < 10.0


@pytest.mark.slow
def test_the_main_thread_works_in_cycles(configuration: Path, start: Start) -> None:
    """Five times a second, though the fake servos bring samples two hundred times a second and a window ends every
    250 ms: each wake-up costs as much as a score."""
    service = start(configuration)
    wait_until(lambda: count(configuration.parent / "history.db") >= 3)
    status = Path(f"/proc/{service.process.pid}/task/{service.process.pid}/status")

    def waits() -> int:
        return int(re.findall(r"\nvoluntary_ctxt_switches:\s+(\d+)", status.read_text())[0])

    before, since = waits(), time.monotonic()
    time.sleep(4.0)
    rate = (waits() - before) / (time.monotonic() - since)
    assert service.stop(signal.SIGTERM) == 0
    assert 2.0 < rate < 20.0


@pytest.mark.slow
def test_reload_takes_a_good_configuration_and_keeps_the_old_one_before_a_bad_one(
    configuration: Path, start: Start
) -> None:
    """SIGHUP with a typo: one log line, scoring goes on; with a second joint: that joint is scored too."""
    database = configuration.parent / "history.db"
    service = start(configuration)
    service.wait_for("started")
    good = configuration.read_text()
    configuration.write_text(good.replace("window_s", "windows_s"))
    service.process.send_signal(signal.SIGHUP)
    log = service.wait_for("the old configuration stays")
    assert "detector.windows_s: unknown key; did you mean window_s?" in log
    before = count(database)
    wait_until(lambda: count(database) > before + 1)
    configuration.write_text(fake_config(configuration.parent, joints=["elbow", "wrist"]))
    service.process.send_signal(signal.SIGHUP)
    service.wait_for("configuration taken: robot fake, 2 joints")
    before = count(database)
    wait_until(lambda: count(database, "wrist") > 1 and count(database) > before + 1)
    assert service.stop(signal.SIGTERM) == 0


@contextmanager
def manager(folder: Path) -> Iterator[socket.socket]:
    """systemd's end of the notification socket, at ``folder``/notify."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.bind(str(folder / "notify"))
        end.settimeout(60.0)
        yield end


def words(end: socket.socket, seconds: float) -> set[str]:
    """The states that a manager hears within some seconds; what had come before does not count."""
    end.setblocking(False)
    with suppress(BlockingIOError):
        while end.recv(1000):
            pass
    end.settimeout(60.0)
    heard, stop = set(), time.monotonic() + seconds
    while time.monotonic() < stop:
        heard.add(end.recv(1000).decode().partition("=")[0])
    return heard


@pytest.mark.slow
def test_systemd_hears_of_life_only_while_samples_arrive(tmp_path: Path, start: Start) -> None:
    """READY, STATUS and WATCHDOG arrive; WATCHDOG ceases with the ports gone, and with one that hangs in a read, as the
    log says; STOPPING comes at the end."""
    missing, hanging = tmp_path / "missing", tmp_path / "hanging"
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path, f'[fake]\nmissing = "{missing}"\nhanging = "{hanging}"\n'))
    with manager(tmp_path) as end:
        service = start(path, NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="300000")
        assert end.recv(1000) == b"READY=1"
        wait_until(lambda: words(end, 1.2) == {"STATUS", "WATCHDOG"})
        missing.touch()
        service.wait_for("the port went away", 2)
        wait_until(lambda: words(end, 1.5) == {"STATUS"})  # ten feeds would fit
        missing.unlink()
        service.wait_for("tip: reading", 2)
        wait_until(lambda: "WATCHDOG" in words(end, 1.2))
        hanging.touch()
        service.wait_for("tip: no sign of life for 0.3 s; the watchdog is not fed")
        wait_until(lambda: words(end, 1.5) == {"STATUS"})
        hanging.unlink()
        service.process.send_signal(signal.SIGTERM)
        wait_until(lambda: end.recv(1000) == b"STOPPING=1")


def test_the_journal_gets_priorities(configuration: Path, start: Start) -> None:
    """Under systemd without journald each line begins with its level and carries no time of its own."""
    service = start(configuration, INVOCATION_ID="1")
    service.wait_for("<6>started: robot fake, 1 joint")
    service.stop(signal.SIGTERM)


@pytest.mark.slow
def test_a_wrong_servo_is_an_alarm_and_the_others_go_on(tmp_path: Path, start: Start) -> None:
    """One impostor on the bus: its joint is DEGRADED and has an alarm with the reason, the other one is scored."""
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path, joints=["elbow", "impostor"]))
    service = start(path)
    service.wait_for("health joint=elbow health=OK")
    service.wait_for("alarm joint=impostor")
    service.stop(signal.SIGTERM)
    with open_readonly(tmp_path / "history.db") as reader:
        healths = [(row.name, row.health) for row in reader.joints()]
        assert healths == [("elbow", Health.OK), ("impostor", Health.DEGRADED)]
        assert [alarm.reason for alarm in reader.active_alarms()] == ["impostor: found fake, expected fake"]
        assert reader.scores("impostor") == []


@pytest.mark.slow
def test_a_full_disk_stops_nothing(configuration: Path, start: Start) -> None:
    """While files cannot grow the service goes on and says so; afterwards every window in between is there."""
    database = configuration.parent / "history.db"
    service = start(configuration)
    wait_until(lambda: count(database) >= 2)
    pid, before = service.process.pid, resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (10_000, before[1]))
    service.wait_for("scoring continues, rows wait in memory")
    stood = count(database)
    time.sleep(1.0)
    assert count(database) == stood
    resource.prlimit(pid, resource.RLIMIT_FSIZE, before)
    service.wait_for("written again; 0 rows were dropped")
    assert service.stop(signal.SIGTERM) == 0
    with open_readonly(database) as reader:
        times = np.array([row.time.timestamp() for row in reader.scores("elbow")])
    assert np.diff(times).max() < 0.3


@pytest.mark.slow
def test_a_disk_that_is_full_at_the_start(tmp_path: Path, start: Start) -> None:
    """The service starts, says so as an error, scores, and knows the alarm of the run before; once there is room all is
    in the database, and the alarm still is the one it was."""
    path = tmp_path / "fake.toml"
    path.write_text(fake_config(tmp_path, joints=["elbow", "impostor"]))
    service = start(path)
    service.wait_for("alarm joint=impostor cause=device severity=error event=raised")
    assert service.stop(signal.SIGTERM) == 0
    stood = count(tmp_path / "history.db")
    with files_up_to(10_000):
        service = start(path, INVOCATION_ID="1")
    log = service.wait_for("scoring continues, rows wait in memory")
    assert re.search("^<3>.*the disk refuses", log, re.MULTILINE)
    service.wait_for("started")
    time.sleep(1.5)
    resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    service.wait_for("written again; 0 rows were dropped")
    wait_until(lambda: count(tmp_path / "history.db") >= stood + 6)
    time.sleep(1.5)  # the alarms are looked at again
    assert service.stop(signal.SIGTERM) == 0
    assert "event=raised" not in service.log.read_text()
    with open_readonly(tmp_path / "history.db") as reader:
        assert [alarm.state for alarm in reader.alarms("impostor")] == [AlarmState.ACTIVE]
        times = np.array([row.time.timestamp() for row in reader.scores("elbow")])
    assert np.sum(np.diff(times) > 0.3) == 1  # between the two runs


@pytest.mark.slow
def test_a_disk_that_has_no_room_for_the_state_folder(small_disk: SmallDisk, start: Start) -> None:
    """The service starts, says so, scores, and once there is room all is in the database."""
    path, database = small_disk.path / "fake.toml", small_disk.path / "state" / "history.db"
    path.write_text(fake_config(database.parent))
    small_disk.hold(2)
    service = start(path, HOME=str(small_disk.path))
    service.wait_for("the disk is full; free some space (No space left on device); scoring continues, rows wait")
    service.wait_for("started")
    time.sleep(1.5)
    small_disk.hold(1000)
    service.wait_for("written again; 0 rows were dropped")
    wait_until(lambda: count(database) >= 8)
    assert service.stop(signal.SIGTERM) == 0
    with open_readonly(database) as reader:
        times = np.array([row.time.timestamp() for row in reader.scores("elbow")])
    assert np.diff(times).max() < 0.3


def test_rows_that_a_full_disk_refused_to_the_end_are_told(configuration: Path, start: Start) -> None:
    """A service that has to stop while the disk is full says how many rows are lost, and exits with 1."""
    service = start(configuration)
    wait_until(lambda: count(configuration.parent / "history.db") >= 2)
    resource.prlimit(service.process.pid, resource.RLIMIT_FSIZE, (10_000, resource.RLIM_INFINITY))
    service.wait_for("scoring continues, rows wait in memory")
    assert service.stop(signal.SIGTERM) == 1
    assert re.search(r"[1-9]\d* rows were lost: .*disk", service.wait_for("stopped"))


def hardware(folder: Path, servo_port: str, accel_port: str) -> Path:
    """Two AX-12A and a microcontroller, on these ports."""
    path = folder / "hardware.toml"
    bus = f'driver = "dynamixel"\nport = "{servo_port}"\nmodel = "AX-12A"\naccelerometer = "tip"\n'
    path.write_text(
        f"""
[robot]
name = "arm"
[store]
path = "{folder / "history.db"}"
[[accelerometer]]
name = "tip"
driver = "csv_serial"
port = "{accel_port}"
rate_hz = 1000
time_column = 0
oscillator = {{ f_res_hz = 58.0 }}
"""
        f'[[joint]]\nname = "shoulder"\nid = 1\n{bus}'
        f'[[joint]]\nname = "elbow"\nid = 2\n{bus}'
    )
    return path


@pytest.mark.slow
def test_a_robot_is_unplugged_and_plugged_in_again(tmp_path: Path, start: Start) -> None:
    """Ports missing at the start are waited for; a bus unplugged on the way is an alarm until it is back, and all the
    while systemd hears of life."""
    motion = Motion(play=0.0, levers=(0.1, 0.1))
    path = hardware(tmp_path, str(tmp_path / "port.0"), str(tmp_path / "port.1"))
    path.write_text(path.read_text() + "[alarm]\noff_delay_s = 0\n")
    service = start(path, NOTIFY_SOCKET=str(tmp_path / "notify"), WATCHDOG_USEC="900000")
    service.wait_for("retrying", 2)
    log = service.wait_for("alarm joint=elbow cause=device severity=error event=raised")
    reason = re.search("alarm joint=elbow .*", log)
    assert reason
    assert re.search("dynamixel .*port.0 does not exist.*; tip: .*port.1 does not exist", reason[0])
    line, stream = ServoLine.of("AX-12A", [1, 2], motion), CsvStream(motion)
    with Emulator(line, stream, link=tmp_path / "port") as emulator, manager(tmp_path) as end:
        wait_until(lambda: count(tmp_path / "history.db") >= 5)
        service.wait_for("health joint=elbow health=OK")
        wait_until(lambda: told(tmp_path, "elbow")[-1:] == ["cleared"])
        emulator.unplug(0)
        wait_until(lambda: told(tmp_path, "elbow")[-1:] == ["raised"])
        wait_until(lambda: "WATCHDOG" in words(end, 1.5))
        before = count(tmp_path / "history.db")
        emulator.plug(0)
        wait_until(lambda: count(tmp_path / "history.db") > before + 2)
        wait_until(lambda: told(tmp_path, "elbow")[-1:] == ["cleared"])
        assert service.stop(signal.SIGTERM) == 0  # before the robot goes away again
    # twice, and once more each time that a busy machine makes an emulated servo late
    changes = told(tmp_path, "elbow")
    assert changes == ["raised", "cleared"] * (len(changes) // 2) != ["raised", "cleared"]


def told(folder: Path, joint: str) -> list[str]:
    """How the joint's device alarm came and went."""
    with open_readonly(folder / "history.db") as reader:
        found = [change for _, change in reader.transitions(joint) if change.alarm.cause is Cause.DEVICE]
    return [change.event.value for change in found if change.event is not AlarmEvent.CHANGED]


@pytest.mark.slow
def test_another_device_on_the_port_is_told(tmp_path: Path, start: Start) -> None:
    """A GPS receiver where the accelerometer should be: the joints' alarm names what was found and expected."""
    motion = Motion()
    with Emulator(ServoLine.of("AX-12A", [1, 2], motion), TextStream()) as emulator:
        service = start(hardware(tmp_path, *emulator.paths))
        log = service.wait_for("alarm joint=elbow")
        assert service.stop(signal.SIGTERM) == 0
    assert re.search(r"tip: wrong device: found .*expected ", log)
    assert "tip: tip:" not in log


@pytest.mark.slow
def test_the_robots_controller_on_the_same_port_is_told_by_name(tmp_path: Path, start: Start) -> None:
    """A program that has the servos' port open, without any lock: the joints' alarm names it, not a byte is sent, and
    both joints are scored once it has ended."""
    motion = Motion(play=1.0)
    with Emulator(ServoLine.of("AX-12A", [1, 2], motion), CsvStream(motion)) as emulator:
        with program(SLEEPING, emulator.paths[0]) as controller:
            service = start(hardware(tmp_path, *emulator.paths))
            service.wait_for(f"is open in another program, process {controller.pid} (")
            service.wait_for("alarm joint=elbow cause=device")
            assert count(tmp_path / "history.db") == 0
        wait_until(lambda: count(tmp_path / "history.db") > 1 and count(tmp_path / "history.db", "shoulder") > 1)
        assert service.stop(signal.SIGTERM) == 0


@pytest.mark.slow
def test_an_alarm_outlives_a_restart_until_its_device_reads(tmp_path: Path, start: Start) -> None:
    """First the port is missing, at the next start another servo is there: the alarm stays and tells the new fault."""
    motion = Motion()
    path = hardware(tmp_path, str(tmp_path / "port.0"), str(tmp_path / "port.1"))
    service = start(path)
    service.wait_for("alarm joint=elbow")
    assert service.stop(signal.SIGTERM) == 0
    with Emulator(ServoLine.of("AX-12A", [7], motion), CsvStream(motion), link=tmp_path / "port"):
        service = start(path)
        log = service.wait_for("alarm joint=elbow")
        assert service.stop(signal.SIGTERM) == 0
    assert "event=cleared" not in log
    with open_readonly(tmp_path / "history.db") as reader:
        (alarm,) = reader.alarms("elbow")
    assert (alarm.state, "no answer" in alarm.reason) == (AlarmState.ACTIVE, True)


@pytest.mark.slow
def test_alarms_outlive_a_database_that_is_damaged_in_use(tmp_path: Path, start: Start) -> None:
    """The service goes on in a new one, where the alarm still is the one that was acknowledged; what the other joint
    hears of it is an alarm of its own; no traceback."""
    path, database = tmp_path / "fake.toml", tmp_path / "history.db"
    path.write_text(fake_config(tmp_path, joints=["elbow", "impostor"]))
    service = start(path)
    service.wait_for("alarm joint=impostor cause=device severity=error event=raised")
    ask(database, Request(0, "impostor", Verb.ACK, by="anna"), datetime.now(UTC))
    service.wait_for("event=acknowledged")
    service.wait_for("health joint=elbow health=OK")
    before = known(database)[0]
    for file in (database, Path(f"{database}-wal")):
        with file.open("r+b") as pages:
            pages.seek(4096)
            pages.write(b"\xff" * (file.stat().st_size - 4096))
    service.wait_for("a new history begins")
    wait_until(lambda: count(database) >= 2)
    service.wait_for(
        "alarm joint=elbow cause=device severity=error event=raised state=active reason='a new history begins"
    )
    assert service.stop(signal.SIGTERM) == 0
    assert [alarm for alarm in known(database)[0] if alarm.joint == "impostor"] == before
    said = service.log.read_text()
    assert "Traceback" not in said
    assert said.count("event=") == 3


@pytest.mark.slow
def test_damage_that_only_a_reader_meets_is_told_once(configuration: Path, start: Start) -> None:
    """Requests are looked for every second and cannot be read: one line, scores go on, and no file is moved aside."""
    database = configuration.parent / "history.db"
    Store(database, "fake").close()
    with closing(sqlite3.connect(database)) as db:
        root, size = (db.execute(query).fetchone()[0] for query in (
            "SELECT rootpage FROM sqlite_schema WHERE name = 'request_that_waits'", "PRAGMA page_size"))  # fmt: skip
    service = start(configuration)
    wait_until(lambda: count(database) >= 1)
    with database.open("r+b") as file:
        file.seek((root - 1) * size)
        file.write(b"\xff" * size)
    service.wait_for("is damaged")
    before = count(database)
    wait_until(lambda: count(database) >= before + 16)  # four a second
    assert service.log.read_text().count("is damaged") == 1
    assert not [*database.parent.glob("history.db.damaged-*")]


def known(database: Path) -> tuple[list[AlarmRow], list[JointRow]]:
    """The alarms that are not normal, and the health of all joints."""
    with open_readonly(database) as reader:
        return reader.alarms(living=True), reader.joints()


@pytest.mark.slow
def test_a_replay_ends_by_itself(tmp_path: Path, start: Start) -> None:
    """A recording as fast as possible: exit 0 without a signal, a window at each of its 20 s x 2 reversals, none lost,
    times counted from the recording's start."""
    times = np.arange(20_000) / 1000
    rows = "".join(f"{t:.3f},{0.5 * np.sin(2 * np.pi * t):.6f},{np.sin(40 * t):.4f}\n" for t in times)
    (tmp_path / "rec.csv").write_text("# start = 2026-01-31T12:00:00Z\ntime,command,accel\n" + rows)
    path = tmp_path / "replay.toml"
    path.write_text(
        fake_config(tmp_path, '[replay]\nspeed = "max"\n')
        .replace('driver = "fake"', f'driver = "replay"\nport = "{tmp_path / "rec.csv"}"')
    )  # fmt: skip
    service = start(path)
    assert service.process.wait(60) == 0
    assert "lost: none" in service.log.read_text()
    with open_readonly(tmp_path / "history.db") as reader:
        found = [row.time.timestamp() - 1769860800 for row in reader.scores("elbow")]
    assert 37 <= len(found) <= 40
    assert np.diff(found) == pytest.approx(np.full(len(found) - 1, 0.5), abs=0.02)
    assert found[0] < 1.6


def run_until(text: str, database: Path, windows: int) -> None:
    """Runs the service in this process until so many more windows of the elbow are stored, for a minute at most."""
    from lostmotion.daemon import config, service

    enough, ended = count(database) + windows, threading.Event()

    def watch() -> None:
        while not ended.wait(0.05):
            if count(database) >= enough:
                os.kill(os.getpid(), signal.SIGTERM)
                return

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        assert service.run(config.loads(text, "simulated"), duration_s=60.0) == 0
    finally:
        ended.set()
        watcher.join()


@pytest.mark.slow
def test_the_built_in_robot_keeps_good_and_worn_joints_apart(tmp_path: Path) -> None:
    """At thirty times its speed, the elbow's scores lie above the shoulder's: worst quartile of one over best of the
    other."""
    from lostmotion.daemon import config

    text = (Path(config.__file__).parent / "simulated.toml").read_text()
    text = text.replace("speed = 1 ", "speed = 30 ") + f'[store]\npath = "{tmp_path / "history.db"}"\n'
    run_until(text, tmp_path / "history.db", 120)
    with open_readonly(tmp_path / "history.db") as reader:
        shoulder, elbow = ([row.score for row in reader.scores(name)] for name in ("shoulder", "elbow"))
    assert min(len(shoulder), len(elbow)) > 30
    assert np.percentile(elbow, 25) > np.percentile(shoulder, 75)


@pytest.mark.slow
def test_two_joints_on_one_accelerometer(tmp_path: Path) -> None:
    """Only the joint that has play is alarmed, before and after a restart, though the other's scores are as high; the
    size of its play is right within 15 %, and status tells whose it is."""
    text = SIMULATED.replace("history.db", f"{tmp_path}/history.db") + SECOND_JOINT + "levers_m = { tip = 0.25 }\n"
    for windows in (200, 50):  # the median of 160 is 6.9 mrad, that of 400 7.1
        run_until(text, tmp_path / "history.db", windows)
    with open_readonly(tmp_path / "history.db") as reader:
        assert {transition.alarm.joint for _, transition in reader.transitions()} == {"elbow"}
        (alarm,) = reader.active_alarms()
        assert "most probably of elbow" in alarm.reason
        scores = {joint: reader.scores(joint) for joint in ("elbow", "wrist")}
        (origin,) = reader.origins()
    assert origin.probabilities["wrist"] < 0.01
    assert np.median([row.score for row in scores["wrist"]]) > 4 * 5.5
    sizes = [row.play for row in scores["elbow"] if row.play > 0]
    assert np.median(sizes) == pytest.approx(8e-5 / 0.01, rel=0.15)
    told = call("status", "--database", tmp_path / "history.db", "--json").stdout
    assert 50 <= origin.windows <= 100
    assert json.loads(told)["attribution"] == [{"joints": origin.probabilities, "windows": origin.windows}]
    assert "play: most probably of elbow (over 99%)" in call("status", "--database", tmp_path / "history.db").stdout
