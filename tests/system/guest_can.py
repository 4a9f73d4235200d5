"""Runs in the virtual machine: a virtual CAN bus, the service on it, and two listeners; its findings go out as JSON.

Not a test: ``test_can_bus.py`` starts it and judges what it has seen.
"""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import can

NODE = 0x21
PATIENCE_S = 240.0
"""an emulated processor is slow"""
LOG = Path("/run/candump.log")


def run(*command: str) -> str:
    """Standard output of a command."""
    return subprocess.run(command, capture_output=True, text=True).stdout.strip()


def vcan() -> can.BusABC:
    """A socket on the bus."""
    return can.Bus("vcan0", interface="socketcan")


def listen(bus: can.BusABC, until: int) -> list[tuple[int, str]]:
    """Frames of a bus, until so many heartbeats have followed an emergency."""
    frames, after, end = list[tuple[int, str]](), 0, time.monotonic() + PATIENCE_S
    while after < until and time.monotonic() < end:
        message = bus.recv(1.0)
        if message is not None:
            frames.append((message.arbitration_id, message.data.hex()))
            alarms = any(cob_id == 0x80 + NODE and data[:4] != "0000" for cob_id, data in frames)
            after += alarms and message.arbitration_id == 0x700 + NODE
    return frames


def look() -> dict[str, object]:
    """The bus comes up, the service tells its alarm; the bus goes down and up, the service tells it again."""
    for command in ("modprobe vcan", "ip link add dev vcan0 type vcan", "ip link set vcan0 up"):
        run(*command.split())
    dump = ["candump", "-L", "vcan0"]
    with LOG.open("w") as log, subprocess.Popen(dump, stdout=log) as candump, vcan() as bus:
        run("systemctl", "start", "lostmotion")
        before = run("systemctl", "show", "lostmotion", "--value", "-p", "MainPID")
        first = listen(bus, 3)
        candump.terminate()
    run("ip", "link", "set", "vcan0", "down")
    end = time.monotonic() + PATIENCE_S
    while "trying again" not in run("journalctl", "-u", "lostmotion", "-o", "cat") and time.monotonic() < end:
        time.sleep(1)
    run("ip", "link", "set", "vcan0", "up")
    with vcan() as bus:  # one that is opened before hears first of all that the network is down
        again = listen(bus, 1)
    after = run("systemctl", "show", "lostmotion", "--value", "-p", "MainPID")
    said = run("journalctl", "-u", "lostmotion", "-o", "cat")
    return {"first": first, "candump": LOG.read_text(), "again": again, "pids": [before, after], "log": said}


print(json.dumps(look()))
