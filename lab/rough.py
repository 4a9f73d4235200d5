"""Rough inertia, damping and stiffness from the spectra of input and output, before anything is simulated.

Recordings come in volts, newtons or newton metres: what a model's file says may be off by many orders of magnitude,
and no fit finds its way from there.  Every equation of motion is linear in these parameters, and what friction adds is
in phase with speed, so that least squares in the frequency domain gives them well enough to begin with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from lostmotion.lab.experiment import Experiment
from lostmotion.model import Model
from lostmotion.model.motion import FloatArray

__all__ = ["from_spectra", "usual_torque"]

Spectrum = NDArray[np.complex128]
ORDER: Mapping[str, Mapping[str, int]] = {
    "oscillator": {"m": 2, "b": 1, "k": 0},
    "joint": {"J": 2, "viscous_friction.b_v": 1},
}
"""By base, the parameters that a model may have and which derivative of the output each multiplies."""
OUTPUT = {"oscillator": "displacement", "joint": "position"}
CLEAR = 300.0
"""Times the power at the highest frequencies, which is noise: bins with more of it count."""
LEAST_BINS = 8


def from_spectra(model: Model, experiments: Sequence[Experiment]) -> Model:
    """The model with its free linear parameters estimated: m q'' + b q' + k q = F, J theta_2'' = tau.

    As it is where input or output was not recorded, or where nothing physical comes out.
    """
    orders = {name: order for name, order in ORDER.get(model.base, {}).items() if name in model.parameters}
    usable = [e for e in experiments if e.drive is not None and OUTPUT.get(model.base, "") in e.measured]
    wanted = [name for name in orders if not model.parameters[name].fixed]
    if not usable or not wanted:
        return model
    rows, targets = [], []
    for experiment in usable:
        force, motion, s = _spectra(experiment, OUTPUT[model.base])
        known = sum(model.parameters[name].value * s ** orders[name] * motion for name in orders if name not in wanted)
        rows.append(np.stack([s ** orders[name] * motion for name in wanted], axis=1))
        targets.append(force - known)
    A, y = np.concatenate(rows), np.concatenate(targets)
    if y.size < LEAST_BINS:
        return model
    size = np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(np.vstack([A.real, A.imag]) / size, np.concatenate([y.real, y.imag]))[0] / size
    return model.replace({name: float(value) for name, value in zip(wanted, found, strict=True) if value > 0})


def _spectra(experiment: Experiment, column: str) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Force, motion and s = i omega at the frequencies where the motion stands out from its noise."""
    values = experiment.measured[column]
    seen = ~np.isnan(values)
    time = np.arange(experiment.time[0], experiment.time[-1], 1 / experiment.rate_hz)
    motion = _tapered(np.interp(time, experiment.time[seen], values[seen]))
    assert experiment.drive is not None
    force = _tapered(experiment.drive.position(time))
    power = np.abs(motion) ** 2
    clear = power > CLEAR * float(np.median(power[3 * power.size // 4 :]))
    clear[:3] = False  # the taper's own
    s = np.asarray(2j * np.pi * np.fft.rfftfreq(time.size, 1 / experiment.rate_hz), dtype=np.complex128)
    return force[clear], motion[clear], s[clear]


def _tapered(values: FloatArray) -> Spectrum:
    return np.asarray(np.fft.rfft((values - values.mean()) * np.hanning(values.size)))


def usual_torque(model: Model, experiment: Experiment) -> float:
    """Root mean square of the torque that drives a joint or servo [N m], at the angles that were measured; else 0."""
    if experiment.drive is None or "position" not in experiment.measured:
        return 0.0
    drive = experiment.drive.position(experiment.time)
    if model.base == "servo":
        v = {name: p.value for name, p in experiment.model(model).parameters.items()}
        duty = v["kp"] * v["error_gain"] * (drive - experiment.measured["position"])
        drive = v["kt"] * v["U"] / v["R"] * np.clip(duty, -v["cap"], v["cap"])
    return float(np.sqrt(np.nanmean(drive**2)))
