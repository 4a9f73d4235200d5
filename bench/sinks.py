"""Somebody at the far end of every sink: a Zenoh router with a subscriber, a CAN adapter, and a scraper of metrics."""

from __future__ import annotations

import socket
import threading
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from tests.daemon.canbus import SlcanAdapter
from tests.daemon.zenoh_world import session

from lostmotion.drivers.emulator import Emulator

__all__ = ["CAN_TABLE", "all_sinks", "free_port"]

SCRAPE_S = 15.0
CAN_TABLE = """
[alarm.can]
interface = "slcan"
channel = "{port}"
node_id = 0x21
options = {{ sleep_after_open = 0 }}
"""
TABLES = """
[metrics]
listen = "127.0.0.1:{metrics}"
[alarm.zenoh]
mode = "client"
connect = ["{endpoint}"]
"""


@contextmanager
def all_sinks() -> Iterator[str]:
    """The tables that turn them on; all of them are served until the block ends."""
    endpoint, metrics, done = f"tcp/127.0.0.1:{free_port()}", free_port(), threading.Event()
    scraper = threading.Thread(target=_scrape, args=(f"http://127.0.0.1:{metrics}/metrics", done))
    with Emulator(SlcanAdapter()) as adapter, session("router", listen=[endpoint]) as router:
        router.declare_subscriber("lostmotion/**", lambda sample: None)
        scraper.start()
        try:
            yield TABLES.format(metrics=metrics, endpoint=endpoint) + CAN_TABLE.format(port=adapter.paths[0])
        finally:
            done.set()
            scraper.join()


def _scrape(url: str, done: threading.Event) -> None:
    """Asks as often as Prometheus would."""
    while not done.wait(SCRAPE_S):
        with suppress(OSError):  # not up yet, or gone already
            urllib.request.urlopen(url).read()


def free_port() -> int:
    """A TCP port of this host that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
