"""Multiple shooting: segments with separate initial states, least squares, continuation in the horizon."""
