"""One case: three recordings of a joint with something hidden in it, on disk.  What is hidden goes to truth.json.

The strength of an effect is set by what it does: what the best fit of the base leaves of it in the accelerometer's
signal, over the noise, is brought into a window (RATIO) by the size of the noise and, where that is not enough, of the
effect.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from bench.hidden_effects import mujoco_joint
from bench.hidden_effects.catalogue import ACTS_ON, INSIDE, OUTSIDE, Random, Values, draw, rough, true_base
from bench.hidden_effects.motion import hand_waved
from bench.hidden_effects.physics import Command, follow, simulate
from bench.hidden_effects.sizing import Segment, left_by_base

__all__ = ["DURATION", "KINDS", "LEAD", "RATE_HZ", "Case", "draw_case", "read_sensor", "write_case"]

FloatArray = NDArray[np.float64]
KINDS = ("strong", "moderate", "nothing", "pair", "outside", "bounces", "joint")
"""All on the base play but for joint, which is MuJoCo's."""
RATE_HZ, DURATION, LEAD, RECORDINGS = 800.0, 4.0, 0.5, 3
"""The recording begins LEAD s after the motion: its initial state is nobody's knowledge."""
RATIO = {"strong": (10.0, 20.0), "moderate": (3.0, 6.0)}
NOISE = (0.05, 0.4)
COUNTS = (16 * 9.80665 / 32768, 0.0118)
RANGE = 16 * 9.80665
TOUCH = 1e-8
"""A disturbance of the initial angle [rad], for the horizon of predictability."""
STRETCH, STRETCHES = 0.45, (0.8, 1.8)
LAGGING = {"actuator_lag.T", "finite_actuator.J1"}
START, SMALLEST_LARGEST, TRIES = {"strong": 3.0, "moderate": 1.0}, (0.3, 5.0), 4
GROWING = ("clock_skew", "bias_drift")
UNITS = {"d": "m", "k": "N/m", "l": "m", "alpha": "N s/m", "b": "N s/m"}


@dataclass(frozen=True)
class Case:
    """What is hidden and how strongly: kind is one of KINDS, size "strong" or "moderate"."""

    name: str
    kind: str
    effects: tuple[str, ...]
    size: str
    colour: str
    seed: int


@dataclass(frozen=True)
class _Joint:
    """A joint and three motions of it."""

    values: Values
    commands: tuple[Command, ...]


def draw_case(kind: str, number: int, seed: int) -> Case:
    """The number-th case of a kind; strong and moderate go through the catalogue in turn."""
    rng = np.random.default_rng((seed, KINDS.index(kind), number))
    turn = np.random.default_rng((seed, KINDS.index(kind))).permutation
    size = kind if kind in RATIO else "strong"
    effects: tuple[str, ...] = ()
    if kind in RATIO:
        effects = (INSIDE[turn(len(INSIDE))[number % len(INSIDE)]],)
    elif kind == "outside":
        effects = (OUTSIDE[turn(len(OUTSIDE))[number % len(OUTSIDE)]],)
    elif kind == "pair":
        first = str(rng.choice(INSIDE))
        others = [name for name in INSIDE if ACTS_ON[name] != ACTS_ON[first]]
        effects = (first, str(rng.choice(others)))
    elif kind == "joint":
        effects = tuple(name for name in (mujoco_joint.HIDDEN[number % len(mujoco_joint.HIDDEN)],) if name != "nothing")
    elif kind == "bounces" and number % 2:
        effects = (str(rng.choice(INSIDE)),)
    colour = ("white", "ar1", "pink")[number % 2 * int(rng.integers(1, 3))]
    return Case(f"{kind}-{seed}-{number:03d}", kind, effects, size, colour, int(rng.integers(2**31)))


def write_case(case: Case, folder: Path) -> None:
    """Simulates the case and writes its files into the folder."""
    if case.kind == "joint":
        mujoco_joint.write_joint((*case.effects, "nothing")[0], case.seed, folder)
        return
    rng = np.random.default_rng(case.seed)
    alpha = (800.0, 1500.0) if case.kind == "bounces" else (3000.0, 6000.0)
    commands = tuple(hand_waved(rng, LEAD + DURATION) for _ in range(RECORDINGS))
    base = _Joint(true_base(rng, alpha), commands)
    hidden, noise, ratios = _sized(case, base, rng)
    values = {**base.values, **hidden}
    folder.mkdir(parents=True, exist_ok=True)
    count = float(rng.choice(COUNTS))
    rms = [
        _write_recording(folder / f"rec{i}.csv", values, command, _noise(rng, case.colour, noise), count)
        for i, command in enumerate(commands, 1)
    ]
    (folder / "model.toml").write_text(_model_file(rough(base.values, rng)))
    truth = {
        "kind": case.kind, "size": case.size, "effects": list(case.effects), "parameters": values, "noise": rms,
        "colour": case.colour, "count": count, "ratio": ratios, "seed": case.seed,
        "predictable_s": [_predictable(values, command, noise) for command in commands],
    }  # fmt: skip
    (folder / "truth.json").write_text(json.dumps(truth, indent=1))


def _sized(case: Case, base: _Joint, rng: Random) -> tuple[Values, float, list[float]]:
    """Parameters of the effects, the noise's rms [m/s²], and what each effect leaves over the noise.

    The noise follows the first effect as far as it may, then the size does.
    """
    quietest, loudest = NOISE[0] * rng.uniform(1, 2), NOISE[1] * rng.uniform(0.5, 1)
    noise = float(np.exp(rng.uniform(math.log(quietest), math.log(loudest))))
    hidden: Values = {}
    lefts: list[float] = []
    low, high = RATIO[case.size]
    for effect in case.effects:
        wanted, seed, strength = rng.uniform(low, high), int(rng.integers(2**31)), START[case.size]
        for _ in range(TRIES):
            found = _peak_share(draw(effect, np.random.default_rng(seed), strength), base)
            left = _left(base, found)
            if not hidden:
                noise = float(np.clip(left / wanted, quietest, loudest))
            if low <= left / noise <= high:
                break
            strength *= float(np.clip((wanted * noise / max(left, 1e-6)) ** 0.8, 0.4, 2.5))
            strength = float(np.clip(strength, *SMALLEST_LARGEST))
        hidden |= found
        lefts.append(left)
    noise = max(min([noise, *(left / low for left in lefts)]), quietest)  # the weaker of a pair shall show too
    return hidden, noise, [left / noise for left in lefts]


def _peak_share(values: Values, base: _Joint) -> Values:
    """A saturation that is given as a share of the peak becomes an acceleration."""
    if "sensor_saturation.share" not in values:
        return values
    peak = max(np.max(np.abs(read_sensor(base.values, command, _times()))) for command in base.commands)
    return {"sensor_saturation.a_max": round(values["sensor_saturation.share"] * float(peak), 3)}


def _left(base: _Joint, effect: Values) -> float:
    """Root mean square of what the effect leaves in the signal after the base has done its best [m/s²].

    Over short segments, as farther from a start chaos would rule; over whole recordings for what only time brings out.
    """
    times, values = _times(), {**base.values, **effect}
    if next(iter(effect)).split(".")[0] in GROWING:
        changes = [
            read_sensor(values, command, times) - read_sensor(base.values, command, times) for command in base.commands
        ]
        return float(np.sqrt(np.mean([np.var(change) for change in changes])))
    segments = [segment for command in base.commands[:2] for segment in _segments(values, command)]
    return left_by_base(base.values, segments, 1 / RATE_HZ)


def _segments(values: Values, command: Command) -> list[Segment]:
    """Segments of the clean signal, each with a state to begin from in which the base's gap is as it was."""
    times = np.arange(round((STRETCHES[-1] + STRETCH) * RATE_HZ)) / RATE_HZ
    accel, states = simulate(values, command, times, follow(values, command, 0.0))
    late = values.get("command_delay.T", 0.0)
    found = []
    for start in STRETCHES:
        first, last = round(start * RATE_HZ), round((start + STRETCH) * RATE_HZ)
        state = states[first].copy()
        angle = state[4] if LAGGING & set(values) else command.at(times[first : first + 1] - late)[0]
        state[0] += command.at(times[first : first + 1])[0] - angle
        found.append(Segment(command, start, _read(values, accel[first:last], times[first:last] - LEAD), state))
    return found


def _times() -> FloatArray:
    return LEAD + np.arange(round(DURATION * RATE_HZ)) / RATE_HZ


def read_sensor(values: Values, command: Command, times: FloatArray) -> FloatArray:
    """What the sensor would tell at its stamps `times` without noise or counts; the motion starts at 0."""
    own = times - times[0]
    felt_at = times[0] + own / (1 + values.get("clock_skew.s", 0.0))
    from_start = np.concatenate(([0.0], felt_at))
    return _read(values, simulate(values, command, from_start, follow(values, command, 0.0))[0][1:], own)


def _read(values: Values, accel: FloatArray, own: FloatArray) -> FloatArray:
    """The sensor's own part, for accelerations at times since it was switched on: curve, hum, offset, drift, range."""
    accel = accel + values.get("curved_sensor.c", 0.0) * accel**2
    hum = np.sin(2 * math.pi * values.get("hum.f", 0.0) * own + values.get("hum.phi", 0.0))
    accel = accel + values.get("hum.a", 0.0) * hum + values["bias"] + values.get("bias_drift.c", 0.0) * own
    limit = values.get("sensor_saturation.a_max", math.inf)
    return np.asarray(np.clip(accel, -limit, limit))


def _predictable(values: Values, command: Command, noise: float) -> float:
    """When a change of TOUCH at the start of the recording shows above the noise [s]; DURATION when it does not."""
    times = _times()
    state = simulate(values, command, np.array([0.0, LEAD]), follow(values, command, 0.0))[1][-1]
    same = simulate(values, command, times, state)[0]
    state[0] += TOUCH
    apart = np.abs(simulate(values, command, times, state)[0] - same) > noise
    return float(np.argmax(apart) / RATE_HZ) if apart.any() else DURATION


def _noise(rng: Random, colour: str, rms: float) -> FloatArray:
    """Noise of that rms (N,): white, ar1 (a sample resembles the one before), pink (power falls as 1/f)."""
    size = round(DURATION * RATE_HZ)
    white = rng.normal(0.0, 1.0, size + 200)
    if colour == "ar1":
        keep = rng.uniform(0.5, 0.9)
        white = np.asarray(lfilter([math.sqrt(1 - keep**2)], [1, -keep], white))
    elif colour == "pink":
        spectrum = np.fft.rfft(white)
        spectrum[1:] /= np.sqrt(np.arange(1, spectrum.size) / 20 + 0.1)
        spectrum[0] = 0
        white = np.fft.irfft(spectrum, white.size)
    drawn = white[200:]
    return np.asarray(rms * drawn / np.std(drawn))


def _write_recording(path: Path, values: Values, command: Command, noise: FloatArray, count: float) -> float:
    """Writes the recording; the rms of all that its sensor adds to the clean signal."""
    times = _times()
    clean = read_sensor(values, command, times)
    limit = min(values.get("sensor_saturation.a_max", math.inf), RANGE)
    reading = np.clip(np.round((clean + noise) / count) * count, -limit, limit)
    rows = zip(times - LEAD, command.at(times), reading, strict=True)
    lines = [f"{time:.6f},{angle:.10g},{accel:.6g}" for time, angle, accel in rows]
    path.write_text("\n".join(["time,command,accel", *lines, ""]))
    return float(np.std(reading - clean))


def _model_file(values: Values) -> str:
    lines = [f'{name} = {{ value = {value:.6g}, unit = "{UNITS[name]}" }}' for name, value in values.items()]
    return "\n".join(['base = "play"', "[parameters]", *lines, ""])
