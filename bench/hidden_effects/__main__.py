"""Arguments of the bench: `python -m bench.hidden_effects generate DIR …`."""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.hidden_effects.cases import KINDS, draw_case, write_case


def main() -> None:
    """Writes cases."""
    parser = argparse.ArgumentParser(prog="python -m bench.hidden_effects", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    generate = commands.add_parser("generate", help="write cases, each into its own folder")
    generate.add_argument("dir", type=Path)
    generate.add_argument("--seed", type=int, default=0)
    generate.add_argument("--cases", default=",".join(KINDS), help="kinds, with commas")
    generate.add_argument("--count", type=int, default=1, help="of each kind")
    options = parser.parse_args()
    for kind in options.cases.split(","):
        for number in range(options.count):
            case = draw_case(kind, number, options.seed)
            write_case(case, options.dir / case.name)
            print(options.dir / case.name, flush=True)


if __name__ == "__main__":
    main()
