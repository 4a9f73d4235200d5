"""What `lab explain` says of driven motions: ``python -m bench.driven_motions [--seed 400] [--count 1]``.

Joints under a controller by torque and angle, servos by goal and angle, and masses on springs by force and place or
acceleration (``bench.driven_systems``).  Each case hides one effect of the catalogue, two, or none, and gives three
recordings with different motions.  Gears are in ``bench.hidden_effects``, what moves freely in ``bench.free_motions``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.driven_systems import SYSTEMS
from lostmotion.drivers.errors import LostmotionError
from lostmotion.drivers.recording import Recording
from lostmotion.lab import experiments, explain, open_executor
from lostmotion.lab.results import Explanation
from lostmotion.model import ModelError, build_model

__all__ = ["Case", "main"]

HIDDEN = {
    "joint": ("none", "viscous_friction", "coulomb_friction", "viscous_friction+coulomb_friction", "gravity_torque",
              "gravity_torque+coulomb_friction", "quadratic_damping", "torque_ripple", "load_dependent_friction",
              "stribeck_friction", "spring_torque", "friction_behind_play",
              "friction_behind_play+coulomb_friction"),
    "servo": ("none", "coulomb_friction", "gravity_torque", "gravity_torque+coulomb_friction",
              "load_dependent_friction", "torque_ripple", "command_delay", "actuator_lag", "quadratic_damping",
              "velocity_limit"),
    "oscillator": ("none", "coulomb_friction", "hardening_spring", "quadratic_damping", "second_mode", "sensor_lag",
                   "clock_skew", "bias_drift", "sensor_saturation"),
}  # fmt: skip
GIVEN = {"servo": ("viscous_friction",)}
"""What the model file has beside the base."""
OUTCOMES = ("right", "alike", "more", "part", "nothing", "wrong", "failed")
BUDGET_S = 180.0


@dataclass(frozen=True)
class Case:
    """What is hidden in which base: effects joined by "+", or none."""

    base: str
    hidden: str
    seed: int

    @property
    def effects(self) -> tuple[str, ...]:
        """Their names."""
        return () if self.hidden == "none" else tuple(self.hidden.split("+"))

    def recordings(self) -> list[Recording]:
        """Three of one system."""
        rng = np.random.default_rng((self.seed, *self.base.encode(), *self.hidden.encode()))
        system = SYSTEMS[self.base].drawn(rng, self.effects)
        return [system.record(np.random.default_rng((self.seed, at, 7)), f"{at}.csv") for at in range(3)]

    def outcome(self, found: Explanation) -> str:
        """One of OUTCOMES: "alike" where all that is missing is named or reported as not distinguished from a name."""
        wanted, named = set(self.effects), set(found.missing)
        if named == wanted:
            return "right" if named or found.complete else "more"
        alike = {name for group in found.confusable for name in group}
        if wanted <= named | alike and len(named) == len(wanted):
            return "alike"
        return ("more" if named > wanted else "part" if named & wanted else "wrong") if named else "nothing"


def main() -> None:
    """Asks, and prints a line for each case and a table of the counts."""
    parser = argparse.ArgumentParser(prog="python -m bench.driven_motions", description=__doc__)
    parser.add_argument("--seed", type=int, default=400)
    parser.add_argument("--count", type=int, default=1, help="of each kind")
    parser.add_argument("--base", choices=list(HIDDEN), action="append", help="all where it is left out")
    parser.add_argument("--hidden", help="only this one")
    options = parser.parse_args()
    console = Console(width=None if sys.stdout.isatty() else 160)
    table = Table("base", *OUTCOMES)
    with open_executor() as pool:
        for base in options.base or HIDDEN:
            hidden = [one for one in HIDDEN[base] if options.hidden in (None, one)]
            seeds = range(options.seed, options.seed + options.count)
            counted = Counter(_asked(Case(base, one, seed), pool, console) for one in hidden for seed in seeds)
            table.add_row(base, *(str(counted[name]) for name in OUTCOMES))
    console.print(table)


def _asked(case: Case, pool: Executor, console: Console) -> str:
    """The outcome of a case, printed with the answer."""
    start = time.process_time()
    try:
        model = build_model(case.base, GIVEN.get(case.base, ()))
        found = explain(model, experiments(model, case.recordings()), pool, budget_s=BUDGET_S)
        outcome, error = case.outcome(found), found.error
        words = f"{', '.join(found.missing) or found.verdict}, {error.before:.3g} to {error.after:.3g} {error.unit}"
        words += f", noise {error.noise:.3g}" + ("" if found.complete else ", not complete")
    except (LostmotionError, ModelError) as refused:
        outcome, words = "failed", str(refused)
    console.print(f"{outcome:8} {case.base} {case.seed} {case.hidden}: {words}; {time.process_time() - start:.0f} s")
    return outcome


if __name__ == "__main__":
    main()
