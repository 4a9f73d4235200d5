"""How long after a window's end its score is in the database, and in another process by way of Zenoh.

    python -m bench.latency [--duration 60] [--accel csv:1000] [--cycle 0.005]

The same emulated robot as in ``bench.service``; both times are taken in this process, on the same host's clock.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

import zenoh

from bench.service import running_service
from bench.sinks import free_port

GOAL_ROW_S, GOAL_SAMPLE_S = 0.250, 0.020
"""with cycles of 5 ms"""
LOOK_S = 0.002


def main(arguments: Sequence[str] = ()) -> None:
    """Prints p50, p99 and the largest of both delays."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=20.0, help="seconds")
    parser.add_argument("--accel", default="csv:1000", help="csv:1000 or witmotion:200")
    parser.add_argument("--cycle", type=float, default=0.005, help="[robot] cycle_s")
    given = parser.parse_args(arguments)
    port = free_port()
    alarm = f'[alarm.zenoh]\nlisten = ["tcp/127.0.0.1:{port}"]\n'
    print(f"from a window's end, {given.accel}, {given.duration:g} s")
    with tempfile.TemporaryDirectory() as name, running_service(Path(name), given.accel, alarm, cycle_s=given.cycle):
        time.sleep(4.0)
        samples = Samples(f"tcp/127.0.0.1:{port}")
        rows = row_delays(Path(name) / "history.db", given.duration)
        samples.close()
    print(f"{'until':<24}{'windows':>8}{'p50 ms':>9}{'p99 ms':>9}{'max ms':>9}{'goal p99':>10}")
    show("row committed", rows, GOAL_ROW_S)
    show("Zenoh sample received", samples.delays, max(GOAL_SAMPLE_S, given.cycle + GOAL_SAMPLE_S / 2))


class Samples:
    """Receives scores over Zenoh and notes how late each is."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        self.delays: list[float] = []
        self._lock = threading.Lock()
        self._session = zenoh.open(config)
        self._session.declare_subscriber("lostmotion/bench/*/score", self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        now = time.time()
        score = json.loads(sample.payload.to_bytes())
        with self._lock:
            self.delays.append(now - end_of(score["time"], score["duration"]))

    def close(self) -> None:
        self._session.close()


def row_delays(path: Path, duration_s: float) -> list[float]:
    """Looks for new rows every few milliseconds, as any reader of the file can."""
    db = sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)
    seen = {row[:2] for row in db.execute("SELECT joint, time FROM scores")}
    delays, version = [], None
    end = time.monotonic() + duration_s
    while time.monotonic() < end:
        changed = db.execute("PRAGMA data_version").fetchone()
        if changed != version:
            version, now = changed, time.time()
            for joint, start, duration in db.execute("SELECT joint, time, duration FROM scores"):
                if (joint, start) not in seen:
                    seen.add((joint, start))
                    delays.append(now - end_of(start, duration))
        time.sleep(LOOK_S)
    db.close()
    return delays


def end_of(start: str, duration_s: float) -> float:
    """UTC [s] at which a window that began at ``start`` ended."""
    return datetime.fromisoformat(start).timestamp() + duration_s


def show(name: str, delays: list[float], goal_s: float) -> None:
    """One row of the table."""
    ranked = sorted(1e3 * delay for delay in delays)
    p50, p99 = (ranked[min(int(len(ranked) * share), len(ranked) - 1)] for share in (0.50, 0.99))
    print(f"{name:<24}{len(ranked):>8}{p50:>9.1f}{p99:>9.1f}{ranked[-1]:>9.1f}{1e3 * goal_s:>10.0f}")


if __name__ == "__main__":
    main(sys.argv[1:])
