"""Runs the commands of one job within its limits, and leaves in the job's folder how it went.

A separate process, started by ``jobs.py``, so that a job survives the page's process: ``python -m
lostmotion.web.runner FOLDER``.  The lock that marks a running job is an open file that it inherits and holds
to its end, however that comes.  The standard library alone is imported: the memory is the commands'.
"""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = ["main"]

OOM_SCORE = "500"
"""the kernel ends this before anything of the robot when memory is short"""


class StoppedError(Exception):
    """Somebody wants it to end."""


def main(folder: Path) -> None:
    """Runs the job whose folder this is; ends its process group, unless all went well."""
    if os.getpgrp() != os.getpid():
        os.setpgid(0, 0)
    signal.signal(signal.SIGTERM, _stop)
    began = time.time()
    try:
        wish = json.loads((folder / "wish.json").read_text("utf-8"))
        _limit(wish["limits"])
        _write_state(folder, "running", "", began, None)
        state, text = _outcome(folder, wish)
    except StoppedError:
        state, text = "stopped", "It was stopped."
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    _write_state(folder, state, text, began, time.time())
    if state != "done":
        os.killpg(0, signal.SIGKILL)


def _stop(number: int, frame: object) -> None:
    raise StoppedError


def _limit(limits: dict[str, Any]) -> None:
    os.nice(limits["nice"])
    most = limits["memory_bytes"]
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    cpu_s = int(limits["time_s"] * (os.cpu_count() or 1)) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (limits["file_bytes"], limits["file_bytes"]))
    with suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text(OOM_SCORE)


def _outcome(folder: Path, wish: dict[str, Any]) -> tuple[str, str]:
    """The state at the end, and a message for the user."""
    until = time.monotonic() + wish["limits"]["time_s"]
    for step in wish["steps"]:
        with (folder / "result.json").open("wb") as out, (folder / "log").open("ab") as log:
            child = subprocess.Popen(step, cwd=wish["cwd"], stdin=subprocess.DEVNULL, stdout=out, stderr=log)
            try:
                status = child.wait(max(until - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                return "failed", f"It took longer than {wish['limits']['time_s'] / 60:.3g} minutes, and was ended."
        if status != 0:
            return "failed", _reason(folder, status, wish["limits"])
    return "done", ""


def _reason(folder: Path, status: int, limits: dict[str, Any]) -> str:
    """The last message of a command, or how it ended."""
    lines = (folder / "log").read_text("utf-8", "replace").splitlines()
    messages = [line for line in lines if line.strip() and not line.startswith('{"progress"')]
    if status > 0 and messages:
        return messages[-1].removeprefix("lostmotion: ").replace(f"{folder}{os.sep}", "")
    if status == -signal.SIGXCPU:
        return "It computed for longer than it may, and was ended."
    ended = f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"
    return f"It ended with {ended}; perhaps it needed more than the {limits['memory_bytes'] / 1e9:.2g} GB it may have."


def _write_state(folder: Path, state: str, text: str, began: float, ended: float | None) -> None:
    new = folder / "state.new"
    new.write_text(json.dumps({"state": state, "text": text, "began": began, "ended": ended}), "utf-8")
    new.replace(folder / "state.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
