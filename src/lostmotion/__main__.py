"""The program ``lostmotion``, and ``python -m lostmotion``."""

import sys

__all__ = ["main"]


def main() -> None:
    """The command line; Ctrl-C while it is still loaded ends it without a word, as later (``commands/guard.py``)."""
    try:
        from lostmotion.daemon.cli import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
