"""The bar's length and resonance against SciPy's roots of the frequency equation, and a finite-element bar."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq, minimize_scalar

from lostmotion.detector.cantilever import MATERIALS, Beam, dunkerley, frequencies, length_for, rectangle, rod
from tests.conftest import ROOT
from tests.daemon.cli_world import call, is_one_line

STEEL = rectangle(MATERIALS["steel"], 10e-3, 1e-3)
PAGE = ROOT / "docs" / "building.md"


def exact(beam: Beam, length: float, tip: float) -> float:
    """The first resonance [Hz]: SciPy's root of the determinant of the four boundary conditions, as it stands."""

    def determinant(x: float) -> float:
        c, s, ch, sh = math.cos(x), math.sin(x), math.cosh(x), math.sinh(x)
        mu = tip / (beam.mass * length)
        bent = [c + ch, s + sh]
        sheared = [s - sh + mu * x * (c - ch), -c - ch + mu * x * (s - sh)]
        return bent[0] * sheared[1] - bent[1] * sheared[0]

    x = brentq(determinant, 1e-3, 1.8752, xtol=1e-14)
    return float(x**2 * math.sqrt(beam.stiffness / beam.mass) / length**2 / math.tau)


def by_elements(beam: Beam, length: float, tip: float, count: int = 40) -> NDArray[np.float64]:
    """The resonances [Hz] of a bar of Hermite elements with a mass at its end."""
    h = length / count
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
                  [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]])  # fmt: skip
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h],
                  [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])  # fmt: skip
    stiffness, mass = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for i in range(0, 2 * count, 2):
        stiffness[i : i + 4, i : i + 4] += beam.stiffness / h**3 * k
        mass[i : i + 4, i : i + 4] += beam.mass * h / 420 * m
    mass[-2, -2] += tip
    return np.asarray(np.sqrt(eigh(stiffness[2:, 2:], mass[2:, 2:], eigvals_only=True)[:2]) / math.tau)


@pytest.mark.parametrize("tip", [0.0, 1e-3, 5e-3, 12e-3, 0.2])
def test_both_resonances(tip: float) -> None:
    """The first within 1e-9 of SciPy's root, both within 1e-4 of a bar of forty finite elements."""
    found = frequencies(STEEL, 0.1, tip)
    assert found[0] == pytest.approx(exact(STEEL, 0.1, tip), rel=1e-9)
    assert found == pytest.approx(by_elements(STEEL, 0.1, tip), rel=1e-4)


def test_a_bare_bar_has_the_formula_of_the_page() -> None:
    """f = 1.8751²/2pi sqrt(E I / (m' L⁴)): 81.54 Hz for steel of 100 x 10 x 1 mm."""
    inertia, area = 10e-3 * 1e-3**3 / 12, 10e-3 * 1e-3
    formula = 1.8751**2 / math.tau * math.sqrt(200e9 * inertia / (7850 * area * 0.1**4))
    assert formula == pytest.approx(81.54, abs=0.01)
    assert frequencies(STEEL, 0.1)[0] == pytest.approx(formula, rel=1e-4)


def test_the_errors_of_dunkerley_and_rayleigh_are_as_stated() -> None:
    """Dunkerley is 0.37 % too low at worst, at a mass ratio of a quarter; Rayleigh's 33/140 up to 1.5 % too high."""

    def error(ratio: float, own: float) -> float:
        tip = ratio * STEEL.mass * 0.1
        spring = 3 * STEEL.stiffness / 0.1**3
        return math.sqrt(spring / (own * STEEL.mass * 0.1 + tip)) / math.tau / exact(STEEL, 0.1, tip) - 1

    worst = minimize_scalar(lambda ratio: error(ratio, 3 / 1.8751040687**4), bounds=(0.01, 10), method="bounded")
    assert worst.fun == pytest.approx(-0.0037, abs=5e-5)
    assert worst.x == pytest.approx(0.24, abs=0.02)
    assert dunkerley(STEEL, 0.1, worst.x * STEEL.mass * 0.1) / exact(STEEL, 0.1, worst.x * STEEL.mass * 0.1) - 1 == (
        pytest.approx(worst.fun, rel=1e-3)
    )
    assert max(error(ratio, 33 / 140) for ratio in np.geomspace(1e-6, 100, 100)) == pytest.approx(0.0147, abs=2e-4)


def test_the_table_of_the_page() -> None:
    """Every length of docs/building.md rings at its frequency within half a millimetre, by SciPy's root."""
    from bench import building  # late: it draws, and each worker of the tests reads this file

    rows = re.findall(r"^\| (.+?) \| (\d+) g \| (.+) \|$", PAGE.read_text(), re.MULTILINE)
    assert len(rows) == 9
    for name, grams, cells in rows:
        beam, tip = building.SECTIONS[name], float(grams) * 1e-3
        for f_res_hz, cell in zip(building.FREQUENCIES_HZ, cells.split(" | "), strict=True):
            length = float(cell) * 1e-3
            assert exact(beam, length + 0.51e-3, tip) < f_res_hz < exact(beam, length - 0.51e-3, tip)


def test_the_command_tells_the_length() -> None:
    """The length found rings at the requested frequency; a given length gives the frequency back."""
    common = ("--material", "carbon", "--diameter", "3mm", "--tip", "5g", "--json")
    result = json.loads(call("calibrate", "bar", *common, "--frequency", "58").stdout)
    beam = rod(MATERIALS["carbon"], 3e-3)
    assert exact(beam, result["length_m"], 5e-3) == pytest.approx(58, rel=1e-9)
    assert result["least_rate_hz"] == pytest.approx(464)
    assert result["length_m"] == length_for(beam, 58, 5e-3)
    back = json.loads(call("calibrate", "bar", *common, "--length", f"{result['length_m']}m").stdout)
    assert back["f_res_hz"] == pytest.approx(58, rel=1e-9)


def test_the_page_shows_what_the_command_prints() -> None:
    """The answer in docs/building.md is that of its first command."""
    command = re.search(r"^\$ lostmotion (.*)$", PAGE.read_text(), re.MULTILINE)
    assert command
    assert call(*command[1].split()).stdout in PAGE.read_text()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--width", "10", "--thickness", "1mm", "--frequency", "60"), "expected a number and a unit"),
        (("--width", "10mm", "--frequency", "60"), "--diameter of a rod"),
        (("--width", "10mm", "--thickness", "1mm"), "--frequency and --length"),
        (("--width", "0mm", "--thickness", "1mm", "--frequency", "60"), "between 0 and 1 m"),
        (("--width", "10mm", "--thickness", "1mm", "--frequency", "1e9"), "take another one"),
        (("--width", "10mm", "--thickness", "1mm", "--length", "0mm"), "above 0"),
    ],
)
def test_wrong_calls_are_refused(arguments: tuple[str, ...], words: str) -> None:
    """One line, status 2, with what was expected."""
    assert is_one_line(call("calibrate", "bar", *arguments), words)


def test_a_stubby_bar_is_warned_of() -> None:
    """A bar of 5 mm by 1 mm is no cantilever of Euler's and Bernoulli's."""
    result = call("calibrate", "bar", "--width", "10mm", "--thickness", "1mm", "--length", "5mm")
    assert "5.0 times as long as thick" in result.stderr
    assert "--tip is not given, so this is the bare bar" in result.stderr
    assert "--tip" not in call("calibrate", "bar", "--diameter", "3mm", "--length", "90mm", "--tip", "0g").stderr
