"""A real CAN interface of the kernel: in a virtual machine, since a container has only its host's kernel.

``make test-vm`` runs it; it takes some minutes and is no part of ``make test``.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import cantools.database
import pytest

from tests.conftest import ROOT
from tests.system import image
from tests.system.conftest import with_wheel
from tests.system.machine import Machine
from tests.system.robot import CONFIG, LOSTMOTION
from tests.wheel import run

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1500)]

EXTRA = ("linux-image-amd64", "can-utils", "iproute2", "kmod")
EMCY, HEARTBEAT = 0x0A1, 0x721
BOOT_S = 1200
CONFIGURATION = """
[robot]
name = "arm1"
[store]
path = "/var/lib/lostmotion/history.db"
[replay]
speed = 1
[[accelerometer]]
name = "tip"
driver = "replay"
port = "/opt/worn.csv"
rate_hz = 200
oscillator = { f_res_hz = 58.0 }
[[joint]]
name = "elbow"
driver = "replay"
port = "/opt/worn.csv"
accelerometer = "tip"
[detector]
f_norm_hz = 85.0
f_norm_width_hz = 30.0
[alarm.can]
interface = "socketcan"
channel = "vcan0"
node_id = 0x21
"""
UNIT = f"""
[Service]
Type=idle
ExecStart={image.VENV}/bin/python /opt/guest_can.py
ExecStopPost=systemctl poweroff
StandardOutput=file:/dev/ttyS1
StandardError=inherit
"""


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What the machine's listeners have seen."""
    reason = image.missing() or ("" if shutil.which("qemu-system-x86_64") else "qemu-system-x86_64 is missing")
    if not os.environ.get("LOSTMOTION_VM") or platform.machine() != "x86_64":
        reason = "a virtual machine is started by `make test-vm` only, on x86_64"
    if reason:
        pytest.skip(reason)
    folder = tmp_path_factory.mktemp("vm")
    base = image.image("vm", EXTRA)
    machine = Machine(folder / "machine", *with_wheel(base, folder))
    install(machine, folder)
    machine.write_image(folder / "disk", "4G")
    start(base / "boot", folder)
    machine.destroy()
    result = (folder / "result").read_text()
    assert result.startswith("{"), result + (folder / "console").read_text(errors="replace")[-3000:]
    return json.loads(result.splitlines()[0])


def install(machine: Machine, folder: Path) -> None:
    """The service for a replayed robot with play, and the script that looks at it."""
    recording = folder / "worn.csv"
    simulate = ("simulate", "play", "--duration", "240", "--rate-hz", "200", "--noise", "0.1", "--seed", "1")
    run(Path(sys.executable).parent / "lostmotion", *simulate, "-o", recording, cwd=folder)
    machine.boot()
    machine.copy(recording, "/opt/worn.csv")
    machine.copy(Path(__file__).parent / "guest_can.py", "/opt/guest_can.py")
    machine.write(CONFIG, CONFIGURATION)
    machine.write("/etc/systemd/system/guest.service", UNIT)
    machine.run(LOSTMOTION, "service", "install", "--root", "/")
    machine.run("systemctl", "disable", "lostmotion")
    machine.run("systemctl", "add-wants", "multi-user.target", "guest.service")
    machine.power_off()


def start(boot: Path, folder: Path) -> None:
    """The machine, on an emulated processor, until it powers itself off."""
    (kernel,), (initrd,) = boot.glob("vmlinuz-*"), boot.glob("initrd.img-*")
    subprocess.run(
        [
            "qemu-system-x86_64", "-accel", "tcg", "-cpu", "max", "-smp", "2", "-m", "1500", "-display", "none",
            "-nic", "none", "-no-reboot", "-kernel", kernel, "-initrd", initrd,
            "-append", "root=/dev/vda rw console=ttyS0 init=/lib/systemd/systemd panic=-1",
            "-drive", f"file={folder / 'disk'},format=raw,if=virtio,cache=unsafe",
            "-serial", f"file:{folder / 'console'}", "-serial", f"file:{folder / 'result'}",
        ],
        check=True, timeout=BOOT_S, stdin=subprocess.DEVNULL,
    )  # fmt: skip


def test_the_alarm_is_an_emcy_on_the_bus(seen: Any) -> None:
    """python-can and candump see the same frames: boot-up, a play warning or error with its score, heartbeats."""
    database = cantools.database.load_file(ROOT / "daemon/sinks/lostmotion.dbc")
    assert [HEARTBEAT, "00"] in seen["first"]
    assert seen["first"].count([HEARTBEAT, "05"]) >= 3
    alarms = [bytes.fromhex(data) for cob_id, data in seen["first"] if cob_id == EMCY and data[:4] != "0000"]
    told = database.decode_message(EMCY, alarms[0])
    assert str(told["ErrorCode"]) in ("play warning", "play error")
    assert (told["JointIndex"], told["ErrorRegister"]) == (0, 0x81)
    assert told["Score"] > 8.0
    dumped = re.findall(r"vcan0 ([0-9A-F]{3})#([0-9A-F]*)", seen["candump"])
    assert [[int(cob_id, 16), data.lower()] for cob_id, data in dumped][: len(seen["first"])] == seen["first"]


def test_a_bus_that_was_down_hears_what_stands(seen: Any) -> None:
    """After the interface went down and came up the same process tells the alarm again."""
    assert any(cob_id == EMCY and data[:4] != "0000" for cob_id, data in seen["again"])
    assert seen["pids"][0] == seen["pids"][1] != "0"
    assert "active alarms are sent then" in seen["log"]
