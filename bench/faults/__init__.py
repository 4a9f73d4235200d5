"""Faults at random against a running service, and what must hold all the same; ``python -m bench.faults``."""
