"""What the service costs on emulated hardware: share of a core, resident memory, and windows lost.

    python -m bench.service [--duration 600] [--accel csv:1000] [--cycle 0.2] [--sinks]
    python -m bench.service [--duration 600] --arm

Six AX-12A at 100 Hz on one line and one accelerometer answer from another process.  What a process costs that at the
same time only exchanges as many bytes (``floor.py``) stands beside it: the floor that wake-ups set on this machine, and
what another program on it adds to both.  With --sinks Zenoh, CAN and metrics are on as well, and heard.  With --arm it
is README's arm instead, without sinks: two servos, of which one has play, so that its size is estimated.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path

from bench.process import children, cpu_seconds, memory_mb, run_command, run_on, waits, windows
from bench.sinks import all_sinks
from lostmotion.drivers.clock import CYCLE_S

GOAL_CORE, GOAL_MB = 0.05, 75.0
WARM_UP_S = 5.0
TURN_S = 10.0
"""for how long the service stays on one core [s]"""
README = Path(__file__).parent.parent / "README.md"
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
    parser.add_argument("--cycle", type=float, default=CYCLE_S, help="[robot] cycle_s")
    parser.add_argument("--sinks", action="store_true", help="Zenoh, CAN and metrics on")
    parser.add_argument("--arm", action="store_true", help="README's arm, without sinks")
    given = parser.parse_args(arguments)
    if given.arm:
        core, now, most, scored = measure_arm(given.duration)
        print(
            f"README's arm, {given.duration:g} s: {core:.1%} of a core, {now:.1f} MB, most {most:.1f}, {scored} windows"
        )
        return
    print(f"service, 6 AX-12A at 100 Hz, {given.duration:g} s{', all sinks on' if given.sinks else ''}")
    print(f"goal: at most {GOAL_CORE:.0%} of a core and {GOAL_MB:g} MB, no window lost")
    print(
        f"{'accelerometer':<16}{'core':>8}{'bytes only':>12}{'times':>7}{'waits/s':>9}{'RSS MB':>9}"
        f"{'triggered':>11}{'scored':>8}{'lost':>6}"
    )
    for accel in given.accel or ["csv:1000", "witmotion:200"]:
        with all_sinks() if given.sinks else nullcontext("") as tables:
            cost, (triggered, scored, lost) = measure(accel, given.duration, tables, given.cycle)
        print(
            f"{accel:<16}{cost.core:>8.2%}{cost.floor:>12.2%}{cost.core / cost.floor:>7.2f}{cost.waits_hz:>9.0f}"
            f"{cost.rss_mb:>9.1f}{triggered:>11}{scored:>8}{lost:>6}",
            flush=True,
        )


@dataclass(frozen=True)
class Cost:
    """Shares of a core of the service and of the same exchange of bytes alone, how often a second the service's threads
    wait, and its peak resident memory [MB]."""

    core: float
    floor: float
    waits_hz: float
    rss_mb: float


def measure(accel: str, duration_s: float, tables: str, cycle_s: float = CYCLE_S) -> tuple[Cost, tuple[int, int, int]]:
    """The cost after the warm-up; windows triggered, scored and lost."""
    with ExitStack() as stack:
        name = stack.enter_context(tempfile.TemporaryDirectory())
        others = children()
        floor = stack.enter_context(running_floor(accel))
        floor_group = children() - others
        process = stack.enter_context(running_service(Path(name), accel, tables, cycle_s=cycle_s))
        service_group = children() - others - floor_group
        time.sleep(WARM_UP_S)
        before, start = (cpu_seconds(process.pid), cpu_seconds(floor), waits(process.pid)), time.monotonic()
        take_turns(service_group, floor_group, duration_s)
        after, seconds = (cpu_seconds(process.pid), cpu_seconds(floor), waits(process.pid)), time.monotonic() - start
        core, beside, waits_hz = ((b - a) / seconds for a, b in zip(before, after, strict=True))
        cost = Cost(core, beside, waits_hz, memory_mb(process.pid, "VmHWM"))
        process.send_signal(signal.SIGTERM)
        _, text = process.communicate(timeout=30)
    return cost, windows(text)


def take_turns(own: set[int], beside: set[int], duration_s: float) -> None:
    """For so long, each of two groups of processes runs on a core of its own, and they change places: where the kernel
    places them, one may have to share a core with its emulators and the other not."""
    cores = sorted(os.sched_getaffinity(0))
    turns = max(2 * round(duration_s / (2 * TURN_S)), 2)
    for turn in range(turns):
        run_on(cores[turn % 2 % len(cores)], own)
        run_on(cores[(turn + 1) % 2 % len(cores)], beside)
        time.sleep(duration_s / turns)


def measure_arm(duration_s: float) -> tuple[float, float, float, int]:
    """Of README's arm: share of a core after the warm-up, resident memory [MB] at the end and at most, windows."""
    (text,) = re.findall(r"```toml\n(.*?)\[alarm.zenoh\]", README.read_text(), re.DOTALL)
    levers = ("--levers", "0.25,0.10")
    with (
        tempfile.TemporaryDirectory() as name,
        running_emulators("csv:1000", *levers, servos="ax12:2,3") as (servos, sensor),
    ):
        names = {"/dev/ttyUSB0": servos, "/dev/ttyUSB1": sensor, "/var/lib/lostmotion": name}
        path = Path(name) / "arm.toml"
        path.write_text(re.sub("|".join(names), lambda found: names[found[0]], text))
        with subprocess.Popen(run_command(path), stderr=subprocess.PIPE, text=True) as process:
            time.sleep(WARM_UP_S)
            before = cpu_seconds(process.pid)
            time.sleep(max(duration_s - WARM_UP_S, 1.0))
            core = (cpu_seconds(process.pid) - before) / max(duration_s - WARM_UP_S, 1.0)
            now, most = memory_mb(process.pid, "VmRSS"), memory_mb(process.pid, "VmHWM")
            process.send_signal(signal.SIGTERM)
            scored = windows(process.communicate(timeout=30)[1])[1]
    return core, now, most, scored


@contextmanager
def running_floor(accel: str) -> Iterator[int]:
    """A process that only exchanges the service's bytes, with emulators of its own; its number."""
    with running_emulators(accel) as ports, subprocess.Popen([sys.executable, "-m", "bench.floor", *ports]) as process:
        try:
            yield process.pid
        finally:
            process.kill()


@contextmanager
def running_emulators(accel: str, *options: str, servos: str = "ax12:1,2,3,4,5,6") -> Iterator[list[str]]:
    """The servos and the accelerometer in a process of their own; their ports."""
    command = [sys.executable, "-m", "lostmotion.drivers.emulator", "--servos", servos, "--accel", accel]
    command += options
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as emulator:
        assert emulator.stdout is not None
        try:
            yield [emulator.stdout.readline().strip() for _ in range(2)]
        finally:
            emulator.kill()


@contextmanager
def running_service(
    folder: Path, accel: str, alarm: str = "", servos: str = "dynamixel", cycle_s: float = CYCLE_S
) -> Iterator[subprocess.Popen[str]]:
    """The emulators and the service, each in a process of its own; both end with the block.  servos: their driver; with
    "tap" the servos have a master already."""
    with running_emulators(accel, *["--mastered"] * (servos == "tap")) as ports:
        path = folder / "bench.toml"
        text = configuration(folder, ports, accel).replace('driver = "dynamixel"', f'driver = "{servos}"')
        path.write_text(text.replace("[robot]", f"[robot]\ncycle_s = {cycle_s}") + alarm)
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
