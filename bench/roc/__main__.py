"""`python -m bench.roc [--quick] [--figures FOLDER]`: the table of docs/detector.md, and its pictures."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from bench.roc.trials import ORDER, Condition, Outcome, run
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
    print("SNR [dB] for 90 % found at 1 % false alarms\n")
    print(f"{'rate, f_res':26}" + "".join(f"{name[:13]:>14}" for name in ORDER))
    outcomes = []
    for condition in QUICK if arguments.quick else CONDITIONS:
        begin = time.perf_counter()
        outcomes.append(run(condition))
        print(_row(outcomes[-1]), f"  {time.perf_counter() - begin:.0f} s", flush=True)
    if arguments.figures:
        from bench.roc.figure import draw

        draw(outcomes, arguments.figures)


def _row(outcome: Outcome) -> str:
    cells = (outcome.needed[name] for name in ORDER)
    return f"{outcome.condition.name:26}" + "".join(f"{'> 32' if math.isnan(x) else f'{x:.1f}':>14}" for x in cells)


if __name__ == "__main__":
    main()
