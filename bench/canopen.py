"""What the service costs that listens to a CANopen bus, beside one that polls Dynamixel servos: shares of a core.

    python -m bench.canopen [--duration 30]

Six CiA 402 drives at 100 SYNCs a second and a CiA 404 sensor at 1 kHz behind one serial adapter (slcan), which is in
another process; and six AX-12A at 100 Hz with an accelerometer at 1 kHz on serial lines, one service after the other
on the same machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.process import run_command
from bench.ros2 import measured
from bench.service import running_service

NODES = range(1, 7)
TABLES = """
[robot]
name = "bench"
[store]
path = "{folder}/history.db"
[[accelerometer]]
name = "tip"
driver = "canopen"
port = "{port}"
interface = "slcan"
node = 32
pdo = [{{ cob_id = 0x1A0, map = [0x71300110] }}]
scale = 0.005
rate_hz = 1000
oscillator = {{ f_res_hz = 58.0, zeta = 0.012, length_m = 0.10 }}
"""
JOINT = """
[[joint]]
name = "j{node}"
driver = "canopen"
port = "{port}"
interface = "slcan"
node = {node}
pdo = [
    {{ cob_id = {tpdo}, map = [0x60410010, 0x60640020] }},
    {{ cob_id = {rpdo}, map = [0x60400010, 0x607A0020] }},
]
counts_per_turn = 10000
gear_ratio = 50
accelerometer = "tip"
"""


def main(arguments: Sequence[str] = ()) -> None:
    """Prints a row for each driver and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0, help="seconds for each driver")
    given = parser.parse_args(arguments)
    cores = []
    print(f"{'driver':<12}{'core':>8}{'RSS MB':>9}{'triggered':>11}{'scored':>8}{'lost':>6}")
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        services = (
            ("dynamixel", running_service(Path(one), "csv:1000")),
            ("canopen", listening(Path(other))),
        )
        for name, service in services:
            with service as process:
                core, rss_mb, counts = measured(process, given.duration)
            cores.append(core)
            print(f"{name:<12}{core:>8.2%}{rss_mb:>9.1f}{counts[0]:>11}{counts[1]:>8}{counts[2]:>6}", flush=True)
    print(f"ratio {cores[1] / cores[0]:.2f}")


@contextmanager
def listening(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """The service on a CANopen bus, each in a process of its own; both end with the block."""
    nodes = ",".join(map(str, NODES))
    command = [sys.executable, "-m", "lostmotion.drivers.emulator", "--canopen", nodes]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        port = emulator.stdout.readline().strip()
        joints = [JOINT.format(node=node, port=port, tpdo=0x180 + node, rpdo=0x200 + node) for node in NODES]
        path = folder / "bench.toml"
        path.write_text(TABLES.format(folder=folder, port=port) + "".join(joints))
        with subprocess.Popen(run_command(path), stderr=subprocess.PIPE, text=True) as process:
            try:
                yield process
            finally:
                process.kill()
                emulator.kill()


if __name__ == "__main__":
    main(sys.argv[1:])
