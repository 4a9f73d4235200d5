"""A recording that a running service makes of one joint and its accelerometer, beside its work.

Its own thread writes the file; pollers and the main thread only leave samples.  Who may ask for one: ``tasks.py``.
"""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from lostmotion.daemon.config import Config
from lostmotion.daemon.no_memory import NO_MEMORY, is_no_memory
from lostmotion.daemon.records import iso
from lostmotion.drivers.base import AccelBlock, AccelerometerOptions, JointOptions, ServoSample
from lostmotion.drivers.clock import Clock
from lostmotion.drivers.errors import LostmotionError

__all__ = ["Capture", "also_moved_by", "head"]

log = logging.getLogger(__name__)

PAUSE_S = 0.2
"""how often what has come is written [s]"""
WAITING = 10_000
"""blocks and readings that may wait for a disk that hangs; more are lost"""
LARGEST = 200_000_000
"""of a file [byte]: half an hour of five thousand samples a second"""


class Capture:
    """Writes what it is given until ``end``, until so many seconds of robot time are over, or the file is large."""

    def __init__(self, path: Path, joint: str, metadata: Mapping[str, Any], clock: Clock, duration_s: float) -> None:
        self.joint = joint
        self._path, self._metadata, self._clock = path, metadata, clock
        self._start = clock.now()
        self._until = self._start + duration_s
        self._waiting: deque[AccelBlock | Sequence[ServoSample]] = deque(maxlen=WAITING)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="capture", daemon=True)
        self._thread.start()

    @property
    def is_over(self) -> bool:
        """Whether nothing more will be written."""
        return not self._thread.is_alive()

    def add(self, data: AccelBlock | Sequence[ServoSample]) -> None:
        """Takes a block of the accelerometer, or samples of the joint.  Never waits."""
        self._waiting.append(data)

    def end(self) -> None:
        """Nothing more is to be written but what has come; does not wait."""
        self._over.set()

    def _run(self) -> None:
        from lostmotion.drivers.recorder import Recorder  # files are no business of a service that records nothing

        try:
            with Recorder(self._path, self._metadata, self._start) as recorder:
                while not self._over.wait(PAUSE_S):
                    self._write(recorder)
                    if self._clock.now() >= self._until or self._path.stat().st_size > LARGEST:
                        break
                self._write(recorder)
            log.info("%s: %d rows of joint %s", self._path, recorder.rows, self.joint)
        except (LostmotionError, OSError, MemoryError) as error:
            log.error("the recording ended: %s", NO_MEMORY if is_no_memory(error) else error)

    def _write(self, recorder: Any) -> None:
        for _ in range(len(self._waiting)):
            data = self._waiting.popleft()
            if isinstance(data, AccelBlock):
                recorder.add_accel(data)
            else:
                recorder.add_servo(data)


def head(
    config: Config,
    sensor: AccelerometerOptions,
    joint: JointOptions | None,
    start: datetime,
    limits: Mapping[str, float],
    others: Sequence[str] = (),
) -> dict[str, Any]:
    """What stands at the head of a recording of an accelerometer, and of a joint where there is one.

    start: its UTC; limits: ``resolution_rad`` and ``range_ms2``, as far as they are finite; others: the other joints
    that move the accelerometer.
    """
    bar = sensor.oscillator
    return {
        "robot": config.robot.name,
        **({"joint": joint.name, "servo_driver": joint.driver, "poll_hz": joint.poll_hz} if joint else {}),
        "start": iso(start),
        "accelerometer": sensor.name,
        **({"also_moved_by": list(others)} if others else {}),
        "accelerometer_driver": sensor.driver,
        "rate_hz": sensor.rate_hz,
        "f_res_hz": bar.f_res_hz,
        "zeta": bar.zeta,
        "length_m": bar.length_m,
        **{key: value for key, value in limits.items() if math.isfinite(value)},
    }


def also_moved_by(config: Config, joint: JointOptions) -> list[str]:
    """The other joints that move the joint's accelerometer."""
    return [
        one.name for one in config.joints if one != joint and joint.accelerometer in (one.accelerometer, *one.levers_m)
    ]
