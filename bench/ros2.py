"""What the service costs that listens to ROS 2, beside one that polls Dynamixel servos: shares of a core, their ratio.

    python -m bench.ros2 [--duration 30]

Six joints at 100 Hz on one topic and an Imu at 1 kHz over a Zenoh router, which is in another process; and six AX-12A
at 100 Hz with an accelerometer at 1 kHz on serial lines, one service after the other on the same machine.  The robot
with ROS 2 tells unquantised commands, so that more windows are opened, each of which costs.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.beside import compare, parser
from bench.process import run_command
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
    known = parser(__doc__)
    known.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    given = known.parse_args(arguments)
    if given.serve:
        serve()
    else:
        compare("ros2", listening, given.duration)


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
