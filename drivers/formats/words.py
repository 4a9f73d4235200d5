"""Parses the name of a series: which column it may be, which joint's, in which unit.  Pure functions of text."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

from lostmotion.drivers.units import COLUMN_UNITS, to_si

__all__ = [
    "SPEED_LETTER", "SPELT", "UNNAMED", "axis_of", "column_of", "ends_in_time", "is_angle", "is_angular",
    "is_asked_speed", "is_commanded", "is_error", "is_estimated", "is_gyroscope", "is_input", "is_other",
    "is_reached", "is_run", "is_sent", "is_time", "joint_of", "puts_out", "rate_of", "says_nothing", "speed_of",
    "time_rank", "unit_of", "without_joint",
]  # fmt: skip

COMMAND = {
    "goal", "goals", "target", "targets", "desired", "reference", "references", "ref", "command", "commands",
    "commanded", "cmd", "setpoint", "action", "actions", "des", "demand", "demanded",
}  # fmt: skip
MEASURED = {"actual", "act", "measured", "feedback", "present"}
"""of a position where no other quantity is named, as a command is one: ``FL_1_target`` and ``FL_1_actual``"""
REPORTED = {"state", "states", "observation", "sensor", "shaft"}
"""of what is read, and not sent: the ``reference`` in a controller's state is a sample"""
POSITION = {
    "position", "positions", "pos", "angle", "angles", "qpos", "q", "theta", "phi", "encoder", "enc", "counts", "ticks",
}  # fmt: skip
SYMBOLS = {"q", "theta", "phi"}
"""of the joint, where a name says another quantity, too: ``q3_tau`` is its torque"""
QUANTITIES = {
    "temperature": {"temperature", "temp"},
    "voltage": {"voltage", "volt", "volts"},
    "torque": {"torque", "torques", "effort", "efforts", "tau", "tor", "torq", "trq"},
    "force": {"force"},
    "displacement": {"displacement", "distance"},
    "accel": {"accel", "acceleration", "acc", "accl", "accelerometer"},
    "current": {"current", "cur", "amps", "iq"},
}
COMMANDED = QUANTITIES["torque"] | QUANTITIES["force"]
"""of a controlled drive the command is as good as what was measured: ``target_torque``"""
UNIT_SAYS = ("position", "torque", "current", "force", "accel")
SPEED = {
    "velocity", "velocities", "velo", "vel", "speed", "qd", "qvel", "dq", "omega", "rpm", "dot", "tacho", "tachometer",
}  # fmt: skip
ERRORS = {"error", "errors", "err"}
OTHER = SPEED | ERRORS | {
    "accelerations", "jerk", "covariance", "orientation", "quaternion", "gyro", "angular", "status",
    "moving", "enabled", "enable", "mode", "flag", "index", "stamp", "limit", "limits", "min", "max", "mean", "std",
    "id", "tolerance", "delta", "load", "pwm", "duty", "uncertainty", "uncertainties", "sigma",
    "ddot", "double", "offset", "layout", "latitude", "longitude", "altitude", "direction", "accuracy",
}  # fmt: skip
"""words of series that are none of the columns"""
OF_SPEED = {"angular"}
"""words of these that a speed may have beside its own"""
INPUT = {"u", "pwm", "lpwm", "rpwm", "duty", "input", "inputs", "control", "ctrl"}
"""what drives a motor, in a unit of its own: a share of the voltage, most often; half bridges have one for each
direction"""
OUTPUT = re.compile(r"(^|[/.])output[/.\[]")
"""A part of a ROS message: what a controller puts out, and no angle of an output shaft."""
JOINT_STATES = re.compile(r"/joint_states[/.]")
"""a topic of ROS, whose messages (sensor_msgs/JointState) have rad and N m by definition"""
ESTIMATED = {"est", "estimate", "estimated", "hat", "observer", "observed"}
"""of an observer: worse than what was measured: ``theta_hat``"""
GENERAL = {
    "joint", "joints", "state", "states", "observation", "controller", "trajectory", "robot", "data", "feedback",
    "actual", "act", "present", "measured", "linear", "interface", "values", "value", "motor", "motors", "servo",
    "sensor", "imu", "msg", "x", "y", "z", "output", "out", "input", "shaft", "meas", "hz", *ESTIMATED,
}  # fmt: skip
TIMES = ("__time", "time", "timestamp", "timestamps", "t", "times", "tout", "elapsed", "datetime", "stamp")
"""words of the time axis, those first that others come after"""
BESIDE_TIME = {"elapsed", "sensor", "stamp", "date", "from", "start", "since", "the", "of", "in"}
"""words that may stand beside them"""
SPELT = {
    "degrees": "deg", "degree": "deg", "radians": "rad", "radian": "rad", "rads": "rad", "revs": "rev", "turns": "rev",
    "rad/sec": "rad/s", "rads/s": "rad/s", "rps": "rev/s", "dps": "deg/s", "deg/sec": "deg/s", "rpm": "rpm",
    "nm": "N m", "n.m": "N m", "n*m": "N m", "n-m": "N m", "n·m": "N m", "mnm": "mN m", "mn.m": "mN m", "mn*m": "mN m",
    "ncm": "N cm", "n.cm": "N cm", "n*cm": "N cm", "knm": "kN m", "kn": "kN", "newton": "N", "newtons": "N",
    "ma": "mA", "mv": "mV", "a": "A", "amp": "A", "amps": "A", "v": "V", "volt": "V", "volts": "V", "c": "degC",
    "n": "N", "pounds": "lbf",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millis": "ms", "millisec": "ms",
    "millisecond": "ms", "milliseconds": "ms", "usec": "us", "micros": "us", "microsec": "us", "microsecond": "us",
    "microseconds": "us", "nsec": "ns", "nanosec": "ns", "nanoseconds": "ns", "meters": "m", "metres": "m",
    "m/s2": "m/s^2", "m/s/s": "m/s^2", "m/s**2": "m/s^2",
}  # fmt: skip
DOTTED = re.compile(r"(?<![A-Za-z])(theta|phi|psi|alpha|beta|q|x|y|z)(d?dot)(?![A-Za-z])", re.IGNORECASE)
"""a symbol with a dot or two above it, spelt in one word: ``phidot``"""
SPEED_LETTER = re.compile(r"[vw]|d[qx]|[qx]d", re.IGNORECASE)
"""what books call a speed, which may also be a voltage or anything else: its numbers must say so"""
UNITS = {
    "deg", "rad", "s", "ms", "us", "ns", "mm", "cm", "m", "nm", "a", "ma", "v", "mv", "c", "g", "n", "kn", "arcmin",
    "rev", *SPELT,
}  # fmt: skip
RUN = re.compile(r"\s*(?:\bRun\s*#?\s*\d+|\bMonitor Run|#\d+|\(\d+\)|(?<=[A-Za-z])_?\d+)\s*$", re.IGNORECASE)
"""the number of a run at the end of a name: ``Position (m) Run #1``, ``t2``; of the second of its name in ``t (4)``; or
the run that is shown while it is measured, which has none: ``Position (cm) Monitor Run``"""
FILE, SPAN = re.compile(r"\.(?:txt|csv|dat)$", re.IGNORECASE), re.compile(r"\s*[+-]?[\d.]+\s*[:,]\s*[+-]?[\d.]+\s*")
"""the end of a file's name, as columns are called that were files; and a range in brackets: ``command [-1:1]``"""
RATE = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)\s*([kM]?)Hz\b", re.IGNORECASE)
"""how often something was counted"""
UNNAMED = re.compile(r"column\d+")
"""what a column without a name is called"""
GIVEN = re.compile(r"(timeseries|unnamed|untitled|signal|Var(?:Name)?)\s?\d*", re.IGNORECASE)
"""what MATLAB calls a series that nobody named"""
BRACKETED = re.compile(r"[\[(]([^\])]+)[\])]\s*$")
"""the text in brackets at the end of a name"""
GREEK = str.maketrans(
    {"θ": " theta ", "Θ": " theta ", "ϑ": " theta ", "φ": " phi ", "ϕ": " phi ", "ω": " omega ", "τ": " tau "}
)
TRANSLATED = {
    "time": "zeit tiempo temps tempo tid tijd czas",
    "angle": "winkel angulo angolo vinkel hoek",
    "position": "auslenkung posicion posizione posicao posisjon pozycja elongation elongacion elongazione",
    "displacement": "weg verschiebung deplacement desplazamiento spostamento deslocamento forskyvning",
    "distance": "abstand entfernung distancia distanza distanz",
    "velocity": "geschwindigkeit winkelgeschwindigkeit drehzahl vitesse velocidad velocita velocidade hastighet "
    "predkosc",
    "acceleration": "beschleunigung aceleracion accelerazione aceleracao akselerasjon przyspieszenie",
    "force": "kraft fuerza forza forca kracht",
    "torque": "drehmoment couple coppia",
    "current": "strom courant corriente corrente",
    "voltage": "spannung voltaje tensione tensao",
    "temperature": "temperatur temperatura",
    "reference": "referencia riferimento referenz sollwert consigne",
    "output": "saida salida uscita ausgang",
    "error": "erro erreur errore fehler",
    "effort": "esforco esfuerzo sforzo",
    "actual position": "posa",
    "goal position": "posd",
    "actual velocity": "vela",
    "goal velocity": "veld",
}
"""words of other languages without their accents, and abbreviations of two words in one"""
ENGLISH = {word: english for english, words in TRANSLATED.items() for word in words.split()}
HEADS = "geschwindigkeit drehzahl winkel drehmoment spannung strom beschleunigung kraft temperatur zeit"
COMPOUND = re.compile(rf"(soll|ist)?([a-z]*?)({'|'.join(HEADS.split())}|position|moment)", re.IGNORECASE)
"""a German noun of several: ``Motorspannung``, ``Sollposition``"""
BEFORE_NOUN = {"soll": "goal", "ist": "actual"}
SIGNS = {
    "角加速度": " angular acceleration ", "角速度": " angular velocity ", "加速度": " acceleration ",
    "速度": " velocity ", "角度": " angle ", "位移": " displacement ", "位置": " position ", "时间": " time ",
    "時間": " time ", "время": " time ", "угол": " angle ",
}  # fmt: skip
"""the longer ones first"""
PARTS = {"joint", "motor", "servo"}
"""in the name of a joint, but none alone where there is more"""
WORD = r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+"
"""one of a name, which signs, digits and capitals separate"""
VOCABULARY = COMMAND | POSITION | set().union(*QUANTITIES.values()) | OTHER | INPUT | GENERAL | UNITS


def column_of(name: str) -> str | None:
    """The column that a series of this name may be, None for none."""
    if name in COLUMN_UNITS:
        return None if name == "time" else name
    words = set(_words(name))
    if words & OTHER or _unit_of_speed(name) or OUTPUT.search(name):
        return None
    found = [column for column, known in QUANTITIES.items() if words & known]
    by_unit = _column_of_unit(name)
    if not found and by_unit not in (None, "position") and not words & (POSITION - SYMBOLS):
        return None if words & COMMAND and by_unit == "current" else by_unit  # q-axis [A] is no angle q
    if _says_position(name, found) or {"observation", "state"} <= words:
        return "command" if words & COMMAND else "position"
    if found:
        return None if words & COMMAND and not words & COMMANDED else found[0]
    if words & COMMAND or words & MEASURED:
        return "command" if words & COMMAND else "position"
    return _column_of_unit(name)


def _says_position(name: str, others: Sequence[str]) -> bool:
    """Whether a name says a position: by a symbol where it says no other quantity, else by the last word of one, as
    what is before that is the joint: of ``wrist_angle_effort`` the torque."""
    words = _words(name)
    if not others:
        return bool({*words} & POSITION)
    known = (POSITION - SYMBOLS).union(*(QUANTITIES[other] for other in others))
    return next(word for word in reversed(words) if word in known) in POSITION


def _column_of_unit(name: str) -> str | None:
    """The column that the unit at the end of a name says, as in ``alpha_deg`` or ``M1 [Nm]``; a single letter behind a
    sign may be anything."""
    found = [unit for unit in _last(name) if len(unit) > 1 or name.rstrip().endswith(("]", ")"))]
    columns = {si: column for column, si in COLUMN_UNITS.items() if column in UNIT_SAYS}
    return next((columns[si[0]] for unit in found if (si := to_si(unit)) and si[0] in columns), None)


def is_angle(name: str) -> bool:
    """Whether a name calls a series an angle, as few call the counts of an encoder."""
    return bool({"angle", "angles"} & {*_words(name)})


def is_commanded(name: str) -> bool:
    """Whether a series is what was asked for, and not what was measured."""
    return bool(set(_words(name)) & COMMAND)


def is_estimated(name: str) -> bool:
    """Whether a series is what an observer made of the measured ones."""
    return bool({*_words(name)} & ESTIMATED)


def is_reached(name: str, goal: str) -> bool:
    """Whether a name is that of a goal without the word that says so: ``Stroke`` of ``Stroke_Ref``."""
    return [word for word in _words(goal) if word not in COMMAND] == _words(name)


def is_gyroscope(name: str) -> bool:
    """Whether a series is a gyroscope's: a speed with an error that hardly changes."""
    return bool({"gyro", "gyroscope", "gyr"} & {*_words(name)})


def is_input(name: str) -> bool:
    """Whether a series is the input of a motor, of no quantity that has a column: ``u``, ``pwm``, ``control_input``."""
    words = set(_words(name))
    return bool(words & INPUT) and column_of(name) is None and not words & (OTHER - INPUT | COMMAND)


def puts_out(name: str) -> bool:
    """Whether a series is what a controller puts out, by its last word: ``out``, ``pid_out``; where something else is
    the motion, that is the motor's input."""
    return _words(name)[-1:] == ["out"] and column_of(name) is None and not is_other(name)


def is_other(name: str) -> bool:
    """Whether a name says a quantity that has no column, as that of an error."""
    return bool({*_words(name)} & OTHER)


def is_error(name: str) -> bool:
    """Whether a name says by how much a goal is missed."""
    return bool({*_words(name)} & ERRORS)


def is_sent(name: str) -> bool:
    """Whether a series is what a motor is told, and not what a sensor or an observer says."""
    words = {*_words(name)}
    return bool(words & (COMMAND | INPUT)) and not words & (OTHER - INPUT | MEASURED | ESTIMATED | REPORTED)


def says_nothing(name: str) -> bool:
    """Whether a series has no name, or one that a program gave, or a letter as in a formula, which may be of any
    quantity."""
    is_letter = SPEED_LETTER.fullmatch(name) or (len(name) == 1 and name.isalpha())
    return bool(UNNAMED.fullmatch(name) or GIVEN.fullmatch(name) or is_letter) and not (
        column_of(name) or is_time(name) or axis_of(name)
    )


def speed_of(name: str) -> str | None:
    """The unit of a series that is a speed, as its name says; "" where it says none, None for other series."""
    words = set(_words(name))
    unit = _unit_of_speed(name)
    return None if not (words & SPEED or unit) or words & (OTHER - SPEED - OF_SPEED | COMMAND) else unit


def is_angular(name: str) -> bool:
    """Whether a name is that of an angle's rate, as in ``angular_velocity``; an omega may be in rpm."""
    return "angular" in _words(name)


def is_asked_speed(name: str) -> bool:
    """Whether a series is the speed that a controller asks for: ``goal_velocity``, ``commanded_deg_s``."""
    words = {*_words(name)}
    return bool(words & COMMAND and (words & SPEED or _unit_of_speed(name))) and not words & (OTHER - SPEED)


def _unit_of_speed(name: str) -> str:
    """The unit of a speed at the end of a name, "" for none; turns a second may be called Hz."""
    found = ("rev/s" if unit == "Hz" and {*_words(name)} & SPEED else unit for unit in _last(name))
    return next((unit for unit in found if (si := to_si(unit)) and si[0] in ("rad/s", "m/s")), "")


def rate_of(name: str) -> float:
    """The rate in the name of a series [Hz], as in ``timestep (8 kHz)``; 0 for none."""
    found = RATE.search(name)
    return float(found[1]) * {"": 1, "k": 1e3, "m": 1e6}[found[2].lower()] if found else 0.0


def is_run(name: str) -> bool:
    """Whether a name ends with the number of a run, or of a joint."""
    return bool(RUN.search(name))


def axis_of(name: str) -> str:
    """The axis that a name says, "" for none: of ``Acceleration x (m/s^2)`` and of ``x`` it is x."""
    axes = [word for word in _words(BRACKETED.sub("", RUN.sub("", name))) if word in ("x", "y", "z")]
    return axes[0] if len(axes) == 1 else ""


def is_time(name: str) -> bool:
    """Whether a series of this name may be the time axis."""
    return time_rank(name) < len(TIMES) + 1


def ends_in_time(name: str) -> bool:
    """Whether the last word of a name says a time, as of ``loop_time`` and ``pi_time``, whatever its others say."""
    words = [word for word in _words(BRACKETED.sub("", RUN.sub("", name))) if word not in UNITS]
    return words[-1:] in (["time"], ["timestamp"])


def time_rank(name: str) -> int:
    """The place of a name among those of the time axis, the first one at 0; beyond them all for another series."""
    name = re.sub(r"(?<=[a-z]) [A-Z](?=\s*[\[(]|$)", "", RUN.sub("", name))  # a run may have a letter: Time B
    plain = re.sub(r"[\[(][^\])]*[\])]\s*$", "", name).rpartition(":")[2]  # behind the data set: OSL:timestamp
    words = ["__time"] if plain == "__time" else _words(plain)
    kept = [word for word in words if word not in UNITS | BESIDE_TIME] or words
    if len(kept) == 1 and kept[0] in TIMES:
        return TIMES.index(kept[0])
    is_unit = len(words) == 1 and to_si(SPELT.get(words[0], "")) == ("s", 1.0)
    has_unit = name.rstrip()[-1:] in "])" and (to_si(_last(name)[0]) or ("",))[0] == "s"
    return len(TIMES) if is_unit or has_unit else len(TIMES) + 1


def joint_of(name: str) -> str:
    """The joint in a name: the text in brackets, else what is left of the path without the usual words."""
    if name in COLUMN_UNITS or UNNAMED.fullmatch(name):
        return ""
    name = FILE.sub("", _english(name))
    for bracket in re.findall(r"\[([^\]]+)\]", name):
        if to_si(_spelt(bracket)) is not None or SPAN.fullmatch(bracket):
            continue
        if bracket.isdigit():
            return str(bracket)
        if kept := _proper(bracket):
            return kept
    parts = [_proper(part) for part in re.split(r"[/.]", name) if set(_words(part)) - VOCABULARY]
    return "/".join(filter(None, parts))


def without_joint(name: str) -> str:
    """A name without its joint: equal for the same quantity of two joints."""
    return name.replace(joint_of(name), "")


def unit_of(name: str, column: str) -> str:
    """The unit at the end of a name, as in ``angle_deg``, ``angle (deg)``, ``angle deg`` or ``angle [deg]``; "" for
    none.

    Without brackets it must suit the column: the m of ``torque_m`` is a motor, and no metre.
    """
    if BRACKETED.search(RUN.sub("", name)):
        return next((unit for unit in _last(name) if to_si(unit) is not None), "")
    fits = (unit for unit in _last(name) if (si := to_si(unit)) is not None and si[0] == COLUMN_UNITS[column])
    return next(fits, COLUMN_UNITS[column] if JOINT_STATES.search(name) and column in ("position", "torque") else "")


def _last(name: str) -> list[str]:
    """What may be the unit at the end of a name, as ``to_si`` knows it."""
    if found := BRACKETED.search(RUN.sub("", name)):
        return [_spelt(found[1])]
    plain = name.strip()
    fraction = "/".join(re.split(r"_(?:per_)?", plain)[-2:])
    compound = [fraction] if to_si(_spelt(fraction)) else []  # as in speed_rad_s
    return [_spelt(unit) for unit in (*compound, *(re.split(by, plain)[-1] for by in (r"[_\s,-]", r"[_\s,/-]")))]


def _spelt(unit: str) -> str:
    """A unit as ``to_si`` knows it, where it is spelt otherwise."""
    plain = unit.strip()
    return plain if to_si(plain) is not None else SPELT.get(re.sub(r"\s", "", plain).lower(), plain)


def _words(name: str) -> list[str]:
    """Words in lower case, in English, split at signs, digits and capitals; Greek letters are words."""
    return [word.lower() for word in re.findall(WORD, _english(name))]


def _english(name: str) -> str:
    """A name with the usual words of other languages in English, without accents, and Greek letters as words."""
    for sign, english in SIGNS.items():
        name = name.replace(sign, english)
    plain = DOTTED.sub(r"\1 \2", name.translate(GREEK))
    if not plain.isascii():
        plain = "".join(letter for letter in unicodedata.normalize("NFKD", plain) if not unicodedata.combining(letter))
    return re.sub(r"[A-Za-z]+", lambda word: ENGLISH.get(word[0].lower(), "") or _of_nouns(word[0]), plain)


def _of_nouns(word: str) -> str:
    """A German compound in words, its nouns in English; another word as it is."""
    found = COMPOUND.fullmatch(word)
    if not found or found[3] == word:
        return word
    before = BEFORE_NOUN.get((found[1] or "").lower(), "")
    nouns = (before, found[2], ENGLISH.get(found[3].lower(), found[3]))
    return " ".join(filter(None, nouns))


def _proper(text: str) -> str:
    """The first words of a text that are not usual ones, and more than a kind of part: of ``q3_tau_J_compensate`` the
    3, of ``motorStatePos_0`` the 0."""
    groups: list[list[re.Match[str]]] = [[]]
    for word in re.finditer(WORD, text):
        if word[0].lower() not in VOCABULARY - PARTS:
            groups[-1].append(word)
        elif groups[-1]:
            groups.append([])
    found = [group for group in groups if group]
    best = next((group for group in found if {word[0].lower() for word in group} - PARTS), [*found, []][0])
    return text[best[0].start() : best[-1].end()] if best else ""
