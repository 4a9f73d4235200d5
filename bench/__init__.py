"""Benchmarks: each module prints a table, none is a timed test.

Their matrices are small, as those of the command line are: with threads of its own BLAS takes up to five times the
processor time (85 windows with a size of the play: 9.7 s instead of 2.2 beside other programs on two cores).
"""

import os

for library in ("OPENBLAS", "MKL"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
