"""Checks of a configuration beyond types: tables agree, numbers are in range, addresses are well-formed.

No device is opened; of the file system is asked what is at the database's path, unless a service holds it.
"""

from __future__ import annotations

import codecs
import errno
import re
import stat
from collections import Counter
from collections.abc import Iterable, Iterator
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING

from lostmotion.daemon import sockets
from lostmotion.daemon.database import is_held
from lostmotion.detector.errors import DetectorError
from lostmotion.detector.score import validate
from lostmotion.detector.windows import window_length
from lostmotion.drivers.base import AccelerometerOptions, JointOptions
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.packages import is_there, missing
from lostmotion.drivers.ros2_session import Ros2Network

if TYPE_CHECKING:
    from lostmotion.daemon.config import Config
    from lostmotion.daemon.options import ZenohOptions

__all__ = ["CrossCheckError", "check", "check_endpoints"]

WINDOW_S = (0.02, 5.0)
"""a window has to hold a ring-down, and to fit four times into the ring of samples (robot.py)"""
MOST_CAN_JOINTS = 255
PIECE = 65536
"""bytes of a file that are looked at in one go"""
ENDPOINT = re.compile(
    r"(tcp|udp|tls|quic|ws)/\S+:(?P<port>\d{1,5})([?#]\S*)?|(serial|unixsock-stream|unixpipe|vsock)/\S+", re.ASCII
)
SAFE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")


class CrossCheckError(LostmotionError):
    """Two tables of the configuration contradict each other, or a value is outside its range."""


def check(config: Config, runs: bool) -> None:
    """Raises CrossCheckError at the first contradiction, DriverError for a robot that cannot run where it is to."""
    _packages(config)
    _names(config)
    _ranges(config)
    _limits(config)
    _one_time(config)
    _ports(config)
    if runs:
        _robots(config)
    _drivers_agree(config)
    _addresses(config)
    _can(config)
    for joint in config.joints:
        _bands(config, joint)


def _packages(config: Config) -> None:
    """What the sinks that are asked for need is installed."""
    for row in config.sinks:
        if row.package and not is_there(row.package):
            raise CrossCheckError(f"alarm.{row.name}: {missing(row.package, f'[alarm.{row.name}]')}")


def _names(config: Config) -> None:
    for kind, names in (
        ("robot", [config.robot.name]),
        ("joint", [joint.name for joint in config.joints]),
        ("accelerometer", [sensor.name for sensor in config.accelerometers]),
    ):
        for name, times in Counter(names).items():
            if not SAFE_NAME.fullmatch(name):
                raise CrossCheckError(
                    f"{kind}.name: found {name!r}, expected letters, digits, _ . or - (it becomes part of a Zenoh key)"
                )
            if times > 1:
                raise CrossCheckError(f"{kind}.name: {name!r} is given {times} times, expected once")
    sensors = {sensor.name for sensor in config.accelerometers}
    for joint in config.joints:
        if joint.accelerometer not in sensors:
            raise CrossCheckError(
                f"joint {joint.name!r}.accelerometer: found {joint.accelerometer!r}, "
                f"expected the name of an accelerometer: {', '.join(sorted(sensors))}"
            )
        for name in joint.levers_m.keys() - sensors:
            raise CrossCheckError(
                f"joint {joint.name!r}.levers_m: found {name!r}, "
                f"expected names of accelerometers: {', '.join(sorted(sensors))}"
            )


def _ranges(config: Config) -> None:
    for joint in config.joints:
        _within(f"joint {joint.name!r}.poll_hz", joint.poll_hz, 1.0, 10_000.0)
        for name, lever in joint.levers_m.items():
            _within(f"joint {joint.name!r}.levers_m.{name} (without its sign)", abs(lever), 1e-3, 10.0)
    for sensor in config.accelerometers:
        path = f"accelerometer {sensor.name!r}"
        _within(f"{path}.rate_hz", sensor.rate_hz, 1.0, 100_000.0)
        _within(f"{path}.oscillator.f_res_hz", sensor.oscillator.f_res_hz, 0.1, 50_000.0)
        _within(f"{path}.oscillator.zeta", sensor.oscillator.zeta, 1e-5, 0.99)
        _within(f"{path}.oscillator.length_m", sensor.oscillator.length_m, 1e-3, 10.0)


def _within(path: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise CrossCheckError(f"{path}: found {value:g}, expected {low:g} to {high:g}")


def _limits(config: Config) -> None:
    """A milder alarm has the smaller limit."""
    alarm = config.alarm
    for mild, bad in (("degraded", "warning"), ("play_warning", "play_error"), ("severity_warning", "severity_error")):
        low, high = getattr(alarm, mild), getattr(alarm, bad)
        if low is not None and high is not None and low > high:
            raise CrossCheckError(f"alarm.{mild}: found {low:g}, expected at most {high:g}, the value of {bad}")


def _one_time(config: Config) -> None:
    """A virtual robot shares nothing with hardware."""
    virtual = sorted(name for name, driver in config.drivers.items() if driver.waits)
    if virtual and len(config.drivers) > 1:
        others = ", ".join(sorted(set(config.drivers) - {virtual[0]}))
        raise CrossCheckError(
            f"driver: {virtual[0]!r} lives in a time of its own and cannot be mixed with {others}; use one or the other"
        )


def _devices(config: Config) -> Iterator[tuple[str, JointOptions | AccelerometerOptions]]:
    for joint in config.joints:
        yield f"joint {joint.name!r}", joint
    for sensor in config.accelerometers:
        yield f"accelerometer {sensor.name!r}", sensor


def _ports(config: Config) -> None:
    """One port has one driver and one baud rate; several joints may share it, an accelerometer has its own."""
    first: dict[str, tuple[str, JointOptions | AccelerometerOptions]] = {}
    ids: dict[tuple[str, object], str] = {}
    for path, item in _devices(config):
        if config.is_virtual or not item.port:
            continue
        other_path, other = first.setdefault(item.port, (path, item))
        number = getattr(item, "id", None)
        if config.drivers[item.driver].shares and config.drivers[other.driver].shares:
            _one_bus(path, item, other_path, other)
            continue
        if other is not item and (isinstance(item, AccelerometerOptions) or item.driver != other.driver):
            raise CrossCheckError(f"{path}.port: {item.port} already belongs to {other_path}; a port has one master")
        if getattr(item, "baudrate", None) != getattr(other, "baudrate", None):
            raise CrossCheckError(
                f"{path}.baudrate: found {getattr(item, 'baudrate', None)}, "
                f"expected {getattr(other, 'baudrate', None)} as for {other_path} on the same port {item.port}"
            )
        if number is not None and ids.setdefault((item.port, number), path) != path:
            raise CrossCheckError(f"{path}.id: {number} on {item.port} already belongs to {ids[item.port, number]}")


def _one_bus(
    path: str, item: JointOptions | AccelerometerOptions, other_path: str, other: JointOptions | AccelerometerOptions
) -> None:
    """Devices on one bus agree about it."""
    for key in ("interface", "bitrate", "options"):
        found, expected = (getattr(one, key, None) for one in (item, other))
        if found != expected:
            raise CrossCheckError(
                f"{path}.{key}: found {found}, expected {expected} as for {other_path} on the same bus {item.port}"
            )


def _addresses(config: Config) -> None:
    """The database can be a file; metrics are asked for at an address; Zenoh understands its endpoints."""
    _database(config)
    if config.metrics and not _is_listenable(config.metrics.listen):
        raise CrossCheckError(
            f"metrics.listen: found {config.metrics.listen!r}, expected ADDRESS:PORT such as 127.0.0.1:9464 "
            "or [::1]:9464"
        )
    for name, robot in config.robots.items():
        if isinstance(robot, Ros2Network):
            check_endpoints(f"{name}.connect", robot.connect)
    zenoh = config.zenoh
    if zenoh and (zenoh.config or any("_file=" in endpoint for endpoint in (*zenoh.connect, *zenoh.listen))):
        _zenoh_files(zenoh)
    if zenoh and not (zenoh.multicast_scouting or any(sockets.endpoints(zenoh))):
        file = f", nor in {zenoh.config}" if zenoh.config else ""
        raise CrossCheckError(
            f"alarm.zenoh.connect: found none{file}, so that no program can reach the robot; expected a router such as "
            '["tcp/10.0.0.1:7447"], or listen = ["tcp/127.0.0.1:7447"] in mode "peer"'
        )
    for key, endpoints in (("connect", zenoh.connect), ("listen", zenoh.listen)) if zenoh else ():
        check_endpoints(f"alarm.zenoh.{key}", endpoints)


def _is_listenable(address: str) -> bool:
    """Whether a text is an IP address and a port."""
    host, port = sockets.host_and_port(address) or ("", 0)
    try:
        ip_address(host)
    except ValueError:
        return False
    return port > 0


def _database(config: Config) -> None:
    """Nothing is there yet, or a file; where this user may not look, opening it raises the error."""
    try:
        mode = config.database.stat().st_mode
    except OSError as error:
        if error.errno in (errno.ENAMETOOLONG, errno.ELOOP):
            raise CrossCheckError(f"store.path: {error.strerror}: {config.database!s:.80}") from error
        return
    if stat.S_ISDIR(mode):
        raise CrossCheckError(
            f"store.path: found a directory, {config.database}; expected a file, such as {config.database}/history.db"
        )
    if not stat.S_ISREG(mode):
        raise CrossCheckError(f"store.path: found a device or a pipe, {config.database}; expected a file")
    # A service that reads its configuration again holds its database, of which closing would end SQLite's locks.
    if not is_held(config.database) and _is_text(config.database):
        raise CrossCheckError(f"store.path: found a text file, {config.database}; expected a database, or no file yet")


def _is_text(path: Path) -> bool:
    """Whether a file holds UTF-8 without a NUL, which no database does, damaged or not."""
    decoder = codecs.getincrementaldecoder("utf-8")()
    size = 0
    try:
        with path.open("rb") as file:
            while piece := file.read(PIECE):
                size += len(piece)
                decoder.decode(piece)
                if b"\0" in piece:
                    return False
        decoder.decode(b"", final=True)
    except (OSError, UnicodeDecodeError):
        return False
    return size > 0


def check_endpoints(name: str, endpoints: Iterable[str]) -> None:
    """Raises CrossCheckError for what Zenoh takes for no address; name: of the option that holds them."""
    for endpoint in endpoints:
        found = ENDPOINT.fullmatch(endpoint)
        if found is None or int(found["port"] or 0) > sockets.LAST_PORT:
            raise CrossCheckError(
                f"{name}: found {endpoint!r}, expected protocol/address:port such as tcp/127.0.0.1:7447 "
                "(tcp, udp, tls, quic, ws; or serial, unixsock-stream, unixpipe, vsock with their own addresses)"
            )


def _zenoh_files(options: ZenohOptions) -> None:
    """Zenoh reads its file, and what that names, or an endpoint, can be read."""
    from zenoh import ZError  # many do without Zenoh

    from lostmotion.daemon.zenoh_session import brief, configuration

    try:
        configuration(options)
    except ZError as error:
        where = f"alarm.zenoh.config: {options.config}" if options.config else "alarm.zenoh"
        raise CrossCheckError(f"{where}: {brief(error)}") from error


def _can(config: Config) -> None:
    """python-can knows the interface; 255 joints have an index."""
    if config.can is None:
        return
    from lostmotion.drivers.python_can import can  # many do without CAN, and without a third of a second

    if config.can.interface not in can.VALID_INTERFACES:
        raise CrossCheckError(
            f"alarm.can.interface: found {config.can.interface!r}, expected one that python-can knows: "
            f"{', '.join(sorted(can.VALID_INTERFACES))}"
        )
    if len(config.joints) > MOST_CAN_JOINTS:
        raise CrossCheckError(f"alarm.can: found {len(config.joints)} joints, expected at most {MOST_CAN_JOINTS}")


def _robots(config: Config) -> None:
    """Lets the drivers look at the options of their robots."""
    for driver in config.drivers.values():
        if driver.check:
            driver.check(config.robots[driver.name])


def _drivers_agree(config: Config) -> None:
    """Lets the drivers look at their own options; a virtual robot's devices are costly to make and check at start."""
    if config.is_virtual:
        return
    for joints in config.buses():
        config.make_bus(joints, SystemClock())
    for sensor in config.accelerometers:
        config.make_accelerometer(sensor, SystemClock())


def _bands(config: Config, joint: JointOptions) -> None:
    """The bands of eqs. 8 and 10 lie under the accelerometer's Nyquist frequency."""
    sensor = config.accelerometer(joint.accelerometer)
    settings = config.settings(joint.name)
    nyquist = sensor.rate_hz / 2
    top = settings.f_res_hz + settings.f_width_hz / 2
    if top >= nyquist:
        raise CrossCheckError(
            f"accelerometer {sensor.name!r}: the oscillator rings up to {top:g} Hz, but rate_hz = {sensor.rate_hz:g} "
            f"shows only what is below {nyquist:g} Hz; take a faster sensor or a slower oscillator"
        )
    _within(f"joint {joint.name!r}: window_s", window_length(settings, sensor.rate_hz), *WINDOW_S)
    try:
        validate(settings, sensor.rate_hz)
    except DetectorError as error:
        raise CrossCheckError(f"joint {joint.name!r}: {error}") from error
