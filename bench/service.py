"""What the service costs on emulated hardware: share of a core, resident memory, and windows lost.

    python -m bench.service [--duration 600] [--accel csv:1000] [--sinks]

Six AX-12A at 100 Hz on one line and one accelerometer answer from another process.  What a process costs that only
exchanges the same bytes, and does nothing with them, stands beside it: the floor that wake-ups set on this machine.
With --sinks Zenoh, CAN and metrics are on as well, and heard.
"""

from __future__ import annotations

import argparse
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from pathlib import Path

from serial import Serial

from bench.process import cpu_seconds, memory_mb, run_command, windows
from bench.sinks import all_sinks
from lostmotion.drivers.codec.dynamixel import READ, Packet, encode

GOAL_CORE, GOAL_MB = 0.05, 80.0
WARM_UP_S = 5.0
LONGEST_FLOOR_S = 20.0
JOINT = """
[[joint]]
name = "j{0}"
driver = "dynamixel"
port = "{1}"
model = "AX-12A"
id = {0}
accelerometer = "tip"
"""
DRIVERS = {"csv": ("csv_serial", "time_column = 0\ncolumn = 1"), "witmotion": ("witmotion", "")}


def main(arguments: Sequence[str] = ()) -> None:
    """Prints one table row for each kind of accelerometer."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0, help="seconds for each accelerometer")
    parser.add_argument("--accel", action="append", help="csv:1000 or witmotion:200; may be given twice")
    parser.add_argument("--sinks", action="store_true", help="Zenoh, CAN and metrics on")
    given = parser.parse_args(arguments)
    print(f"service, 6 AX-12A at 100 Hz, {given.duration:g} s{', all sinks on' if given.sinks else ''}")
    print(f"goal: at most {GOAL_CORE:.0%} of a core and {GOAL_MB:g} MB, no window lost")
    print(f"{'accelerometer':<16}{'core':>8}{'bytes only':>12}{'RSS MB':>9}{'triggered':>11}{'scored':>8}{'lost':>6}")
    for accel in given.accel or ["csv:1000", "witmotion:200"]:
        floor = measure_floor(accel, min(given.duration, LONGEST_FLOOR_S))
        with all_sinks() if given.sinks else nullcontext("") as tables:
            core, rss_mb, (triggered, scored, lost) = measure(accel, given.duration, tables)
        print(
            f"{accel:<16}{core:>8.2%}{floor:>12.2%}{rss_mb:>9.1f}{triggered:>11}{scored:>8}{lost:>6}",
            flush=True,
        )


def measure(accel: str, duration_s: float, tables: str) -> tuple[float, float, tuple[int, int, int]]:
    """Share of a core after the warm-up, peak resident memory [MB], and windows triggered, scored and lost."""
    with tempfile.TemporaryDirectory() as name, running_service(Path(name), accel, tables) as process:
        time.sleep(WARM_UP_S)
        before, start = cpu_seconds(process.pid), time.monotonic()
        time.sleep(duration_s)
        core = (cpu_seconds(process.pid) - before) / (time.monotonic() - start)
        rss_mb = memory_mb(process.pid, "VmHWM")
        process.send_signal(signal.SIGTERM)
        _, text = process.communicate(timeout=30)
    return core, rss_mb, windows(text)


def measure_floor(accel: str, duration_s: float) -> float:
    """Share of a core of this process while it exchanges the service's bytes with the emulators."""
    requests = [encode(Packet(number, READ, bytes((30, 14))), protocol=1) for number in range(1, 7)]
    with running_emulators(accel) as ports, ExitStack() as stack:
        line, sensor = (stack.enter_context(Serial(port, timeout=0)) for port in ports)
        answer = select.poll()
        answer.register(line.fileno(), select.POLLIN)
        before, start = time.process_time(), time.monotonic()
        for cycle in range(int(duration_s * 100)):
            time.sleep(max(0.0, start + cycle / 100 - time.monotonic()))
            for request in requests:
                os.write(line.fileno(), request)
                answer.poll(100)
                os.read(line.fileno(), 64)
            sensor.read(1024)
        return (time.process_time() - before) / (time.monotonic() - start)


@contextmanager
def running_emulators(accel: str) -> Iterator[list[str]]:
    """The servos and the accelerometer in a process of their own; their ports."""
    command = [sys.executable, "-m", "lostmotion.drivers.emulator", "--servos", "ax12:1,2,3,4,5,6", "--accel", accel]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        try:
            yield [emulator.stdout.readline().strip() for _ in range(2)]
        finally:
            emulator.kill()


@contextmanager
def running_service(folder: Path, accel: str, alarm: str = "") -> Iterator[subprocess.Popen[str]]:
    """The emulators and the service, each in a process of its own; both end with the block."""
    with running_emulators(accel) as ports:
        path = folder / "bench.toml"
        path.write_text(configuration(folder, ports, accel) + alarm)
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        with subprocess.Popen(run_command(path), stderr=subprocess.PIPE, text=True, env=environment) as process:
            try:
                yield process
            finally:
                process.kill()


def configuration(folder: Path, ports: list[str], accel: str) -> str:
    """Six joints on the first port, one accelerometer on the second."""
    kind, _, rate = accel.partition(":")
    driver, keys = DRIVERS[kind]
    text = f"""
[robot]
name = "bench"
[store]
path = "{folder / "history.db"}"
[[accelerometer]]
name = "tip"
driver = "{driver}"
port = "{ports[1]}"
rate_hz = {rate}
oscillator = {{ f_res_hz = 58.0, zeta = 0.012, length_m = 0.10 }}
{keys}
"""
    return text + "".join(JOINT.format(number, ports[0]) for number in range(1, 7))


if __name__ == "__main__":
    main(sys.argv[1:])
