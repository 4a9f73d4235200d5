"""Recordings of one question that are of different machines: masses on springs and robot joints, in closed form."""

from __future__ import annotations

import logging
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lostmotion.drivers.recording import Recording
from tests.lab.inverse.test_inverse import explained, robot

NOISE_M = 2e-4
SAID = "were they recorded on different machines"


def mass(seed: int, hz: float, damping: float = 0.05) -> Recording:
    """A mass on a spring that is let go, in closed form."""
    times, w = np.arange(0.0, 4.0, 0.01), 2 * np.pi * hz
    swing = 0.05 * np.exp(-damping * w * times) * np.cos(w * np.sqrt(1 - damping**2) * times)
    noise = NOISE_M * np.random.default_rng(seed).standard_normal(times.size)
    return Recording(times, {"displacement": swing + noise}, name=f"m{seed}.csv")


@pytest.mark.parametrize(
    ("frequencies", "said"), [((3.0, 3.0, 3.0), ""), ((3.0, 3.0, 2.6), r"k is 133 N/m in \S*m2.csv and 178 in")]
)
def test_masses_on_springs(
    frequencies: tuple[float, ...], said: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The spring that is another one is told with its stiffness; equal ones are not told."""
    with caplog.at_level(logging.WARNING):
        explained(
            tmp_path, 'base = "oscillator"\n[parameters]\nm = 0.5\n', [mass(*each) for each in enumerate(frequencies)]
        )
    assert (SAID in caplog.text) is bool(said)
    assert re.search(said, caplog.text)


@pytest.mark.slow
@pytest.mark.parametrize("inertia", [1.0, 2.5])
def test_joints_of_robots(inertia: float, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Of one robot nothing is told; of another one, whose torques are larger, it is told that it is another one."""
    recordings = [replace(robot(seed), name=f"r{seed}.csv") for seed in (1, 2, 3)]
    heavy = {**recordings[1].columns, "torque": inertia * recordings[1].columns["torque"]}
    with caplog.at_level(logging.WARNING):
        explained(tmp_path, 'base = "joint"\n', [recordings[0], replace(recordings[1], columns=heavy), recordings[2]])
    assert (SAID in caplog.text) is (inertia > 1)


@pytest.mark.slow
def test_another_zero_of_the_torque(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """What differs is told by what it changes: a constant of 2 N m, and no friction that takes its place."""
    recordings = [replace(robot(seed), name=f"r{seed}.csv") for seed in (1, 2, 3)]
    moved = {**recordings[1].columns, "torque": recordings[1].columns["torque"] + 20.0}
    with caplog.at_level(logging.WARNING):
        explained(tmp_path, 'base = "joint"\n', [recordings[0], replace(recordings[1], columns=moved), recordings[2]])
    assert re.search(r"bias is \S+ N m in \S*r\d.csv and \S+ in \S*r\d.csv; were they recorded on", caplog.text)
