"""A search compiles before its time begins."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import gc
import numpy as np
from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explanation, open_executor
from lostmotion.model import build_model
from lostmotion.model.kernel import Kernel
from lostmotion.model.solve import integrate

def ready():
    kernels = {one.function.__name__ for one in gc.get_objects() if type(one) is Kernel and "address" in vars(one)}
    return kernels | {"integrate"} if integrate.signatures else kernels

before, kept = [], explanation.compile_kernels
explanation.compile_kernels = lambda *given, **how: (kept(*given, **how), before.append(ready()))
times = np.arange(0.0, 3.0, 0.02)
columns = {"command": 0.5 * np.sin(4 * times), "position": 0.45 * np.sin(4 * times - 0.2)}
with open_executor("threads:1") as pool:
    servo = build_model("servo")
    explanation.explain(servo, experiments(servo, [Recording(times, columns)]), pool, budget_s=2.0)
print(len(before[0]), "integrate" in before[0], sorted(ready() - before[0]))
"""


@pytest.mark.slow
def test_a_search_compiles_before_its_time_begins() -> None:
    """In a process that has compiled nothing, nor loaded it from the disk, the integrator and the kernels of all
    candidates for a servo are ready when the search begins, and none is added by it."""
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, timeout=300)
    count, integrator, later = done.stdout.split(maxsplit=2)
    assert int(count) > 10
    assert (integrator, later.strip()) == ("True", "[]")
