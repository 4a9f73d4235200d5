"""What numba compiles, compiled once before the workers of the tests start: each of them would do it for itself, at the
same time, for a minute.  The machine code is kept on disk."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np

from lostmotion.model import ModelError, build_model, catalogue
from lostmotion.model.motion import Sine

__all__ = ["compile_models"]

TIMES = np.arange(20) / 1000


def compile_models() -> None:
    """All of it, in two processes: the filter takes as long as the rest."""
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for job in [pool.submit(compile_filter), pool.submit(compile_kernels)]:
            job.result()


def compile_kernels() -> None:
    """Solver, observer, and every base and effect."""
    drive = Sine(0.1, 1.0)
    outputs = {"play": "accel", "oscillator": "displacement", "joint": "position", "servo": "position"}
    for base, output in outputs.items():
        plain = build_model(base)
        plain.simulate(drive, TIMES)
        start = plain.initial_state(drive)
        plain.prepare(drive, TIMES, [output], 0.0)(start[None, :], 1e-4)
        if base == "play":
            plain.observer(drive, TIMES, output, 0.0)(start, np.zeros(start.size), np.zeros(TIMES.size), 1e-4)
        for effect in catalogue():
            try:
                build_model(base, [effect.id]).simulate(drive, TIMES)
            except ModelError:  # an effect of another base
                continue


def compile_filter() -> None:
    """The cubature filter of the lab."""
    from lostmotion.lab.discrepancy.input_estimation import InputProcess
    from tests.lab.discrepancy.test_cubature import tracker

    tracker(np.zeros(TIMES.size)).run(InputProcess("oscillator", 1.0, 0.1, 1e-3))


if __name__ == "__main__":
    compile_models()
