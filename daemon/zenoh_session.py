"""How a Zenoh session of ours is opened, by the service and by the commands that ask a fleet."""

from __future__ import annotations

import json
import re
from pathlib import Path

import zenoh

from lostmotion.daemon.options import ZenohOptions

__all__ = ["JSON", "SCHEMA", "brief", "configuration", "why_closed"]

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
    """Zenoh's configuration: its own file first, if one is named, then what the options say.  Raises zenoh.ZError."""
    config = zenoh.Config.from_file(options.config) if options.config else zenoh.Config()
    settings = {
        "mode": options.mode or (None if options.config else "peer"),
        "connect/endpoints": options.connect or None,
        "listen/endpoints": options.listen or (None if options.config else []),
        "scouting/multicast/enabled": options.multicast_scouting,
        "timestamping/enabled": True,  # the publishers' cache orders by it
    }
    for key, value in settings.items():
        if value is not None:
            config.insert_json5(key, json.dumps(value))
    return config


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
