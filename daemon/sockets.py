"""Which sockets a service with a configuration opens, and who can reach them.  Nothing is opened here.

Serial ports, files and systemd's notification socket are no sockets that others can reach; they are not listed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from ipaddress import ip_address
from typing import TYPE_CHECKING, Literal

from lostmotion.daemon.paths import PathError, expanded
from lostmotion.daemon.sinks.registry import BUILT_IN
from lostmotion.drivers.ros2_session import Ros2Network

if TYPE_CHECKING:
    from lostmotion.daemon.config import Config
    from lostmotion.daemon.options import CanOptions, MetricsOptions, WebOptions, ZenohOptions

__all__ = ["LAST_PORT", "Socket", "endpoints", "host_and_port", "is_loopback", "page_refusal", "sockets"]

SCOUTING = "udp/224.0.0.224:7446"
"""where Zenoh looks for others by multicast"""
LOCAL = re.compile(r"(\w+/)?(127\.[\d.]+|\[::1\]|localhost):\d+.*|(unixsock-stream|unixpipe|serial|vsock)/.*")
ENCRYPTED = re.compile(r"(tls|quic)/.*")
ADDRESS = re.compile(r"(\[[0-9a-fA-F:.]+\]|[\w.-]+):([0-9]{1,5})")
LAST_PORT = 65535
THIS_COMPUTER = "this computer"
UNKNOWN = "unknown (the sink does not state it)"


@dataclass(frozen=True, slots=True)
class Socket:
    """of: the part of the service, or the sink, that opens it; reach: who can connect to it, "" where nobody can;
    plain: whether all who can do so without a certificate, and read what passes by."""

    of: str
    does: Literal["listens", "connects", "sends"]
    address: str
    reach: str = ""
    plain: bool = False


def sockets(config: Config) -> tuple[Socket, ...]:
    """All of them, those that listen first."""
    found = [*(_of_zenoh(config.zenoh) if config.zenoh else ())]
    if config.metrics:
        found.append(_listening("metrics", config.metrics.listen))
    if config.can:
        found.append(_of_can(config.can))
    for row, options in config.sinks.items():
        if row.name not in BUILT_IN:
            addresses = row.addresses(options) if row.addresses else (UNKNOWN,)
            found += [Socket(row.name, "connects", address) for address in addresses]
    for robot in config.robots.values():
        if isinstance(robot, Ros2Network):
            found += [Socket("ros2", "connects", endpoint) for endpoint in robot.connect]
    return tuple(sorted(found, key=lambda socket: socket.does != "listens"))


def endpoints(options: ZenohOptions) -> tuple[list[str], list[str]]:
    """Where the session connects to, and where it listens, including Zenoh's own file."""
    if not options.config:
        return options.connect, options.listen if options.mode != "client" else []
    from lostmotion.daemon import zenoh_session  # many do without Zenoh, and without its third of a second

    return zenoh_session.endpoints(options)


def is_loopback(host: str) -> bool:
    """Whether an address, or the name ``localhost``, is of this computer alone."""
    try:
        return ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def host_and_port(address: str) -> tuple[str, int] | None:
    """The parts of HOST:PORT or [IPv6]:PORT; None for another text."""
    parts = ADDRESS.fullmatch(address)
    return (parts[1].strip("[]"), int(parts[2])) if parts and int(parts[2]) <= LAST_PORT else None


def _is_one(one: tuple[str, int], other: tuple[str, int] | None) -> bool:
    """Whether two programs cannot both listen at these addresses; port 0 is any that is free."""
    if other is None or one[1] != other[1] or not one[1]:
        return False
    hosts = {one[0].replace("localhost", "127.0.0.1"), other[0]}
    return len(hosts) == 1 or "::" in hosts or ("0.0.0.0" in hosts and not any(":" in host for host in hosts))


def page_refusal(options: WebOptions, metrics: MetricsOptions | None) -> str:
    """Why the page is not served with these options, "" where it is: its address is none or that of the metrics, others
    can reach it and need no password, there is half of what TLS needs, or a path begins with the home of nobody."""
    address = host_and_port(options.listen)
    if address is None:
        return f"web.listen: found {options.listen!r}, expected ADDRESS:PORT such as 127.0.0.1:8737"
    if metrics and _is_one(address, host_and_port(metrics.listen)):
        return (
            f"web.listen: found {options.listen}, where the metrics listen (metrics.listen = {metrics.listen!r}); "
            "expected another port for one of them"
        )
    if not (options.password_hash or options.token_file or is_loopback(address[0])):
        return (
            f"web.listen: found {options.listen}, which others can reach, and no password; set web.password_hash "
            "(`lostmotion web --hash-password` makes it) or web.token_file, or listen on 127.0.0.1"
        )
    if bool(options.certificate) != bool(options.key):
        return "web.certificate and web.key: found one of them, expected both or none"
    paths = [(f"web.{key}", getattr(options, key)) for key in ("token_file", "certificate", "key", "lab")]
    try:
        for key, path in [*paths, *(("web.own_effects", effect) for effect in options.own_effects)]:
            expanded(key, path)
    except PathError as error:
        return str(error)
    return ""


def _of_zenoh(options: ZenohOptions) -> Iterator[Socket]:
    connect, listen = endpoints(options)
    yield from (_listening("zenoh", endpoint) for endpoint in listen)
    if options.multicast_scouting:
        yield Socket("zenoh", "listens", SCOUTING, "everybody on its networks", plain=True)
    yield from (Socket("zenoh", "connects", endpoint) for endpoint in connect)


def _listening(of: Literal["zenoh", "metrics"], address: str) -> Socket:
    if LOCAL.fullmatch(address):
        return Socket(of, "listens", address, THIS_COMPUTER)
    if ENCRYPTED.fullmatch(address):
        return Socket(of, "listens", address, "who has a certificate, where Zenoh's file asks for one")
    return Socket(of, "listens", address, f"everybody who reaches {_host(address)}, in plain text", plain=True)


def _host(address: str) -> str:
    host = address.partition("/")[2] or address
    host = host.partition("#")[0].rpartition(":")[0]
    return "this computer" if host in ("0.0.0.0", "[::]") else host


def _of_can(options: CanOptions) -> Socket:
    where = " ".join(str(options.options[key]) for key in ("host", "port") if key in options.options)
    return Socket("can", "sends", " ".join(part for part in (options.interface, options.channel, where) if part))
