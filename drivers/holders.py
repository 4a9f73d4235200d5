"""Which other processes have a serial port open, whether they lock it or not: from /proc.

A lock keeps out only programs that ask for it, and many controllers do not.  Linux decides what may be seen: root
sees all processes, a user his own; nothing is seen under systemd's ProtectProc=invisible.  No port is opened here.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

__all__ = ["holders"]

PROC = Path("/proc")
PTMX = os.makedev(5, 2)
"""the device of which every open file is the far end of a pseudo-terminal"""
PTYS = range(136, 144)
"""major numbers of pseudo-terminals, which every container numbers anew"""
LONGEST_NAME = 60


def holders(path: str) -> list[str]:
    """The other processes that have the device at ``path`` open, as ``PID (command line)``.

    The device counts, not its name: a symbolic link to it, or another node of the same number, is the same.  Of a
    pseudo-terminal the process at its far end is the device itself, and no second user.
    """
    try:
        device = Path(path).stat()
    except OSError:
        return []
    if not stat.S_ISCHR(device.st_mode):
        return []
    pids = (int(entry.name) for entry in os.scandir(PROC) if entry.name.isdigit())
    return [_named(pid) for pid in sorted(pids) if pid != os.getpid() and _holds(pid, _identity(device))]


def _identity(device: os.stat_result) -> tuple[int, int]:
    """The device's number, and for a pseudo-terminal the file system that numbers it."""
    return device.st_rdev, device.st_dev if os.major(device.st_rdev) in PTYS else 0


def _holds(pid: int, device: tuple[int, int]) -> bool:
    numbers = dict(_devices(pid))
    if device not in numbers.values():
        return False
    masters = (number for number, (rdev, _) in numbers.items() if rdev == PTMX)
    return not any(_far_end(pid, number) == os.minor(device[0]) for number in masters)


def _devices(pid: int) -> Iterator[tuple[str, tuple[int, int]]]:
    """The identities of all devices that a process has open, by file descriptor; none where nothing may be seen."""
    folder = PROC / str(pid) / "fd"
    with suppress(OSError):  # it has ended, or is another user's
        for entry in folder.iterdir():
            with suppress(OSError):
                found = entry.stat()
                if stat.S_ISCHR(found.st_mode):
                    yield entry.name, _identity(found)


def _far_end(pid: int, number: str) -> int | None:
    """Of which pseudo-terminal the open file is the far end."""
    with suppress(OSError):
        for line in (PROC / str(pid) / "fdinfo" / number).read_text().splitlines():
            key, _, value = line.partition(":")
            if key == "tty-index":
                return int(value)
    return None


def _named(pid: int) -> str:
    try:
        command = (PROC / str(pid) / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace").strip()
    except OSError:
        command = "?"
    shown = command if len(command) <= LONGEST_NAME else f"{command[:LONGEST_NAME]}…"
    return f"{pid} ({''.join(letter if letter.isprintable() else '?' for letter in shown)})"
