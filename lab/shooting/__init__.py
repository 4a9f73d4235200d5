"""Multiple shooting: segments with initial states of their own, least squares, continuation in the horizon."""
