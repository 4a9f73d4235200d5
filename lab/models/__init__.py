"""Model files, effects added to them, effects of one's own, recordings simulated from them."""

from lostmotion.lab.models.modelfile import load, save

__all__ = ["load", "save"]
