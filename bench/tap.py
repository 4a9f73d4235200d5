"""What the service costs that listens to servos of another master, beside one that polls them: shares of a core, ratio.

    python -m bench.tap [--duration 30]

Six AX-12A at 100 Hz and an accelerometer at 1 kHz, one service after the other on the same machine.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.ros2 import measured
from bench.service import running_service


def main(arguments: Sequence[str] = ()) -> None:
    """Prints a row for each driver and the ratio."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0, help="seconds for each driver")
    given = parser.parse_args(arguments)
    cores = []
    print(f"{'driver':<12}{'core':>8}{'RSS MB':>9}{'triggered':>11}{'scored':>8}{'lost':>6}")
    for driver in ("dynamixel", "tap"):
        with tempfile.TemporaryDirectory() as name, running_service(Path(name), "csv:1000", servos=driver) as process:
            core, rss_mb, counts = measured(process, given.duration)
        cores.append(core)
        print(f"{driver:<12}{core:>8.2%}{rss_mb:>9.1f}{counts[0]:>11}{counts[1]:>8}{counts[2]:>6}", flush=True)
    print(f"ratio {cores[1] / cores[0]:.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])
