"""Recordings with one physical effect hidden in them, and how well `lab explain` finds it.

The recordings come from a simulator of their own: nothing here imports lostmotion (MuJoCo moves those of the base
joint, where it is installed).  Each case is a folder with a rough model (`model.toml`: the base and parameters that
are off), three recordings and `truth.json`, which only the scoring reads.

    python -m bench.hidden_effects generate DIR --seed S --kinds strong,nothing --count N
    python -m bench.hidden_effects run --seed S --kinds strong,moderate --count N --jobs J --figures DIR

Seeds 0 to 999 are for development.  What is reported comes from seeds 1000 and above, each used once: whoever looks
at the cases of such a seed and then changes the diagnosis takes the next one.

A case is strong when the best fit of the base leaves 10 to 20 times the noise (moderate: 3 to 6) or, for what only
shows slowly (leakage, crosstalk, drift), when its size is the largest that is sensible.
"""
