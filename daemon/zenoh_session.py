"""How a Zenoh session of ours is opened, by the service and by the commands that ask a fleet."""

from __future__ import annotations

import json
import re

import zenoh

from lostmotion.daemon.options import ZenohOptions

__all__ = ["JSON", "SCHEMA", "brief", "configuration"]

SCHEMA = 1
"""version of the payloads: grows when a key changes its meaning or goes away"""
JSON = zenoh.Encoding.APPLICATION_JSON


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
