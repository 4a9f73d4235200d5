"""Rough estimates of inertia, damping and stiffness from the spectra of input and output; and spectral lines.

Recordings may be in volts, newtons or newton metres, so that the values of a model file may be wrong by orders of
magnitude, too far for a fit to converge.  Every equation of motion is linear in these parameters, so that least squares
in the frequency domain gives initial values for all fits.  Nothing is simulated here.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.data.series import rms
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

if TYPE_CHECKING:
    from lostmotion.lab.data.experiment import Experiment

__all__ = ["from_spectra", "spectral_lines", "strongest_mode", "turned", "usual_torque"]

Spectrum = NDArray[np.complex128]
Band = tuple[float, float]
ORDER: Mapping[str, Mapping[str, int]] = {
    "oscillator": {"m": 2, "b": 1, "k": 0},
    "joint": {"J": 2, "viscous_friction.b_v": 1},
}
"""By base, the parameters that are estimated, and the order of the derivative of the output that each multiplies."""
OUTPUTS: Mapping[str, Mapping[str, int]] = {"oscillator": {"displacement": 0, "accel": 2}, "joint": {"position": 0}}
"""By base, the columns of the output, the most direct one first, and the order of the derivative that each is."""
BESIDE: Mapping[str, Sequence[Callable[[FloatArray], FloatArray]]] = {"joint": (np.sin, np.cos)}
"""By base, functions of the output that are further regressors, so that a weight is not taken for an inertia."""
CLEAR = 300.0
"""Ratio of the power to that at the highest frequencies, which is noise, above which a bin is used."""
LEAST_BINS = 6
"""Least number of frequencies for an estimate."""
BESIDE_LINE = 1.3
"""A mode is estimated up to this factor below and above the strongest line in the spectrum of the output."""
log = logging.getLogger(__name__)


def turned(model: Model, experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """The experiments of an oscillator; those with a force that is counted against the motion have one of the opposite
    sign, and a warning reports this.

    Mass, damping and stiffness of the strongest mode are then all negative, in each of the recordings.  Two sensors
    have their own positive directions, and the tip of a flexible arm moves against the torque in every second mode.
    """
    driven = [one for one in experiments if one.drive is not None and model.base == "oscillator"]
    signs = [_sign(model, one) for one in driven]
    if not signs or any(sign != -1.0 for sign in signs):
        return tuple(experiments)
    log.warning("%s: the force is counted against the motion; it is turned round", driven[0].name)
    return tuple(one.with_reversed_input() if one in driven else one for one in experiments)


def _sign(model: Model, experiment: Experiment) -> float:
    """The sign that mass, damping and stiffness have in common by the strongest mode of a recording, 0 where they have
    none."""
    found = _of_strongest_mode(model, [experiment], list(ORDER[model.base]))
    signs = {float(np.sign(value)) for value in found.values()}
    return signs.pop() if len(signs) == 1 else 0.0


def _of_strongest_mode(model: Model, experiments: Sequence[Experiment], wanted: Sequence[str]) -> dict[str, float]:
    """The parameters that are ``wanted``, beside the strongest line in the spectrum of the output of the first
    recording; {} where it has none."""
    column, usable = _output(model, experiments)
    line = spectral_lines(usable[0].measured[column], usable[0].rate_hz)[:1] if column else ()
    band = (line[0] / BESIDE_LINE, line[0] * BESIDE_LINE) if line else (0.0, 0.0)
    return _estimates(model, usable, ORDER[model.base], wanted, band) if line else {}


def strongest_mode(model: Model, experiments: Sequence[Experiment]) -> Model | None:
    """The model with the mass, damping and stiffness of the strongest mode, as another mode biases those of
    ``from_spectra``; of a free motion with its stiffness and rest.  None where these are not physical."""
    wanted = [
        name for name in ORDER.get(model.base, {}) if name in model.parameters and not model.parameters[name].fixed
    ]
    if model.base != "oscillator" or not wanted:
        return None
    if all(one.drive is None for one in experiments):
        return _of_free_motion(model, experiments[0])
    values = _of_strongest_mode(model, experiments, wanted)
    return model.replace(values) if values and min(values.values()) > 0 else None


def _of_free_motion(model: Model, experiment: Experiment) -> Model | None:
    """The model with k = m (2 pi f)², f being the strongest line in the spectrum of the output, and at rest at its
    mean; None without a line, or with a stiffness that is given.  The acceleration of an angle that is read 10 000
    times a second in steps of 0.16 mrad is noise: a fit to that of a pendulum of 1.3 Hz had one of 23 Hz."""
    column = next(name for name in OUTPUTS["oscillator"] if name in experiment.measured)
    lines = spectral_lines(experiment.measured[column], experiment.rate_hz)
    if not lines or model.parameters["k"].fixed:
        return None
    k = model.parameters["m"].value * (2 * np.pi * lines[0]) ** 2
    rest = float(np.nanmean(experiment.measured[column])) if column == "displacement" else 0.0
    return model.replace({"k": k, **({} if model.parameters["bias"].fixed else {"bias": k * rest})})


def from_spectra(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with its free linear parameters estimated: m q'' + b q' + k q = F, J theta_2'' + a weight = tau.

    Of an acceleration a the same equation is fitted, twice differentiated: m a'' + b a' + k a = F''.
    Unchanged where input or output was not recorded, or where the estimates are not physical.
    """
    orders = {name: order for name, order in ORDER.get(model.base, {}).items() if name in model.parameters}
    wanted = [name for name in orders if not model.parameters[name].fixed]
    column, usable = _output(model, experiments)
    if not column or not wanted:
        return model
    values = _estimates(model, usable, orders, wanted)
    return model.replace({name: value for name, value in values.items() if value > 0})


def _output(model: Model, experiments: Sequence[Experiment]) -> tuple[str, list[Experiment]]:
    """The most direct column of the output, "" for none, and the experiments that have it and an input."""
    found = [name for name in OUTPUTS.get(model.base, {}) if any(name in one.measured for one in experiments)]
    usable = [one for one in experiments if found and one.drive is not None and found[0] in one.measured]
    return (found[0], usable) if usable else ("", [])


def _estimates(
    model: Model,
    usable: Sequence[Experiment],
    orders: Mapping[str, int],
    wanted: Sequence[str],
    band: Band = (0.0, np.inf),
) -> dict[str, float]:
    """The parameters that are ``wanted``, by least squares in a band; {} where it has too few bins."""
    column, outputs = _output(model, usable)[0], OUTPUTS[model.base]
    blocks = [_spectra(one, column, outputs[column], BESIDE.get(model.base, ()), band) for one in usable]
    force, *motion = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    derivatives, beside = motion[:3], motion[3:]
    known = sum(
        model.parameters[name].value * derivatives[order] for name, order in orders.items() if name not in wanted
    )
    A, y = np.stack([*(derivatives[orders[name]] for name in wanted), *beside], axis=1), force - known
    if y.size < LEAST_BINS:
        return {}
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    found = np.linalg.lstsq(np.vstack([A.real, A.imag]) / size, np.concatenate([y.real, y.imag]))[0] / size
    return dict(zip(wanted, found[: len(wanted)].tolist(), strict=True))


def _spectra(
    experiment: Experiment, column: str, order: int, functions: Sequence[Callable[[FloatArray], FloatArray]], band: Band
) -> list[Spectrum]:
    """The spectra, at the frequencies of a band [Hz] at which the output exceeds its noise, of the force's derivative
    of this order; of the output, its first and its second derivative; and of functions of the output.

    All use the same taper w, which is zero at both ends together with its slope, so that integration by parts is exact:
    int w e^-st x'' dt = int (w'' - 2 s w' + s^2 w) e^-st x dt.
    """
    assert experiment.drive is not None
    time = np.arange(experiment.time[0], experiment.time[-1], 1 / experiment.rate_hz)
    x = experiment.interpolated(column, time)
    force = experiment.drive.position(time)
    turn = 2 * np.pi / (time[-1] - time[0])
    angle = turn * (time - time[0])
    w, slope, bend = 0.5 - 0.5 * np.cos(angle), 0.5 * turn * np.sin(angle), 0.5 * turn**2 * np.cos(angle)
    s = 2j * np.pi * np.fft.rfftfreq(time.size, 1 / experiment.rate_hz)
    others = [np.fft.rfft(w * function(x)) for function in functions]

    def derivatives(values: FloatArray) -> list[Spectrum]:
        tapered, sloped, bent = (np.fft.rfft(weight * values) for weight in (w, slope, bend))
        return [tapered, s * tapered - sloped, s**2 * tapered - 2 * s * sloped + bent]

    motion = derivatives(x - x.mean())
    power = np.abs(motion[0]) ** 2
    clear = power > CLEAR * float(np.median(power[3 * power.size // 4 :]))
    clear[:2] = False  # the main lobe of the taper, where a constant force shows
    clear &= (band[0] * 2 * np.pi <= s.imag) & (s.imag <= band[1] * 2 * np.pi)
    return [spectrum[clear] for spectrum in (derivatives(force)[order], *motion, *others)]


def usual_torque(model: Model, experiment: Experiment) -> float:
    """Root mean square of the torque that drives a joint or servo at the measured angles [N m]; 0 without an input."""
    if experiment.drive is None or "position" not in experiment.measured:
        return 0.0
    drive = experiment.drive.position(experiment.time)
    if model.base == "servo":
        v = {name: p.value for name, p in experiment.model(model).parameters.items()}
        duty = v["kp"] * v["error_gain"] * (drive - experiment.measured["position"])
        drive = v["kt"] * v["U"] / v["R"] * np.clip(duty, -v["cap"], v["cap"])
    return rms(drive)


MOST = 6
"""Largest number of lines."""
APART = 0.1
"""Width of a line, as a share of its frequency."""
CLEAR_LINE = 100.0
"""Times the noise, the median over all frequencies: the largest of 10 000 bins of white noise is ten times its mean."""


def spectral_lines(values: FloatArray, rate_hz: float) -> tuple[float, ...]:
    """The frequencies [Hz] of at most ``MOST`` lines in the spectrum of values (N,), NaN where not sampled, the
    strongest first."""
    from scipy.signal import periodogram

    known = np.isfinite(values)
    there = np.interp(np.arange(values.size), np.flatnonzero(known), values[known])
    spectrum: tuple[FloatArray, FloatArray] = periodogram(  # type: ignore[call-overload]  # the stubs lack "linear"
        there, rate_hz, "blackmanharris", detrend="linear"
    )
    frequency, power = spectrum
    inner = power[1:-1]
    peaks = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > CLEAR_LINE * np.median(power)))
    found: list[float] = []
    for at in peaks[np.argsort(-power[peaks])]:
        if all(abs(frequency[at] - one) > APART * one for one in found):
            found.append(float(frequency[at]))
    return tuple(found[:MOST])
