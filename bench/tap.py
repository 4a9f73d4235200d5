"""What the service costs that listens to servos of another master, beside one that polls them: shares of a core, ratio.

    python -m bench.tap [--duration 30]

Six AX-12A at 100 Hz and an accelerometer at 1 kHz, one service after the other on the same machine.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from bench.beside import compare, parser
from bench.service import running_service


def main(arguments: Sequence[str] = ()) -> None:
    """Prints a row for each driver and the ratio."""
    given = parser(__doc__).parse_args(arguments)
    compare("tap", lambda folder: running_service(folder, "csv:1000", servos="tap"), given.duration)


if __name__ == "__main__":
    main(sys.argv[1:])
