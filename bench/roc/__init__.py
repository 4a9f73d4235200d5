"""How far the detector is from the best possible: `python -m bench.roc`."""
