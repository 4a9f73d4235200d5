"""Robots for the tests of the page: a year of wear with its windows, and names that would run if they were not
escaped."""

from __future__ import annotations

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from lostmotion.daemon.lifecycle import raised
from lostmotion.daemon.records import Cause, DeviceRow, Health, JointRow, ScoreRow, Severity, WindowRow
from lostmotion.daemon.store import Store

RATE_HZ, F_RES_HZ = 1000.0, 58.0
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"
CONFIG = """
[robot]
name = {robot}
[store]
path = "history.db"
[[accelerometer]]
name = "tip"
driver = "csv_serial"
port = "/dev/ttyUSB7"
rate_hz = 1000
oscillator = {{ f_res_hz = 58.0 }}
[[joint]]
name = {joint}
driver = "dynamixel"
port = "/dev/ttyUSB8"
model = "AX-12A"
id = 1
accelerometer = "tip"
gear_radius_m = 0.01
"""


def robot(folder: Path, joint: str = "elbow", name: str = "arm1", extra: str = "") -> Path:
    """A configuration whose ports are not there."""
    path = folder / "robot.toml"
    quoted = {key: '"' + value.replace('"', '\\"') + '"' for key, value in (("robot", name), ("joint", joint))}
    path.write_text(CONFIG.format(**quoted) + extra)
    return path


def fill(path: Path, count: int = 400, joint: str = "elbow", name: str = "arm1") -> datetime:
    """A year of wear until now, a raw window every tenth time, an alarm that stands; the time of the last window."""
    store = Store(path, name)
    end = datetime.now(UTC).replace(microsecond=0)
    noise = np.random.default_rng(3)
    for k in range(count):
        time = end - timedelta(days=365) * (count - 1 - k) / count
        score = 1 + 6 * k / count
        severity = 0.002 * math.exp(k / count + noise.normal(0, 0.1))
        sizes = {"severity": severity, "severity_low": 0.8 * severity, "severity_high": 1.3 * severity}
        store.add(ScoreRow(joint, time, 0.25, score, 4.0, score > 4, severity, **sizes))
        if k % 10 == 9:
            store.add(ringing(joint, time, score > 4))
    store.add(JointRow(joint, Health.WARNING, "half of the windows are above the level", end))
    store.add(raised(joint, Cause.PLAY, Severity.WARNING, "half of the windows are above the level", end))
    store.add(DeviceRow("tip", end, "silent", "nothing for 5 s", 1000, 3, 0, 0, 1, 0))
    store.close()
    return time


def ringing(joint: str, time: datetime, impact: bool) -> WindowRow:
    """A window in which the bar rings with 5 m/s²."""
    seconds = np.arange(250) / RATE_HZ
    wave = 5 * np.exp(-0.012 * 2 * np.pi * F_RES_HZ * seconds) * np.sin(2 * np.pi * F_RES_HZ * seconds)
    moments = np.arange(-0.5, 0.25, 0.01) + 1e-3
    command = np.array([moments, 0.5 * np.cos(2 * np.pi * moments)], np.float32)
    return WindowRow(joint, time, impact, RATE_HZ, 0.0, wave.astype(np.float32), command)
