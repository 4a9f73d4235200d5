"""Model files, effects added to them, user-defined effects, recordings simulated from them."""

from lostmotion.lab.models.modelfile import load, save

__all__ = ["load", "save"]
