"""Pictures of the page for the documentation: a simulated robot at the end of the year that ``make demo`` shows.

    python -m bench.screenshots [--figures docs/figures]

Each page as wide as a laptop's window, light, and as a phone, dark.  Needs Chromium; takes a minute.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench.web import CHROMIUM, serving

ROOT = Path(__file__).parent.parent
PAGES = {"robot": "/", "joint": "/joints/elbow"}
LOOKS = {"wide": (1100, "light"), "phone": (400, "dark")}
YEAR_S = 36
SETTLE_MS = 2000
"""plots are drawn by then"""


def main(arguments: Sequence[str] = ()) -> None:
    """Writes ``web-PAGE-LOOK.png`` for each page and look."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--figures", type=Path, default=ROOT / "docs" / "figures", help="the folder of the pictures")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        database = worn(Path(name))
        with serving(database) as (_, address):
            shoot(address, given.figures)


def worn(folder: Path) -> Path:
    """The database of the demo's robot after its year."""
    found = re.search(r"<<'END'\n(.*?)\nEND\n", (ROOT / "examples" / "demo.sh").read_text("utf-8"), re.DOTALL)
    assert found is not None, "examples/demo.sh holds a configuration"
    (folder / "robot.toml").write_text(found[1] + "\n", "utf-8")
    call = [sys.executable, "-c", "from lostmotion.daemon.cli import main; main()"]
    subprocess.run([*call, "run", "--config", "robot.toml", "--duration", str(YEAR_S)], cwd=folder, check=True)
    return folder / "history.db"


def shoot(address: str, folder: Path) -> None:
    """A picture of each page in each look."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for look, (width, scheme) in LOOKS.items():
            context = browser.new_context(
                viewport={"width": width, "height": 800}, color_scheme="dark" if scheme == "dark" else "light"
            )
            page = context.new_page()
            for name, path in PAGES.items():
                page.goto(address + path)
                page.wait_for_timeout(SETTLE_MS)
                page.screenshot(path=folder / f"web-{name}-{look}.png", full_page=True)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
