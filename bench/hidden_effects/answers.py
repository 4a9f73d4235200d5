"""Asks `lostmotion lab explain` about a case, as a user would: a process, files in, one JSON document out."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

__all__ = ["Answer", "ask_all"]

FILES = ("model.toml", "rec1.csv", "rec2.csv", "rec3.csv")


@dataclass(frozen=True)
class Answer:
    """What came back: the document, or why there is none, and how long it took [s]."""

    folder: Path
    document: dict[str, Any] | None
    failure: str
    seconds: float


def ask_all(command: Sequence[str], folders: Sequence[Path], jobs: int, limit_s: float) -> Iterator[Answer]:
    """An answer for each folder, as they come; `jobs` at a time."""
    with ThreadPoolExecutor(jobs) as pool:
        asked = [pool.submit(ask, command, folder, limit_s) for folder in folders]
        for answer in as_completed(asked):
            yield answer.result()


def ask(command: Sequence[str], folder: Path, limit_s: float) -> Answer:
    """One answer; a command that fails, says no JSON or takes longer than limit_s [s] is a wrong one."""
    call = [*command, *(name for name in FILES if (folder / name).exists()), "--json"]
    begin = time.perf_counter()
    try:
        done = subprocess.run(call, cwd=folder, capture_output=True, text=True, timeout=limit_s, check=False)
    except subprocess.TimeoutExpired:
        return Answer(folder, None, f"no answer within {limit_s:g} s", limit_s)
    seconds = time.perf_counter() - begin
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or ["nothing on stderr"]
        return Answer(folder, None, f"exit status {done.returncode}: {lines[-1]}", seconds)
    try:
        return Answer(folder, json.loads(done.stdout), "", seconds)
    except json.JSONDecodeError as error:
        return Answer(folder, None, f"stdout is no JSON: {error}", seconds)
