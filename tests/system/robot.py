"""A robot for a machine: an AX-12A servo and a WitMotion sensor, emulated on pseudo-terminals."""

from __future__ import annotations

from tests.system.image import VENV
from tests.system.machine import Machine

__all__ = [
    "CONFIG",
    "LOSTMOTION",
    "TEXT",
    "WATCHDOG_S",
    "install_with_robot",
    "plug_in",
    "scores",
    "show",
    "wait_for_scores",
]

LOSTMOTION = f"{VENV}/bin/lostmotion"
CONFIG = "/etc/lostmotion/lostmotion.toml"
TEXT = """
[robot]
name = "arm1"
[store]
path = "/var/lib/lostmotion/history.db"
[[accelerometer]]
name = "tip"
driver = "witmotion"
port = "/run/robot.1"
rate_hz = 200
oscillator = { f_res_hz = 58.0 }
[[joint]]
name = "elbow"
driver = "dynamixel"
port = "/run/robot.0"
model = "AX-12A"
id = 3
accelerometer = "tip"
[metrics]
[detector]
f_norm_hz = 85.0
f_norm_width_hz = 30.0
"""
# A pseudo-terminal stands in for /dev/ttyUSB0; a watchdog that tests can wait for.
WATCHDOG_S = 8
DROP_IN = f"[Service]\nDeviceAllow=char-pts rw\nWatchdogSec={WATCHDOG_S}\nRestartSec=100ms\n"


def install_with_robot(machine: Machine) -> None:
    """Plugs the robot in, writes its configuration, installs the service."""
    plug_in(machine)
    machine.write(CONFIG, TEXT)
    machine.write("/etc/systemd/system/lostmotion.service.d/test.conf", DROP_IN)
    machine.run(LOSTMOTION, "service", "install")


def plug_in(machine: Machine) -> None:
    """Starts the emulator; its ports belong to root and the group dialout, as real ones do."""
    python = f"{VENV}/bin/python"
    machine.run("systemd-run", "--unit=emulator", python, "-m", "lostmotion.drivers.emulator", "--servos=ax12:3",
                "--accel=witmotion:200", "--link=/run/robot")  # fmt: skip
    machine.wait_until(lambda: "robot.1" in machine.run("ls", "/run"))
    machine.run("sh", "-c", "chgrp dialout $(realpath /run/robot.*); chmod 660 $(realpath /run/robot.*)")


def show(machine: Machine, name: str, unit: str = "lostmotion") -> str:
    """A property of the service, or of another unit, such as MainPID."""
    return machine.run("systemctl", "show", unit, "--value", "-p", name).strip()


def scores(machine: Machine) -> int:
    """How many scores the database holds."""
    return machine.run(LOSTMOTION, "history", "elbow", "--csv", check=False).count("Z,")


def wait_for_scores(machine: Machine) -> int:
    """Waits until new ones come in; how many there are."""
    before = scores(machine)
    machine.wait_until(lambda: scores(machine) > before)
    return scores(machine)
