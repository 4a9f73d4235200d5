"""What the lab decides by stands in one file, each constant with its reason; its other numbers do not decide."""

from __future__ import annotations

import ast
from pathlib import Path

from lostmotion.lab import policy

LAB = Path(policy.__file__).parent
NUMERICS = {
    "commands/output.py": (1, "digits of a file"),
    "commands/options.py": (1, "units of time"),
    "commands/terminal.py": (3, "size of a plot, rows of a table"),
    "commands/table.py": (1, "width of a table"),
    "comparison/bands.py": (3, "resolution of a spectrum that is shown"),
    "comparison/compare.py": (2, "what is described, what is worth a word in a sentence"),
    "comparison/phases.py": (9, "what the phases of a motion are called"),
    "comparison/residual_analysis.py": (1, "resolution of what is shown"),
    "data/blocks.py": (1, "draws of signs"),
    "data/autoregression.py": (8, "a robust regression"),
    "data/degrees.py": (2, "which motions may tell the unit of an angle, and by how much"),
    "data/energy.py": (5, "what is driven, and the places and passages that are looked at"),
    "data/excerpt.py": (1, "length of windows"),
    "data/checks.py": (6, "what is no recording"),
    "data/frequency_response.py": (8, "estimators of first values"),
    "data/noise.py": (11, "an estimator of the noise, each number with its measured error"),
    "data/rounded_input.py": (7, "a penalised spline, each number with its measured error; what is a step"),
    "data/readings.py": (13, "what is a reading that is repeated or lost, a jump of a counter or a turn, a second"),
    "data/series.py": (2, "what is one direction"),
    "data/step_start.py": (5, "what is a start from rest"),
    "data/supply.py": (4, "which of two things a voltage is; the margins are measured"),
    "data/whiteness.py": (3, "lags, rank of a matrix, length of a block"),
    "data/stand_ins.py": (3, "what is the second derivative of other readings"),
    "design/next_experiment.py": (3, "the motions that are proposed, and what is no motion"),
    "discrepancy/basis.py": (5, "grid of an unknown function"),
    "discrepancy/describe.py": (3, "what a curve is drawn with"),
    "discrepancy/residual_maps.py": (2, "resolution of what is shown"),
    "discrepancy/wave.py": (4, "frequencies of a sine"),
    "fitting/fit.py": (3, "steps and number of refinements, floor and lags of a covariance"),
    "fitting/strategy.py": (15, "grids of first values, convergence and length of segments"),
    "gears/explain.py": (1, "what a step costs"),
    "gears/input_error.py": (1, "share of an error that is small beside the noise"),
    "gears/score_test.py": (1, "draws of a bootstrap"),
    "gears/trials.py": (1, "steps of a fit"),
    "gears/unseen.py": (1, "steps of a fit"),
    "inverse/candidates.py": (6, "first values and steps of a fit, range of noise"),
    "inverse/first_values.py": (5, "zero angles, rounding, a small part of an effect, first values, shares of a step"),
    "inverse/explain.py": (2, "what is drawn, and which motor is told"),
    "inverse/output_error.py": (9, "length, horizons, rate and integration step of what is simulated"),
    "inverse/problem.py": (4, "convergence of a fixed-point iteration, freedom of an angle, a bound"),
    "inverse/free_parameters.py": (5, "a finite difference, scales, a weak prior, bounds"),
    "inverse/regression.py": (7, "a minimiser; rank of a matrix, leverage of a block; samples and step of a trial run"),
    "inverse/saturation.py": (2, "delays that are tried, and how far away a limit is that should not act"),
    "inverse/channel.py": (5, "grids of bands and delays, and blocks; what a motor that is switched tells"),
    "inverse/release.py": (
        10,
        "local polynomials, times of release, what is no error, parts of a period, top of a speed",
    ),
    "inverse/modes.py": (3, "modes of model and catalogue, and harmonics"),
    "inverse/signals.py": (12, "filters and splines"),
    "inverse/zero_phase.py": (1, "the order of a filter"),
    "inverse/torques.py": (2, "width of a smoothed sign"),
    "models/simulate.py": (4, "a simulation's length and check"),
    "observer/descent.py": (4, "steps of a minimiser"),
    "observer/filter.py": (5, "gains of observers"),
    "observer/global_search.py": (19, "an evolution: its populations, generations and widths"),
    "observer/objective.py": (9, "what observers are run on, and a robust cost"),
    "parallel.py": (2, "waiting times"),
    "quantity.py": (3, "digits, the smallest probability that is shown"),
    "shooting/continuation.py": (4, "length of the first segments, a robust cost"),
    "shooting/initial_guess.py": (1, "a finite difference"),
    "shooting/initial_state.py": (5, "grids of first values, steps of a fit"),
    "shooting/least_squares.py": (3, "a minimiser"),
    "shooting/parameters.py": (5, "weak priors, rounding"),
    "shooting/segment.py": (4, "finite differences"),
    "shooting/task.py": (5, "integration steps, and the noise that hides their errors"),
}
"""How many numbers each other module of the lab has, and what they are for."""
MOST = 42


def is_number(value: ast.expr) -> bool:
    """Whether an expression holds numbers only."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return is_number(value.left) and is_number(value.right)
    parts: list[ast.expr] = []
    if isinstance(value, ast.Tuple | ast.List):
        parts = value.elts
    elif isinstance(value, ast.Dict | ast.Call):
        parts = value.values if isinstance(value, ast.Dict) else value.args
    return bool(parts) and all(map(is_number, parts))


def numbers(path: Path) -> list[str]:
    """The names of a module's constants that are numbers."""
    found = []
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            target = node.targets[0] if isinstance(node, ast.Assign) else node.target
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            if is_number(node.value) and (len(names) == 1 or len(names) == len(values)):
                found += [ast.unparse(name) for name in names]
    return found


def test_a_policy_of_few_constants() -> None:
    """There are no more than 42, and each is one of them once."""
    names = numbers(LAB / "policy.py")
    assert len(set(names)) == len(names) <= MOST


def test_each_constant_says_what_it_decides() -> None:
    """Behind each stands a sentence."""
    body = ast.parse((LAB / "policy.py").read_text()).body
    for before, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(before, ast.Assign):
            assert isinstance(after, ast.Expr), ast.unparse(before)
            assert isinstance(after.value, ast.Constant)
            assert len(str(after.value.value)) > 30, ast.unparse(before)


def test_each_constant_is_used() -> None:
    """Outside of the policy, by its name there."""
    text = "".join(path.read_text() for path in LAB.rglob("*.py"))
    assert [name for name in numbers(LAB / "policy.py") if f"policy.{name}" not in text] == []


def test_no_other_module_decides() -> None:
    """The numbers of the others are those that have been looked at and found to be numerics, or words and pictures."""
    paths = {path.relative_to(LAB).as_posix(): path for path in LAB.rglob("*.py")}
    others = {
        name: path for name, path in paths.items() if not name.startswith(("report/", "policy.py", "models/own/"))
    }
    found = {name: len(many) for name, path in others.items() if (many := numbers(path))}
    assert found == {name: count for name, (count, _) in NUMERICS.items()}, "is a new one of them for lab/policy.py?"
