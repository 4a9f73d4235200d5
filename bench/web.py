"""What the page costs and how quick it is, in a real browser beside a running service, all on this machine.

    python -m bench.web [--pages 10] [--duration 20] [--scores 1000000]

Seven figures with their goals: the first page of a fresh browser (time until it has loaded, bytes that crossed), a year
of a joint (min-max of all scores, as the browser asks for it), how long after a score is committed an open page hears
of it, and what ``--pages`` open pages cost the process of the page and the service, whose joints reverse all the time.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from bench import store
from bench.process import cpu_seconds, memory_mb
from bench.service import WARM_UP_S, running_service

CHROMIUM = "/usr/bin/chromium"
GOAL_FIRST_S, GOAL_FIRST_KB, GOAL_YEAR_S, GOAL_NEWS_S, GOAL_CORE, GOAL_MB = 0.5, 200.0, 0.3, 0.3, 0.1, 120.0
ROW = "{:<58}{:>10}{:>10}"
TIMES = 15


def main(arguments: Sequence[str] = ()) -> None:
    """Prints a row for each figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pages", type=int, default=10)
    parser.add_argument("--duration", type=float, default=20.0, help="seconds with and without the open pages")
    parser.add_argument("--scores", type=int, default=1_000_000, help="of the joint whose year is asked for")
    given = parser.parse_args(arguments)
    print(ROW.format("figure", "measured", "goal"))
    with tempfile.TemporaryDirectory() as name:
        year(Path(name), given.scores)
    with tempfile.TemporaryDirectory() as name, running_service(Path(name), "csv:1000") as service:
        time.sleep(WARM_UP_S)
        with serving(Path(name) / "history.db") as (process, address):
            first_page(address)
            news(Path(name) / "history.db", address)
            open_pages(address, given.pages, given.duration, process.pid, service.pid)


@contextmanager
def serving(database: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The page in a process of its own, and its address."""
    call = "from lostmotion.daemon.cli import main; main()"
    command = [sys.executable, "-c", call, "web", "--database", str(database), "--listen", "127.0.0.1:0", *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = next(line for line in process.stderr if "serving " in line)
        try:
            yield process, line.split("serving ")[1].split(" ")[0].rstrip("/")
        finally:
            process.terminate()
            process.wait(20)


def year(folder: Path, scores: int) -> None:
    """The plot's question for all scores of a joint, as the median of some."""
    store.JOINTS = store.YEARS = 1
    store.fill(folder / "history.db", scores)
    with serving(folder / "history.db") as (_, address):
        taken = [_ask(f"{address}/api/joints/joint1/series")[0] for _ in range(5)]
    print(ROW.format(f"{scores:.3g} scores of a year, asked for", f"{statistics.median(taken):.3f} s", GOAL_YEAR_S))


def _ask(address: str) -> tuple[float, bytes]:
    start = time.perf_counter()
    with urllib.request.urlopen(address, timeout=60) as answer:
        body = answer.read()
    return time.perf_counter() - start, body


def first_page(address: str) -> None:
    """A browser without a cache opens the robot."""
    from playwright.sync_api import sync_playwright

    taken, sizes = [], []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for _ in range(TIMES):
            context = browser.new_context()
            page = context.new_page()
            page.goto(address, wait_until="load")
            page.locator("[data-joint], .joint, article").first.wait_for()
            found = json.loads(page.evaluate(TIMING))
            taken.append(found["loaded"] / 1000)
            sizes.append(found["bytes"] / 1000)
            context.close()
        browser.close()
    print(
        ROW.format("first page, from the click until it has loaded", f"{statistics.median(taken):.3f} s", GOAL_FIRST_S)
    )
    print(ROW.format("first page, bytes over the wire", f"{max(sizes):.0f} kB", GOAL_FIRST_KB))


TIMING = """() => {
  const page = performance.getEntriesByType("navigation")[0];
  const all = [page, ...performance.getEntriesByType("resource")];
  return JSON.stringify({loaded: page.loadEventEnd || page.domComplete,
                         bytes: all.reduce((sum, one) => sum + one.transferSize, 0)});
}"""


def news(database: Path, address: str) -> None:
    """From a commit to the event that a listener reads, with the service writing beside it."""
    heard: list[tuple[float, str]] = []
    threading.Thread(target=_listen, args=(f"{address}/api/events", heard), daemon=True).start()
    time.sleep(2)
    delays = []
    with closing(sqlite3.connect(database, timeout=10)) as db:
        for number in range(TIMES):
            name = f"bench{number}"
            with db:
                db.execute("INSERT INTO joint (name) VALUES (?)", [name])
            start = time.perf_counter()
            while not (found := [moment for moment, text in list(heard) if f'"{name}"' in text]):
                assert time.perf_counter() < start + 10, "no event within 10 s"
                time.sleep(0.002)
            delays.append(found[0] - start)
        with db:
            db.execute("DELETE FROM joint WHERE name LIKE 'bench%'")
    print(ROW.format("from a commit to the event at an open page, slowest", f"{max(delays):.3f} s", GOAL_NEWS_S))


def _listen(address: str, heard: list[tuple[float, str]]) -> None:
    with urllib.request.urlopen(address, timeout=60) as answer:
        heard.extend((time.perf_counter(), line.decode()) for line in answer)


def open_pages(address: str, count: int, duration_s: float, web: int, service: int) -> None:
    """Shares of a core without and with pages that a browser shows."""
    from playwright.sync_api import sync_playwright

    before = _shares(duration_s, service)[0]
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = browser.new_context()
        for _ in range(count):
            context.new_page().goto(address)
        page_core, with_pages = _shares(duration_s, web, service)
        browser.close()
    alone = (before + _shares(duration_s, service)[0]) / 2
    print(
        ROW.format(
            f"process of the page with {count} open pages, share of a core", f"{page_core:.1%}", f"{GOAL_CORE:.0%}"
        )
    )
    print(ROW.format("  its resident memory", f"{memory_mb(web, 'VmHWM'):.0f} MB", f"{GOAL_MB:.0f} MB"))
    print(ROW.format("the service with the pages open, times its cost without", f"{with_pages / alone:.2f}", "1"))


def _shares(duration_s: float, *processes: int) -> list[float]:
    before, start = [cpu_seconds(pid) for pid in processes], time.monotonic()
    time.sleep(duration_s)
    passed = time.monotonic() - start
    return [(cpu_seconds(pid) - one) / passed for pid, one in zip(processes, before, strict=True)]


if __name__ == "__main__":
    main(sys.argv[1:])
