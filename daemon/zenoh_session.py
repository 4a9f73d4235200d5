"""How a Zenoh session of ours is opened, by the service and by the commands that ask a fleet."""

from __future__ import annotations

import json
import logging
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from time import time

import zenoh

from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.zenoh_reach import cause
from lostmotion.drivers.textfile import TextFileError, read_text

__all__ = [
    "JSON",
    "SCHEMA",
    "brief",
    "clock_problem",
    "configuration",
    "connect_endpoints",
    "endpoints",
    "unreached",
    "why_closed",
]

log = logging.getLogger(__name__)

SCHEMA = 1
"""version of the payloads: grows when a key changes its meaning or goes away"""
JSON = zenoh.Encoding.APPLICATION_JSON
TLS_FILES = (
    "root_ca_certificate",
    "connect_private_key",
    "connect_certificate",
    "listen_private_key",
    "listen_certificate",
)
AUTH_FILES = ("usrpwd/dictionary_file", "pubkey/public_key_file", "pubkey/private_key_file", "pubkey/known_keys_file")
FILE_IN_ENDPOINT = re.compile(r'[#;](\w+_file)=([^;"]+)')
"""as in tls/10.0.0.1:7447#root_ca_certificate_file=/etc/ca.pem;…"""
AUTHORITY = "root_ca_certificate"
LISTENER = re.compile(r"listener bound to (\S+?): \[.*?: ([^:\]]+?) \(os error \d+\)")
"""what Zenoh says of an address where it cannot listen"""
MOST_BYTES = 10_000_000
"""of a file of keys, certificates or passwords"""
END_OF_TIME = 2.0**32
"""seconds since 1970 from which on Zenoh, whose stamps have 32 bits for them, panics: 7 February 2106"""


def clock_problem() -> str:
    """Why nothing can be published or opened now, "" for nothing: a clock beyond 2106, as after a reset of its chip.  A
    panic of Zenoh's is no Exception, and one while a session is opened ends the process."""
    return "the system's clock is beyond 2106, which Zenoh cannot stamp" if time() >= END_OF_TIME else ""


def configuration(options: ZenohOptions) -> zenoh.Config:
    """Zenoh's configuration: its own file first, if one is named, then the options.

    Raises zenoh.ZError, also where a file of TLS or passwords that it names is a device, a pipe or a directory.

    Where neither sets where to listen, Zenoh would listen on all interfaces, in plain text; ours does not listen.
    """
    config = _from_file(options.config) if options.config else zenoh.Config()
    mode = options.mode or json.loads(config.get_json("mode")) or "peer"
    settings = {
        "mode": mode,
        "connect/endpoints": options.connect or None,
        "listen/endpoints": options.listen or _asked_to_listen(config, mode),
        "scouting/multicast/enabled": options.multicast_scouting,
        "timestamping/enabled": True,  # the publishers' cache orders by it
    }
    for key, value in settings.items():
        if value is not None:
            config.insert_json5(key, json.dumps(value))
    for name, path in _files(config):
        _refuse_what_is_no_file(name, path)
    return config


def _files(config: zenoh.Config) -> Iterator[tuple[str, str]]:
    """The files that Zenoh will read when the session is opened, with their keys."""
    tls, auth = (json.loads(config.get_json(key)) for key in ("transport/link/tls", "transport/auth"))
    yield from ((name, tls[name]) for name in TLS_FILES if tls.get(name))
    for name in AUTH_FILES:
        table, _, key = name.partition("/")
        if path := (auth.get(table) or {}).get(key):
            yield key, path
    for key in ("connect/endpoints", "listen/endpoints"):
        yield from FILE_IN_ENDPOINT.findall(config.get_json(key))


def _refuse_what_is_no_file(name: str, path: str) -> None:
    """Zenoh would wait for a pipe, and read a device until the memory is full.  What is not there may come."""
    try:
        found = Path(path).stat()
    except (OSError, ValueError):
        return
    if stat.S_ISDIR(found.st_mode):
        raise zenoh.ZError(f"{name}: found a directory, {path}; expected a file")
    if not stat.S_ISREG(found.st_mode):
        raise zenoh.ZError(f"{name}: found a device or a pipe, {path}; expected a file")
    if found.st_size > MOST_BYTES:
        raise zenoh.ZError(f"{name}: found {found.st_size} bytes in {path}, expected at most {MOST_BYTES}")


def _from_file(path: str) -> zenoh.Config:
    """Zenoh's own file.  Zenoh itself would read a device without end until the memory is full, and wait for a pipe."""
    try:
        read_text(Path(path))
    except TextFileError as error:
        raise zenoh.ZError(str(error).removeprefix(f"{path}: ")) from error
    return zenoh.Config.from_file(path)


def endpoints(options: ZenohOptions) -> tuple[list[str], list[str]]:
    """The endpoints where the session connects to, and where it listens.  Raises zenoh.ZError."""
    config = configuration(options)
    mode = json.loads(config.get_json("mode"))
    listen = [] if mode == "client" else _of_mode(json.loads(config.get_json("listen/endpoints")), mode)
    return _of_mode(json.loads(config.get_json("connect/endpoints")), mode), listen


def connect_endpoints(config: zenoh.Config) -> list[str]:
    """The endpoints that a session connects to, whatever its mode."""
    found = json.loads(config.get_json("connect/endpoints"))
    each = found.values() if isinstance(found, dict) else [found]
    return list(dict.fromkeys(str(endpoint) for some in each for endpoint in some or []))


def _asked_to_listen(config: zenoh.Config, mode: str) -> list[str]:
    """The endpoints that a file of Zenoh's asks for; without its defaults."""
    found, unasked = (json.loads(one.get_json("listen/endpoints")) for one in (config, zenoh.Config()))
    return [] if found == unasked else _of_mode(found, mode)


def _of_mode(value: object, mode: str) -> list[str]:
    """Endpoints that may differ by mode."""
    found = value.get(mode) if isinstance(value, dict) else value
    return [str(endpoint) for endpoint in (found if isinstance(found, list) else [found] if found else [])]


def brief(error: zenoh.ZError) -> str:
    """The error without the places in Zenoh's source that it names."""
    return re.sub(r"\s*at \S+\.rs:\d+\.?", "", str(error))


def why_closed(options: ZenohOptions, error: zenoh.ZError) -> str:
    """Why no session opened, in one line: a file of TLS that this process cannot read, or what the endpoint answers,
    of both of which Zenoh only says "unable to connect"; an address where it cannot listen; else the text of the
    error, which the log has at the level DEBUG."""
    log.debug("zenoh: %s", error)
    text = brief(error)
    try:
        config = configuration(options)
        tls = json.loads(config.get_json("transport/link/tls"))
    except zenoh.ZError:
        return text
    for name in TLS_FILES:
        try:
            if tls.get(name):
                Path(tls[name]).read_bytes()
        except OSError as unreadable:
            return f"{name} {tls[name]}: {unreadable.strerror}"
    if text.startswith("Unable to connect"):
        return f"nobody answers at {unreached(config)}"
    if refused := LISTENER.search(text):
        return f"cannot listen at {refused[1]}: {refused[2].lower()}"
    return text


def unreached(config: zenoh.Config) -> str:
    """The endpoints to which a session connects, which do not answer, each with the cause as far as it is known."""
    trusted = json.loads(config.get_json("transport/link/tls")).get(AUTHORITY) or ""
    causes = {
        one: cause(one, dict(FILE_IN_ENDPOINT.findall(one)).get(f"{AUTHORITY}_file", trusted))
        for one in connect_endpoints(config)
    }
    return ", ".join(f"{one.partition('#')[0]}{f': {why}' * bool(why)}" for one, why in causes.items())
