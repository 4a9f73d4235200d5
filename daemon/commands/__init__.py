"""The implementations of the commands, one module each.  cli.py defines the arguments."""
