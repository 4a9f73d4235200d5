"""Configurations that no person would write: each is taken or refused in one line, and no service ends by one."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lostmotion.daemon import config, service
from lostmotion.daemon.config import ConfigError
from lostmotion.daemon.database import StoreError
from lostmotion.daemon.robot import Robot
from lostmotion.daemon.signals import Flags
from lostmotion.drivers import toml_text
from tests.daemon.cli_world import call
from tests.daemon.conftest import Running, wait_until
from tests.daemon.fakes import fake_config
from tests.daemon.test_service import count

SIMULATED = """[robot]
name = "arm"
[store]
path = "history.db"
keep_windows_mb = 100
keep_scores_days = 730
[[accelerometer]]
name = "tip"
driver = "simulated"
rate_hz = 1000
noise_ms2 = 0.1
oscillator = { f_res_hz = 58.0, zeta = 0.012 }
[[joint]]
name = "elbow"
driver = "simulated"
accelerometer = "tip"
play_m = 3e-5
wear_per_year = 2.0
[detector]
window_s = 0.25
f_norm_hz = 100.0
level = 4.0
[simulated]
speed = 1
seed = 1
motion = "hand-waved"
start = 2026-01-01T00:00:00Z
[alarm]
trend_days = 30
[metrics]
listen = "127.0.0.1:9464"
"""
DIGITS = "9" * 5000
LONG = "a" * 5000
ATTACKS = {
    "a user that is not": ('"history.db"', '"~nosuchuser/h.db"', "store.path: found '~nosuchuser/h.db'"),
    "NUL in a path": ('"history.db"', r'"/tmp/a\u0000b"', "store.path: found"),
    "5000 characters": ('"history.db"', f'"/tmp/{LONG}"', "store.path: found"),
    "a long file name": ('"history.db"', f'"/tmp/{LONG[:300]}"', "store.path: File name too long"),
    "a device": ('"history.db"', '"/dev/zero"', "store.path: found a device or a pipe, /dev/zero; expected a file"),
    "1e308": ("level = 4.0", "level = 1e308", "detector.level: found 1e+308, expected 0, or a number between"),
    "1e308 window": ("window_s = 0.25", "window_s = 1e308", "detector.window_s: found 1e+308"),
    "1e300 days": ("days = 730", "days = 1e300", "store.keep_scores_days: found 1e+300"),
    "1e308 MB": ("windows_mb = 100", "windows_mb = 1e308", "store.keep_windows_mb: found 1e+308"),
    "almost 0": ("noise_ms2 = 0.1", "noise_ms2 = 1e-320", "accelerometer 'tip'.noise_ms2: found 1e-320"),
    "wear": ("wear_per_year = 2.0", "wear_per_year = 1e5", "wear_per_year: found 100000.0; expected a number <= 100"),
    "speed": ("speed = 1", "speed = 1e9", "simulated.speed: found 1000000000.0; expected a number <= 10000000.0"),
    "5000 digits": ("seed = 1", f"seed = {DIGITS}", "found a number that is too long, expected whole numbers of at"),
    "hexadecimal": ("seed = 1", f"seed = 0x{DIGITS}", "found a number that is too long, expected whole numbers of at"),
    "3000 lists": ("seed = 1", f"seed = {'[' * 3000}{']' * 3000}", "nested too deeply, expected at most 64 levels"),
    "3000 tables": ("seed = 1", f"seed = {'{a=' * 3000}1{'}' * 3000}", "nested too deeply, expected at most 64"),
    "100 lists": ("seed = 1", f"seed = {'[' * 100}{']' * 100}", "nested too deeply, expected at most 64 levels"),
    "50000 parts": ("seed = 1", f"{'a.' * 50_000}b = 1", "found a key of more than 64 parts"),
    "50000 parts in quotes": ("seed = 1", '"=\\"".' * 50_000 + "b = 1", "found a key of more than 64 parts"),
    "year 1": ("2026-01-01T00:00:00Z", "0001-01-01T00:00:00+14:00", "found a time in the year 1"),
    "year 9000": ("2026-", "9000-", "simulated.start: found 9000-01-01 00:00:00+00:00, expected a time between"),
    "no motion": ('"hand-waved"', '"zzz"', "simulated.motion: no motion is called 'zzz'; there are sine"),
    "endless motion": ('"hand-waved"', '"sine:1e300,1e300"', "simulated.motion: 'sine:1e300,1e300' is no motion"),
    "a jump": ('"hand-waved"', '"step:1e12,1e-12,0"', "simulated.motion: 'step:1e12,1e-12,0' reaches 1.88e+24 rad/s"),
    "no address": ('"127.0.0.1:9464"', '"999.1.1.1:9464"', "metrics.listen: found '999.1.1.1:9464', expected ADDRESS"),
}
VALUES = ("1e308", "-1e308", "1e-320", "inf", "nan", "0", "-1", "1e12", "9" * 30, DIGITS, '""', r'"\u0000"',
          f'"{LONG}"', '"~nosuchuser/x"', '"/"', "[]", "{}", "[[[1]]]", "true", "0001-01-01T00:00:00+23:59",
          "9998-12-31T23:59:59Z", "1979-05-27", "07:32:00", '"max"', '"auto"', '"sine:1e308,1e308"',
          '"hand-waved:1e300"')  # fmt: skip
LINES = tuple(SIMULATED.splitlines())

Start = Callable[..., Running]


def attacked(name: str) -> str:
    """The good configuration with one change."""
    old, new, _ = ATTACKS[name]
    assert SIMULATED.count(old) == 1
    return SIMULATED.replace(old, new)


def refused(action: Callable[[], object]) -> str:
    """What a ConfigError or TomlError says, "" without one."""
    try:
        action()
    except (ConfigError, toml_text.TomlError) as error:
        return str(error)
    return ""


def take(text: str) -> None:
    """What a service does with a configuration before it changes over to it."""
    with_values = config.loads(text, "x.toml")
    Robot(with_values)
    int(with_values.store.keep_windows_mb * 1e6), int(with_values.store.keep_scores_days * 86_400e6)


@pytest.mark.parametrize("name", ATTACKS)
def test_an_absurd_value_is_refused_in_one_line(name: str) -> None:
    """The file and the key are named, and the line is short whatever the value's length."""
    message = refused(lambda: config.loads(attacked(name), "bad.toml"))
    assert message.startswith("bad.toml: ")
    assert ATTACKS[name][2] in message
    assert "\n" not in message
    assert len(message) < 250


@pytest.mark.parametrize(("old", "begin", "end"), [
    ('"elbow"', "joint.name: found 'aaa", "a', expected letters, digits, _ . or - (it becomes part of a Zenoh key)"),
    ("noise_ms2", "accelerometer 'tip'.aaa", "noise_ms2, oscillator, port, range_ms2, rate_hz, resolution_ms2"),
])  # fmt: skip
def test_a_name_of_a_page_is_not_told_in_full(old: str, begin: str, end: str) -> None:
    """The refusal of a key or name of thousands of characters had all of them; what was expected is still said."""
    text = SIMULATED.replace(old, f'"{LONG[:4000]}"' if '"' in old else LONG)
    message = refused(lambda: config.loads(text, "bad.toml"))
    assert message.startswith(f"bad.toml: {begin}")
    assert message.endswith(end)
    assert len(message) < 1000


def test_the_unattacked_configuration_is_taken() -> None:
    """Else the attacks would show nothing."""
    take(SIMULATED)


@pytest.mark.slow
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.tuples(st.integers(0, len(LINES) - 1), st.sampled_from(VALUES)), min_size=1, max_size=3))
def test_any_value_anywhere_is_taken_or_refused(changes: list[tuple[int, str]]) -> None:
    """Whatever stands for whichever values: a configuration that a robot can be made of, or ConfigError."""
    lines = list(LINES)
    for number, value in changes:
        key, equals, _ = lines[number].partition(" = ")
        lines[number] = f"{key} = {value}" if equals else lines[number]
    assert "\n" not in refused(lambda: take("\n".join(lines)))


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_file_is_taken_or_refused(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Bytes in place of others, also what is no text: one line, and no other error."""
    file = tmp_path_factory.getbasetemp() / "any.toml"
    text = SIMULATED.encode()
    begin, end = sorted(data.draw(st.tuples(*[st.integers(0, len(text))] * 2)))
    middle = data.draw(st.binary(max_size=20) | st.text("[]{}=.,\"'\\#\n0e-x", max_size=40).map(str.encode))
    file.write_bytes(text[:begin] + middle + text[min(end, begin + 40) :])
    assert "\n" not in refused(lambda: config.load(file))


@settings(max_examples=300, deadline=None)
@given(st.text("[]{}=.,\"'\n 0a", max_size=200))
def test_any_text_is_toml_or_not(text: str) -> None:
    """The parser answers with values or with its own error."""
    assert "\n" not in refused(lambda: toml_text.loads(text))


def test_what_is_no_configuration_file_is_refused(tmp_path: Path) -> None:
    """A device without end, and a pipe into which nobody writes, are not waited for."""
    os.mkfifo(tmp_path / "pipe.toml")
    for path, expected in ((Path("/dev/zero"), "found more than 1000000 characters"),
                           (tmp_path / "pipe.toml", "found a pipe, expected a file"),
                           (tmp_path, "cannot be read: Is a directory")):  # fmt: skip
        with pytest.raises(ConfigError, match=expected):
            config.load(path)


def test_a_text_file_is_no_database(tmp_path: Path, start: Start) -> None:
    """The configuration itself as store.path was moved aside as a damaged database: `config check`, a start and a
    reload refuse it and leave it where it is.  What is empty, or holds a NUL or other bytes, the store judges."""
    file = tmp_path / "arm.toml"
    text = SIMULATED.replace("history.db", str(file))
    file.write_text(text)
    for command in (("config", "check", file), ("run", "--config", file)):
        told = call(*command)
        assert told.exit_code == 2
        assert f"store.path: found a text file, {file}; expected a database, or no file yet" in told.stderr
        assert told.stderr.count("\n") == 1
    for content in (b"", b"a\0b", b"\xff" * 99, "ü".encode()[:1]):
        (tmp_path / "some.db").write_bytes(content)
        config.loads(SIMULATED.replace("history.db", str(tmp_path / "some.db")), "x.toml")
    service_file = tmp_path / "fake.toml"
    service_file.write_text(fake_config(tmp_path))
    running = start(service_file)
    running.wait_for("started")
    service_file.write_text(fake_config(tmp_path).replace("history.db", "arm.toml"))
    running.process.send_signal(signal.SIGHUP)
    running.wait_for("the old configuration stays")
    assert running.stop(signal.SIGTERM) == 0
    assert file.read_text() == text
    assert not [*tmp_path.glob("arm.toml.*")]


def test_a_reload_leaves_sqlite_its_locks(tmp_path: Path, start: Start) -> None:
    """To look into a database that is open, and close it again, would end the locks that keep its log."""
    file, database = tmp_path / "fake.toml", tmp_path / "history.db"
    file.write_text(fake_config(tmp_path))
    running = start(file)
    wait_until(lambda: count(database) > 1)
    running.process.send_signal(signal.SIGHUP)
    running.wait_for("configuration taken")
    with closing(sqlite3.connect(database)) as db:
        db.execute("SELECT count(*) FROM score").fetchone()
    assert database.with_name("history.db-wal").exists()
    assert running.stop(signal.SIGTERM) == 0


def test_a_zenoh_file_without_end_is_refused(tmp_path: Path) -> None:
    """Zenoh would read a device until the memory is full, and wait for a pipe: a reload did neither end nor fail."""
    os.mkfifo(tmp_path / "pipe.json5")
    for path, expected in (("/dev/zero", "found more than 1000000 characters"),
                           (tmp_path / "pipe.json5", "found a pipe, expected a file"),
                           (tmp_path / "none.json5", "cannot be read: No such file")):  # fmt: skip
        zenoh = f'[alarm.zenoh]\nconfig = "{path}"\nlisten = ["tcp/127.0.0.1:7447"]\n'
        message = refused(lambda text=SIMULATED + zenoh: config.loads(text, "x.toml"))  # type: ignore[misc]
        assert message.startswith(f"x.toml: alarm.zenoh.config: {path}: {expected}")


@pytest.mark.parametrize("where", ["file", "passwords", "endpoint"])
def test_a_key_without_end_is_refused(where: str, tmp_path: Path) -> None:
    """Keys, certificates and passwords that are a device, a pipe or a directory: Zenoh would read until the memory is
    full, or wait, when the session is opened; the commands that ask a fleet refuse them, too."""
    os.mkfifo(tmp_path / "pipe.pem")
    file, endpoint = tmp_path / "own.json5", "tls/127.0.0.1:7447"
    for path, what in (("/dev/zero", "device or a pipe"), (tmp_path / "pipe.pem", "device or a pipe"),
                       (tmp_path, "directory")):  # fmt: skip
        for name in ("root_ca_certificate", "listen_private_key", "connect_certificate"):
            if where == "endpoint":
                told = f"alarm.zenoh: {name}_file: found a {what}, {path}; expected a file"
                zenoh = f'[alarm.zenoh]\nlisten = ["{endpoint}#enable_mtls=true;{name}_file={path}"]\n'
            elif where == "passwords":
                told = f"alarm.zenoh.config: {file}: dictionary_file: found a {what}, {path}; expected a file"
                file.write_text(json.dumps({"transport": {"auth": {"usrpwd": {"dictionary_file": str(path)}}}}))
                zenoh = f'[alarm.zenoh]\nconfig = "{file}"\nlisten = ["{endpoint}"]\n'
            else:
                told = f"alarm.zenoh.config: {file}: {name}: found a {what}, {path}; expected a file"
                file.write_text(json.dumps({"transport": {"link": {"tls": {name: str(path)}}}}))
                zenoh = f'[alarm.zenoh]\nconfig = "{file}"\nlisten = ["{endpoint}"]\n'
            message = refused(lambda text=SIMULATED + zenoh: config.loads(text, "x.toml"))  # type: ignore[misc]
            assert message == f"x.toml: {told}"
            if where != "endpoint":
                asked = call("fleet", "status", "--zenoh", file, "--connect", endpoint)
                assert asked.exit_code == 2
                assert asked.stderr.count("\n") == 1
                assert told.removeprefix(f"alarm.zenoh.config: {file}: ") in asked.stderr


@pytest.mark.slow
def test_no_file_ends_a_running_service(tmp_path: Path, start: Start) -> None:
    """After SIGHUP with each of the attacks the service scores on, and takes a good file at the end."""
    file, database = tmp_path / "fake.toml", tmp_path / "history.db"
    good = fake_config(tmp_path)
    file.write_text(good)
    running = start(file)
    running.wait_for("started")
    for number, name in enumerate(ATTACKS, start=1):
        file.write_text(attacked(name))
        running.process.send_signal(signal.SIGHUP)
        running.wait_for("the old configuration stays", number)
    assert "internal error" not in running.log.read_text()
    before = count(database)
    wait_until(lambda: count(database) > before + 1)
    file.write_text(good.replace('"fake"', '"arm2"', 1))
    running.process.send_signal(signal.SIGHUP)
    running.wait_for("configuration taken: robot arm2")
    assert running.stop(signal.SIGTERM) == 0


@pytest.mark.parametrize("stage", ["reading", "beginning"])
def test_an_error_of_any_kind_leaves_the_old_configuration_alive(
    stage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fake_driver: None, caplog: pytest.LogCaptureFixture
) -> None:
    """A reading that raises what nobody thought of, and a configuration that cannot be begun after the old one was
    ended: the old one is in force, with its database open and its threads alive."""
    old = config.loads(fake_config(tmp_path), "old")
    new = config.loads(fake_config(tmp_path).replace("history.db", "new.db"), "new")

    def reading() -> config.Config:
        if stage == "reading":
            raise SystemExit(3)
        return new

    make = service._sinks

    def sinks(given: config.Config) -> list[service.Sink]:
        if given is new:
            raise StoreError("no sinks today")
        return make(given)

    monkeypatch.setattr(service, "_sinks", sinks)
    running = service.Service(old, reading, Flags())
    running.startup()
    try:
        running._take_new_configuration()
        assert running._config is old
        assert "the old configuration stays" in caplog.text
        before = running._robot.samples
        wait_until(lambda: running._robot.samples > before)
        assert running._store.is_open
        assert running._store.path == tmp_path / "history.db"
    finally:
        assert running.shutdown() == 0
