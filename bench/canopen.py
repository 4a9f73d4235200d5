"""What the service costs that listens to a CANopen bus, beside one that polls Dynamixel servos: shares of a core.

    python -m bench.canopen [--duration 30]

Six CiA 402 drives at 100 SYNCs a second and a CiA 404 sensor at 1 kHz behind one serial adapter (slcan), which is in
another process; and six AX-12A at 100 Hz with an accelerometer at 1 kHz on serial lines, one service after the other
on the same machine.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from bench.beside import compare, parser
from bench.process import run_command

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
    compare("canopen", listening, parser(__doc__).parse_args(arguments).duration)


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
