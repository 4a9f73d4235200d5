"""Each effect in the words of a maintenance engineer: what it is called, what it says of the robot, where to look.

Sentences about one effect only; verdict.py joins them.  An effect that is not listed here, a user's own, speaks
through its summary.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from lostmotion.lab.quantity import Interval
from lostmotion.lab.results import Fit
from lostmotion.model.effects import get_effect

__all__ = ["column", "intervals", "look", "name", "sentence", "size", "variable"]

Found = Mapping[str, Interval]


@dataclass(frozen=True)
class _Words:
    """tells, otherwise: templates of the parameters' Intervals; the second is for values that fail ``when``."""

    name: str
    tells: str
    look: str
    when: Callable[[Found], bool] = lambda found: True
    otherwise: str = ""


_WORDS = {
    "viscous_friction": _Words(
        "viscous friction",
        "The joint drags in proportion to its speed: viscous friction of {b_v}.",
        "Look at the grease: too much, too thick, old, or cold. A motor that is held by shorted leads drags so too.",
    ),
    "coulomb_friction": _Words(
        "Coulomb friction",
        "The joint rubs: Coulomb friction of {tau_c}.",
        "Turn the joint by hand without power: look for a dry or dirty bearing, one that is pressed too hard, a seal "
        "or a cable that drags.",
    ),
    "stribeck_friction": _Words(
        "Stribeck friction",
        "The joint sticks before it slides: near rest its friction is {tau_s}; in motion it is {tau_c}.",
        "Look for grease that was pressed out of the bearing or has hardened, and for a seal that sticks; move the "
        "joint through its whole range and grease it anew.",
        lambda found: found["tau_s"].value >= found["tau_c"].value,
        "The joint slides more easily near rest: there its friction is {tau_s}; in motion it is {tau_c}.",
    ),
    "load_dependent_friction": _Words(
        "friction that grows with load",
        "The gear rubs the more, the more it carries: its coefficient of friction is {mu}.",
        "Look at the flanks of the teeth: dry, rough or worn; at a shaft out of line, and at bearings under side load.",
    ),
    "gravity_torque": _Words(
        "the weight of the arm",
        "The arm is out of balance: its weight turns the joint with up to {tau_g}.",
        "Usually no fault: a tool or load that the model does not know; else a spring or counterweight has lost force.",
    ),
    "gear_eccentricity": _Words(
        "a gear out of true",
        "The driving gear runs out of true, {N} times a turn, by {e.size}.",
        "Look for a gear that sits askew or off centre on its shaft, a bent shaft, or a worn bore.",
        lambda found: found["N"].value != 1,
        "The driving gear runs out of true, once a turn, by {e.size}.",
    ),
    "shaft_compliance": _Words(
        "a shaft that twists",
        "The shaft behind the gear twists: its stiffness is only {k_s}.",
        "Look for loose screws in the coupling or horn, a cracked hub, or a long thin shaft.",
    ),
    "actuator_lag": _Words(
        "an actuator that lags",
        "The motor trails behind its command, with a time constant of {T}.",
        "Look at the servo's gains and its limits of speed and acceleration; a low supply voltage makes it slow too.",
    ),
    "command_delay": _Words(
        "a delayed command",
        "The command reaches the motor late, by {T}.",
        "Look at the bus: baud rate, cycle time, an adapter that buffers (FTDI latency timer), a return delay set in "
        "the servo.",
    ),
    "finite_actuator": _Words(
        "an actuator that gives way",
        "The motor gives way when the gear hits it: it holds its position only up to {f1}.",
        "Look at the servo's position gain and torque limit, and at the supply voltage under load.",
    ),
    "contact_asymmetry": _Words(
        "flanks that differ",
        "The teeth are harder on the one flank, that which holds the joint back, by a factor of {ratio}.",
        "Look at both flanks of the teeth: wear on one side, a chipped tooth, plastic that was pressed flat.",
        lambda found: found["ratio"].value >= 1,
        "The teeth are softer on the one flank, that which holds the joint back, by a factor of {ratio.inverse}.",
    ),
    "torque_ripple": _Words(
        "a torque that ripples",
        "The torque ripples {N} times a turn, by {tau_r.size}.",
        "Look for a damaged tooth, a bearing with a flat ball, or a motor that cogs; the count a turn tells which.",
        lambda found: found["N"].value != 1,
        "The torque ripples once a turn, by {tau_r.size}.",
    ),
    "hardening_spring": _Words(
        "a bar that stiffens",
        "The bar stiffens as it bends: its cubic stiffness is {k3}.",
        "Look how the bar is clamped and whether it touches something; gentler reversals, a lighter tip bend it less.",
        lambda found: found["k3"].value >= 0,
        "The bar softens as it bends: its cubic stiffness is {k3}.",
    ),
    "quadratic_damping": _Words(
        "drag that grows with the square of speed",
        "Something brakes with the square of speed, as air does: drag of {b2}.",
        "Look for a broad plate, tape or a loose cable that moves through the air; else it is only air.",
    ),
    "second_mode": _Words(
        "a second resonance of the bar",
        "The bar has a second resonance, at {f2}.",
        "Look for a loose screw or cable at the sensor; else it is the bar's own, and a low-pass filter takes it away.",
    ),
    "gravity_leakage": _Words(
        "gravity in the sensor",
        "The accelerometer feels gravity, as if its axis were tilted by {c.size.tilt}.",
        "Look whether the sensor sits square on its bar, and whether the joint's axis is vertical.",
    ),
    "centripetal_crosstalk": _Words(
        "centripetal acceleration in the sensor",
        "The accelerometer feels the centripetal acceleration, as if it were turned on its bar by {c.size.tilt}.",
        "Look whether the sensor's axis stands square to the bar, and whether its screws or its tape are loose.",
    ),
    "sensor_lag": _Words(
        "a sensor that smooths",
        "The accelerometer smooths its signal, with a time constant of {T}.",
        "Look at the bandwidth that is set in the sensor, and for a soft mount: foam or thick tape smooths as well.",
    ),
    "bias_drift": _Words(
        "a sensor that drifts",
        "The accelerometer's zero drifts by {c}.",
        "Let the sensor warm up before recording; look for a supply voltage that sags, or a mount that creeps.",
    ),
    "sensor_saturation": _Words(
        "a sensor at its limit",
        "The accelerometer is cut off at {a_max}.",
        "Set a wider range in the sensor, or make the reversals gentler; what is cut off is lost.",
    ),
    "clock_skew": _Words(
        "a sensor clock that is off",
        "The accelerometer's clock runs fast, by {s.percent}.",
        "Take the time stamps from the host, or align the clocks at the start of each recording.",
        lambda found: found["s"].value >= 0,
        "The accelerometer's clock runs slow, by {s.size.percent}.",
    ),
}


_READ_AS: Mapping[tuple[str, str], Callable[[Interval], Interval]] = {
    ("gravity_leakage", "c"): lambda c: c.tilt,
    ("centripetal_crosstalk", "c"): lambda c: c.tilt,
    ("clock_skew", "s"): lambda s: s.percent,
}
"""Parameters without a unit that are better read as an angle or a percentage."""

_VARIABLES = {
    "time": ("time", "s"),
    "command": ("the commanded angle", "rad"),
    "command_rate": ("the commanded speed", "rad/s"),
    "theta": ("the joint's angle", "rad"),
    "theta_1": ("the commanded angle", "rad"),
    "theta_2": ("the joint's angle", "rad"),
    "position": ("the joint's angle", "rad"),
    "omega": ("the joint's speed", "rad/s"),
    "omega_2": ("the joint's speed", "rad/s"),
    "velocity": ("the joint's speed", "rad/s"),
    "acceleration": ("the joint's acceleration", "rad/s^2"),
    "load": ("the load", "N"),
    "q": ("the bar's deflection", "m"),
    "q'": ("the bar's speed", "m/s"),
    "temperature": ("the temperature", "degC"),
    "torque": ("the torque", "N m"),
    "gap": ("the gap between the teeth", "m"),
    "force": ("the force", "N"),
    "accel": ("the measured acceleration", "m/s^2"),
    "displacement": ("the displacement", "m"),
}
_COLUMNS = {
    "accel": ("acceleration", "m/s^2"),
    "position": ("angle", "rad"),
    "force": ("force", "N"),
    "displacement": ("displacement", "m"),
    "torque": ("torque", "N m"),
}


def variable(name: str) -> tuple[str, str]:
    """What a residual depends on, as people call it, and its SI unit."""
    return _VARIABLES.get(name, (name.replace("_", " "), ""))


def column(name: str) -> tuple[str, str]:
    """What a compared column of a recording is, and its SI unit."""
    return _COLUMNS.get(name, (name, ""))


def name(effect: str) -> str:
    """What people call it: "Coulomb friction"."""
    words = _WORDS.get(effect)
    return words.name if words else effect.replace("_", " ")


def sentence(effect: str, found: Found) -> str:
    """What it says of the robot, with its main parameters; found: those by their name within the effect.

    Raises ModelError for an effect that does not exist.
    """
    words = _WORDS.get(effect)
    if words:
        return (words.tells if words.when(found) else words.otherwise).format_map(found)
    listed = "; ".join(f"{parameter} = {value}" for parameter, value in found.items())
    summary = get_effect(effect).summary.strip().rstrip(".") or name(effect)
    return f"{summary[0].upper()}{summary[1:]}{': ' if listed else ''}{listed}."


def look(effect: str) -> str:
    """What to look at on the robot; "" where nobody has written it down."""
    words = _WORDS.get(effect)
    return words.look if words else ""


def size(effect: str, parameter: str, value: float, base: str) -> str:
    """A size of an effect by one of its parameters, without its sign, as its sentence has it: "30.0 µN m", "2.9°".

    Raises ModelError for an effect that does not exist or does not act on that base.
    """
    interval = Interval(value, unit=get_effect(effect).parameters_on(base)[parameter].unit).size
    read_as = _READ_AS.get((effect, parameter))
    return read_as(interval).alone if read_as else interval.alone


def intervals(fit: Fit, effect: str) -> dict[str, Interval]:
    """The effect's parameters as fitted, by their name within the effect; those that were not free without interval."""
    prefix = f"{effect}."
    found = {full: Interval(p.value, unit=p.unit) for full, p in fit.model.parameters.items()}
    found |= {e.name: Interval(e.value, e.low, e.high, e.unit) for e in fit.estimates}
    return {full.removeprefix(prefix): value for full, value in found.items() if full.startswith(prefix)}
