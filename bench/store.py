"""A database of many years: its size and growth, how long questions to it take, what rolling up old scores saves.

    python -m bench.store [--scores 10000000] [--folder DIR]

Six joints over ten years; ten million scores are then one each three minutes and a joint's 30 days are 13 700 rows.
"""

from __future__ import annotations

import argparse
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from datetime import timedelta
from pathlib import Path

import numpy as np

from lostmotion.daemon.reader import open_readonly
from lostmotion.daemon.records import from_micros, micros
from lostmotion.daemon.rollup import roll_up
from lostmotion.daemon.store import Store
from lostmotion.detector.trend import MOST

JOINTS, YEARS = 6, 10
YEAR_US = int(365.25 * 86400e6)
END_US = 1_790_000_000_000_000
PIECE = 100_000
GOAL_HISTORY_MS = 50.0
BUSY = 86400 * 365.25
"""windows a year of a joint that reverses once a second, day and night"""


def main(arguments: Sequence[str] = ()) -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scores", type=int, default=10_000_000)
    parser.add_argument("--folder", type=Path, help="where the database is made (default: a temporary folder)")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(dir=given.folder) as name:
        path = Path(name) / "history.db"
        fill(path, given.scores)
        size(path, given.scores)
        questions(path)
        rolling(path)


def fill(path: Path, scores: int) -> None:
    """The database, written in its own order, past the store's thread."""
    Store(path, "bench").close()
    random, each = np.random.default_rng(0), scores // JOINTS
    step = YEARS * YEAR_US // each
    with closing(sqlite3.connect(path)) as db:
        for joint in range(1, JOINTS + 1):
            db.execute("INSERT INTO joint (id, name) VALUES (?, ?)", [joint, f"joint{joint}"])
            for start in range(0, each, PIECE):
                k = np.arange(start, min(start + PIECE, each))
                time_us = END_US - step * (each - k) + random.integers(0, step, k.size)
                score = np.exp(random.normal(1.0 + 2.0 * k / each, 0.5))
                columns = (score, random.uniform(5.0, 50.0, k.size), random.normal(40.0, 1.0, k.size))
                rows = zip(np.unique(time_us).tolist(), *(column.tolist() for column in columns), strict=False)
                with db:
                    db.executemany(
                        "INSERT INTO score (joint_id, time_us, duration_us, score, level, impact, excitation,"
                        f" temperature) VALUES ({joint}, ?, 250000, ?, 8.0, 0, ?, ?)",
                        rows,
                    )


def size(path: Path, scores: int) -> None:
    """Size on the disk, and what a year adds."""
    each = path.stat().st_size / scores
    print(f"{scores / 1e6:.3g} million scores: {path.stat().st_size / 1e6:.0f} MB, {each:.1f} bytes a score")
    print(
        f"a year adds {path.stat().st_size / YEARS / 1e6:.0f} MB; a window a second day and night of {JOINTS} joints:"
    )
    hours = 365.25 * 24 * JOINTS
    print(f"  {JOINTS * BUSY * each / 1e9:.1f} GB, of which {hours * each / 1e6:.1f} MB stay once they are rolled up")


def questions(path: Path) -> None:
    """What commands ask of the database, and the commands as a whole."""
    end = from_micros(END_US)
    print(f"{'question':<44}{'rows':>8}{'p50 ms':>9}{'max ms':>9}{'CPU ms':>9}{'goal':>7}")
    with open_readonly(path) as reader:
        month = len(reader.scores("joint3", end - timedelta(days=30)))
        show("history --since 30d", month, lambda: reader.scores("joint3", end - timedelta(days=30)), GOAL_HISTORY_MS)
        show("history --limit 100", 100, lambda: reader.scores("joint3", limit=100))
        show("status: last window of six joints", 6, lambda: [reader.last_window(j.name) for j in reader.joints()])
        years = reader.series("joint3").size
        show("trend: all years of a joint, one an hour", years, lambda: reader.series("joint3", most=MOST), times=3)
    since = f"{end - timedelta(days=30):%Y-%m-%d}"
    for form in ("--csv", "--json"):
        ask = ("history", "joint3", "--since", since, form)
        show(f"the command history --since 30d {form}", month, lambda ask=ask: command(path, *ask), times=5)
    show("the command trend", years, lambda: command(path, "trend", "joint3", "--json"), times=1)


def show(name: str, rows: int, ask: Callable[[], object], goal_ms: float | None = None, times: int = 25) -> None:
    """Asks so often; a line of the table.  CPU: of this process, which a busy machine does not segment."""
    wall, cpu = [], []
    for _ in range(times):
        start = time.perf_counter(), time.process_time()
        ask()
        wall.append(1e3 * (time.perf_counter() - start[0]))
        cpu.append(1e3 * (time.process_time() - start[1]))
    goal = f"{goal_ms:7.0f}" if goal_ms else ""
    print(f"{name:<44}{rows:>8}{np.median(wall):>9.1f}{max(wall):>9.1f}{np.median(cpu):>9.1f}{goal}", flush=True)


def command(path: Path, *arguments: str) -> None:
    """The program in a process of its own."""
    program = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()"]
    subprocess.run([*program, *arguments, "--database", path], check=True, stdout=subprocess.DEVNULL)


def rolling(path: Path) -> None:
    """Rolls up all but the last two years, as the service does in small steps."""
    before, start, steps = count(path), time.perf_counter(), 0
    until = micros(from_micros(END_US) - timedelta(days=730))
    with closing(sqlite3.connect(path)) as db:
        for joint in range(1, JOINTS + 1):
            with db:
                while roll_up(db, joint, until):
                    steps += 1
        spent = time.perf_counter() - start
        free = db.execute("PRAGMA freelist_count").fetchone()[0] * db.execute("PRAGMA page_size").fetchone()[0]
    print(f"rolled up beyond two years: {before} scores become {count(path)}, {free / 1e6:.0f} MB free again;")
    print(f"  {1e3 * spent / steps:.2f} ms an hour of a joint (the writer spends 5 ms on it after each batch)")


def count(path: Path) -> int:
    """How many scores there are."""
    with closing(sqlite3.connect(path)) as db:
        return int(db.execute("SELECT count(*) FROM score").fetchone()[0])


if __name__ == "__main__":
    main(sys.argv[1:])
