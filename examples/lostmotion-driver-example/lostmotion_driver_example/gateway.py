"""A controller to try the driver on: ``python -m lostmotion_driver_example.gateway 5005 5006``.

Two hand-waved joints, 100 times a second, and the bar on the second one, which has play, 1000 times.
"""

from __future__ import annotations

import socket
import sys
import time

from lostmotion.drivers.emulator import Motion

__all__ = ["send"]

RATE_HZ, SENSOR_HZ = 100, 1000
SPREAD_S = 1.7
"""the first joint makes the second one's motion, so much later"""


def send(joints: int, sensor: int, seconds: float = 3600.0) -> None:
    """Sends to two UDP ports of this computer."""
    motion = Motion(play=1.0)
    tip = motion.tip(SENSOR_HZ)
    each = SENSOR_HZ // RATE_HZ
    start = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for tick in range(round(seconds * RATE_HZ)):
            now = tick / RATE_HZ
            time.sleep(max(0.0, start + now - time.monotonic()))
            angles = [(number, now + SPREAD_S * (2 - number)) for number in (1, 2)]
            lines = "\n".join(f"{number},{motion.goal(t):.6f},{motion.position(t):.6f}" for number, t in angles)
            samples = range(tick * each - each + 1, tick * each + 1)
            accel = "\n".join(f"{i / SENSOR_HZ:.4f},{tip[i % tip.size]:.4f}" for i in samples)
            for text, port in ((lines, joints), (accel, sensor)):
                out.sendto(text.encode(), ("127.0.0.1", port))


if __name__ == "__main__":
    send(int(sys.argv[1]), int(sys.argv[2]))
