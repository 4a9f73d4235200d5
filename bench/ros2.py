"""What the service costs that listens to ROS 2, beside one that polls Dynamixel servos: shares of a core, their ratio.

    python -m bench.ros2 [--duration 30]

Six joints at 100 Hz on one topic and an Imu at 1 kHz over a Zenoh router, which is in another process; and six AX-12A
at 100 Hz with an accelerometer at 1 kHz on serial lines, one service after the other on the same machine.  The robot
with ROS 2 tells unquantised commands, so that more windows are opened, each of which costs.
"""

from __future__ import annotations

import argparse
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.process import cpu_seconds, memory_mb, run_command, windows
from bench.service import WARM_UP_S, running_service
from lostmotion.drivers.emulator.ros2 import Ros2Robot

JOINTS = tuple(f"joint{i}" for i in range(6))
TABLES = """
[robot]
name = "bench"
[store]
path = "{folder}/history.db"
[ros2]
connect = ["{endpoint}"]
[[accelerometer]]
name = "tip"
driver = "ros2"
topic = "/imu"
rate_hz = 1000
oscillator = {{ f_res_hz = 58.0 }}
"""
JOINT = '\n[[joint]]\nname = "{}"\ndriver = "ros2"\nreference = "/controller_state"\naccelerometer = "tip"\n'


def main(arguments: Sequence[str] = ()) -> None:
    """Prints a row for each driver and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0, help="seconds for each driver")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args(arguments)
    if given.serve:
        serve()
        return
    cores = []
    print(f"{'driver':<12}{'core':>8}{'RSS MB':>9}{'triggered':>11}{'scored':>8}{'lost':>6}")
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        services = (
            ("dynamixel", running_service(Path(one), "csv:1000")),
            ("ros2", listening(Path(other))),
        )
        for name, service in services:
            with service as process:
                core, rss_mb, counts = measured(process, given.duration)
            cores.append(core)
            print(f"{name:<12}{core:>8.2%}{rss_mb:>9.1f}{counts[0]:>11}{counts[1]:>8}{counts[2]:>6}", flush=True)
    print(f"ratio {cores[1] / cores[0]:.2f}")


def measured(process: subprocess.Popen[str], duration_s: float) -> tuple[float, float, tuple[int, int, int]]:
    """Share of a core after the warm-up, peak resident memory [MB], windows triggered, scored and lost."""
    time.sleep(WARM_UP_S)
    before, start = cpu_seconds(process.pid), time.monotonic()
    time.sleep(duration_s)
    core = (cpu_seconds(process.pid) - before) / (time.monotonic() - start)
    rss_mb = memory_mb(process.pid, "VmHWM")
    process.send_signal(signal.SIGTERM)
    return core, rss_mb, windows(process.communicate(timeout=30)[1])


@contextmanager
def listening(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The service on a robot with ROS 2, each in a process of its own; both end with the block."""
    command = [sys.executable, "-m", "bench.ros2", "--serve"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as robot:
        assert robot.stdout is not None
        tables = TABLES.format(folder=folder, endpoint=robot.stdout.readline().strip())
        path = folder / "bench.toml"
        path.write_text(tables + "".join(JOINT.format(name) for name in JOINTS))
        with subprocess.Popen(run_command(path), stderr=subprocess.PIPE, text=True) as process:
            try:
                yield process
            finally:
                process.kill()
                robot.kill()


def serve() -> None:
    """Says where the robot is, and publishes until stdin ends or it is killed."""
    with Ros2Robot(joints=JOINTS) as robot:
        print(*robot.paths, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1:])
