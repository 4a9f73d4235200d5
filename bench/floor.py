"""What the service's exchange of bytes alone costs: no look at them, no windows.

    python -m bench.floor SERVO_PORT ACCELEROMETER_PORT

Asks six servos of protocol 1.0 a hundred times a second, and reads what the accelerometer sends, until it is ended.
"""

from __future__ import annotations

import os
import select
import sys
import time

from serial import Serial

from lostmotion.drivers.codec.dynamixel import Question

QUESTIONS = [Question(number, 30, 14) for number in range(1, 7)]
PERIOD_S = 0.01


def main(servo_port: str, accelerometer_port: str) -> None:
    """Never returns."""
    line, sensor = Serial(servo_port, timeout=0), Serial(accelerometer_port, timeout=0)
    answer = select.poll()
    answer.register(line.fileno(), select.POLLIN)
    due = time.monotonic()
    while True:
        due += PERIOD_S
        time.sleep(max(0.0, due - time.monotonic()))
        for question in QUESTIONS:
            os.write(line.fileno(), question.request)
            answer.poll(100)
            os.read(line.fileno(), 64)
        sensor.read(1024)


if __name__ == "__main__":
    main(*sys.argv[1:])
