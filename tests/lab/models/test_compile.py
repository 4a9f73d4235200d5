"""A search compiles before its time begins."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import time
import numpy as np
from numba.core import event
from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explanation, open_executor
from lostmotion.model import build_model

spent, depth, ready = {False: 0.0, True: 0.0}, [], []

class Listener(event.Listener):
    def on_start(self, what):
        depth.append(time.process_time())

    def on_end(self, what):
        began = depth.pop()
        if not depth:
            spent[bool(ready)] += time.process_time() - began

event.register("numba:compile", Listener())
kept = explanation.compile_kernels
explanation.compile_kernels = lambda *given, **how: (kept(*given, **how), ready.append(True))
times = np.arange(0.0, 3.0, 0.02)
columns = {"command": 0.5 * np.sin(4 * times), "position": 0.45 * np.sin(4 * times - 0.2)}
with open_executor("threads:1") as pool:
    servo = build_model("servo")
    explanation.explain(servo, experiments(servo, [Recording(times, columns)]), pool, budget_s=2.0)
print(spent[False], spent[True])
"""


@pytest.mark.slow
def test_a_search_compiles_before_its_time_begins(tmp_path: Path) -> None:
    """On a machine that has compiled nothing, the integrator of a servo is ready when the search begins."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, env=environment, check=True, timeout=300
    )
    before, within = map(float, done.stdout.split())
    assert before > 3 * within > 0
