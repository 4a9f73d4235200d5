"""The page in a process of its own, and a real browser that looks at it."""

from __future__ import annotations

import http.client
import json
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.conftest import CHROMIUM
from tests.daemon.cli_world import PROGRAM
from tests.daemon.conftest import wait_until

DEADLINE_MS = 30_000
"""for what a busy machine does at once when it is idle"""


class Site:
    """A server of the page; ``address`` is where it listens."""

    def __init__(self, folder: Path, *arguments: str | Path) -> None:
        self.folder = folder
        self._log = folder / f"web{len(list(folder.glob('web*.log')))}.log"
        with self._log.open("w") as sink:
            command = [*PROGRAM, "web", "--listen", "127.0.0.1:0", *(str(a) for a in arguments)]
            self.process = subprocess.Popen(command, cwd=folder, stderr=sink, env=os.environ | {"PWD": str(folder)})
        wait_until(self._is_up, 60, lambda: self.log)
        self.address = self.log.split("serving ")[1].split(" ")[0].rstrip("/")

    @property
    def log(self) -> str:
        """What it has said."""
        return self._log.read_text()

    def _is_up(self) -> bool:
        assert self.process.poll() is None, self.log
        return "serving " in self.log

    def ask(self, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, dict[str, str], bytes]:
        """A program's request: status, headers (names in lower case), body."""
        connection = http.client.HTTPConnection(urlsplit(self.address).netloc, timeout=60)
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        connection.request(method, path, data, {name.replace("_", "-"): value for name, value in headers.items()})
        answer = connection.getresponse()
        found = answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
        connection.close()
        return found

    def csrf(self) -> str:
        """The token that changes carry, as the page has it."""
        return self.ask("GET", "/")[2].decode().split('name="csrf" content="')[1].split('"')[0]

    def close(self) -> None:
        """Ends it."""
        self.process.terminate()
        try:
            self.process.wait(20)
        finally:
            self.process.kill()
            self.process.wait()


expect.set_options(timeout=DEADLINE_MS)
Serve = Callable[..., Site]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Starts the page, with arguments of ``lostmotion web``; it ends with the test."""
    started: list[Site] = []

    def begin(*arguments: str | Path) -> Site:
        started.append(Site(tmp_path, *arguments))
        return started[-1]

    yield begin
    for site in started:
        site.close()


@pytest.fixture(scope="module")
def serve_all() -> Iterator[Callable[[Path, Path], Site]]:
    """The same for all tests of a file, which only look, in a folder with a configuration: a server takes half a second
    of the processor to start."""
    started: list[Site] = []

    def begin(folder: Path, configuration: Path) -> Site:
        started.append(Site(folder, "--config", configuration))
        return started[-1]

    yield begin
    for site in started:
        site.close()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """A browser, for the tests of a file."""
    if not CHROMIUM.exists():
        pytest.skip(f"needs {CHROMIUM}")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=["--no-sandbox"])
        yield browser
        browser.close()


Open = Callable[..., Page]


@pytest.fixture
def look(chromium: Browser) -> Iterator[Open]:
    """Opens an address in a fresh profile; whatever the page's scripts complain about fails the test at its end."""
    complaints: list[str] = []
    contexts = []

    def opened(
        address: str, *, width: int = 1100, dark: bool = False, complains: bool = False, before: str = ""
    ) -> Page:
        context = chromium.new_context(
            viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light", locale="en-GB"
        )
        context.set_default_timeout(DEADLINE_MS)
        context.add_init_script(before)
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: complaints.append(f"{address}: {error}"))
        if not complains:
            page.on(
                "console",
                lambda message: (
                    complaints.append(f"{message.text} {message.location}") if message.type == "error" else None
                ),
            )
        page.goto(address)
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []


def violations(page: Page) -> list[str]:
    """What axe-core (WCAG 2.1 A and AA, and best practice) finds wrong with a page."""
    found = Axe().run(page).response["violations"]
    return [f"{one['id']}: {one['help']}: {[node['html'][:200] for node in one['nodes']][:3]}" for one in found]


def overflow(page: Page) -> int:
    """By how many pixels a page is wider than its window."""
    return int(page.evaluate("document.documentElement.scrollWidth - window.innerWidth"))
