"""How a Zenoh session of ours is opened, by the service and by the commands that ask a fleet."""

from __future__ import annotations

import json
import re
from pathlib import Path

import zenoh

from lostmotion.daemon.options import ZenohOptions
from lostmotion.drivers.textfile import TextFileError, read_text

__all__ = ["JSON", "SCHEMA", "brief", "configuration", "opened", "why_closed"]

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


def configuration(options: ZenohOptions) -> zenoh.Config:
    """Zenoh's configuration: its own file first, if one is named, then what the options say.  Raises zenoh.ZError.

    Where neither says where to listen, Zenoh would listen on all interfaces, in plain text; ours does not listen.
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
    return config


def _from_file(path: str) -> zenoh.Config:
    """Zenoh's own file.  Zenoh itself would read a device without end until the memory is full, and wait for a pipe."""
    try:
        read_text(Path(path))
    except TextFileError as error:
        raise zenoh.ZError(str(error).removeprefix(f"{path}: ")) from error
    return zenoh.Config.from_file(path)


def opened(options: ZenohOptions) -> tuple[list[str], list[str]]:
    """The endpoints where the session connects to, and where it listens.  Raises zenoh.ZError."""
    config = configuration(options)
    mode = json.loads(config.get_json("mode"))
    listen = [] if mode == "client" else _of_mode(json.loads(config.get_json("listen/endpoints")), mode)
    return _of_mode(json.loads(config.get_json("connect/endpoints")), mode), listen


def _asked_to_listen(config: zenoh.Config, mode: str) -> list[str]:
    """The endpoints that a file of Zenoh's asks for; its defaults nobody has asked for."""
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
    """Why no session opened: a file of TLS that this process cannot read, of which Zenoh says only that it is unable to
    connect; else what the error says."""
    try:
        tls = json.loads(configuration(options).get_json("transport/link/tls"))
    except zenoh.ZError:
        return brief(error)
    for name in TLS_FILES:
        try:
            if tls.get(name):
                Path(tls[name]).read_bytes()
        except OSError as unreadable:
            return f"{name} {tls[name]}: {unreadable.strerror}"
    return brief(error)
