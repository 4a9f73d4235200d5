"""`python -m bench.roc [--quick] [--figures FOLDER]`: the table of docs/detector.md, and its pictures."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from bench.roc.needed import shown
from bench.roc.rivals import RIVALS, SHIPPED
from bench.roc.trials import BOUNDS, TOP_DB, Condition, Outcome, run
from bench.roc.waveforms import Bar

CONDITIONS = (
    Condition("1 kHz, 58 Hz"),
    Condition("... play 5 µm", plays=(5e-6,)),
    Condition("... play 20 µm", plays=(20e-6,)),
    Condition("... play 60 µm", plays=(60e-6,)),
    Condition("... play 200 µm", plays=(200e-6,)),
    Condition("... resonance 1 % off", off=1.01),
    Condition("... coloured noise", noise="coloured"),
    Condition("... mains hum", noise="hum"),
    Condition("... fan 5 Hz beside", noise="fan"),
    Condition("... shaken bar", noise="shaken"),
    Condition("... 10 % missing", holes=0.1),
    Condition("... clipped at 1.5 s.d.", clip=1.5),
    Condition("... MuJoCo", mujoco=True),
    Condition("100 Hz, 35 Hz", Bar(35.0, 0.012, 100.0)),
    Condition("200 Hz, 58 Hz", Bar(58.0, 0.012, 200.0)),
    Condition("... coloured noise", Bar(58.0, 0.012, 200.0), noise="coloured"),
    Condition("... fan 5 Hz beside", Bar(58.0, 0.012, 200.0), noise="fan"),
    Condition("... resonance 1 % off", Bar(58.0, 0.012, 200.0), off=0.99),
    Condition("... MuJoCo", Bar(58.0, 0.012, 200.0), mujoco=True),
    Condition("200 Hz, 92 Hz (near half)", Bar(92.0, 0.012, 200.0)),
    Condition("3200 Hz, 58 Hz", Bar(58.0, 0.012, 3200.0)),
)
QUICK = (CONDITIONS[0], CONDITIONS[14])


def main() -> None:
    """Runs the conditions and prints a row of each as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two conditions only")
    parser.add_argument("--figures", type=Path, help="write roc.png there")
    arguments = parser.parse_args()
    print("SNR [dB] for 90 % found at 1 % false alarms, ± its standard error (bootstrap over windows and motions)\n")
    print(_row("rate, f_res", [*BOUNDS, *RIVALS]))
    print(_row("---", ["---"] * (len(BOUNDS) + len(RIVALS))))
    outcomes = []
    for condition in QUICK if arguments.quick else CONDITIONS:
        begin = time.perf_counter()
        outcomes.append(run(condition))
        cells = [shown(outcomes[-1].needed[name], TOP_DB) for name in (*BOUNDS, *RIVALS)]
        print(_row(condition.name, cells), f" {outcomes[-1].waveforms} waveforms,",
              f"{time.perf_counter() - begin:.0f} s", flush=True)  # fmt: skip
    _print_shipped(outcomes)
    if arguments.figures:
        from bench.roc.figure import draw

        draw(outcomes, arguments.figures)


def _print_shipped(outcomes: list[Outcome]) -> None:
    """What the levels of the defaults do, which nobody has calibrated."""
    print("\nwith the level that is shipped: false alarms [%], and SNR [dB] for 90 % found\n")
    print(_row("rate, f_res", list(SHIPPED)))
    print(_row("---", ["---"] * len(SHIPPED)))
    for outcome in outcomes:
        shipped = [outcome.shipped[name] for name in SHIPPED]
        cells = [f"{100 * a:.2f}, " + (f"> {TOP_DB:g}" if math.isnan(db) else f"{db:.1f}") for a, db in shipped]
        print(_row(outcome.condition.name, cells))


def _row(first: str, cells: list[str]) -> str:
    return f"| {first} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    main()
