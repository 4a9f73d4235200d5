"""A driver's cost in the service beside that of the driver that polls Dynamixel servos, one after the other on the same
machine: shares of a core and their ratio.  What ``bench.canopen``, ``bench.ros2`` and ``bench.tap`` share.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path

from bench.process import cpu_seconds, memory_mb, windows
from bench.service import WARM_UP_S, running_service

__all__ = ["compare", "parser"]

Service = Callable[[Path], AbstractContextManager[subprocess.Popen[str]]]
"""a running service with its database in that folder"""


def parser(doc: str | None) -> argparse.ArgumentParser:
    """The arguments of such a bench."""
    made = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("--duration", type=float, default=30.0, help="seconds for each driver")
    return made


def compare(name: str, service: Service, duration_s: float) -> None:
    """Prints a row for each driver and the ratio."""
    services: Sequence[tuple[str, Service]] = (
        ("dynamixel", lambda folder: running_service(folder, "csv:1000")),
        (name, service),
    )
    cores = []
    print(f"{'driver':<12}{'core':>8}{'RSS MB':>9}{'triggered':>11}{'scored':>8}{'lost':>6}")
    for driver, start in services:
        with tempfile.TemporaryDirectory() as folder, start(Path(folder)) as process:
            core, rss_mb, counts = _measured(process, duration_s)
        cores.append(core)
        print(f"{driver:<12}{core:>8.2%}{rss_mb:>9.1f}{counts[0]:>11}{counts[1]:>8}{counts[2]:>6}", flush=True)
    print(f"ratio {cores[1] / cores[0]:.2f}")


def _measured(process: subprocess.Popen[str], duration_s: float) -> tuple[float, float, tuple[int, int, int]]:
    """Share of a core after the warm-up, peak resident memory [MB], windows triggered, scored and lost."""
    time.sleep(WARM_UP_S)
    before, start = cpu_seconds(process.pid), time.monotonic()
    time.sleep(duration_s)
    core = (cpu_seconds(process.pid) - before) / (time.monotonic() - start)
    rss_mb = memory_mb(process.pid, "VmHWM")
    process.send_signal(signal.SIGTERM)
    return core, rss_mb, windows(process.communicate(timeout=30)[1])
