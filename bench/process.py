"""A lostmotion service in a process of its own, seen from outside: its command, CPU time, memory, windows."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

__all__ = ["children", "cpu_seconds", "memory_mb", "run_command", "run_on", "waits", "windows"]


def run_command(config: Path) -> list[str]:
    """What starts the service with this configuration."""
    return [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()", "run", "--config", str(config)]


def cpu_seconds(pid: int) -> float:
    """User and system time that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children() -> set[int]:
    """The processes that this one has started, and that have not ended."""
    own, found = str(os.getpid()), set()
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended
            if (folder / "stat").read_text().rsplit(")", 1)[1].split()[1] == own:
                found.add(int(folder.name))
    return found


def run_on(core: int, processes: Iterable[int]) -> None:
    """Moves processes with all their threads to a core."""
    for pid in processes:
        for thread in Path(f"/proc/{pid}/task").iterdir():
            with suppress(OSError):
                os.sched_setaffinity(int(thread.name), {core})


def waits(pid: int) -> int:
    """How often the threads that it has now have waited for something."""
    texts = [(thread / "status").read_text() for thread in Path(f"/proc/{pid}/task").iterdir()]
    return sum(int(number) for text in texts for number in re.findall(r"\nvoluntary_ctxt_switches:\s+(\d+)", text))


def memory_mb(pid: int, kind: str) -> float:
    """Memory of a process [MB]; kind: VmHWM (resident at most) or RssAnon (resident now, without pages of files)."""
    found = re.search(rf"{kind}:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    assert found is not None
    return int(found[1]) / 1024


def windows(text: str) -> tuple[int, int, int]:
    """Windows triggered, scored and lost, from the last summary of each joint; the service logs one when it stops."""
    rows = re.findall(r"(\w+): windows triggered=(\d+) scored=(\d+) lost: (.*)", text)
    if not rows:
        raise RuntimeError(f"the service did not end well:\n{text}")
    last = {joint: (int(triggered), int(scored), lost) for joint, triggered, scored, lost in rows}
    lost = sum(int(number) for _, _, reasons in last.values() for number in re.findall(r"(\d+) x", reasons))
    return sum(row[0] for row in last.values()), sum(row[1] for row in last.values()), lost
