"""Faults at random against the service: what of 200 campaigns holds, and how soon each fault is told.

    python -m bench.faults [--seeds 200] [--first 0] [--jobs 4]

Each campaign is a robot of its own (an emulated AX-12A, an accelerometer and an slcan adapter behind the real drivers),
a Zenoh router with a subscriber, and a service, in processes of their own, against which four faults are chosen by the
seed, now and then two at once.  ``campaign.py`` says what must hold all the same.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

from bench.faults.attacks import ATTACKS
from bench.faults.campaign import Outcome, run


def main(arguments: Sequence[str] = ()) -> int:
    """Prints the failures as they come, then a table; 1 when any campaign failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200, help="how many campaigns")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--jobs", type=int, default=4, help="campaigns at a time: each takes a tenth of a core")
    given = parser.parse_args(arguments)
    begun, outcomes = time.monotonic(), list[Outcome]()
    # A process each: emulated devices that wait for one another would send what was late in a burst.
    with ProcessPoolExecutor(given.jobs, get_context("spawn"), max_tasks_per_child=1) as pool:
        for future in as_completed(pool.submit(run, given.first + k) for k in range(given.seeds)):
            outcomes.append(future.result())
            for failure in outcomes[-1].failures:
                print(
                    f"seed {outcomes[-1].seed}: {failure} ({', '.join(name for name, _ in outcomes[-1].told)})",
                    flush=True,
                )
    show(outcomes, time.monotonic() - begun)
    return int(any(outcome.failures for outcome in outcomes))


def show(outcomes: Sequence[Outcome], seconds: float) -> None:
    """The table."""
    good = sum(not outcome.failures for outcome in outcomes)
    scores = sum(outcome.scores for outcome in outcomes)
    print(f"{good} of {len(outcomes)} campaigns held everything; {scores} scores, {seconds / 60:.0f} min")
    times, often, bad = defaultdict[str, list[float]](list), defaultdict[str, int](int), defaultdict[str, int](int)
    for outcome in outcomes:
        for name, told in outcome.told:
            often[name] += 1
            bad[name] += bool(outcome.failures)
            times[name] += [told] if told is not None else []
    print(f"{'fault':<42}{'times':>6}{'seen after s, median':>22}{'most':>7}{'in failed ones':>16}")
    for attack in ATTACKS:
        found = times[attack.name]
        middle = f"{statistics.median(found):.1f}" if found else "-"
        print(f"{attack.name:<42}{often[attack.name]:>6}{middle:>22}"
              f"{(f'{max(found):.1f}' if found else '-'):>7}{bad[attack.name]:>16}")  # fmt: skip


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
