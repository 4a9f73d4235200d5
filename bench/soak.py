"""Whether the service's memory grows: a simulated robot at 20 times real speed, with all sinks on.

    python -m bench.soak [--duration 1200] [--speed 20]

Resident memory of its own is read once a second; pages of files are left out, for the kernel takes them back when it
likes.  Buffers and SQLite's page caches fill in the first minutes, so the slope is that of a straight line through what
comes after WARM_UP_S; start, middle and end are medians of its thirds.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.process import cpu_seconds, memory_mb, run_command, windows
from bench.sinks import all_sinks
from lostmotion.daemon import config
from lostmotion.drivers.base import FloatArray

WARM_UP_S = 300.0
GOAL_MB_PER_HOUR = 1.0


def main(arguments: Sequence[str] = ()) -> None:
    """Prints one row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=1200.0, help=f"seconds, more than {WARM_UP_S:g}")
    parser.add_argument("--speed", type=float, default=20.0, help="robot time per real time")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        readings, core, windows = soak(Path(name), given.duration, given.speed)
    times, rss = readings[:, readings[0] > WARM_UP_S]
    slope = np.polyfit(times, rss, 1)[0] * 3600
    start, middle, end = (float(np.median(part)) for part in np.array_split(rss, 3))
    print(f"soak, {given.duration:g} s at {given.speed:g} times real speed, Zenoh, CAN and metrics on")
    print(f"{'windows':>8}{'core':>8}{'start MB':>10}{'middle MB':>11}{'end MB':>8}{'MB an hour':>12}{'goal':>6}")
    print(f"{windows:>8}{core:>8.1%}{start:>10.2f}{middle:>11.2f}{end:>8.2f}{slope:>12.2f}{GOAL_MB_PER_HOUR:>6.1f}")


def soak(folder: Path, duration_s: float, speed: float) -> tuple[FloatArray, float, int]:
    """Times [s] and resident memory [MB], shape (2, N); share of a core; windows scored."""
    path, log = folder / "soak.toml", folder / "log"
    text = (Path(config.__file__).parent / "simulated.toml").read_text().replace("speed = 1 ", f"speed = {speed} ")
    with all_sinks() as tables, log.open("w") as stderr:
        path.write_text(f'{text}[store]\npath = "{folder / "history.db"}"\n{tables}')
        with subprocess.Popen(run_command(path), stderr=stderr) as process:
            begin, readings = time.monotonic(), list[tuple[float, float]]()
            while (now := time.monotonic() - begin) < duration_s:
                readings.append((now, memory_mb(process.pid, "RssAnon")))
                time.sleep(1.0)
            core = cpu_seconds(process.pid) / duration_s
            process.send_signal(signal.SIGTERM)
    return np.array(readings).T, core, windows(log.read_text())[1]


if __name__ == "__main__":
    main(sys.argv[1:])
