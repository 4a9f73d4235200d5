"""Recordings with one physical effect hidden in them, and how well `lab explain` finds it.

The recordings come from a simulator of their own: nothing here imports lostmotion.  Each case is a folder with a rough
model (`model.toml`: the base and parameters that are off), three recordings and `truth.json`, which only the scoring
reads.  Seeds 0 to 999 are for development; what is reported comes from seeds 1000 and above, each used once.

    python -m bench.hidden_effects generate DIR --seed S --cases strong,nothing --count N
    python -m bench.hidden_effects run --seed S --kinds strong,moderate --count N --jobs J --figures DIR
"""
