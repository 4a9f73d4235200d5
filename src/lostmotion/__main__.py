"""``python -m lostmotion``: the command line."""

from lostmotion.daemon.cli import main

if __name__ == "__main__":
    main()
