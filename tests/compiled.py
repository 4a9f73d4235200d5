"""What numba and Python compile, compiled once before the workers of the tests start: each of them would do it for
itself, at the same time.  The machine code and the modules are kept on disk."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from lostmotion.lab.data.experiment import Experiment
from lostmotion.lab.inverse.signals import Signals
from lostmotion.lab.inverse.torques import acceleration
from lostmotion.model import ModelError, build_model, catalogue
from lostmotion.model.motion import Sine
from lostmotion.model.observer import follow

__all__ = ["compile_models", "compile_tests"]

TIMES = np.arange(20) / 1000


@contextmanager
def compile_tests() -> Iterator[None]:
    """In a fresh clone the tests' own modules, beside what is done meanwhile: 12.6 s of processor time, and 5.7 s when
    they are there, which six workers would need."""
    folder = Path(__file__).parent
    if (folder / "lab" / "__pycache__").exists() or sys.dont_write_bytecode:
        yield
        return
    collect = [sys.executable, "-m", "pytest", "-q", "--collect-only", "-p", "no:cacheprovider", str(folder)]
    with subprocess.Popen(collect, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as collecting:
        yield
        collecting.wait()


def compile_models() -> None:
    """Solver, observer, every base and effect, the filter and the equation of motion of the lab: 16 s of processor
    time in a fresh clone, half of them for the solver's one function."""
    drive = Sine(0.1, 1.0)
    outputs = {"play": "accel", "oscillator": "displacement", "joint": "position", "servo": "position"}
    for base, output in outputs.items():
        plain = build_model(base)
        plain.simulate(drive, TIMES)
        start = plain.initial_state(drive)
        plain.prepare(drive, TIMES, [output], 0.0)(start[None, :], 1e-4)
        if base == "play":
            run = plain.observer(drive, TIMES, output, 0.0)
            follow([run], start[None], np.zeros((1, start.size)), np.zeros(TIMES.size), 1e-4)
        for effect in catalogue():
            try:
                build_model(base, [effect.id]).simulate(drive, TIMES)
            except ModelError:  # an effect of another base
                continue
    long = np.arange(400) / 100
    swing = Signals.of(Experiment("", None, long, {"position": np.sin(6 * long)}))
    for effects in ([], ["presliding_friction"]):
        acceleration(build_model("joint", effects), swing, swing.torque)
