"""A configuration to start from, made of what was found on the ports; what only a person knows is marked FILL IN."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from lostmotion.detector.play_size import LEAST_RATE
from lostmotion.drivers.codec.registers import ALL_MODELS
from lostmotion.drivers.probe.port import Look
from lostmotion.drivers.probe.servos import FoundServo
from lostmotion.drivers.probe.streams import FoundSensor
from lostmotion.drivers.toml_text import toml_value

__all__ = ["configuration"]

USUAL_F_RES_HZ = 58.0
POLLS_HZ = (100, 50, 25, 20, 10, 5)
TURN_S = 0.002
"""of a servo that obeys no sync read, and of the adapter, beside the bytes"""
BUSY = 0.8
"""share of the time that the line may be busy"""
SO101 = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
"""LeRobot's names of six STS3215 with the ids 1 to 6"""
BITS_PER_BYTE = 10
FRAME = 12
"""bytes around a state block, at most"""

HEAD = """\
# Written by `lostmotion doctor --find`.  Look at every line that says FILL IN, then:
#     lostmotion config check FILE
#     lostmotion doctor --config FILE
[robot]
name = "robot"                    # FILL IN: what you call it

[store]
path = "history.db"               # FILL IN: where the history is kept; under systemd /var/lib/lostmotion/history.db
"""
PLACEHOLDER_SENSOR = FoundSensor("csv_serial", 115_200, 1000.0, {"time_column": 0, "time_unit": "us", "column": 1}, "")
PLACEHOLDER_SERVO = FoundServo("dynamixel", 1, "XL330-M288", 1200, 2, 1_000_000)
NOWHERE = "/dev/serial/by-id/FILL-IN"


def configuration(looks: Sequence[tuple[str, Look]]) -> str:
    """The text of the configuration; "" where there is neither a servo nor a sensor.  looks: ports that stay, and what
    was found on each."""
    sensors = [(port, look.sensor) for port, look in looks if look.sensor is not None]
    lines = [(port, *_together(look.servos)) for port, look in looks]
    known = [(port, servos, others) for port, servos, others in lines if any(servo.model for servo in servos)]
    if not sensors and not known:
        return ""
    parts = [HEAD]
    for i, (port, sensor) in enumerate(sensors or [(NOWHERE, PLACEHOLDER_SENSOR)]):
        parts.append("\n".join(_sensor(f"tip{i + 1}" if i else "tip", port, sensor)) + "\n")
    if len(sensors) < 2:
        parts.append(LEVERS)
    several = len(known) > 1
    for i, (port, servos, others) in enumerate(known or [(NOWHERE, [PLACEHOLDER_SERVO], [])]):
        parts.append("\n".join(_bus(port, servos, f"line{i + 1}_" if several else "")))
        parts += [_left_out(servo) for servo in others]
    return "\n".join(parts)


LEVERS = """\
# levers_m: from the joint's axis to the accelerometer [m], FILL IN: measure it in the pose in which the robot works.
"""


def _together(servos: Sequence[FoundServo]) -> tuple[list[FoundServo], list[FoundServo]]:
    """The servos of one port that one driver can read at one baud rate, as many as possible; and the others."""
    kinds = [(servo.driver, servo.baudrate) for servo in servos]
    best = max(kinds, key=kinds.count, default=None)
    chosen = [servo for servo, kind in zip(servos, kinds, strict=True) if kind == best]
    return chosen, [servo for servo in servos if servo not in chosen]


def _left_out(servo: FoundServo) -> str:
    what = f"{servo.driver} {servo.model or servo.number}, id {servo.id}, at {servo.baudrate} baud"
    return f"# left out: {what}: a port has one driver and one baud rate; set all servos on it to the same\n"


def _sensor(name: str, port: str, sensor: FoundSensor) -> Iterator[str]:
    yield "[[accelerometer]]"
    yield f'name = "{name}"'
    yield f'driver = "{sensor.driver}"'
    yield f"port = {toml_value(port)}" + ("   # FILL IN: no sensor was found" if port == NOWHERE else "")
    yield f"baudrate = {sensor.baudrate}"
    yield f"rate_hz = {sensor.rate_hz:g}" + ("" if port == NOWHERE else "   # measured")
    for key, value in sensor.options.items():
        yield f"{key} = {toml_value(value)}{_hint(key, sensor)}"
    if sensor.driver == "csv_serial":
        yield f"scale = 1.0               # FILL IN: m/s² per unit of the reading{_seen(sensor)}"
    f_res = min(USUAL_F_RES_HZ, round(sensor.rate_hz / LEAST_RATE, 1))
    yield "# FILL IN: resonance and length of the metal bar; `lostmotion calibrate tap` measures the resonance"
    if f_res < USUAL_F_RES_HZ:
        limit = f"measure the size of the play on bars up to {f_res:g} Hz"
        yield f"# {sensor.rate_hz:g} samples a second {limit}: a long bar, or a faster sensor"
    yield f"oscillator = {{ f_res_hz = {f_res}, zeta = 0.012, length_m = 0.10 }}"


def _hint(key: str, sensor: FoundSensor) -> str:
    if key == "axis":
        return f"                  # FILL IN: the one along which the bar's end moves; {sensor.told}"
    if key == "column" and sensor.columns > 2:
        return "                  # FILL IN: the one along which the bar's end moves, counted from 0"
    return ""


def _seen(sensor: FoundSensor) -> str:
    return f"; {sensor.told}" if sensor.told else ""


def _bus(port: str, servos: Sequence[FoundServo], prefix: str) -> Iterator[str]:
    poll, names = _poll_hz(servos), _names(servos)
    for servo, name in zip(servos, names, strict=True):
        if not servo.model:
            yield f"# id {servo.id}: model number {servo.number} is none that lostmotion knows"
            continue
        yield "[[joint]]"
        yield f'name = "{prefix}{name}"'
        yield f'driver = "{servo.driver}"'
        yield f"port = {toml_value(port)}" + ("   # FILL IN: no servo was found" if port == NOWHERE else "")
        yield f"baudrate = {servo.baudrate}"
        yield f'model = "{servo.model}"'
        yield f"id = {servo.id}"
        yield f"poll_hz = {poll}"
        yield 'accelerometer = "tip"'
        yield "levers_m = { tip = 0.10 }   # FILL IN"
        yield ""


def _names(servos: Sequence[FoundServo]) -> Sequence[str]:
    kind = [(servo.id, servo.model) for servo in servos]
    return SO101 if kind == [(id, "STS3215") for id in range(1, 7)] else [f"joint{servo.id}" for servo in servos]


def _poll_hz(servos: Sequence[FoundServo]) -> int:
    """As often as the line can bear."""
    byte_s = BITS_PER_BYTE / servos[0].baudrate
    models = [ALL_MODELS[servo.model] for servo in servos if servo.model]
    cycle = sum((model.block_size + 2 * FRAME) * byte_s + TURN_S * (not model.syncs) for model in models)
    return next((rate for rate in POLLS_HZ if rate * cycle <= BUSY), POLLS_HZ[-1])
