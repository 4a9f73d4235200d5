"""The likelihood of gears with play, whose motion is chaotic: short segments, each with its own initial state."""
