"""The example of docs/adding-a-driver.md is built, installed beside us and used, as a third party would."""

from __future__ import annotations

import contextlib
import re
import socket
import subprocess
import sys
import threading
from pathlib import Path

DOC = Path(__file__).parents[2] / "docs" / "adding-a-driver.md"
USE = """
import sys
import msgspec, tomllib
from lostmotion.drivers.clock import SystemClock
from lostmotion.drivers.errors import PortError
from lostmotion.drivers.registry import get_driver, names

table = tomllib.loads(sys.argv[1])["accelerometer"][0] | {"port": sys.argv[2]}
row = get_driver(table["driver"])
assert "example_udp" in names()
sensor = row.accelerometer(msgspec.convert(table, row.accelerometer_options), row.robot_options(), SystemClock())
sensor.open()
print("open", flush=True)
(identity,) = sensor.identify()
assert identity.ok, identity
blocks = [block for block in (sensor.read() for _ in range(100)) if len(block.time)]
assert all(abs(a) <= 9.0 for block in blocks for a in block.accel)
times = [t for block in blocks for t in block.time]
assert len(times) > 50 and times == sorted(times)
sensor.close()
sensor.close()
try:
    sensor.read()
except PortError as error:
    print(error)
"""


def code(language: str) -> list[str]:
    """The code blocks of the page in one language."""
    return re.findall(rf"```{language}\n(.*?)```", DOC.read_text(), re.DOTALL)


def install(folder: Path) -> None:
    """What pip does with a package of one module: the module, and its metadata with the entry point."""
    module, project = code("python")[0], code("toml")[0]
    (folder / "lostmotion_udp.py").write_text(module)
    point = re.search(r"^example_udp = \"(.*)\"", project, re.MULTILINE)
    assert point
    info = folder / "lostmotion_udp-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lostmotion-udp\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(f"[lostmotion.drivers]\nexample_udp = {point[1]}\n")


def send(port: int, stop: threading.Event) -> None:
    """The sensor: 500 readings a second on its own clock."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sensor:
        for tick in range(100_000):
            if stop.wait(0.002):
                return
            with contextlib.suppress(OSError):
                sensor.sendto(b"%.3f,%.2f" % (tick * 0.002, tick % 9), ("127.0.0.1", port))


def test_the_example_is_found_by_its_entry_point_and_reads(tmp_path: Path) -> None:
    """A program that has the example package installed names its driver, opens it and reads ascending times."""
    install(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    stop = threading.Event()
    sensor = threading.Thread(target=send, args=(port, stop))
    sensor.start()
    try:
        done = subprocess.run(
            [sys.executable, "-c", USE, code("toml")[1], str(port)],
            env={"PYTHONPATH": str(tmp_path)},
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    finally:
        stop.set()
        sensor.join()
    assert done.stderr == ""
    assert done.stdout.splitlines() == ["open", f"UDP port {port} is not open"]


def test_the_emulator_of_the_page_works() -> None:
    """The last Python block of the page prints a port."""
    done = subprocess.run(
        [sys.executable, "-c", code("python")[1]], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.startswith("/dev/")
