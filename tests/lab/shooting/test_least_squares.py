"""Levenberg-Marquardt on straight lines with start values of their own, where the least squares are known."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from lostmotion.lab.shooting import least_squares
from lostmotion.lab.shooting.least_squares import START_PRIOR, Problem, Solution, _step, minimise
from lostmotion.lab.shooting.parameters import Unknowns
from lostmotion.lab.shooting.segment import Linearised
from lostmotion.model import Model, Parameter, build_model
from lostmotion.model.motion import FloatArray

MODEL = build_model("play", values={name: Parameter(p.value, p.unit, p.low, p.high, fixed=True)
                                    for name, p in build_model("play").parameters.items()
                                    if not (p.fixed or name in ("d", "b"))})  # fmt: skip
"""Two numbers are free, the play and the bar's damping."""
UNKNOWNS = Unknowns.of(MODEL)
RNG = np.random.default_rng(3)


@pytest.fixture(autouse=True)
def _lines_are_segments(monkeypatch: pytest.MonkeyPatch) -> None:
    """The residuals of lines, which nothing simulates."""

    def residuals(model: Model, segments: Sequence[Any], substep_s: float) -> list[FloatArray]:
        return [one.residual(model, one.start, substep_s) for one in segments]

    monkeypatch.setattr(least_squares, "residuals", residuals)


class Recorded:
    """An experiment that states nothing of the model."""

    @staticmethod
    def model(model: Model) -> Model:
        """The same."""
        return model


@dataclass(frozen=True, eq=False)
class Line:
    """A segment whose residual is target - A z - B start / scale + bend sin(z): linear but for the last part, and for
    an edge over which it jumps when its start moves."""

    target: FloatArray
    A: FloatArray
    B: FloatArray
    start: FloatArray
    scale: FloatArray
    bend: float = 0.0
    edge: float = 0.0
    experiment: Any = field(default_factory=Recorded)

    def starting(self, state: FloatArray) -> Line:
        """The same with another start."""
        return replace(self, start=state)

    def residual(self, model: Model, start: FloatArray, substep_s: float) -> FloatArray:
        """At the model's values."""
        return self._at(UNKNOWNS.z(model), start)

    def linearised(self, model: Model, unknowns: Unknowns, z: FloatArray, substep_s: float) -> Linearised:
        """With exact derivatives."""
        return Linearised(self._at(z, self.start), -self.A + self.bend * np.cos(z), -self.B)

    def _at(self, z: FloatArray, start: FloatArray) -> FloatArray:
        over = self.edge * float(np.any(start))
        return self.target - self.A @ z - self.B @ (start / self.scale) + self.bend * float(np.sum(np.sin(z))) + over


def lines(z: FloatArray, count: int = 3, noise: float = 0.0) -> list[Any]:
    """Segments of 30 samples with start states of their own, all beginning at zero, made from the parameters z."""
    made = []
    for _ in range(count):
        A, B = RNG.normal(size=(30, 2)), RNG.normal(size=(30, 3))
        target = A @ z + B @ RNG.normal(size=3) + noise * RNG.normal(size=30)
        made.append(Line(target, A, B, np.zeros(3), np.array([1e-4, 1e-2, 5.0])))
    return made


def problem(**given: Any) -> Problem:
    """The two free numbers with priors so wide that they have no say, centred on the model's values."""
    unknowns = replace(UNKNOWNS, prior=np.full(2, 1e4))
    return Problem(MODEL, unknowns, unknowns.z(MODEL), 1e-4, **given)


def home() -> FloatArray:
    """Where the model's values lie, (2,)."""
    return problem().centre


def total(given: Problem, z: FloatArray, made: Sequence[Any]) -> float:
    """Cost of the parameters and all segments."""
    return given.prior(z) + float(given.costs(z, made).sum())


def test_two_parameters_are_free() -> None:
    """What all tests here take for granted."""
    assert UNKNOWNS.names == ("d", "b")


def test_linear_problem_is_solved_at_once() -> None:
    """Parameters and all start states of a linear problem without noise, to the last digits, in a few steps."""
    true = home() + np.array([0.3, -0.4])
    made = lines(true)
    found = minimise(problem(), home(), made, iterations=8, tolerance=0.0)
    np.testing.assert_allclose(found.z, true, atol=1e-3)  # the priors' pull on the start states is left
    np.testing.assert_allclose(found.z, _dense(made), atol=1e-7)
    assert found.cost < 1e-5 * total(problem(), home(), made)


def test_a_start_at_an_edge_holds_up_no_others() -> None:
    """The segment that any step of its start makes worse keeps it; parameters and all other starts are found."""
    true = home() + np.array([0.3, -0.4])
    made = lines(true, count=8, noise=0.01)
    made[2] = replace(made[2], edge=1e3)
    found = minimise(problem(huber=3.0), home(), made)
    np.testing.assert_array_equal(found.segments[2].start, 0.0)
    np.testing.assert_allclose(found.z, true, atol=0.1)
    assert all(np.any(segment.start) for i, segment in enumerate(found.segments) if i != 2)


def _dense(made: list[Any]) -> FloatArray:
    """Parameters of the same least squares with priors on the start states, all unknowns in one matrix."""
    starts = 3 * len(made)
    rows = [np.hstack([line.A, np.kron(np.eye(len(made))[i], line.B)]) for i, line in enumerate(made)]
    prior = np.hstack([np.zeros((starts, 2)), np.eye(starts) / START_PRIOR])
    solved = np.linalg.lstsq(
        np.vstack([*rows, prior]), np.concatenate([*(line.target for line in made), np.zeros(starts)]), rcond=None
    )
    return np.asarray(solved[0][:2])


@pytest.mark.parametrize("damping", [0.0, 0.1, 3.0])
@pytest.mark.parametrize("huber", [math.inf, 0.8])
def test_elimination_gives_the_dense_step(huber: float, damping: float) -> None:
    """The step with start states eliminated segment by segment is that of the whole damped normal equations."""
    given, made = problem(huber=huber), lines(home() + 0.1, noise=1.0)
    blocks = [line.linearised(MODEL, given.unknowns, home(), 1e-4) for line in made]
    pull = [RNG.normal(size=3) for _ in made]
    dz, ds = _step(given, home(), blocks, pull, damping, given.unknowns.bounds)
    J = np.vstack([
        np.hstack([block.A, np.kron(np.eye(len(made))[i], block.B)]) for i, block in enumerate(blocks)
    ])  # fmt: skip
    r = np.concatenate([block.r for block in blocks])
    w = np.minimum(1.0, huber / np.abs(r))
    prior = np.concatenate([1 / given.unknowns.prior**2, np.full(3 * len(made), 1 / START_PRIOR**2)])
    H = J.T @ (w[:, None] * J) + np.diag(prior)
    H += damping * np.diag(np.diag(H))
    step = np.linalg.solve(H, -(J.T @ (w * r) + np.concatenate([np.zeros(2), *pull])))
    np.testing.assert_allclose(np.concatenate([dz, *ds]), step, rtol=1e-8, atol=1e-12)


def test_bounds_hold() -> None:
    """A play that wants to double stops at its bound; the other parameter then is the best one there."""
    model = MODEL.replace({"d": replace(MODEL.parameters["d"], high=1.1 * MODEL.parameters["d"].value)})
    given = replace(problem(), unknowns=replace(Unknowns.of(model), prior=np.full(2, 1e4)), model=model)
    made = lines(home() + np.array([math.log(2), 0.1]))
    found = minimise(given, home(), made, tolerance=0.0)
    assert found.z[0] == pytest.approx(home()[0] + math.log(1.1), abs=1e-9)
    held = [replace(line, target=line.target - line.A[:, 0] * found.z[0], A=line.A * [0, 1]) for line in made]
    inner = minimise(problem(), home(), held, tolerance=0.0)
    assert found.z[1] == pytest.approx(inner.z[1], abs=1e-4)


@pytest.mark.parametrize("bend", [0.0, 5.0, 80.0])
@pytest.mark.parametrize("iterations", [0, 1, 20])
def test_never_worse_than_given(bend: float, iterations: int) -> None:
    """However crooked the problem, the cost told is the one of what is returned, and not above that of the start."""
    made = [replace(line, bend=bend) for line in lines(home() + 1.0, noise=1.0)]
    for huber in (math.inf, 2.0):
        given = problem(huber=huber)
        found: Solution = minimise(given, home() - 0.7, made, iterations=iterations)
        assert found.cost <= total(given, home() - 0.7, made)
        assert found.cost == pytest.approx(total(given, found.z, found.segments), rel=1e-12)


def test_what_cannot_be_run_is_left_alone() -> None:
    """From a start of infinite cost nothing moves, and the cost says so."""
    made = lines(home())
    made[1] = replace(made[1], target=np.full(30, np.inf))
    found = minimise(problem(), home(), made)
    assert found.cost == math.inf
    np.testing.assert_array_equal(found.z, home())


def test_outliers_have_little_say() -> None:
    """One sample in thirty that is far off moves the parameters ten times less when residuals are bounded."""
    true = home() + 0.2
    made = lines(true, count=6, noise=0.1)
    for line in made:
        line.target[4] += 200.0
    errors = [
        float(np.linalg.norm(minimise(problem(huber=huber), home(), made, iterations=60, tolerance=1e-9).z - true))
        for huber in (0.3, math.inf)
    ]
    assert errors[0] < 0.1
    assert errors[0] < errors[1] / 10
