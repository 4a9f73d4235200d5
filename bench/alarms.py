"""Alarms: how soon another process hears of them, and whether kills of router and service lose any.

    python -m bench.alarms [--duration 60] [--restarts 20] [--kills 200]

Latency: from a window's end until the alarm that it causes has been received over Zenoh and over slcan on a
pseudo-terminal, on the emulated robot of ``bench.service`` with limits so close to its scores that alarms never rest.
Both times are taken on the same host's clock.  Restarts: a router killed and started again under 50 transitions a
second.  Kills: of the service, at random moments.  Lost counts what is stored and was not heard, or heard and not
stored.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path

import zenoh
from tests.daemon.alarm_world import Watcher, broken_links, restless_config, stored
from tests.daemon.canbus import SlcanAdapter
from tests.daemon.test_zenoh_router import transitions
from tests.daemon.zenoh_world import Router, session

from bench.latency import show
from bench.service import running_service
from bench.sinks import CAN_TABLE, free_port
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.sinks.emcy import EmcyNode
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.drivers.emulator import Emulator

GOAL_ZENOH_S, GOAL_SLCAN_S = 0.020, 0.050
CYCLE_S = 0.005
WINDOW_S = 0.25
NODE = 0x21
RESTLESS = "[detector]\nlevel = 200.0\n[alarm]\nwindows = 3\noff_delay_s = 0\ndeadband = 0\n"
ZENOH_TABLE = '[alarm.zenoh]\nlisten = ["{endpoint}"]\n'
PAUSE_S = 0.04


def main(arguments: Sequence[str] = ()) -> None:
    """Prints all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=20.0, help="seconds of alarms for the latency")
    parser.add_argument("--restarts", type=int, default=5, help="of the router")
    parser.add_argument("--kills", type=int, default=10, help="of the service")
    given = parser.parse_args(arguments)
    load, cores = os.getloadavg()[0], os.cpu_count()
    print(f"from a window's end, 6 AX-12A, csv:1000, {given.duration:g} s; load {load:.1f} on {cores} cores before")
    print(f"{'until':<24}{'alarms':>8}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}{'goal p99':>10}")
    over_zenoh, over_slcan = latencies(given.duration)
    show("Zenoh received", over_zenoh, GOAL_ZENOH_S)
    show("slcan received", over_slcan, GOAL_SLCAN_S)
    print(f"\n{'killed':<24}{'times':>8}{'alarms':>9}{'lost':>9}{'doubled':>9}{'broken':>10}")
    print(f"{'router':<24}{given.restarts:>8}{restart_router(given.restarts)}", flush=True)
    print(f"{'service':<24}{given.kills:>8}{kill_service(given.kills)}", flush=True)


class StampingAdapter(SlcanAdapter):
    """Notes when each emergency came; ``heard``: (arrival [s, UTC], frame's data)."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[tuple[float, bytes]] = []

    def receive(self, data: bytes, now: float) -> None:
        arrived, before = time.time(), len(self.frames)
        super().receive(data, now)
        self.heard += [(arrived, data) for number, data in self.frames[before:] if number == 0x80 + NODE]


def latencies(duration_s: float) -> tuple[list[float], list[float]]:
    """Delays [s] of the transitions over Zenoh, and of the emergencies over slcan."""
    endpoint, adapter, delays = f"tcp/127.0.0.1:{free_port()}", StampingAdapter(), list[float]()
    with tempfile.TemporaryDirectory() as name, Emulator(adapter) as emulator:
        tables = RESTLESS + ZENOH_TABLE.format(endpoint=endpoint) + CAN_TABLE.format(port=emulator.paths[0])
        with running_service(Path(name), "csv:1000", tables, cycle_s=CYCLE_S) as service:
            assert service.stderr is not None
            threading.Thread(target=service.stderr.read, daemon=True).start()  # a full pipe would stop the service
            time.sleep(4.0)
            with session("client", connect=[endpoint]) as other:
                other.declare_subscriber("lostmotion/bench/*/alarm", lambda sample: delays.append(delay(sample)))
                time.sleep(duration_s)
        return delays, slcan_delays(Path(name) / "history.db", adapter.heard)


def delay(sample: zenoh.Sample) -> float:
    """How long after its window's end a transition has arrived [s]."""
    now = time.time()
    return now - datetime.fromisoformat(json.loads(sample.payload.to_bytes())["time"]).timestamp() - WINDOW_S


def slcan_delays(database: Path, heard: list[tuple[float, bytes]]) -> list[float]:
    """The same of each emergency: the database has the transitions that led to them, in the same order."""
    with open_readonly(database) as reader:
        joints = [row.name for row in reader.joints()]
        changes = [change for _, change in reader.transitions()]
    node, delays, arrivals = EmcyNode(NODE, sorted(joints)), [], iter(heard[1:])  # the first is the reset at the start
    for change in changes:
        for frame in node.alarm(change):
            arrived, data = next(arrivals, (math.nan, frame.data))
            if data[:4] != frame.data[:4]:  # the score may be of a later window
                raise RuntimeError(f"found the frame {data.hex()} where {frame.data.hex()} was expected: one is lost")
            if not math.isnan(arrived):
                delays.append(arrived - change.time.timestamp() - WINDOW_S)
    return delays


def restart_router(times: int) -> str:
    """Kills the router again and again under load; the end of the table's row."""
    endpoint, moments = f"tcp/127.0.0.1:{free_port()}", random.Random(1)
    with (
        tempfile.TemporaryDirectory() as name,
        closing(Router(Path(name), endpoint)) as router,
        closing(ZenohSink("arm1", ZenohOptions(mode="client", connect=[endpoint]), Path(name) / "none.db")) as sink,
        closing(Watcher(endpoint, Path(name) / "watched")) as watcher,
    ):
        told: list[str] = []
        load = zip(transitions(10**6, "elbow"), transitions(10**6, "wrist"), strict=True)

        def work(seconds: float) -> None:
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                for transition in next(load):
                    sink.alarm(transition)
                    told.append(transition.id)
                time.sleep(PAUSE_S)

        for _ in range(times):
            work(moments.uniform(0.2, 2.0))
            router.kill()
            work(moments.uniform(0.0, 1.0))
            router.start()
        work(1.0)
        settle(watcher, len(told))
        return account(told, watcher.ids)


def kill_service(times: int) -> str:
    """Kills a service whose alarms never rest; the end of the table's row."""
    endpoint, moments = f"tcp/127.0.0.1:{free_port()}", random.Random(2)
    with (
        tempfile.TemporaryDirectory() as name,
        session("router", listen=[endpoint]),
        closing(Watcher(endpoint, Path(name) / "watched")) as watcher,
    ):
        path = Path(name) / "fake.toml"
        path.write_text(restless_config(Path(name), f'[alarm.zenoh]\nmode = "client"\nconnect = ["{endpoint}"]\n'))
        command = [sys.executable, "-m", "tests.daemon.fakes", str(path)]
        for _ in range(times):
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as service:
                time.sleep(moments.uniform(0.3, 3.0))
                service.kill()
        with subprocess.Popen(command, stderr=subprocess.DEVNULL) as service:
            time.sleep(3.0)
            service.terminate()
        changes = stored(Path(name) / "history.db")
        settle(watcher, len(changes))
        return account([change.id for change in changes], watcher.ids) + f"{len(broken_links(changes)):>10}"


def settle(watcher: Watcher, count: int) -> None:
    """Gives the subscriber time to recover."""
    end = time.monotonic() + 30.0
    while len(watcher.ids) < count and time.monotonic() < end:
        time.sleep(0.1)


def account(told: list[str], heard: list[str]) -> str:
    """Transitions, those that are on one side only, and those that were heard twice."""
    lost = len(set(told) ^ set(heard))
    return f"{len(told):>9}{lost:>9}{len(heard) - len(set(heard)):>9}"


if __name__ == "__main__":
    main(sys.argv[1:])
