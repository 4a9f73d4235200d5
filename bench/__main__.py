"""All benchmarks, one after another: ``python -m bench [NAME…]``.  Each prints a table measured in one run."""

from __future__ import annotations

import importlib
import sys

NAMES = ("simulation", "detector", "latency", "alarms", "fleet", "service", "store")


def main() -> None:
    """Runs the named benchmarks, or all."""
    for name in sys.argv[1:] or NAMES:
        print(f"== {name}", flush=True)
        importlib.import_module(f"bench.{name}").main()


if __name__ == "__main__":
    main()
