"""The search for missing effects in gears with play, whose motion is chaotic: short segments with an initial state
each."""
