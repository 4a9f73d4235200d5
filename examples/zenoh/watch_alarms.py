"""Every transition of every robot's alarms as a line of JSON, each once, whatever happens on the way.

    python watch_alarms.py --connect tcp/127.0.0.1:7447
    python watch_alarms.py --zenoh operator.json5

An advanced subscriber asks publishers for what it has missed while a router was away; a robot that is started again
sends its newest transitions again, with the same ids.
"""

from __future__ import annotations

import argparse
import json
import threading
from collections.abc import Sequence
from contextlib import suppress

import zenoh
from zenoh.ext import HistoryConfig, RecoveryConfig, declare_advanced_subscriber


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--connect", action="append", default=[], help="endpoint of a router or a robot")
    parser.add_argument("--zenoh", help="configuration file of Zenoh (JSON5)")
    given = parser.parse_args(arguments)
    if not (given.connect or given.zenoh):
        parser.error("found no address, expected --connect or --zenoh")
    config = zenoh.Config.from_file(given.zenoh) if given.zenoh else zenoh.Config()
    if given.connect:
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps(given.connect))
    config.insert_json5("scouting/multicast/enabled", "false")
    seen: set[tuple[str, str]] = set()

    def take(sample: zenoh.Sample) -> None:
        change = json.loads(sample.payload.to_bytes())
        name = (str(sample.key_expr), change["id"])
        if name not in seen:
            seen.add(name)
            print(json.dumps(change), flush=True)

    try:
        opened = zenoh.open(config)
    except zenoh.ZError as error:
        where, text = ", ".join(given.connect) or given.zenoh, str(error).partition(" at /")[0]
        why = f"nobody answers at {where}" if text.startswith("Unable to connect") else text
        parser.exit(2, f"{why}; expected a router or a robot, which is started first\n")
    with opened as session, suppress(KeyboardInterrupt):
        declare_advanced_subscriber(
            session,
            "lostmotion/*/*/alarm",
            take,
            history=HistoryConfig(detect_late_publishers=True),
            recovery=RecoveryConfig(periodic_queries=None, heartbeat=True),
        )
        threading.Event().wait()


if __name__ == "__main__":
    main()
