"""Pictures of the page for docs/figures: each page in a window of a computer (light) and of a phone (dark).

    python -m bench.screenshots [--figures docs/figures]

The robot is the demo's, after its year of wear; the lab's run searches what is missing from a servo with a dry bearing;
the fleet is heard over a Zenoh router.  Takes two minutes; needs Chromium.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from bench.web import CHROMIUM, serving
from lostmotion.daemon.options import ZenohOptions
from lostmotion.daemon.sinks.zenoh import ZenohSink
from lostmotion.drivers.emulator.ros2 import free_port

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ROOT = Path(__file__).parent.parent
LOOKS = (("wide", 1100, "light"), ("phone", 400, "dark"))
MODEL = 'base = "servo"\neffects = ["viscous_friction"]\n[parameters]\nkt = { value = 1.2, fixed = true }\n'
RUBBING = (
    'base = "servo"\neffects = ["viscous_friction", "coulomb_friction"]\n[parameters]\ncoulomb_friction.tau_c = 0.15\n'
)
SEARCH_MS = 300_000
Shot = tuple[str, str, Callable[["Page"], None]]
"""name of the picture, address, and what is done before it is taken"""


def main(arguments: Sequence[str] = ()) -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, default=ROOT / "docs" / "figures")
    given = parser.parse_args(arguments)
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        folder = Path(name)
        config = wear(folder)
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        with fleet(folder / "history.db") as endpoint, serving(folder / "history.db", "--config", str(config)) as page:
            run = search(folder, browser, page[1])
            take(browser, page[1], given.figures, run)
            with serving(folder / "history.db", "--connect", endpoint) as (_, address):
                shots(browser, address, given.figures, [("fleet", "/fleet", _settle)])
        browser.close()


def wear(folder: Path) -> Path:
    """The demo's robot after its year; its configuration."""
    config = folder / "robot.toml"
    demo = (ROOT / "examples" / "demo.sh").read_text()
    found = re.search(r"<<'END'\n(.*?)^END$", demo, re.DOTALL | re.MULTILINE)
    assert found
    config.write_text(found[1])
    _lostmotion(folder, "run", "--config", str(config), "--duration", "36")
    return config


def search(folder: Path, browser: Browser, address: str) -> str:
    """Brings three recordings to the lab and lets it search; the address of the run when it is over."""
    (folder / "rubbing.toml").write_text(RUBBING)
    files = []
    for number in (1, 2, 3):
        files.append(str(folder / f"hand-{number}.csv"))
        motion = ["--motion", f"hand-waved:{number}", "--duration", "6", "--rate-hz", "100", "--noise", "0.0005"]
        _lostmotion(folder, "simulate", "rubbing.toml", "-o", files[-1], *motion, "--seed", str(number))
    page = browser.new_page()
    page.goto(f"{address}/lab")
    page.locator("body[data-loaded]").wait_for()
    page.locator("#files").set_input_files(files)
    page.locator("#recordings :checked").nth(2).wait_for()
    page.locator('input[name="base"][value="servo"]').check()
    page.locator("#model-details summary").click()
    page.locator("#model").fill(MODEL)
    page.locator('button[value="explain"]').click()
    page.locator("#ladder, #ranking").first.wait_for(timeout=SEARCH_MS)
    page.wait_for_timeout(2000)
    found = page.url.removeprefix(address)
    page.close()
    return found


@contextmanager
def fleet(database: Path) -> Iterator[str]:
    """A router on which the demo's robot answers under two names, and a third one lives and does not; its endpoint."""
    import json

    import zenoh

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    for key, value in (("mode", "router"), ("listen/endpoints", [endpoint]), ("scouting/multicast/enabled", False)):
        config.insert_json5(key, json.dumps(value))
    options = ZenohOptions(mode="client", connect=[endpoint])
    with ExitStack() as stack:
        router = zenoh.open(config)
        stack.callback(router.close)
        for name in ("packing-1", "packing-2"):
            stack.enter_context(closing(ZenohSink(name, options, database)))
        token = router.liveliness().declare_token("lostmotion/welding-1/alive")
        stack.callback(token.undeclare)
        yield endpoint


def take(browser: Browser, address: str, folder: Path, run: str) -> None:
    """The pages of one robot."""
    shots(
        browser,
        address,
        folder,
        [
            ("robot", "/", _settle),
            ("joint", "/joints/elbow", _window),
            ("calibrate", "/calibrate", _settle),
            ("lab", "/lab", _settle),
            ("run", run, _settle),
        ],
    )


def shots(browser: Browser, address: str, folder: Path, pages: Sequence[Shot]) -> None:
    """Takes each page in both looks."""
    folder.mkdir(parents=True, exist_ok=True)
    for look, width, scheme in LOOKS:
        context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, locale="en-GB")  # type: ignore[arg-type]
        for name, path, prepare in pages:
            page = context.new_page()
            page.goto(address + path)
            prepare(page)
            page.screenshot(path=folder / f"web-{name}-{look}.png", full_page=True)
            print(folder / f"web-{name}-{look}.png", flush=True)
            page.close()
        context.close()


def _settle(page: Page) -> None:
    page.wait_for_timeout(2500)


def _window(page: Page) -> None:
    """Opens a window late in the year."""
    plot = page.locator("#history .u-over")
    plot.wait_for()
    _settle(page)  # the plot is drawn anew when its trend has come
    box = plot.bounding_box()
    assert box
    page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.5 * box["height"])
    page.locator("#spectrum canvas").wait_for()
    _settle(page)


def _lostmotion(folder: Path, *arguments: str) -> None:
    call = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()", *arguments]
    subprocess.run(call, cwd=folder, check=True, stdout=subprocess.DEVNULL, env=os.environ | {"PWD": str(folder)})


if __name__ == "__main__":
    main(sys.argv[1:])
