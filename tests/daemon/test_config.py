"""The configuration: what is taken, and in which words the rest is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from lostmotion.daemon import config
from lostmotion.daemon.config import ConfigError
from lostmotion.drivers.clock import CYCLE_S

GOOD = """
[robot]
name = "arm1"
[store]
path = "history.db"
[[accelerometer]]
name = "tip"
driver = "witmotion"
port = "/dev/ttyUSB1"
baudrate = 115200
rate_hz = 200
oscillator = { f_res_hz = 58.0, zeta = 0.012, length_m = 0.10 }
[[joint]]
name = "elbow"
driver = "dynamixel"
port = "/dev/ttyUSB0"
baudrate = 1000000
model = "AX-12A"
id = 3
poll_hz = 100
accelerometer = "tip"
[joint.detector]
level = 5.5
window_s = "auto"
[[joint]]
name = "wrist"
driver = "dynamixel"
port = "/dev/ttyUSB0"
baudrate = 1000000
model = "AX-12A"
id = 4
accelerometer = "tip"
[detector]
window_s = 0.25
f_width_hz = 12.0
f_norm_hz = 85.0
f_norm_width_hz = 20.0
level = 4.0
[alarm.zenoh]
mode = "peer"
connect = []
listen = ["tcp/127.0.0.1:7447"]
"""
WITMOTION = 'driver = "witmotion"\nport = "/dev/ttyUSB1"\nbaudrate = 115200'


def test_a_good_configuration_is_decoded_to_typed_values() -> None:
    """Every table of the documented example arrives with its values; a joint's own detector keys win."""
    good = config.loads(GOOD, "good.toml")
    assert [joint.name for joint in good.joints] == ["elbow", "wrist"]
    assert good.joint("elbow").model == "AX-12A"  # type: ignore[attr-defined]
    assert good.accelerometer("tip").oscillator.zeta == 0.012
    assert (good.settings("elbow").level, good.settings("elbow").window_s) == (5.5, None)
    assert (good.settings("wrist").level, good.settings("wrist").window_s) == (4.0, 0.25)
    assert good.settings("wrist").f_res_hz == 58.0
    assert good.zenoh is not None
    assert good.zenoh.listen == ["tcp/127.0.0.1:7447"]
    assert not good.zenoh.multicast_scouting
    assert [len(bus) for bus in good.buses()] == [2]


def test_notes_say_what_cannot_be_told() -> None:
    """200 samples a second of a bar of 58 Hz, two joints without lever arms, ten commands a second, a short window:
    a line each, with what was found and expected; a faster sensor and lever arms leave none."""
    slow = GOOD.replace("poll_hz = 100", "poll_hz = 10")
    slow = slow.replace("window_s = 0.25", 'window_s = 0.1\nstatistic = "ringdown"')
    told = config.loads(slow, "").notes
    for part in (
        "accelerometer 'tip': the size of the play and which joint has it cannot be estimated",
        "accelerometer 'tip': which of the joints elbow, wrist has play, and its size, may be wrong: found no lev",
        "accelerometer 'tip': weak impacts are missed: a window of 0.1 s holds 35%",
        "joint 'elbow': reversals of motions above 1 Hz are missed",
    ):
        assert sum(note.startswith(part) for note in told) == 1, part
    assert len(told) == 4
    good = GOOD.replace(WITMOTION, 'driver = "csv_serial"\nport = "/dev/ttyUSB1"').replace("= 200", "= 1000")
    good = good.replace("id = 3", "id = 3\nlevers_m = { tip = 0.25 }")
    assert config.loads(good, "").notes == ()


CSV_SENSOR = 'driver = "csv_serial"\nport = "/dev/ttyUSB1"\nrate_hz = 1000'


@pytest.mark.parametrize(
    ("found", "put", "told"),
    [
        ("", "", ""),
        (CSV_SENSOR, f"{CSV_SENSOR}\nbaudrate = 9600", "port /dev/ttyUSB1: found 9600 baud, which carry 960 bytes"),
        (CSV_SENSOR, f"{CSV_SENSOR}\ncolumn = 1\ntime_column = 0", "expected at least 130000 baud for the conf"),
        (CSV_SENSOR, f"{CSV_SENSOR}\ncolumn = 1\ntime_column = 0\nbaudrate = 230400", ""),
        ("poll_hz = 100", "poll_hz = 5000", "port /dev/ttyUSB0: found 1000000 baud, which carry 100000 bytes a second"),
        ("poll_hz = 100", "poll_hz = 1000", ""),
    ],
)
def test_a_line_too_slow_for_its_devices_is_noted(found: str, put: str, told: str) -> None:
    """Lines of a sensor, with and without a time of ten digits, and polls of two servos, against the baud rate."""
    fast = GOOD.replace(WITMOTION, 'driver = "csv_serial"\nport = "/dev/ttyUSB1"').replace("= 200", "= 1000")
    text = fast.replace("id = 3", "id = 3\nlevers_m = { tip = 0.25 }")
    assert found in text
    notes = config.loads(text.replace(found, put) if found else text, "").notes
    assert [told in note for note in notes] == [True] * bool(told)


def test_two_columns_of_one_sensor_differ() -> None:
    """A time that is the reading is refused."""
    text = GOOD.replace(WITMOTION, 'driver = "csv_serial"\nport = "/dev/ttyUSB1"\ncolumn = 1\ntime_column = 1')
    with pytest.raises(config.ConfigError, match="time_column: found 1, which is the column of the reading"):
        config.loads(text, "")


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ('listen = "0.0.0.0:8737"', "web.listen: found 0.0.0.0:8737, which others can reach, and no password"),
        ('listen = "0.0.0.0:8737"\ntoken_file = "token"', ""),
        ('listen = "[::1]:8737"', ""),
        ('listen = "nowhere"', "web.listen: found 'nowhere', expected ADDRESS:PORT"),
        ('certificate = "a.pem"', "web.certificate and web.key"),
        ('listen = "127.0.0.1:9464"\n[metrics]', "web.listen: found 127.0.0.1:9464, where the metrics listen"),
        ('listen = "[::1]:9000"\n[metrics]\nlisten = "[::]:9000"', "web.listen: found [::1]:9000, where the m"),
        ('listen = "127.0.0.1:0"\n[metrics]\nlisten = "127.0.0.1:9000"', ""),
        ('listen = "[::1]:9000"\n[metrics]\nlisten = "0.0.0.0:9000"', ""),
        ('[metrics]\nlisten = "127.0.0.2:8737"', ""),
    ],
)
def test_a_page_that_will_not_be_served_is_noted(lines: str, told: str) -> None:
    """The service runs without its page, so the configuration is valid; what ``lostmotion web`` refuses is told."""
    notes = [note for note in config.loads(f"{GOOD}\n[web]\n{lines}\n", "").notes if "web" in note]
    assert [note.startswith(f"lostmotion web refuses this: {told}") for note in notes] == [True] * bool(told)


def test_a_sensor_of_200_hz_on_a_bar_of_58_is_valid_with_its_notes() -> None:
    """One joint, the norm's band of the defaults: valid, with a note on the size of the play and one on the band."""
    joint = GOOD.replace('level = 5.5\nwindow_s = "auto"', "").replace("f_norm_hz = 85.0", "f_norm_hz = 100.0")
    joint = joint.replace("f_norm_width_hz = 20.0", 'statistic = "band"\nf_norm_width_hz = 40.0')
    one, _, rest = joint.partition('[[joint]]\nname = "wrist"')
    told = config.loads(one + rest[rest.index("[detector]") :], "").notes
    assert [note.split(":")[0] for note in told] == ["accelerometer 'tip'", "joint 'elbow'"]
    assert "the size of the play cannot be estimated: found 3.4 samples" in told[0]
    assert "which joint" not in told[0]
    assert "the norm's band reaches beyond 100 Hz" in told[1]


def test_no_play_size_asked_for_needs_no_fast_sensor() -> None:
    """One joint on a sensor and `play_size = false`: 200 samples a second leave nothing untold."""
    alone = GOOD.replace("[detector]\nwindow_s", "[detector]\nplay_size = false\nwindow_s")
    alone = alone.replace('id = 4\naccelerometer = "tip"', 'id = 4\naccelerometer = "top"')
    other = '[[accelerometer]]\nname = "top"\ndriver = "csv_serial"\nport = "/dev/ttyUSB2"\nrate_hz = 200\n'
    assert config.loads(alone + other + "oscillator = { f_res_hz = 58.0 }\n", "").notes == ()


def test_lever_arms() -> None:
    """A joint's lever arm is the bar's length unless it is given, sets the scale of its play, and may be negative; one
    that an unknown accelerometer should feel, or of no length, is refused."""
    given = config.loads(GOOD.replace("id = 3", "id = 3\nlevers_m = { tip = -0.25 }"), "")
    assert [given.levers(joint) for joint in given.joints] == [{"tip": -0.25}, {"tip": 0.1}]
    assert (given.settings("elbow").length_m, given.settings("wrist").length_m) == (-0.25, 0.1)
    for wrong, expected in (("{ top = 1 }", "found 'top', expected names of accelerometers: tip"),
                            ("{ tip = 0 }", r"levers_m.tip .without its sign.: found 0")):  # fmt: skip
        with pytest.raises(ConfigError, match=expected):
            config.loads(GOOD.replace("id = 3", f"id = 3\nlevers_m = {wrong}"), "")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("poll_hz = 100", "pol_hz = 100", "joint 'elbow'.pol_hz: unknown key; did you mean poll_hz?"),
        ("id = 3", 'id = "3"', "joint 'elbow'.id: found '3'; expected a whole number"),
        ("id = 3", "", "joint 'elbow'.id: is missing"),
        ("[detector]", "[detector]\ngentle = []", "detector.gentle: found a list; expected a number"),
        ("zeta = 0.012", "zetta = 0.012", "accelerometer 'tip'.oscillator.zetta: unknown key; did you mean zeta?"),
        ("zeta = 0.012", "zeta = 0.0", "accelerometer 'tip'.oscillator.zeta: found 0, expected 1e-05 to 0.99"),
        ("level = 4.0", "level = -1", "detector.level: found -1; expected a number > 0"),
        ("level = 4.0", "level = nan", "detector.level: found nan"),
        ("[detector]", "[detektor]", "detektor: unknown key; did you mean detector?"),
        ("[detector]", "[simulated]", "simulated: unknown key; no joint or accelerometer uses that driver"),
        (
            'driver = "witmotion"',
            'driver = "witmoton"',
            "accelerometer 'tip'.driver: no driver is called 'witmoton'; did you mean witmotion?",
        ),
        (
            'driver = "dynamixel"',
            'driver = "hebi"',
            "'elbow'.driver: no driver is called 'hebi'; there are canopen, dynamixel, feetech, ",
        ),
        (
            'driver = "witmotion"',
            "driver = 3",
            "'tip'.driver: found 3, expected one of can, canopen, csv_serial, iio, replay, ros2, simulated, witmotion",
        ),
        (WITMOTION, 'driver = "replay"', "'replay' lives in a time of its own"),
        ('accelerometer = "tip"', 'accelerometer = "top"', "joint 'elbow'.accelerometer: found 'top'"),
        ('name = "wrist"', 'name = "elbow"', "joint.name: 'elbow' is given 2 times, expected once"),
        ('name = "wrist"', 'name = "a/b"', "joint.name: found 'a/b', expected letters, digits"),
        ("id = 4", "id = 3", "joint 'wrist'.id: 3 on /dev/ttyUSB0 already belongs to joint 'elbow'"),
        ('port = "/dev/ttyUSB1"', 'port = "/dev/ttyUSB0"', "already belongs to joint 'elbow'; a port has one master"),
        ("baudrate = 1000000\nmodel", "baudrate = 57600\nmodel", "expected 57600 as for joint 'elbow'"),
        ("f_res_hz = 58.0", "f_res_hz = 98.0", "the oscillator rings up to 104 Hz, but rate_hz = 200 shows only"),
        (
            "f_norm_hz = 85.0",
            'statistic = "band"\nf_norm_hz = 150.0',
            "joint 'elbow': the norm band 140-160 Hz has 0 bins",
        ),
        ('mode = "peer"', 'mode = "mesh"', "alarm.zenoh.mode: found 'mesh'; expected 'client', 'peer', 'router'"),
        ('mode = "peer"', 'mode = "client"', "alarm.zenoh.connect: found none, so that no program can reach"),
        ('listen = ["tcp/127.0.0.1:7447"]', "", "alarm.zenoh.connect: found none, so that no program can reach"),
        ('"auto"', '"car"', "joint 'elbow'.detector.window_s: found 'car'; expected a number or 'auto'"),
        ("window_s = 0.25", "window_s = 1000.0", "joint 'wrist': window_s: found 1000, expected 0.02 to 5"),
        ("window_s = 0.25", "window_s = 0.01", "joint 'wrist': window_s: found 0.01, expected 0.02 to 5"),
        ('port = "/dev/ttyUSB1"', "", "accelerometer 'tip'.port: is missing"),
        ('port = "/dev/ttyUSB0"', 'port = ""', "joint 'elbow'.port: found ''; expected a text of length >= 1"),
        ("baudrate = 1000000", "baudrate = 0", "joint 'elbow'.baudrate: found 0; expected a whole number >= 1"),
        (
            'driver = "dynamixel"',
            'driver = "witmotion"',
            "joint 'elbow'.driver: found 'witmotion', which is no servo (",
        ),
        ('driver = "witmotion"', 'driver = "dynamixel"', "found 'dynamixel', which is no accelerometer"),
        ("connect = []", 'connect = ["localhost"]', "alarm.zenoh.connect: found 'localhost', expected protocol/addr"),
        ('"tcp/127.0.0.1:7447"', '"tcp/127.0.0.1"', "alarm.zenoh.listen: found 'tcp/127.0.0.1', expected protocol/"),
        ("7447", "99999", "alarm.zenoh.listen: found 'tcp/127.0.0.1:99999', expected protocol/address:port"),
        ('path = "history.db"', 'path = "/"', "store.path: found a directory, /; expected a file"),
        (
            "[alarm.zenoh]",
            "[alarm]\nlimit = 3\n[alarm.zenoh]",
            "alarm.limit: unknown key; there are can, deadband, degraded, error, judged_within_h, off_delay_s, ",
        ),
        ("[alarm.zenoh]", "[alarm]\nof_delay_s = 3\n[alarm.zenoh]", "did you mean off_delay_s?"),
        ("[alarm.zenoh]", "[alarm]\ndeadband = 1\n[alarm.zenoh]", "alarm.deadband: found 1; expected a number < 1"),
        ("[alarm.zenoh]", '[alarm]\nremind = "often"\n[alarm.zenoh]', "expected 'daily', 'once', 'rarer'"),
        (
            "[alarm.zenoh]",
            "[alarm]\ndegraded = 0.6\n[alarm.zenoh]",
            "alarm.degraded: found 0.6, expected at most 0.5, the value of warning",
        ),
        (
            "[alarm.zenoh]",
            "[alarm]\nplay_warning = 2e-3\nplay_error = 1e-3\n[alarm.zenoh]",
            "alarm.play_warning: found 0.002, expected at most 0.001, the value of play_error",
        ),
        ("[robot]", "[robot", "no valid TOML: "),
        ("[robot]", "[robot]\ncycle_s = 1e-3", "robot.cycle_s: found 0.001; expected a number >= 0.005"),
        ("[detector]", "[detector]\ngentle = true", "detector.gentle: found true; expected a number"),
        ("[[accelerometer]]", "[accelerometer]", "accelerometer: found [accelerometer], expected [[accelerometer]]"),
        ('[robot]\nname = "arm1"', "", "[robot] is missing"),
        ("rate_hz = 200", "rate_hz = 400", "accelerometer tip: rate_hz is 400"),
    ],
)
def test_a_bad_configuration_is_refused_in_one_line(old: str, new: str, expected: str) -> None:
    """Each mistake is told in one line that begins with the file and names the key, what was found and expected."""
    assert old in GOOD
    with pytest.raises(ConfigError) as refused:
        config.loads(GOOD.replace(old, new, 1), "bad.toml")
    message = str(refused.value)
    assert message.startswith("bad.toml: ")
    assert expected in message
    assert "\n" not in message


def test_endpoints_of_all_kinds_are_taken() -> None:
    """IPv6, names, metadata and protocols that have no port are endpoints of Zenoh too."""
    endpoints = [
        "tcp/[::1]:7447",
        "udp/robot.local:7447#iface=eth0",
        "unixsock-stream//run/z.sock",
        "serial//dev/ttyS0#baudrate=9600",
    ]
    zenoh = config.loads(GOOD.replace('["tcp/127.0.0.1:7447"]', str(endpoints)), "x").zenoh
    assert zenoh is not None
    assert zenoh.listen == endpoints


def test_a_byte_order_mark_is_taken(tmp_path: Path) -> None:
    """A file that an editor on Windows began with a mark is read like any other."""
    (tmp_path / "bom.toml").write_text(GOOD, encoding="utf-8-sig")
    assert config.load(tmp_path / "bom.toml").robot.name == "arm1"


def test_the_robots_cycle_is_that_of_its_clock() -> None:
    """All that reads hardware asks the clock for it."""
    assert config.loads(GOOD, "x").make_clock().cycle_s == CYCLE_S
    assert config.loads(GOOD.replace("[robot]", "[robot]\ncycle_s = 0.02"), "x").make_clock().cycle_s == 0.02


def test_can_and_a_norm_band_beyond_nyquist() -> None:
    """[alarm.can] is validated down to the name of the interface; a norm band beyond Nyquist is a note."""
    can = '[alarm.can]\ninterface = "socketcan"\nchannel = "can0"\nnode_id = 0x21\n'
    wide = GOOD.replace("f_norm_width_hz = 20.0", 'statistic = "band"\nf_norm_width_hz = 40.0')
    assert any("joint 'elbow': the norm's band reaches beyond 100 Hz" in n for n in config.loads(wide + can, "x").notes)
    with pytest.raises(
        ConfigError, match=r"alarm\.can\.interface: found 'socketcam', expected one that python-can knows"
    ):
        config.loads(GOOD + can.replace("socketcan", "socketcam"), "x")
    with pytest.raises(ConfigError, match=r"alarm\.can\.node_id: found 200; expected a whole number <= 127"):
        config.loads(GOOD + can.replace("0x21", "200"), "x")


def test_a_missing_file_is_told(tmp_path: Path) -> None:
    """The path and the reason stand in one line."""
    with pytest.raises(ConfigError, match=r"nothing\.toml: cannot be read: No such file"):
        config.load(tmp_path / "nothing.toml")


def test_the_built_in_robot_has_a_good_shoulder_and_a_worn_elbow(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The default configuration is valid, names the two joints, and keeps its database in the user's state folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    default = config.default()
    assert [joint.name for joint in default.joints] == ["shoulder", "elbow"]
    assert default.database == tmp_path / "lostmotion" / "history.db"


def test_the_state_folder_is_absolute(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A relative XDG_STATE_HOME counts as none, as its specification demands; who has no home is told so in a line."""
    monkeypatch.setenv("XDG_STATE_HOME", "state")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert config.default().database == tmp_path / ".local/state/lostmotion/history.db"
    monkeypatch.setattr(Path, "home", nowhere)
    with pytest.raises(ConfigError, match=r"store\.path: found none.* set HOME"):
        config.default()


def nowhere() -> Path:
    """As pathlib where a container runs as a user without a name."""
    raise RuntimeError("Could not determine home directory.")


@pytest.mark.parametrize("path", sorted((Path(__file__).parents[2] / "examples").glob("*.toml")), ids=lambda p: p.name)
def test_the_examples_are_valid(path: Path) -> None:
    """Every configuration in examples/ passes the check."""
    assert config.load(path).joints
