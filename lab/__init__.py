"""The lab: a model against measurements.  What a notebook, or a file with an effect of one's own, needs is here."""

from lostmotion.lab.own import effect
from lostmotion.model import Parameter

__all__ = ["Parameter", "effect"]
